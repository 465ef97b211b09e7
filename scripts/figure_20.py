"""Homogenised impedance above patches, over the height: appendix A.1, figures 20 and 21.

    python scripts/figure_20.py [-o FOLDER]

Patches of Z = 0.2 in a rigid wall, 1 mm long with gaps of 3 mm (period 4 mm, so that 1/4 of the
admittance is that of Z = 0.8), 150 mm in a duct of 50 mm without flow, 1500 Hz; and, as control,
a homogeneous wall of Z = 0.8. Z(y) is 1 over the mean along x of the local admittance -rho c v/p.
"""

import itertools
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import torchliner as tl
from common import FIGURES, options_of, parser_of
from torchliner.conversions import pressure_amplitude_from_spl
from torchliner.duct.case import DuctCase
from torchliner.duct.flow_profiles import UniformProfile
from torchliner.duct.mesh import DuctMesh
from torchliner.io.result_writers import write_rows
from torchliner.report.figure import MARKERS, X_MM, Y_MM, Figure, colour_of, draw_parts, finish, panels_of, styled

FREQUENCY, HEIGHT, LENGTH, BEYOND = 1500.0, 0.05, 0.15, 0.15  # Hz, m
PATCH, SHARE, TRUE = 0.2, 0.25, 0.8
SIZES = (0.5e-3, 1.0e-3, 2.0e-3)  # of a patch, m; the period is four of them
WINDOWS = {"all of the liner": (0.0, 0.15), "middle 100 mm": (0.025, 0.125), "middle 52 mm": (0.049, 0.101)}
HEIGHTS = np.array([0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0]) * 1e-3
LEVEL = 145.0  # dB, of the picture


def solved(size: float | None) -> Any:
    """The field above patches of a size, each in the middle of its period, or above the homogeneous wall.

    Above patches: two elements a patch, four a gap, degree 3, first cell 0.5 mm at most.
    """
    liner: list[tuple[float, float]] = [(0.0, LENGTH)]
    if size is not None:
        period = size / SHARE
        starts = np.arange(round(LENGTH / period)) * period + (period - size) / 2
        liner = [(float(start), float(start + size)) for start in starts]
    incident = pressure_amplitude_from_spl(LEVEL)
    case = DuctCase(UniformProfile(0.0, HEIGHT), -BEYOND, LENGTH + BEYOND, liner, incident=incident)
    if size is None:
        return tl.DuctSolver(case, FREQUENCY).solve(TRUE)
    edges, columns = [case.start, *(x for patch in liner for x in patch), case.end], [np.array([case.start])]
    for i, (low, high) in enumerate(itertools.pairwise(edges)):
        rigid_end = i in (0, len(edges) - 2)
        count = max(4, round((high - low) / 10e-3)) if rigid_end else (2 if i % 2 else 4)
        columns.append(np.linspace(low, high, count + 1)[1:])
    first, y = min(0.5e-3, size / 2), [0.0]
    while y[-1] < HEIGHT - 1e-9:
        y.append(min(HEIGHT, y[-1] + min(10e-3, first * 1.6 ** (len(y) - 1))))
    if y[-1] - y[-2] < 2e-3:
        y.pop(-2)
    return tl.DuctSolver(case, FREQUENCY, DuctMesh(case, np.concatenate(columns), np.array(y), 3)).solve(PATCH)


def homogenised(field: Any, window: tuple[float, float]) -> np.ndarray:
    """Z at each height, by the mean admittance over the window."""
    x, found = np.linspace(*window, 1501), []
    for y in HEIGHTS:
        p, _, v = (part[0].detach().numpy() for part in field.at((x[1:] + x[:-1]) / 2, y))
        found.append(1 / np.mean(-tl.Fluid().characteristic_impedance * v / p))
    return np.array(found)


def draw_heights(curves: dict[str, np.ndarray], path: Path) -> Figure:
    """Figure 21, with the control."""
    drawn = []
    for i, (label, z) in enumerate(curves.items()):
        look = colour_of(i, label, marker=MARKERS[i], markerfacecolor="none", markersize=3 + 0.5 * i)
        drawn.append({"x": 1e3 * HEIGHTS, "y": z} | look)
    known, size = {"1 / mean admittance of the wall": complex(TRUE)}, {"height": 3.3, "legend": 2}
    return draw_parts(drawn, Y_MM, path, "no flow, 1500 Hz", references=known, poles=None, **size)


@styled
def draw_velocity(field: Any, path: Path) -> Figure:
    """Figure 20: |v| above some patches in the middle of the liner."""
    figure, (axis,) = panels_of(1, 2.2)
    x, y = np.linspace(0.06, 0.09, 301), np.linspace(0, 6e-3, 61)
    grid = np.meshgrid(x, y)
    speed = np.abs(field.at(grid[0].ravel(), grid[1].ravel())[2][0].detach().numpy()).reshape(grid[0].shape)
    drawn = axis.pcolormesh(1e3 * x, 1e3 * y, speed, cmap="cividis", shading="gouraud", rasterized=True)
    figure.colorbar(drawn, ax=axis, label="$|v|$ (m s$^{-1}$)")
    axis.set(xlabel=X_MM, ylabel=Y_MM)
    return finish(figure, path, f"patches of 1 mm, Z = {PATCH:g}, gaps of 3 mm; {LEVEL:g} dB incident")


def main(arguments: Sequence[str] | None = None) -> int:
    options = options_of(parser_of(__doc__, FIGURES), arguments)
    rows, curves = [], {}
    fields = {f"patches of {1e3 * size:g} mm": solved(size) for size in SIZES}
    fields["homogeneous wall, Z = 0.8"] = solved(None)
    for label, field in fields.items():
        for window, span in WINDOWS.items():
            z = homogenised(field, span)
            for y, each in zip(HEIGHTS, z, strict=True):
                row = {"wall": label, "window": window, "y (mm)": 1e3 * y}
                rows.append(row | {"resistance": each.real, "reactance": each.imag})
            slope = np.polyfit(1e3 * HEIGHTS[3:], z[3:], 1)[0]
            print(
                f"{label:27s} {window:18s} at 1 mm {z[3]:.3f}, at 2.5 mm {z[6]:.3f}, a mm above "
                f"{slope:.4f}, from the wall to 5 mm {(z[-1] - TRUE) / 5:.4f}"
            )
            if window == "middle 100 mm":
                curves[label] = z
            elif label == "patches of 1 mm":
                curves[f"{label}, {window}"] = z
    write_rows(rows, options.output / "figure_20_21.csv")
    draw_velocity(fields["patches of 1 mm"], options.output / "figure_20.png")
    draw_heights(curves, options.output / "figure_21.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())

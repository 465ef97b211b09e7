"""Homogenised impedance above patches, over the height: appendix A.1, figures 20 and 21.

    python scripts/figure_20.py [-o FOLDER]

Patches of Z = 0.2 in a rigid wall, 1 mm long with gaps of 3 mm (period 4 mm, so that 1/4 of the
admittance is that of Z = 0.8), 150 mm in a duct of 50 mm without flow, 1500 Hz; and, as control,
a homogeneous wall of Z = 0.8. Z(y) is 1 over the mean along x of the local admittance -rho c v/p.
"""

from __future__ import annotations

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
from torchliner.duct.solver import DuctSolver
from torchliner.io.csv_rows import write_rows
from torchliner.report.figure import COLOURS, LINES, MARKERS, PARTS, Figure, finish, styled, subplots

FREQUENCY, HEIGHT, LENGTH, BEYOND = 1500.0, 0.05, 0.15, 0.15  # Hz, m
PATCH, SHARE, TRUE = 0.2, 0.25, 0.8
SIZES = (0.5e-3, 1.0e-3, 2.0e-3)  # of a patch, m; the period is four of them
WINDOWS = {"all of the liner": (0.0, 0.15), "middle 100 mm": (0.025, 0.125), "middle 52 mm": (0.049, 0.101)}
HEIGHTS = np.array([0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0]) * 1e-3
LEVEL = 145.0  # dB, of the picture


def patches(size: float) -> list[tuple[float, float]]:
    """Each in the middle of its period."""
    period = size / SHARE
    starts = np.arange(round(LENGTH / period)) * period + (period - size) / 2
    return [(float(start), float(start + size)) for start in starts]


def mesh_of(case: DuctCase, size: float) -> DuctMesh:
    """Two elements a patch, four a gap, degree 3, first cell 0.5 mm at most."""
    edges = [case.start, *(x for patch in case.liner for x in patch), case.end]
    columns = [np.array([case.start])]
    for i, (low, high) in enumerate(itertools.pairwise(edges)):
        rigid_end = i in (0, len(edges) - 2)
        count = max(4, round((high - low) / 10e-3)) if rigid_end else (2 if i % 2 else 4)
        columns.append(np.linspace(low, high, count + 1)[1:])
    first = min(0.5e-3, size / 2)
    y = [0.0]
    while y[-1] < HEIGHT - 1e-9:
        y.append(min(HEIGHT, y[-1] + min(10e-3, first * 1.6 ** (len(y) - 1))))
    if y[-1] - y[-2] < 2e-3:
        y.pop(-2)
    return DuctMesh(case, np.concatenate(columns), np.array(y), degree=3)


def solved(size: float | None) -> Any:
    """The field above patches of a size, or above the homogeneous wall."""
    flow = UniformProfile(0.0, HEIGHT)
    liner = [(0.0, LENGTH)] if size is None else patches(size)
    case = DuctCase(flow, -BEYOND, LENGTH + BEYOND, liner, incident=pressure_amplitude_from_spl(LEVEL))
    fine = 1.0e-3 if size is None else size
    mesh = None if size is None else mesh_of(case, fine)
    return DuctSolver(case, FREQUENCY, mesh).solve(TRUE if size is None else PATCH)


def homogenised(field: Any, window: tuple[float, float], heights: np.ndarray) -> np.ndarray:
    """Z at each height, by the mean admittance over the window."""
    x = np.linspace(*window, 1501)
    x = (x[1:] + x[:-1]) / 2
    found = []
    for y in heights:
        p, _, v = (part[0].detach().numpy() for part in field.at(x, y))
        impedance = tl.Fluid().characteristic_impedance
        found.append(1 / np.mean(-impedance * v / p))
    return np.array(found)


def rows_of(label: str, window: str, z: np.ndarray) -> list[dict[str, Any]]:
    """One a height."""
    return [
        {"wall": label, "window": window, "y (mm)": 1e3 * y, "resistance": each.real, "reactance": each.imag}
        for y, each in zip(HEIGHTS, z, strict=True)
    ]


@styled
def draw_heights(curves: dict[str, np.ndarray], path: Path) -> Figure:
    """Figure 21, with the control."""
    figure, axes = subplots(1, 2, 3.3)
    for axis, (part, label), kind in zip(axes[0], PARTS, ("real", "imag"), strict=True):
        del part
        for i, (name, z) in enumerate(curves.items()):
            axis.plot(
                1e3 * HEIGHTS,
                getattr(z, kind),
                color=COLOURS[i % len(COLOURS)],
                marker=MARKERS[i % len(MARKERS)],
                linestyle=LINES[i],
                markerfacecolor="none",
                markersize=3 + 0.5 * i,
                label=name,
            )
        axis.axhline(TRUE if kind == "real" else 0.0, color="k", linewidth=0.8)
        axis.set_xlabel("$y$ (mm)")
        axis.set_ylabel(label)
    return finish(figure, path, "no flow, 1500 Hz; black: 1 / mean admittance of the wall", legend=2)


@styled
def draw_velocity(field: Any, path: Path) -> Figure:
    """Figure 20: |v| above some patches in the middle of the liner."""
    figure, axes = subplots(1, 1, 2.2)
    x, y = np.linspace(0.06, 0.09, 301), np.linspace(0, 6e-3, 61)
    grid = np.meshgrid(x, y)
    _, _, v = field.at(grid[0].ravel(), grid[1].ravel())
    speed = np.abs(v[0].detach().numpy()).reshape(grid[0].shape)
    drawn = axes[0, 0].pcolormesh(1e3 * x, 1e3 * y, speed, cmap="cividis", shading="gouraud", rasterized=True)
    figure.colorbar(drawn, ax=axes[0, 0], label="$|v|$ (m s$^{-1}$)")
    axes[0, 0].set_xlabel("$x$ (mm)")
    axes[0, 0].set_ylabel("$y$ (mm)")
    words = f"patches of 1 mm, Z = {PATCH:g}, gaps of 3 mm; {LEVEL:g} dB incident"
    return finish(figure, path, words)


def main(arguments: Sequence[str] | None = None) -> int:
    options = options_of(parser_of(__doc__, FIGURES), arguments)
    rows, curves = [], {}
    fields = {f"patches of {1e3 * size:g} mm": solved(size) for size in SIZES}
    fields["homogeneous wall, Z = 0.8"] = solved(None)
    for label, field in fields.items():
        for window, span in WINDOWS.items():
            z = homogenised(field, span, HEIGHTS)
            rows += rows_of(label, window, z)
            slope = np.polyfit(1e3 * HEIGHTS[3:], z[3:], 1)[0]
            print(
                f"{label:27s} {window:18s} at 1 mm {z[3]:.3f}, at 2.5 mm {z[6]:.3f}, a mm above "
                f"{slope:.4f}, from the wall to 5 mm {(z[-1] - TRUE) / 5:.4f}"
            )
            if window == "middle 100 mm":
                curves[label] = z
            if label == "patches of 1 mm" and window != "middle 100 mm":
                curves[f"{label}, {window}"] = z
    write_rows(rows, options.output / "figure_20_21.csv")
    draw_velocity(fields["patches of 1 mm"], options.output / "figure_20.png")
    draw_heights(curves, options.output / "figure_21.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())

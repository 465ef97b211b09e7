"""Solved ducts and their modes: tables, JSON, pictures of walls, fields and modes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.duct.field import DuctField
from torchliner.duct.modes import DuctModes
from torchliner.duct.presets import DuctSetup
from torchliner.report.figure import (
    COLOURS,
    LINES,
    MARKERS,
    ONE_ROW,
    SPL,
    Figure,
    entry,
    finish,
    head_panel,
    label_axes,
    styled,
    subplots,
)
from torchliner.report.table import Column, Table, real_and_imaginary

NEPER = 20 * math.log10(math.e)  # dB
ROUNDING = 1e-12
FINE, ACROSS = 400, 60  # points of a picture along and across the duct
NEAR_WALL = 0.05  # of the height
MICROPHONES = (
    Column("frequency (Hz)", heading="f Hz", text=".1f"),
    Column("x (m)", heading="x mm", text=".2f", scale=1e3),
    Column("SPL (dB)", heading="SPL dB", text=".3f"),
    Column("phase (deg)", heading="phase", text=".2f"),
)


def plain_duct(setup: DuctSetup, field: DuctField) -> dict[str, Any]:
    """For JSON; levels in dB re 20 uPa rms, phases in degrees."""
    places = setup.places
    level = field.wall_level(places, setup.wall).detach()
    phase = field.wall_phase(places, setup.wall).detach()
    rows = [
        {
            "frequency (Hz)": frequency,
            "x (m)": float(x),
            "SPL (dB)": float(level[f, i]),
            "phase (deg)": float(phase[f, i]),
        }
        for f, frequency in enumerate(setup.frequency.tolist())
        for i, x in enumerate(places)
    ]
    return {
        "duct": setup.facts,
        "unknowns": field.mesh.unknowns,
        "unknowns of the finer mesh": field.finer_unknowns,
        "plane_mode": field.rows(),
        "microphones": rows,
    }


def format_duct(setup: DuctSetup, found: dict[str, Any]) -> str:
    """What was solved, then one row per microphone; ``found`` is that of ``plain_duct``."""
    case, profile = setup.case, setup.case.profile
    lines = [
        f"{setup.name}: H {1e3 * case.height:g} mm, bulk Mach {profile.bulk_mach:g}, displacement "
        f"thickness {1e3 * profile.displacement_thickness:.3g} mm, source {setup.case.source}, "
        f"{setup.level:g} dB; {found['unknowns']} unknowns"
    ]
    for patch, pair in zip(case.liner, setup.facts["sound"]["impedance"] or [], strict=False):
        z = pair if isinstance(pair, str) else f"{complex(*pair):.4g}"
        lines.append(f"liner {1e3 * patch[0]:g} to {1e3 * patch[1]:g} mm: Z = {z}")
    for ratio in found["plane_mode"]:
        lines.append(
            f"{ratio['frequency (Hz)']:g} Hz: plane mode reflected {ratio['reflection']:.4f}, "
            f"transmitted {ratio['transmission']:.4f}, {ratio['transmission loss (dB)']:.2f} dB; "
            f"energy out {ratio['energy out']:.4g}, absorbed {ratio['energy absorbed']:.4g}, "
            f"missing {ratio['energy missing']:.2g} of that in; {_mesh_words(ratio)}"
        )
        if ratio["growth over the liner (dB)"]:
            lines.append(
                f"{ratio['frequency (Hz)']:g} Hz: a hydrodynamic wave grows by "
                f"{ratio['growth over the liner (dB)']:.3g} dB over the liner"
            )
    return "\n".join([*lines, Table(found["microphones"], MICROPHONES).as_text()])


def _mesh_words(ratio: dict[str, Any]) -> str:
    moved = ratio["mesh difference (dB)"]
    return "one mesh, as stated" if moved is None else f"a finer mesh moves it by {moved:.2g} dB"


@styled
def draw_walls(
    solved: Sequence[tuple[DuctSetup, DuctField]],
    path: str | Path | None = None,
    frequency_index: int = 0,
    labels: Sequence[str] | None = None,
    title: str | None = None,
) -> Figure:
    """SPL and phase along the wall of the microphones (figures 13, 18)."""
    figure, axes = subplots(1, 2, 3.2)
    for i, (setup, field) in enumerate(solved):
        places = np.linspace(setup.case.start, setup.case.end, FINE)
        at = setup.places
        label = labels[i] if labels else f"{setup.name}, source {field.source}"
        drawn = ((field.wall_level, axes[0, 0]), (field.wall_phase, axes[0, 1]))
        for values, axis in drawn:
            curve = values(places, setup.wall)[frequency_index].detach().numpy()
            points = values(at, setup.wall)[frequency_index].detach().numpy()
            if axis is axes[0, 1]:
                jumps = np.abs(np.diff(curve)) > 180
                curve = np.where(np.append(jumps, False), np.nan, curve)
            colour = COLOURS[i]
            axis.plot(1e3 * places, curve, color=colour, label=label, linestyle=LINES[i])
            axis.plot(1e3 * at, points, MARKERS[i], color=colour, markersize=3)
    for axis, label in zip(axes[0], (SPL, "phase (degrees)"), strict=True):
        for start, end in solved[0][0].case.liner:
            axis.axvspan(1e3 * start, 1e3 * end, color="0.9", zorder=0)
        label_axes(axis, "$x$ (mm)", label)
    frequency = float(solved[0][0].frequency[frequency_index])
    entry(axes[0, 0], "liner", width=5, color="0.9")
    entry(axes[0, 0], "at the microphones", "o")
    title = title or f"{solved[0][0].wall} wall, {frequency:g} Hz"
    return finish(figure, path, title, legend=3)


@styled
def draw_field(setup: DuctSetup, field: DuctField, path: str | Path | None = None, frequency_index: int = 0) -> Figure:
    """SPL and wall-normal velocity in the duct."""
    figure, axes = subplots(2, 1, 3.8)
    case = setup.case
    x = np.linspace(case.start, case.end, FINE)
    y = np.linspace(0, case.height, ACROSS)
    grid = np.meshgrid(x, y)
    p, _, v = (part[frequency_index].detach() for part in field.at(grid[0].ravel(), grid[1].ravel()))
    level = spl_from_pressure_amplitude(p).numpy().reshape(grid[0].shape)
    speed = torch.abs(v).numpy().reshape(grid[0].shape)
    inside = y > NEAR_WALL * case.height
    for axis, values, label in ((axes[0, 0], level, SPL), (axes[1, 0], speed, "$|v|$ (m s$^{-1}$)")):
        top = np.percentile(values[inside], 99.5)  # vorticity on the liner's face beside
        drawn = axis.pcolormesh(
            1e3 * x, 1e3 * y, values, cmap="cividis", shading="gouraud", rasterized=True, vmin=values.min(), vmax=top
        )
        figure.colorbar(drawn, ax=axis, label=label, extend="max")
        for start, end in case.liner:
            axis.plot([1e3 * start, 1e3 * end], [0, 0], color=COLOURS[1], linewidth=3, clip_on=False)
        label_axes(axis, "$x$ (mm)", "$y$ (mm)")
    entry(axes[0, 0], "liner", color=COLOURS[1], linewidth=3)
    frequency = float(setup.frequency[frequency_index])
    title = f"{setup.name}, {frequency:g} Hz, source {field.source}; "
    title += "the colours end at 99.5 % of the values off the wall (arrow)"
    return finish(figure, path, title, ONE_ROW)


def mode_table(setup: DuctSetup, modes: dict[str, DuctModes], growing: Tensor) -> Table:
    """One row per frequency, direction and mode; decay in dB over the liner's length too, below 0
    of a wave that grows in its direction.

    The growing wave (1/m, (F,), nan for none) has no number.
    """
    length = setup.case.liner[0][1] - setup.case.liner[0][0] if setup.case.liner else math.nan
    rows = [
        (frequency, direction, n, complex(solved.wavenumber[f, n]), _decay(complex(solved.wavenumber[f, n]), direction))
        for direction, solved in modes.items()
        for f, frequency in enumerate(setup.frequency.tolist())
        for n in range(solved.wavenumber.shape[-1])
    ] + [
        (frequency, "downstream", None, complex(alpha), _decay(complex(alpha), "downstream"))
        for frequency, alpha in zip(setup.frequency.tolist(), growing, strict=True)
        if alpha == alpha
    ]
    return Table(
        rows,
        (
            Column("frequency (Hz)", lambda row: row[0], "f Hz", ".1f"),
            Column("direction", lambda row: row[1], "direction"),
            Column("mode", lambda row: row[2], "n", "d"),
            *real_and_imaginary("alpha real (1/m)", "alpha imaginary (1/m)", lambda row: row[3]),
            Column("", lambda row: row[3], "alpha 1/m", lambda z: f"{z.real:.5f}{z.imag:+.5f}j"),
            Column("decay (dB/m)", lambda row: NEPER * row[4], "dB/m", ".2f"),
            Column("decay over the liner (dB)", lambda row: NEPER * row[4] * length, "dB liner", ".2f"),
        ),
    )


def _decay(alpha: complex, direction: str) -> float:
    """Neper/m along the wave's direction; rounding is 0."""
    if abs(alpha.imag) < ROUNDING * abs(alpha):
        return 0.0
    return -alpha.imag if direction == "downstream" else alpha.imag


def format_modes(setup: DuctSetup, table: Table) -> str:
    """What was solved, then one row per mode."""
    patches = len(setup.case.liner)
    which = f"above the first of {patches} lined patches; " if patches > 1 else ""
    grows = [row[0] for row in table.rows if row[2] is None]
    wave = (
        f"a hydrodynamic wave without a number grows downstream at {grows[0]:g} Hz"
        + f" and {len(grows) - 1} other frequencies" * (len(grows) > 1)
        if grows
        else "no growing wave was found"
    )
    return (
        f"{setup.name}: {which}waves e^(-j alpha x), mode n grew out of the rigid duct's "
        f"mode n as the wall's reflection went straight from 1; {wave}\n"
        f"{table.as_text()}"
    )


@styled
def draw_modes(modes: dict[str, DuctModes], path: str | Path | None = None, frequency_index: int = 0) -> Figure:
    """|p| of each mode over the height."""
    figure, axes = subplots(1, 2, 3.4)
    for axis, (direction, solved) in zip(axes[0], modes.items(), strict=True):
        heights = np.linspace(0, float(solved.height[0]), 200)
        count = solved.wavenumber.shape[-1]
        pressure, _, _ = solved.at(heights)
        for n in range(count):
            shape = pressure[frequency_index, n].abs().numpy()
            axis.plot(shape / shape.max(), 1e3 * heights, color=COLOURS[n], label=f"mode {n}")
        label_axes(axis, "$|p|$ over its maximum", "$y$ (mm), liner at 0")
        head_panel(axis, direction)
    return finish(figure, path, legend=ONE_ROW)

"""Solved ducts: table, JSON, pictures of walls and fields."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.duct.presets import DuctSetup
from torchliner.duct.solver import DuctField
from torchliner.report.figure import (
    COLOURS,
    LINES,
    MARKERS,
    ONE_ROW,
    SPL,
    Figure,
    entry,
    finish,
    label_axes,
    styled,
    subplots,
)
from torchliner.report.table import Column, Table

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
        {"frequency (Hz)": frequency, "x (m)": float(x), "SPL (dB)": float(level[f, i]),
         "phase (deg)": float(phase[f, i])}
        for f, frequency in enumerate(setup.frequency.tolist())
        for i, x in enumerate(places)
    ]  # fmt: skip
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
    solved: Sequence[tuple[DuctSetup, DuctField]], path: str | Path | None = None,
    frequency_index: int = 0, labels: Sequence[str] | None = None, title: str | None = None,
) -> Figure:  # fmt: skip
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
    for axis, values, label in (
        (axes[0, 0], level, SPL),
        (axes[1, 0], speed, "$|v|$ (m s$^{-1}$)"),
    ):
        top = np.percentile(values[inside], 99.5)  # vorticity on the liner's face beside
        drawn = axis.pcolormesh(1e3 * x, 1e3 * y, values, cmap="cividis", shading="gouraud",
                                rasterized=True, vmin=values.min(), vmax=top)  # fmt: skip
        figure.colorbar(drawn, ax=axis, label=label, extend="max")
        for start, end in case.liner:
            axis.plot([1e3 * start, 1e3 * end], [0, 0], color=COLOURS[1], linewidth=3, clip_on=False)
        label_axes(axis, "$x$ (mm)", "$y$ (mm)")
    entry(axes[0, 0], "liner", color=COLOURS[1], linewidth=3)
    frequency = float(setup.frequency[frequency_index])
    title = f"{setup.name}, {frequency:g} Hz, source {field.source}; "
    title += "the colours end at 99.5 % of the values off the wall (arrow)"
    return finish(figure, path, title, ONE_ROW)

"""The pictures of the validation page: errors of every rule, and what the model can reach."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from studies.limits import reach
from studies.validation_reasons import FASTEST, Reason
from torchliner.liners.sdof import SDoFLiner
from torchliner.names import AVERAGINGS, PHASES
from torchliner.report.figure import (
    COLOURS,
    MARKERS,
    PARTS,
    Figure,
    finish,
    legend_below,
    styled,
    subplots,
    typeset,
)
from torchliner.studies.validation import DEFAULT, DRIVES
from torchliner.studies.variants import Row

LINEAR = 0.01  # rho c: within it the axes are linear, beyond it logarithmic
TICKS = (-1, -0.1, -0.01, 0.01, 0.1, 1)
MARKED_SPEEDS = (0.3, 1.0, 3.0)  # m/s, on the model's curve


@styled
def draw_validation_errors(rows: Sequence[Row], path: str | Path | None = None) -> Figure:
    """dR and dX of every rule: a line per case and averaging, drives beside it; the median over the
    heights, and their range.

    A bar is the statistical interval of the default rule at a height.
    """
    cases = list(dict.fromkeys(row.case for row in rows))
    places = [(case, averaging) for case in cases for averaging in AVERAGINGS]
    figure, axes = subplots(1, 2, 1.6 + 0.3 * len(places))
    for axis, part in zip(axes[0], ("real", "imag"), strict=True):
        heights = defaultdict(list)
        for row in rows:
            i = DRIVES.index((row.drive, row.mean))
            y = places.index((row.case, row.averaging)) + 0.19 * (i - 1.5)
            heights[y, i, row.phase].append(getattr(row.miss, part))
            if row.rule == DEFAULT:
                low, high = (getattr(end - row.true, part) for end in (row.low, row.high))
                axis.plot(
                    [low, high], [y, y], color=COLOURS[i], linewidth=4, alpha=0.35, solid_capstyle="butt", zorder=2
                )
        for (y, i, phase), values in heights.items():
            axis.plot([min(values), max(values)], [y, y], color=COLOURS[i], linewidth=0.7, zorder=3)
            axis.plot(
                np.median(values),
                y,
                MARKERS[list(PHASES).index(phase)],
                color=COLOURS[i],
                markerfacecolor="white",
                markersize=3.4,
                markeredgewidth=0.7,
                zorder=4,
            )
        _dress_errors(axis, part, places)
    axes[0, 0].set_yticks(range(len(places)), [f"{case}, {averaging}" for case, averaging in places])
    axes[0, 1].set_yticks([])
    for i, (drive, mean) in enumerate(DRIVES):
        label = drive + (", mean removed" if mean == "removed" else "")
        axes[0, 0].plot([], [], "-", color=COLOURS[i], linewidth=2, label=label)
    for marker, phase in zip(MARKERS, PHASES, strict=False):
        axes[0, 0].plot([], [], marker, color="k", markerfacecolor="none", label=f"phase {phase}")
    axes[0, 0].plot([], [], color="0.6", linewidth=4, label="95 % interval of the default rule")
    return finish(figure, path, "educed less reference, all drives, phases, averagings and heights, 1400 Hz", legend=3)


def _dress_errors(axis: Any, part: str, places: Sequence[tuple[str, str]]) -> None:
    axis.axvline(0, color="k", linewidth=0.8, zorder=1)
    for i in range(0, len(places), 2 * len(AVERAGINGS)):  # every second case
        axis.axhspan(i - 0.5, i + len(AVERAGINGS) - 0.5, color="0.95", zorder=0)
    axis.set_xscale("symlog", linthresh=LINEAR, linscale=0.6)
    axis.set_xticks([*TICKS, 0], [*(typeset(f"{tick:g}") for tick in TICKS), "0"])
    axis.set_xlim(*((-3, 15) if part == "real" else (-0.5, 0.7)))
    axis.set_ylim(len(places) - 0.5, -0.5)
    axis.tick_params(axis="y", length=0)
    name = "R" if part == "real" else "X"
    axis.set_xlabel(rf"$\Delta {name} = {name} - {name}_\mathrm{{ref}}$ ($\rho c$)")


@dataclass(frozen=True)
class ReachPanel:
    """A model and the cases it stands for."""

    title: str
    liner: SDoFLiner
    frequency: float
    rows: Sequence[Reason]


@styled
def draw_reach(panels: Sequence[ReachPanel], path: str | Path | None = None) -> Figure:
    """Complex plane: Z(|v|) of the model, all that a |v(t)| can give, references, replayed holes."""
    figure, axes = subplots(1, len(panels), 3.9)
    for axis, panel in zip(axes[0], panels, strict=True):
        found = reach(panel.liner, panel.frequency, FASTEST)
        axis.fill(
            found.boundary.real, found.boundary.imag, color="0.88", zorder=0, label=r"any $|v(t)|$, phase averaged"
        )
        speeds = np.concatenate([[0], np.geomspace(1e-3, FASTEST, 400)])
        curve = panel.liner.impedance(panel.frequency, speeds).numpy().reshape(-1)
        axis.plot(curve.real, curve.imag, color="k", label=r"model, constant $|v|$")
        for speed in MARKED_SPEEDS:
            z = complex(panel.liner.impedance(panel.frequency, speed).reshape(-1)[0])
            axis.plot(z.real, z.imag, "k|", markersize=6)
            axis.annotate(
                f"{speed:g}", (z.real, z.imag), textcoords="offset points", xytext=(1, 5), fontsize=7, clip_on=True
            )
        _zoom(axis, panel.rows)
        for i, row in enumerate(panel.rows):
            _draw_case(axis, row, COLOURS[i])
        axis.set_title(panel.title)
        axis.set_xlabel(PARTS[0][1])
    axes[0, 0].set_ylabel(PARTS[1][1])
    for marker, label in (
        ("*", "reference"),
        ("o", "replayed from the holes' own velocity, default"),
        ("s", "from its rms"),
    ):
        axes[0, 0].plot([], [], marker, color="0.3", markerfacecolor="0.3" if marker == "*" else "white", label=label)
    legend_below(figure, axes[0, 0], 3)
    caption = "1400 Hz; numbers on the curves: |v| in m/s, hole velocity times porosity"
    return finish(figure, path, caption)


def _draw_case(axis: Any, row: Reason, colour: str) -> None:
    points = ((row.true, "*", colour, 10), (row.replayed, "o", "white", 5), (row.of_rms, "s", "white", 5))
    for value, marker, face, size in points:
        axis.plot(value.real, value.imag, marker, color=colour, markerfacecolor=face, markersize=size, zorder=4)
    axis.plot([row.true.real, row.of_rms.real], [row.true.imag, row.of_rms.imag], ":", color=colour, linewidth=0.8)
    last = row.true.real > 0.7 * axis.get_xlim()[1]
    axis.annotate(
        row.case,
        (row.true.real, row.true.imag),
        textcoords="offset points",
        xytext=(0, -10) if last else (6, 3),
        ha="right" if last else "left",
        fontsize=7.5,
        color=colour,
    )


def _zoom(axis: Any, rows: Sequence[Reason]) -> None:
    """The set runs on far to the right; show what lies around the cases."""
    values = [value for row in rows for value in (row.true, row.replayed, row.of_rms)]
    right, low = max(v.real for v in values), min(v.imag for v in values)
    high = max(v.imag for v in values)
    axis.set_xlim(0, 1.2 * right)
    axis.set_ylim(low - 0.2 * (high - low), high + 0.12 * (high - low))

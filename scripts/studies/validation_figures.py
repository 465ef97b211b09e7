"""The pictures of the validation page: errors of every rule, and what the model can reach."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from studies.limits import reach
from studies.validation import DEFAULT, DRIVES
from torchliner.names import AVERAGINGS, PHASES
from torchliner.report.figure import COLOURS, MARKERS, PARTS, Figure, finish, legend_below, styled, subplots
from torchliner.studies.variants import Row

FASTEST, FREQUENCY = 100.0, 1400.0  # m/s, for the sets that a model can reach: o145 and the g cases stay below; Hz
LINEAR = 0.01  # rho c: within it the axes are linear, beyond it logarithmic
TICKS = (-1, -0.1, -0.01, 0.01, 0.1, 1)
MARKED_SPEEDS = (0.3, 1.0, 3.0)  # m/s, on the model's curve
HOLLOW: Any = {"markerfacecolor": "white", "zorder": 4}


@styled
def draw_validation_errors(rows: Sequence[Row], path: Path) -> Figure:
    """dR and dX of every rule: a line per case and averaging, drives beside it; the median over the heights, and their
    range. A bar is the statistical interval of the default rule at a height."""
    places = [(case, averaging) for case in dict.fromkeys(row.case for row in rows) for averaging in AVERAGINGS]
    figure, axes = subplots(1, 2, 1.6 + 0.3 * len(places))
    for axis, part, name, ends in zip(axes[0], ("real", "imag"), "RX", ((-3, 15), (-0.5, 0.7)), strict=True):
        heights = defaultdict(list)
        for row in rows:
            i = DRIVES.index((row.drive, row.mean))
            y = places.index((row.case, row.averaging)) + 0.19 * (i - 1.5)
            heights[y, i, row.phase].append(getattr(row.miss, part))
            if row.rule == DEFAULT:
                bar = [getattr(end - row.true, part) for end in (row.low, row.high)]
                axis.plot(bar, [y, y], color=COLOURS[i], linewidth=4, alpha=0.35, solid_capstyle="butt", zorder=2)
        for (y, i, phase), values in heights.items():
            axis.plot([min(values), max(values)], [y, y], color=COLOURS[i], linewidth=0.7, zorder=3)
            marker = MARKERS[list(PHASES).index(phase)]
            axis.plot(np.median(values), y, marker, color=COLOURS[i], markersize=3.4, markeredgewidth=0.7, **HOLLOW)
        axis.axvline(0, color="k", linewidth=0.8, zorder=1)
        for i in range(0, len(places), 2 * len(AVERAGINGS)):  # every second case
            axis.axhspan(i - 0.5, i + len(AVERAGINGS) - 0.5, color="0.95", zorder=0)
        axis.set_xscale("symlog", linthresh=LINEAR, linscale=0.6)
        axis.set_xticks([*TICKS, 0], [*(f"{tick:g}".replace("-", "\N{MINUS SIGN}") for tick in TICKS), "0"])
        axis.set(xlim=ends, ylim=(len(places) - 0.5, -0.5))
        axis.tick_params(axis="y", length=0)
        axis.set_xlabel(rf"$\Delta {name} = {name} - {name}_\mathrm{{ref}}$ ($\rho c$)")
    axes[0, 0].set_yticks(range(len(places)), [f"{case}, {averaging}" for case, averaging in places])
    axes[0, 1].set_yticks([])
    for i, (drive, mean) in enumerate(DRIVES):
        label = drive + (", mean removed" if mean == "removed" else "")
        axes[0, 0].plot([], [], "-", color=COLOURS[i], linewidth=2, label=label)
    for marker, phase in zip(MARKERS, PHASES, strict=False):
        axes[0, 0].plot([], [], marker, color="k", markerfacecolor="none", label=f"phase {phase}")
    axes[0, 0].plot([], [], color="0.6", linewidth=4, label="95 % interval of the default rule")
    return finish(figure, path, "educed less reference, all drives, phases, averagings and heights, 1400 Hz", legend=3)


@styled
def draw_reach(panels: Mapping[str, tuple[Any, Sequence[Row]]], path: Path) -> Figure:
    """Complex plane: Z(|v|) of a model, all that a |v(t)| can give, references, replayed holes."""
    figure, axes = subplots(1, len(panels), 3.9)
    for axis, (title, (liner, rows)) in zip(axes[0], panels.items(), strict=True):
        edge = reach(liner, FREQUENCY, FASTEST).boundary
        axis.fill(edge.real, edge.imag, color="0.88", zorder=0, label=r"any $|v(t)|$, phase averaged")
        speeds = np.concatenate([[0], np.geomspace(1e-3, FASTEST, 400), MARKED_SPEEDS])
        curve = liner.impedance(FREQUENCY, speeds).numpy()
        marked, curve = curve[-len(MARKED_SPEEDS) :], curve[: -len(MARKED_SPEEDS)]
        axis.plot(curve.real, curve.imag, color="k", label=r"model, constant $|v|$")
        axis.plot(marked.real, marked.imag, "k|", markersize=6)
        words: Any = {"textcoords": "offset points", "fontsize": 7, "clip_on": True}
        for speed, z in zip(MARKED_SPEEDS, marked, strict=True):
            axis.annotate(f"{speed:g}", (z.real, z.imag), xytext=(1, 5), **words)
        values = np.array([value for row in rows for value in (row.true, row.replayed, row.of_rms)])
        right, low, high = values.real.max(), values.imag.min(), values.imag.max()  # the set runs on far to the right
        axis.set(xlim=(0, 1.2 * right), ylim=(low - 0.2 * (high - low), high + 0.12 * (high - low)))
        for i, row in enumerate(rows):
            at, colour = (row.true.real, row.true.imag), COLOURS[i]
            axis.plot(*at, "*", color=colour, markersize=10, zorder=4)
            axis.plot(row.replayed.real, row.replayed.imag, "o", color=colour, markersize=5, **HOLLOW)
            axis.plot(row.of_rms.real, row.of_rms.imag, "s", color=colour, markersize=5, **HOLLOW)
            axis.plot([at[0], row.of_rms.real], [at[1], row.of_rms.imag], ":", color=colour, linewidth=0.8)
            last = at[0] > 0.84 * right
            place: Any = {"xytext": (0, -10), "ha": "right"} if last else {"xytext": (6, 3)}
            axis.annotate(row.case, at, color=colour, **place, **words)
        axis.set(title=title, xlabel=PARTS[0][1])
    axes[0, 0].set_ylabel(PARTS[1][1])
    axes[0, 0].plot([], [], "*", color="0.3", label="reference")
    for marker, label in (("o", "replayed from the holes' own velocity, default"), ("s", "from its rms")):
        axes[0, 0].plot([], [], marker, color="0.3", markerfacecolor="white", label=label)
    legend_below(figure, axes[0, 0], 3)
    return finish(figure, path, "1400 Hz; numbers on the curves: |v| in m/s, hole velocity times porosity")

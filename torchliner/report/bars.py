"""Pictures of names one above the other, R beside X: variants, models, contributions, cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.report.figure import (
    COLOURS,
    LINES,
    MARKERS,
    ONE_ROW,
    PARTS,
    REFERENCES,
    Figure,
    break_at_poles,
    draw_band,
    entry,
    finish,
    impedance_panels,
    plain_label,
    styled,
    subplots,
)
from torchliner.report.numbers import part_of

Rows = Sequence[Mapping[str, Any]]
BAR: Any = {"solid_capstyle": "butt", "alpha": 0.45, "zorder": 2}


def bar_panels(names: Sequence[str], row_height: float = 0.25) -> tuple[Figure, list[tuple[Any, str]]]:
    """Two panels that share the names at their left, the first on top."""
    figure, axes = subplots(1, 2, 1.1 + row_height * len(names), beside=True)
    for axis, (part, label) in zip(axes[0], PARTS, strict=True):
        shown = [plain_label(name) for name in names] if part == "resistance" else []
        axis.set_ylim(len(names) - 0.3, -0.7)
        axis.set_yticks(range(len(names)), shown)
        axis.tick_params(axis="y", length=0)
        axis.minorticks_off()
        axis.set_xlabel(label)
    return figure, [(axis, part) for axis, (part, _) in zip(axes[0], PARTS, strict=True)]


@styled
def draw_audit(found: Any, path: str | Path | None = None) -> Figure:
    """A bar per factor from its smallest to its largest value, its variants as points."""
    factors = list(dict.fromkeys(row.factor for row in found.rows))
    figure, panels = bar_panels(factors)
    for axis, part in panels:
        base = part_of(found.base, part)
        if found.low is not None:
            words = f"{100 * found.level:g} % interval"
            axis.axvspan(part_of(found.low, part), part_of(found.high, part), color="0.85", zorder=0, label=words)
        axis.axvline(base, color="k", linewidth=0.9, label="base", zorder=1)
        for place, factor in enumerate(factors):
            values = [part_of(row.impedance, part) for row in found.of(factor=factor)]
            axis.plot([min(*values, base), max(*values, base)], [place] * 2, color=COLOURS[0], linewidth=3.5, **BAR)
            label = None if place else "choice changed"
            axis.plot(values, [place] * len(values), "o", color=COLOURS[0], markersize=3.2, zorder=3, label=label)
    return finish(figure, path, f"{found.title}, {found.frequency:g} Hz, averaging {found.averaging}", legend=ONE_ROW)


@styled
def draw_models(found: Any, path: str | Path | None = None) -> Figure:
    """R and X with their intervals: a line a model at one frequency, curves over several."""
    names = list(dict.fromkeys(row.model for row in found.rows))
    several = len(names) < len(found.rows)
    figure, panels = impedance_panels(3.0, r"$f$ (kHz)") if several else bar_panels(names)
    tone = next((row.frequency for row in found.rows if row.distance), None)
    for axis, part in panels:
        for i, name in enumerate(names):
            mine = found.of(model=name)
            values = np.array([part_of(row.impedance, part) for row in mine])
            ends = [[part_of(row[end], part) for row in mine] for end in ("low", "high") if mine[0][end] is not None]
            if several:
                lines = [1e-3 * row.frequency for row in mine]
                if ends:
                    draw_band(axis, lines, ends[0], ends[1], COLOURS[i])
                axis.plot(lines, values, color=COLOURS[i], linestyle=LINES[i], label=plain_label(name))
            else:
                if ends:
                    axis.plot(np.ravel(ends), [i] * 2, color=COLOURS[0], linewidth=4, **BAR)
                axis.plot(values, [i], "o", color=COLOURS[0], label=None if i else "educed", zorder=3)
        for i, (name, value) in enumerate(found.references.items()):
            if not several:
                axis.axvline(part_of(value, part), label=plain_label(name), **REFERENCES[i % 4])
            elif tone:
                style: Any = {"color": "k", "markersize": 7, "markerfacecolor": "none", "zorder": 4}
                axis.plot(1e-3 * tone, part_of(value, part), MARKERS[i], label=plain_label(name), **style)
        if several:
            break_at_poles(axis)
    at = "" if several else f", {found.rows[0].frequency:g} Hz"
    bars = "" if found.level is None else f"; bands: {100 * found.level:g} % interval"
    return finish(figure, path, f"{found.title}{at}, averaging {found.averaging}{bars}", legend=4)


@styled
def draw_contributions(rows: Rows, title: str, path: str | Path | None = None, total: complex | None = None) -> Figure:
    """Bars of the changes of R and X by each parameter, and their sum as a line; ``step`` or ``impedance`` of rows of
    one frequency is drawn, the largest on top."""
    figure, panels = bar_panels([row["parameter"].replace("_", " ") for row in rows], 0.22)
    key, per = ("step", "1 % of $p$") if total is None else ("impedance", "one $u(p)$")
    for (axis, part), sign in zip(panels, "RX", strict=True):
        values = np.array([part_of(row[key], part) for row in rows])
        colours = [COLOURS[int(value < 0)] for value in values]
        axis.barh(np.arange(len(rows)), 1e3 * np.abs(values), color=colours, height=0.65)
        if total is not None:
            axis.axvline(1e3 * part_of(total, part), color="k", linestyle="--", linewidth=0.9)
        axis.set_xlim(left=0)
        axis.set_xlabel(rf"$|\Delta {sign}|$ for {per}, $10^{{-3}}\rho c$")
    entry(panels[0][0], "grows with $p$", width=5, color=COLOURS[0])
    entry(panels[0][0], "falls with $p$", width=5, color=COLOURS[1])
    if total is not None:
        entry(panels[0][0], "combined", linestyle="--", linewidth=0.9)
    return finish(figure, path, title, legend=3)


@styled
def draw_cases(rows: Rows, path: str | Path | None = None) -> Figure:
    """A dot a case with its interval: rows with a name, impedance, low and high."""
    figure, panels = bar_panels([row["name"] for row in rows], 0.22)
    for axis, part in panels:
        for place, row in enumerate(rows):
            if row["low"] is not None:
                ends = [part_of(row[end], part) for end in ("low", "high")]
                axis.plot(ends, [place] * 2, color=COLOURS[0], linewidth=2, **BAR)
            axis.plot(part_of(row["impedance"], part), place, "o", color=COLOURS[0], markersize=4, zorder=3)
    return finish(figure, path, "R and X of each case with its interval")

"""Pictures of studies: what choices, models, parameters, heights and levels do to Z."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchliner.records import ImpedanceMap
from torchliner.records.level_check import DEGREES_PER_DB
from torchliner.report import figure as look
from torchliner.report.curves import ORDERS, alongside_at, references_of
from torchliner.report.figure import Rows, part_of
from torchliner.report.maps import case_title, family
from torchliner.report.table import Row
from torchliner.studies.laws import impedances_at

DOT: Any = {"color": look.COLOURS[0], "marker": "o", "linestyle": "none", "zorder": 3}
GAPS = {"level": "implied minus known level (dB)", "phase": "implied minus known phase (degrees)"}
SPEED = "$|v|$ (m s$^{-1}$)"
DRAWN = 200  # speeds of a picture
NORMAL = 1.96  # standard deviations of a 95 % interval


# A row a name: dots and bars.


@look.styled
def draw_cases(
    rows: Rows,
    path: str | Path | None = None,
    references: Mapping[str, complex] | None = None,
    title: str = "R and X of each case with its interval",
    span: tuple[str, complex, complex] | None = None,
) -> look.Figure:
    """A row a case, the first on top: a dot, or one for each of ``values``, on a bar from ``low`` to ``high``.

    Args:
        rows: with a name, impedance, low and high (None without an interval).
        references: lines through all rows.
        span: name and ends of what is shaded through all rows.
    """
    figure, axes = look.subplots(1, 2, 1.1 + 0.24 * len(rows), beside=True)
    for axis, (part, label) in zip(axes[0], look.PARTS, strict=True):
        names = [look.plain_label(row["name"]) for row in rows]
        axis.set_yticks(range(len(rows)), names if part == "resistance" else [])
        axis.set(xlabel=label, ylim=(len(rows) - 0.3, -0.7))
        axis.tick_params(axis="y", length=0)
        axis.use_sticky_edges = False
        styles = look.REFERENCES[span is not None :]  # a thick line would hide the span
        for style, (name, value) in zip(styles, (references or {}).items(), strict=False):
            axis.axvline(part_of(value, part), label=look.plain_label(name), **style)
        if span is not None:
            axis.axvspan(*(part_of(end, part) for end in span[1:]), color="0.88", zorder=0, label=span[0])
        for place, row in enumerate(rows):
            values = row.get("values", [row["impedance"]])
            label = "choice changed" if "values" in row else ""
            axis.plot([part_of(value, part) for value in values], [place] * len(values), label=label, **DOT)
            if row["low"] is not None:
                low, high = (part_of(row[end], part) for end in ("low", "high"))
                axis.barh(place, high - low, left=low, height=0.3, color=look.COLOURS[0], alpha=0.45)
    return look.finish(figure, path, title, 4)


def draw_audit(found: Any, path: str | Path | None = None) -> look.Figure:
    """A bar per factor from its smallest to its largest value, its variants as dots."""
    rows = []
    for factor in dict.fromkeys(row.factor for row in found.rows):
        values = [row.impedance for row in found.of(factor=factor)]
        ends = [[z.real for z in (*values, found.base)], [z.imag for z in (*values, found.base)]]
        row = {"name": factor, "impedance": found.base, "values": values}
        rows.append(row | {"low": complex(*map(min, ends)), "high": complex(*map(max, ends))})
    span = None if found.low is None else (f"{100 * found.level:g} % interval", found.low, found.high)
    words = f"{found.title}, {found.frequency:g} Hz, averaging {found.averaging}; dots: choices"
    return draw_cases(rows, path, {"base": found.base}, words, span)


def draw_models(found: Any, path: str | Path | None = None) -> look.Figure:
    """R and X with their intervals: a line a model at one frequency, curves over several."""
    names = list(dict.fromkeys(row.model for row in found.rows))
    words = f"averaging {found.averaging}{'' if found.level is None else f'; bands: {100 * found.level:g} % interval'}"
    if len(names) == len(found.rows):
        title = f"{found.title}, {found.rows[0].frequency:g} Hz, {words}"
        return draw_cases([Row(row, name=row.model) for row in found.rows], path, found.references, title)
    drawn = [look.curve_of(found.of(model=n), "frequency", **look.colour_of(i, n)) for i, n in enumerate(names)]
    tone = next((row.frequency for row in found.rows if row.distance), math.nan)
    for marker, (name, value) in zip(look.MARKERS, found.references.items(), strict=False):
        drawn.append({"x": [1e-3 * tone], "y": [value]} | look.dots("k", marker, name, markerfacecolor="none"))
    return look.draw_parts(drawn, look.KHZ, path, f"{found.title}, {words}", poles=True)


@look.styled
def draw_predictions(panels: Mapping[str, Rows], title: str, path: str | Path | None = None) -> look.Figure:
    """Complex plane: reference, prediction as it was, by the fit with its 95 % intervals; a panel of rows a title."""
    figure, axes = look.panels_of(len(panels), 3.6)
    names = list(dict.fromkeys(row["label"] for rows in panels.values() for row in rows))
    for axis, (heading, rows) in zip(axes, panels.items(), strict=True):
        for row in rows:
            colour, z, true = look.COLOURS[names.index(row["label"])], row["impedance"], row["true"]
            if true is not None:
                look.draw_point(axis, true, marker="*", color=colour, markersize=10)
                axis.plot([true.real, z.real], [true.imag, z.imag], ":", color=colour, linewidth=0.8)
            look.draw_point(axis, row["before"], marker="o", color=colour, markerfacecolor="white")
            half = NORMAL * row["standard"]
            look.draw_point(axis, z, (z - half, z + half), marker="s", color=colour, markersize=3.5)
        axis.set(title=heading, **look.PLANE)
    for name, colour in zip(names, look.COLOURS, strict=False):
        look.entry(axes[0], look.plain_label(name), color=colour)
    look.entry(axes[0], "reference", "*")
    look.entry(axes[0], "model as it was", "o", markerfacecolor="white")
    look.entry(axes[0], "calibrated, 95 % interval", "s")
    return look.finish(figure, path, title, legend=3)


# Over height, level and speed.


def level_rows(results: Sequence[ImpedanceMap], frequency_index: int) -> list[Row]:
    """Of each map with a level check and averaging: height (m), averaging, the gaps with their intervals, verdict."""
    checked = [(one.height, one.level_check) for one in results if one.level_check is not None]
    return [
        {"height": height, "averaging": name, **check.liner.at(i, frequency_index)}
        | {"verdict": check.verdict(name, frequency_index)}
        for height, check in sorted(checked, key=lambda pair: pair[0] or 0.0)
        for i, name in enumerate(check.averagings)
    ]


@look.styled
def draw_level_check(
    results: Sequence[ImpedanceMap], path: str | Path | None = None, frequency_index: int = 0
) -> look.Figure:
    """dB, and degrees where the phase is known, over height, with statistical bars.

    Raises:
        ValueError: no map has a level check.
    """
    check = next((one.level_check for one in results if one.level_check is not None), None)
    if check is None:
        raise ValueError(f"level check: {results[0].level_check_words}; nothing to draw")
    rows = level_rows(results, frequency_index)
    placed = all(row["height"] is not None for row in rows)
    kinds = [kind for kind in GAPS if any(row[kind] is not None for row in rows)] or ["level"]
    figure, panels = look.panels_of(len(kinds), 2.9)
    for axis, kind in zip(panels, kinds, strict=True):
        limit = check.limit * (1 if kind == "level" else DEGREES_PER_DB)
        axis.axhspan(-limit, limit, color="0.88", zorder=0, label="limit")
        for marker, (name, colour) in zip(look.MARKERS, look.AVERAGINGS.items(), strict=False):
            mine = [row for row in rows if row["averaging"] == name]
            columns = ([row[key] for row in mine] for key in (kind, f"{kind}_low", f"{kind}_high"))
            values, *ends = (np.array(column, dtype=float) for column in columns)
            x = [1e3 * row["height"] for row in mine] if placed else range(len(mine))
            look.draw_values(axis, x, values, ends, bars=True, color=colour, marker=marker, label=name)
        axis.set(xlabel=look.Y_MM if placed else "height not stated", ylabel=GAPS[kind])
        if not placed:
            axis.set_xticks([])
    frequency = float(results[0].frequency[frequency_index])
    return look.finish(figure, path, f"{case_title(results[0])}, {frequency:g} Hz, off {check.known}", 4)


def draw_over_height(
    rows: Rows, title: str, path: str | Path | None = None, references: Mapping[str, complex] | None = None
) -> look.Figure:
    """R and X over height: rows with a height, an averaging, its impedance and, if known, its interval."""
    drawn = []
    for marker, (name, colour) in zip(look.MARKERS, look.AVERAGINGS.items(), strict=False):
        mine = sorted((row for row in rows if row["averaging"] == name), key=lambda row: float(row["height"]))
        style: Any = {"color": colour, "marker": marker, "label": name, "bars": True}
        drawn += [look.curve_of(mine, "height", **style)] if mine else []
    return look.draw_parts(drawn, look.Y_MM, path, title, references=references)


def draw_maps_over_height(
    results: Sequence[ImpedanceMap], path: str | Path | None = None, index: int = 0
) -> look.Figure:
    """Z of maps of several heights, all averagings, beside what is known from elsewhere (figure 19a's trend)."""
    rows = [
        {"height": one.height, "averaging": name, "impedance": complex(one.liner[name].impedance[index])}
        | dict(zip(("low", "high"), one.bounds_of_liner(name, index) or (None, None), strict=True))
        for one in results
        if one.height is not None
        for name in one.averagings
    ]
    return draw_over_height(rows, family(results, index), path, known_of(results, index))


def known_of(results: Sequence[ImpedanceMap], index: int) -> dict[str, complex]:
    """References of the file, at its tone, other methods, Goodrich."""
    found = references_of(results, index)
    for other, f in alongside_at(results, index):
        found |= {f"{other.name}, {word}": complex(other.liner[each].impedance[f]) for each, word in ORDERS.items()}
    return found


def draw_levels(curve: Any, path: str | Path | None = None) -> look.Figure:
    """Resistance and reactance over level; dashed: the fixed point of the frequency domain."""
    order, drawn = curve.level.argsort().tolist(), []
    for j, frequency in enumerate(curve.frequency.tolist()):
        style = look.colour_of(j, f"{frequency:g} Hz", linestyle="-", marker=look.MARKERS[j])
        drawn += [{"x": curve.level[order], "y": curve.impedance[order, j]} | style]
        style = look.colour_of(j, linestyle="--") | {"label": "$Z$ of the rms $v$"}
        drawn += [{"x": curve.level[order], "y": curve.fixed_point[order, j]} | style]
    return look.draw_parts(drawn, look.INCIDENT, path, "{liner}, {kernel}".format(**curve.choices), legend=6)


def draw_identification(found: Any, path: str | Path | None = None) -> look.Figure:
    """R and X over |v| with bands at the first frequency, by the best law, the best of the other kind and the law as it
    was (all of the first plane)."""
    fit = found.fit
    at, speed = float(fit.runs[0].frequency[0]), torch.linspace(0, fit.knots.top**0.5, DRAWN).double().square()
    rival = [each.fit for each in found.candidates if bool(each.fit.law.frequencies) != bool(fit.law.frequencies)]
    drawn = []
    for i, each in enumerate((fit, *rival[:1])):
        best, *ends = each.band(at, speed)
        drawn.append({"x": speed, "y": best, "ends": ends} | look.colour_of(i, each.law.label.replace("_", " ")))
    before = impedances_at(fit.runs[0].in_flow, [at], speed)[0]
    drawn.append({"x": speed, "y": before, "color": "k", "linestyle": "--", "label": "the law as it was"})

    def more(axis: Any, _: str) -> None:
        axis.axvspan(*fit.seen_speeds, color="0.93", zorder=0, label="$|v|$ that the runs see")

    return look.draw_parts(drawn, SPEED, path, f"{at:g} Hz; bands: 95 %", more=more, poles=None, legend=5)

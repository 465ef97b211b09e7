"""Pictures of studies: what choices, models, parameters, heights and levels do to Z."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchliner.records import ImpedanceMap
from torchliner.records.level_check import DEGREES_PER_DB
from torchliner.report import figure as look
from torchliner.report.numbers import case_title, part_of
from torchliner.studies.laws import impedances_at

Rows = Sequence[Mapping[str, Any]]
DOT: Any = {"color": look.COLOURS[0], "marker": "o", "linestyle": "none", "zorder": 3}
GAPS = {"level": "implied minus known level (dB)", "phase": "implied minus known phase (degrees)"}
SPEED = "$|v|$ (m s$^{-1}$)"
DRAWN = 200  # speeds of a picture


def bar_panels(names: Sequence[str]) -> tuple[look.Figure, list[tuple[Any, str]]]:
    """Two panels that share the names at their left, the first on top."""
    figure, axes = look.subplots(1, 2, 1.1 + 0.24 * len(names), beside=True)
    for axis, (part, label) in zip(axes[0], look.PARTS, strict=True):
        axis.set_yticks(range(len(names)), map(look.plain_label, names) if part == "resistance" else [])
        axis.set(xlabel=label, ylim=(len(names) - 0.3, -0.7))
        axis.tick_params(axis="y", length=0)
        axis.use_sticky_edges = False
    return figure, [(axis, part) for axis, (part, _) in zip(axes[0], look.PARTS, strict=True)]


def _draw_bars(panels: Any, place: float, values: Sequence[complex], ends: Sequence[complex], label: str) -> None:
    """Values on a row as dots, on a bar from end to end of each part."""
    for axis, part in panels:
        reach = [part_of(end, part) for end in ends]
        if reach:
            axis.barh(place, max(reach) - min(reach), left=min(reach), height=0.3, color=look.COLOURS[0], alpha=0.45)
        axis.plot([part_of(value, part) for value in values], [place] * len(values), label=label, **DOT)


@look.styled
def draw_audit(found: Any, path: str | Path | None = None) -> look.Figure:
    """A bar per factor from its smallest to its largest value, its variants as points."""
    factors = list(dict.fromkeys(row.factor for row in found.rows))
    figure, panels = bar_panels(factors)
    for axis, part in panels:
        axis.axvline(part_of(found.base, part), color="k", linewidth=0.9, label="base", zorder=1)
        if found.low is not None:
            words = f"{100 * found.level:g} % interval"
            axis.axvspan(part_of(found.low, part), part_of(found.high, part), color="0.85", zorder=0, label=words)
    for place, factor in enumerate(factors):
        values = [row.impedance for row in found.of(factor=factor)]
        _draw_bars(panels, place, values, [*values, found.base], "choice changed")
    return look.finish(figure, path, f"{found.title}, {found.frequency:g} Hz, averaging {found.averaging}", 3)


@look.styled
def draw_cases(
    rows: Rows,
    path: str | Path | None = None,
    references: Mapping[str, complex] | None = None,
    title: str = "R and X of each case with its interval",
) -> look.Figure:
    """A dot a case with its interval: rows with a name, impedance, low and high."""
    figure, panels = bar_panels([row["name"] for row in rows])
    for place, row in enumerate(rows):
        _draw_bars(panels, place, [row["impedance"]], [row[end] for end in ("low", "high") if row[end] is not None], "")
    look.draw_references(panels, references or {}, along="y")
    return look.finish(figure, path, title, 4)


@look.styled
def draw_models(found: Any, path: str | Path | None = None) -> look.Figure:
    """R and X with their intervals: a line a model at one frequency, curves over several."""
    names = list(dict.fromkeys(row.model for row in found.rows))
    words = f"averaging {found.averaging}{'' if found.level is None else f'; bands: {100 * found.level:g} % interval'}"
    if len(names) == len(found.rows):
        rows = [{"name": row.model, **{key: row[key] for key in ("impedance", "low", "high")}} for row in found.rows]
        title = f"{found.title}, {found.rows[0].frequency:g} Hz, {words}"
        return draw_cases(rows, path, found.references, title)
    figure, panels = look.impedance_panels(3.0, look.KHZ)
    for i, name in enumerate(names):
        rows = found.of(model=name)
        x, z, *ends = ([row[key] for row in rows] for key in ("frequency", "impedance", "low", "high"))
        known = None if rows[0].low is None else ends
        look.draw_impedance(panels, 1e-3 * np.array(x), z, known, **look.colour_of(i, name))
    tone = next((row.frequency for row in found.rows if row.distance), math.nan)
    for marker, (name, value) in zip(look.MARKERS, found.references.items(), strict=False):
        style: Any = {"color": "k", "linestyle": "none", "markerfacecolor": "none", "label": look.plain_label(name)}
        look.draw_impedance(panels, [1e-3 * tone], [value], marker=marker, **style)
    for axis, _ in panels:
        look.frame(axis, poles=True)
    return look.finish(figure, path, f"{found.title}, {words}", 4)


@look.styled
def draw_contributions(
    rows: Rows, title: str, path: str | Path | None = None, total: complex | None = None
) -> look.Figure:
    """Bars of the changes of R and X by each parameter, and their sum as a line; ``step`` or ``impedance`` of rows of
    one frequency is drawn, the largest on top."""
    figure, panels = bar_panels([row["parameter"].replace("_", " ") for row in rows])
    key, per = ("step", "1 % of $p$") if total is None else ("impedance", "one $u(p)$")
    for (axis, part), sign in zip(panels, "RX", strict=True):
        axis.barh(range(len(rows)), [1e3 * part_of(row[key], part) for row in rows], color=look.COLOURS[0], height=0.6)
        axis.axvline(0, color="0.6", linewidth=0.6)
        if total is not None:
            axis.axvline(1e3 * abs(part_of(total, part)), color="k", linestyle="--", label="combined")
        axis.set_xlabel(rf"$\Delta {sign}$ for {per}, $10^{{-3}}\rho c$")
    return look.finish(figure, path, title, 3)


def level_rows(results: Sequence[ImpedanceMap], frequency_index: int) -> list[dict[str, Any]]:
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


@look.styled
def draw_levels(curve: Any, path: str | Path | None = None) -> look.Figure:
    """Resistance and reactance over level; dashed: the fixed point of the frequency domain."""
    figure, panels = look.impedance_panels(3.2, look.INCIDENT)
    order = curve.level.argsort().tolist()
    for j, frequency in enumerate(curve.frequency.tolist()):
        style = look.colour_of(j, f"{frequency:g} Hz", linestyle="-", marker=look.MARKERS[j])
        look.draw_impedance(panels, curve.level[order], curve.impedance[order, j], **style)
        roots = [curve.fixed_points[i] for i in order]
        fixed = [complex(each[0].impedance[j]) if each else complex(math.nan, math.nan) for each in roots]
        style = look.colour_of(j, linestyle="--") | {"label": "$Z$ of the rms $v$"}
        look.draw_impedance(panels, curve.level[order], fixed, **style)
    return look.finish(figure, path, "{liner}, {kernel}".format(**curve.choices), 6)


@look.styled
def draw_heights(study: Any, path: str | Path | None = None) -> look.Figure:
    """R and X over height, by averaging."""
    figure, panels = look.impedance_panels(3.2, look.Y_MM)
    for marker, name in zip(look.MARKERS, study.rows[0].impedance, strict=False):
        x, z = [1e3 * row.height for row in study.rows], [row.impedance[name] for row in study.rows]
        look.draw_impedance(panels, x, z, color=look.AVERAGINGS[name], marker=marker, label=name)
    look.draw_references(panels, {"reference": study.reference["true"]} if "true" in study.reference else {})
    hard = " (null test)" if study.choices.get("surface") == "hard wall" else ""
    return look.finish(figure, path, f"{study.title}{hard}, {study.frequency:g} Hz", 4)


@look.styled
def draw_modulation(study: Any, path: str | Path | None = None) -> look.Figure:
    """Cell-periodic modulation over height, its fitted decay and that of an evanescent sound field."""
    figure, (axis,) = look.panels_of(1, 3.4)
    decay, heights = study.decay, np.array([row.height for row in study.rows])
    names = {"modulation": "all harmonics", "first_harmonic": "first harmonic", "between": "between harmonics"}
    for i, (name, words) in enumerate(names.items()):
        values = np.array([row[name] for row in study.rows], dtype=float)
        if np.isfinite(values).any():
            style = look.colour_of(i, linestyle=":", marker=look.MARKERS[i])
            axis.plot(1e3 * heights, values, **style | {"label": f"{look.V_RMS}, {words}"})
    if decay is not None:
        if decay.follows:
            text = rf"fit: $e^{{-y/l}}$, $l={1e3 * decay.length:.3g}$ mm"
            axis.plot(1e3 * heights, decay.at(heights), color=look.COLOURS[0], label=text)
        length = study.pitch / (2 * math.pi)
        sound = study.rows[0].first_harmonic * np.exp(-(heights - heights[0]) / length)
        text = rf"sound: $l=L_c/2\pi={1e3 * length:.3g}$ mm"
        axis.plot(1e3 * heights, sound, "--", color="0.3", label=text)
    axis.set(yscale="log", xlabel=look.Y_MM, ylabel="cell-periodic part (rms) over mean")
    return look.finish(figure, path, f"{study.title}, {study.frequency:g} Hz", 2)


@look.styled
def draw_identification(found: Any, path: str | Path | None = None) -> look.Figure:
    """R and X over |v| with bands at the first frequency, by the best law, the best of the other kind and the law as it
    was (all of the first plane)."""
    fit = found.fit
    at, speed = float(fit.runs[0].frequency[0]), torch.linspace(0, fit.knots.top**0.5, DRAWN).double().square()
    rival = [each.fit for each in found.candidates if bool(each.fit.law.frequencies) != bool(fit.law.frequencies)]
    figure, panels = look.impedance_panels(3.0, SPEED)
    for i, each in enumerate((fit, *rival[:1])):
        best, *ends = each.band(at, speed)
        look.draw_impedance(panels, speed, best, ends, **look.colour_of(i, each.law.label.replace("_", " ")))
    before = impedances_at(fit.runs[0].in_flow, [at], speed)[0]
    look.draw_impedance(panels, speed, before, color="k", linestyle="--", linewidth=0.9, label="the law as it was")
    for axis, _ in panels:
        axis.axvspan(*fit.seen_speeds, color="0.93", zorder=0, label="$|v|$ that the runs see")
    return look.finish(figure, path, f"{at:g} Hz; bands: 95 %", 5)

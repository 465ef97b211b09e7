"""Pictures of what a study varies: over height, level of the incident wave and |v|."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchliner.records import ImpedanceMap
from torchliner.records.level_check import DEGREES_PER_DB
from torchliner.report.figure import (
    AVERAGINGS,
    COLOURS,
    INCIDENT,
    MARKERS,
    ONE_ROW,
    PARTS,
    REFERENCES,
    V_RMS,
    Figure,
    draw_band,
    entry,
    finish,
    impedance_panels,
    label_axes,
    plain_label,
    styled,
    subplots,
)
from torchliner.report.numbers import case_title, part_of
from torchliner.studies.laws import impedance_at

GAPS = {"level": "implied minus known level (dB)", "phase": "implied minus known phase (degrees)"}
DRAWN = 200  # speeds of a picture


@styled
def draw_level_check(
    results: Sequence[ImpedanceMap], path: str | Path | None = None, frequency_index: int = 0
) -> Figure:
    """dB, and degrees where the phase is known, over height, with statistical bars.

    Raises:
        ValueError: no map has a level check.
    """
    checked = [(one, one.level_check) for one in results if one.level_check is not None]
    if not checked:
        raise ValueError(f"level check: {results[0].level_check_words}; nothing to draw")
    placed = any(one.height is not None for one, _ in checked)
    if placed:
        checked = [pair for pair in checked if pair[0].height is not None]
    rows = [
        {"height": 1e3 * (one.height or 0.0), "averaging": name, **check.liner.at(i, frequency_index)}
        for one, check in sorted(checked, key=lambda pair: pair[0].height or 0.0)
        for i, name in enumerate(check.averagings)
    ]
    kinds = [kind for kind in GAPS if any(row[kind] is not None for row in rows)] or ["level"]
    figure, axes = subplots(1, len(kinds), 2.9)
    for axis, kind in zip(axes[0], kinds, strict=True):
        limit = checked[0][1].limit * (1 if kind == "level" else DEGREES_PER_DB)
        axis.axhspan(-limit, limit, color="0.88", zorder=0, label="limit")
        axis.axhline(0, color="0.6", linewidth=0.6, zorder=1)
        for i, (averaging, colour) in enumerate(AVERAGINGS.items()):
            mine = [row for row in rows if row["averaging"] == averaging and row[kind] is not None]
            style: Any = {"color": colour, "label": averaging, "zorder": 3}
            if mine:
                axis.plot([row["height"] for row in mine], [row[kind] for row in mine], MARKERS[i] + "-", **style)
            barred = [row for row in mine if row[f"{kind}_low"] is not None]
            ends = ([row[f"{kind}_{end}"] for row in barred] for end in ("low", "high"))
            axis.vlines([row["height"] for row in barred], *ends, color=colour, zorder=2)
        label_axes(axis, "$y$ (mm)" if placed else "height not stated", GAPS[kind])
        if not placed:
            axis.set_xticks([])
    frequency = float(results[0].frequency[frequency_index])
    return finish(figure, path, f"{case_title(results[0])}, {frequency:g} Hz, off {checked[0][1].known}", legend=4)


@styled
def draw_levels(curve: Any, path: str | Path | None = None) -> Figure:
    """Resistance and reactance over level; dashed: the fixed point of the frequency domain."""
    figure, panels = impedance_panels(3.2, INCIDENT)
    order = curve.level.argsort()
    level = curve.level[order].numpy()
    lowest = [roots[0].impedance if roots else None for roots in curve.fixed_points]
    several = curve.reflection.shape[1] > 1
    for axis, part in panels:
        for j, frequency in enumerate(curve.frequency.tolist()):
            z, u = (part_of(value[order, j], part) for value in (curve.impedance, curve.spread))
            if several:
                draw_band(axis, level, z - u, z + u, COLOURS[j])
            axis.plot(level, z, color=COLOURS[j], marker=MARKERS[j], label=f"{frequency:g} Hz")
            dashed = [math.nan if (z0 := lowest[i]) is None else float(part_of(z0[j], part)) for i in order.tolist()]
            axis.plot(level, dashed, color=COLOURS[j], linestyle="--")
    if several:
        entry(panels[0][0], "standard deviation of realisations", width=5, color="0.8")
    entry(panels[0][0], "$Z$ of the rms $v$", linestyle="--")
    return finish(figure, path, "{liner}, {kernel}, {drive}".format(**curve.choices), ONE_ROW)


@styled
def draw_heights(study: Any, path: str | Path | None = None) -> Figure:
    """R and X over height, by averaging."""
    figure, panels = impedance_panels(3.2, "$y$ (mm)")
    heights = [1e3 * row.height for row in study.rows]
    for axis, part in panels:
        for i, name in enumerate(study.rows[0].impedance):
            values = [part_of(row.impedance[name], part) for row in study.rows]
            axis.plot(heights, values, MARKERS[i] + "-", color=AVERAGINGS[name], label=name)
        if "true" in study.reference:
            axis.axhline(part_of(study.reference["true"], part), label="reference", **REFERENCES[0])
    hard = " (null test)" if study.choices.get("surface") == "hard wall" else ""
    return finish(figure, path, f"{study.title}{hard}, {study.frequency:g} Hz", legend=4)


@styled
def draw_modulation(study: Any, path: str | Path | None = None) -> Figure:
    """Cell-periodic modulation over height, its fitted decay and that of an evanescent sound field."""
    figure, axes = subplots(1, 1, 3.4)
    axis, decay, heights = axes[0, 0], study.decay, np.array([row.height for row in study.rows])
    names = {"modulation": "all harmonics", "first_harmonic": "first harmonic", "between": "between harmonics"}
    for i, (name, words) in enumerate(names.items()):
        values = np.array([row[name] for row in study.rows], dtype=np.float64)
        if np.isnan(values).all():
            continue
        fitted = decay is not None and decay.follows and name == "modulation"
        style: Any = {"color": COLOURS[i], "label": f"{V_RMS}, {words}"}
        axis.plot(1e3 * heights, values, MARKERS[i] + ("" if fitted else ":"), **style)
        if fitted:
            text = rf"fit: $e^{{-y/l}}$, $l={1e3 * decay.length:.3g}$ mm"
            axis.plot(1e3 * heights, decay.at(heights), "-", color=COLOURS[i], label=text)
    if decay is not None:
        length = study.pitch / (2 * math.pi)
        sound = study.rows[0].first_harmonic * np.exp(-(heights - heights[0]) / length)
        axis.plot(1e3 * heights, sound, "--", color="0.3", label=rf"sound: $l=L_c/2\pi={1e3 * length:.3g}$ mm")
    axis.set_yscale("log")
    label_axes(axis, "$y$ (mm)", "cell-periodic part (rms) over mean")
    return finish(figure, path, f"{study.title}, {study.frequency:g} Hz", legend=2)


@styled
def draw_identification(found: Any, path: str | Path | None = None) -> Figure:
    """R and X over |v| with bands at the first frequency, by the best law, the best of the other kind and the law as it
    was (all of the first plane), and which |v| each run weighs."""
    fit, colours = found.fit, dict[str, str]()
    at, speed = float(fit.runs[0].frequency[0]), torch.linspace(0, fit.knots.top**0.5, DRAWN).double().square()
    figure, axes = subplots(1, 3, 3.0)
    rival = [each.fit for each in found.candidates if bool(each.fit.law.frequencies) != bool(fit.law.frequencies)]
    law = impedance_at(fit.runs[0].in_flow, at, speed)
    for axis, (part, label) in zip(axes[0], PARTS, strict=False):
        for each, colour in zip((fit, *rival[:1]), COLOURS, strict=False):
            best, low, high = (part_of(z, part) for z in each.band(at, speed))
            draw_band(axis, speed, low, high, colour)
            axis.plot(speed, best, color=colour, label=each.law.label.replace("_", " "))
        axis.plot(speed, part_of(law, part), "--", color="k", linewidth=0.9, label="the law as it was")
        axis.axvspan(*fit.seen_speeds, color="0.93", zorder=0)
        label_axes(axis, "$|v|$ (m s$^{-1}$)", label)
    for run in fit.runs:
        colour = colours.setdefault(run.group, COLOURS[2 + len(colours) % 5])
        for weight in fit.weights([run]):
            axes[0, 2].plot(fit.knots.speeds, weight, color=colour, linewidth=0.9)
    for name, colour in colours.items():
        entry(axes[0, 0], plain_label(name), color=colour)
    entry(axes[0, 0], "$|v|$ that the runs see", width=5, color="0.9")
    label_axes(axes[0, 2], "$|v|$ (m s$^{-1}$)", "share of each spline in $Z$")
    return finish(figure, path, f"{at:g} Hz; bands: 95 %", legend=5)

"""Studies as figures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchliner.report.figure import (
    COLOURS,
    MARKERS,
    ONE_ROW,
    PARTS,
    REFERENCES,
    V_RMS,
    Figure,
    draw_band,
    entry,
    finish,
    head_panel,
    impedance_panels,
    label_axes,
    place_legend,
    styled,
    subplots,
)
from torchliner.report.numbers import part_of
from torchliner.report.studies import COMBINED
from torchliner.studies.laws import impedance_at
from torchliner.studies.rows import Row, Study

STYLES = ("-", "--", ":", "-.") * 99
ELLIPSE = 2.4477  # radius that holds 95 % of a two-dimensional Gaussian
DRAWN = 200  # speeds of a picture


def _name_lines(axis: Any, names: Sequence[str], shown: bool) -> None:
    """Lines one above the other, with their names at the left panel."""
    axis.set_ylim(-0.7, len(names) - 0.3)
    axis.set_yticks(range(len(names)), names if shown else [])
    axis.tick_params(axis="y", length=0)
    axis.minorticks_off()


@styled
def draw_audit(found: Study, path: str | Path | None = None) -> Figure:
    """A bar per factor from its smallest to its largest value, its variants as points."""
    factors = list(dict.fromkeys(row.factor for row in found.rows))[::-1]
    figure, axes = subplots(1, 2, 1.0 + 0.255 * len(factors), beside=True)
    for axis, (part, across) in zip(axes[0], PARTS, strict=True):
        base = part_of(found.base, part)
        if found.low is not None:
            words = f"{100 * found.level:g} % statistical interval"
            axis.axvspan(part_of(found.low, part), part_of(found.high, part), color="0.85", zorder=0, label=words)
        axis.axvline(base, color="k", linewidth=0.9, label="base", zorder=1)
        for place, factor in enumerate(factors):
            values = [part_of(row.impedance, part) for row in found.of(factor=factor)]
            ends, label = [min(*values, base), max(*values, base)], "choice changed" if place == 0 else None
            style: Any = {"color": COLOURS[0], "solid_capstyle": "butt"}
            axis.plot(ends, [place] * 2, linewidth=3.5, alpha=0.45, zorder=2, **style)
            axis.plot(values, [place] * len(values), "o", color=COLOURS[0], markersize=3.2, zorder=3, label=label)
        axis.set_xlabel(across)
        _name_lines(axis, factors, part == "resistance")
    return finish(figure, path, f"{found.title}, {found.frequency:g} Hz, averaging {found.averaging}", legend=ONE_ROW)


@styled
def draw_models(found: Study, path: str | Path | None = None) -> Figure:
    """R and X with their intervals: a line a model at one frequency, curves over several."""
    rows = found.rows[::-1]
    bars = "" if found.level is None else f"; bands: {100 * found.level:g} % statistical interval"
    title = f", averaging {found.averaging}{bars}"
    names = list(dict.fromkeys(row.model for row in found.rows))
    if len(names) < len(rows):
        figure, panels = impedance_panels(3.0, r"$f$ (kHz)")
        tone = next((row.frequency for row in rows if row.distance), None)
        for axis, part in panels:
            for i, name in enumerate(names):
                mine = found.of(model=name)
                lines = [1e-3 * row.frequency for row in mine]
                if found.level is not None:
                    low, high = ([part_of(row[end], part) for row in mine] for end in ("low", "high"))
                    draw_band(axis, lines, low, high, COLOURS[i])
                values = [part_of(row.impedance, part) for row in mine]
                axis.plot(lines, values, color=COLOURS[i], linestyle=STYLES[i], label=name)
            for i, (name, value) in enumerate(found.references.items() if tone else ()):
                style: Any = {"color": "k", "markersize": 7, "markerfacecolor": "none", "zorder": 4}
                axis.plot(1e-3 * (tone or 0), part_of(value, part), MARKERS[i], label=name, **style)
        panels[1][0].axhline(0, color="0.6", linewidth=0.6, zorder=0)
        return finish(figure, path, f"{found.title}{title}", legend=4)
    figure, axes = subplots(1, 2, 1.1 + 0.25 * len(rows), beside=True)
    for axis, (part, label) in zip(axes[0], PARTS, strict=True):
        for place, row in enumerate(rows):
            if row.low is not None:
                ends = [part_of(row.low, part), part_of(row.high, part)]
                style = {"color": COLOURS[0], "alpha": 0.4, "solid_capstyle": "butt"}
                axis.plot(ends, [place] * 2, linewidth=4, **style)
            words = "educed" if place == 0 else None
            axis.plot(part_of(row.impedance, part), place, "o", color=COLOURS[0], label=words, zorder=3)
        for (name, value), style in zip(found.references.items(), REFERENCES * 9, strict=False):
            axis.axvline(part_of(value, part), label=name, **style)
        axis.set_xlabel(label)
        _name_lines(axis, [row.model for row in rows], part == "resistance")
    return finish(figure, path, f"{found.title}, {rows[0].frequency:g} Hz{title}", legend=ONE_ROW)


@styled
def draw_contributions(rows: Sequence[Row], title: str, path: str | Path | None = None) -> Figure:
    """Bars of the changes of R and X, largest on top; rows of one frequency, of ``budget_table`` or ``slope_table``."""
    total = next((row for row in rows if row["parameter"] == COMBINED), None)
    kept = [row for row in rows if row is not total][::-1]
    name = "step" if total is None else "impedance"
    figure, axes = subplots(1, 2, 1.1 + 0.22 * len(kept), beside=True)
    for axis, part, sign in zip(axes[0], ("resistance", "reactance"), "RX", strict=True):
        values = np.array([row[f"{name}_{part}"] for row in kept])
        colours = [COLOURS[int(value < 0)] for value in values]
        axis.barh(np.arange(len(kept)), 1e3 * np.abs(values), color=colours, height=0.65)
        if total is not None:
            axis.axvline(1e3 * total[f"impedance_{part}"], color="k", linestyle="--", linewidth=0.9)
        axis.set_xlim(left=0)
        per = "1 % of $p$" if total is None else "one $u(p)$"
        axis.set_xlabel(rf"$|\Delta {sign}|$ for {per}, $10^{{-3}}\rho c$")
        axis.set_yticks(range(len(kept)), [row["parameter"].replace("_", " ") for row in kept] if sign == "R" else [])
        axis.tick_params(axis="y", length=0)
    handles = [axes[0, 0].barh([0], [0], color=colour) for colour in COLOURS[:2]]
    labels = ["grows with $p$", "falls with $p$"]
    if total is not None:
        handles.append(axes[0, 0].plot([], [], "k--", linewidth=0.9)[0])
        labels.append(COMBINED)
    place_legend(figure, handles, labels, 3)
    return finish(figure, path, title)


@styled
def draw_predictions(panels: Mapping[str, Sequence[Row]], title: str, path: str | Path | None = None) -> Figure:
    """Complex plane: reference, prediction as it was, by the fit with its 95 % ellipse; a panel of rows a title."""
    figure, axes = subplots(1, len(panels), 3.6)
    names = list(dict.fromkeys(row.label for rows in panels.values() for row in rows))
    for axis, (heading, rows) in zip(axes[0], panels.items(), strict=True):
        for row in rows:
            colour, z = COLOURS[names.index(row.label)], row.impedance
            if row.true is not None:
                axis.plot(row.true.real, row.true.imag, "*", color=colour, markersize=10)
                axis.plot([row.true.real, z.real], [row.true.imag, z.imag], ":", color=colour, linewidth=0.8)
            axis.plot(row.before.real, row.before.imag, "o", color=colour, markerfacecolor="white", markersize=7)
            axis.plot(z.real, z.imag, "s", color=colour, markersize=3.5)
            axis.plot(*_ellipse(row), color=colour, linewidth=0.9)
        axis.axhline(0, color="0.8", linewidth=0.6, zorder=0)
        axis.margins(0.08)
        head_panel(axis, heading)
        axis.set_xlabel(PARTS[0][1])
    axes[0, 0].set_ylabel(PARTS[1][1])
    for i, name in enumerate(names):
        entry(axes[0, 0], name, color=COLOURS[i])
    for marker, label, face in (
        ("*", "reference", "k"),
        ("o", "model as it was", "white"),
        ("s", "calibrated, 95 % ellipse", "k"),
    ):
        entry(axes[0, 0], label, marker, markerfacecolor=face)
    return finish(figure, path, title, legend=3)


def _ellipse(row: Row) -> tuple[Any, Any]:
    """Points of the 95 % ellipse of the parameters' spread."""
    product = row.correlation * row.standard.real * row.standard.imag
    covariance = np.array([[row.standard.real**2, product], [product, row.standard.imag**2]])
    if not np.isfinite(covariance).all():
        return [], []
    widths, axes = np.linalg.eigh(covariance)
    turn = np.linspace(0, 2 * np.pi, 181)
    circle = np.stack([np.cos(turn), np.sin(turn)]) * np.sqrt(np.maximum(widths, 0))[:, None]
    points = ELLIPSE * axes @ circle
    return row.impedance.real + points[0], row.impedance.imag + points[1]


@styled
def draw_identification(found: Study, path: str | Path | None = None) -> Figure:
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
        entry(axes[0, 0], name, color=colour)
    entry(axes[0, 0], "$|v|$ that the runs see", width=5, color="0.9")
    label_axes(axes[0, 2], "$|v|$ (m s$^{-1}$)", "share of each spline in $Z$")
    return finish(figure, path, f"{at:g} Hz", legend=5)


@styled
def draw_heights(study: Study, path: str | Path | None = None) -> Figure:
    """R and X over height, by averaging."""
    figure, panels = impedance_panels(3.2, "$y$ (mm)")
    heights = [1e3 * row.height for row in study.rows]
    for axis, part in panels:
        for i, name in enumerate(study.rows[0].impedance):
            values = [part_of(row.impedance[name], part) for row in study.rows]
            axis.plot(heights, values, MARKERS[i] + "-", color=COLOURS[i], label=name)
        if "true" in study.reference:
            axis.axhline(part_of(study.reference["true"], part), label="reference", **REFERENCES[0])
    hard = " (null test)" if study.choices.get("surface") == "hard wall" else ""
    return finish(figure, path, f"{study.title}{hard}, {study.frequency:g} Hz", legend=4)


@styled
def draw_modulation(study: Study, path: str | Path | None = None) -> Figure:
    """Cell-periodic modulation over height, its fitted decay and that of an evanescent sound field."""
    figure, axes = subplots(1, 1, 3.4)
    axis, decay, heights = axes[0, 0], study.decay, np.array([one.height for one in study.rows])
    names = {
        "modulation": rf"{V_RMS}, all harmonics",
        "first_harmonic": rf"{V_RMS}, first harmonic",
        "between": rf"{V_RMS}, between harmonics",
    }
    columns = {name: [one[name] for one in study.rows] for name in names}
    shown = {name: each for name, each in columns.items() if any(value is not None for value in each)}
    for i, (name, each) in enumerate(shown.items()):
        fitted = decay is not None and decay.follows and name == "modulation"
        values = np.array(each, dtype=np.float64)
        axis.plot(1e3 * heights, values, MARKERS[i] + ("" if fitted else ":"), color=COLOURS[i], label=names[name])
        if fitted:
            text = rf"fit: $e^{{-y/l}}$, $l={1e3 * decay.length:.3g}$ mm"
            axis.plot(1e3 * heights, decay.at(heights), "-", color=COLOURS[i], label=text)
    if decay is not None:
        length = study.pitch / (2 * math.pi)
        sound = columns["first_harmonic"][0] * np.exp(-(heights - heights[0]) / length)
        axis.plot(1e3 * heights, sound, "--", color="0.3", label=rf"sound: $l=L_c/2\pi={1e3 * length:.3g}$ mm")
    axis.set_yscale("log")
    label_axes(axis, "$y$ (mm)", "cell-periodic part (rms) over mean")
    return finish(figure, path, f"{study.title}, {study.frequency:g} Hz", legend=2)

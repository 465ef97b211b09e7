"""Pictures of studies: what choices, models, parameters, heights and levels do to Z."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from torchliner.report import figure as look
from torchliner.report.figure import Rows, part_of
from torchliner.report.table import Row
from torchliner.studies.laws import impedances_at

SPEED = "$|v|$ (m s$^{-1}$)"
DRAWN = 200  # speeds of a picture
MOST_DRAWN = 60  # lines of a picture
NORMAL = 1.96  # standard deviations of a 95 % interval


@look.styled
def draw_cases(
    rows: Rows,
    path: str | Path | None = None,
    references: Mapping[str, complex] | None = None,
    title: str = "R and X of each case with its interval",
    span: tuple[str, complex, complex] | None = None,
) -> look.Figure:
    """A row a case, the first on top: a dot on a bar from ``low`` to ``high``, if known; ``others``, names and values,
    are markers too. Through all rows: ``references`` as lines, name and ends of a shaded ``span``."""
    figure, (axes,) = look.subplots(1, 2, 1.1 + 0.24 * len(rows))
    for axis, (part, label) in zip(axes, look.PARTS, strict=True):
        names = [look.plain_label(row["name"]) for row in rows]
        axis.set_yticks(range(len(rows)), names if part == "resistance" else [])
        axis.set(xlabel=label, ylim=(len(rows) - 0.3, -0.7))
        axis.tick_params(axis="y", length=0)
        axis.locator_params(axis="x", nbins=5)
        axis.use_sticky_edges = False
        styles = look.REFERENCES[span is not None :]  # a thick line would hide the span
        for style, (name, value) in zip(styles, (references or {}).items(), strict=False):
            axis.axvline(part_of(value, part), label=look.plain_label(name), **style)
        if span is not None:
            axis.axvspan(*(part_of(end, part) for end in span[1:]), color="0.88", zorder=0, label=span[0])
        for place, row in enumerate(rows):
            axis.plot(part_of(row["impedance"], part), place, **look.dots(look.COLOURS[0], "o", "", zorder=3))
            for marker, (name, values) in zip("ds*", row.get("others", {}).items(), strict=False):
                some = part_of([*values], part)
                axis.plot(some, [place] * len(some), **look.dots("k", marker, name, markerfacecolor="none", zorder=4))
            if row["low"] is not None:
                low, high = (part_of(row[end], part) for end in ("low", "high"))
                axis.barh(place, high - low, left=low, height=0.3, color=look.COLOURS[0], alpha=0.45)
    return look.finish(figure, path, title, 4)


def draw_audit(found: Any, path: str | Path | None = None) -> look.Figure:
    """A bar per factor from its smallest to its largest value, its variants as markers."""
    rows = []
    for factor in dict.fromkeys(row.factor for row in found.rows):
        values = [row.impedance for row in found.of(factor=factor)]
        ends = [[z.real for z in (*values, found.base)], [z.imag for z in (*values, found.base)]]
        row = {"name": factor, "impedance": found.base, "others": {"choice changed": values}}
        rows.append(row | {"low": complex(*map(min, ends)), "high": complex(*map(max, ends))})
    span = None if found.low is None else (f"{100 * found.level:g} % interval", found.low, found.high)
    words = f"{found.title}, {found.frequency:g} Hz, averaging {found.averaging}"
    return draw_cases(rows, path, {"base": found.base}, words, span)


def draw_comparison(found: Any, path: str | Path | None = None, frequency: float | None = None) -> look.Figure:
    """What ``compare`` found: by how much the liner and its cells differ, with intervals."""
    frequency = frequency or found.rows[0].frequency
    rows = [Row(row, name=row.place, impedance=row.difference) for row in found.of(frequency=frequency)]
    words = f"second minus first, {frequency:g} Hz, averaging {found.averaging}; {found.words}"
    return draw_cases(rows[:MOST_DRAWN], path, {"no difference": 0j}, words)


def draw_predictions(rows: Rows, title: str, path: str | Path | None = None) -> look.Figure:
    """What a fit predicts of each plane, with its 95 % interval, beside the reference and the model as it was."""
    drawn = []
    for row in rows:
        z, half = row["impedance"], NORMAL * row["standard"]
        others = {"model as it was": [row["before"]], "reference": [row["true"]]}
        place = "" if row["height"] is None else f", y = {1e3 * row['height']:.3g} mm"
        about = {"name": f"{row['label']}{place}", "label": "prediction", "impedance": z, "others": others}
        drawn.append(about | {"low": z - half, "high": z + half})
    return draw_cases(drawn, path, title=f"{title}; bars: 95 % interval of the fit")


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


def draw_levels(curve: Any, path: str | Path | None = None) -> look.Figure:
    """Resistance and reactance over level."""
    order, drawn = curve.level.argsort().tolist(), []
    for j, frequency in enumerate(curve.frequency.tolist()):
        style = look.colour_of(j, f"{frequency:g} Hz", linestyle="-", marker=look.MARKERS[j])
        drawn += [{"x": curve.level[order], "y": curve.impedance[order, j]} | style]
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

"""The page of impedances educed from microphones: lines and methods side by side."""

from __future__ import annotations

import itertools
import math
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from torchliner.file_checks import naming
from torchliner.io.whole_file import writable
from torchliner.records import FieldFit, WallEduction
from torchliner.records.origin import named_file
from torchliner.report.page.asked import _words
from torchliner.report.page.blocks import Block, Facts, Folded, Grid, Section, Text, shown
from torchliner.report.page.columns import FREQUENCY, bounded, impedance_columns
from torchliner.report.page.compared import _off, _outside
from torchliner.report.page.of_map import FOOTER
from torchliner.report.page.origin import citation, files_of, stated_origin, typed, versions
from torchliner.report.page.render import ENDING, Page, require_report
from torchliner.report.page.subject import inputs_of
from torchliner.report.page.wall_pictures import along_wall, in_planes, spectrum
from torchliner.report.page.wall_subject import WallSubject
from torchliner.report.page.warned import warnings_of
from torchliner.report.table import Column, Table, format_bounds, format_complex
from torchliner.report.typesetting import typeset
from torchliner.report.wall_table import COLUMNS, FIELD, LEVEL, WAVES, Educed

SHOWN = {WallEduction: WAVES, FieldFit: FIELD}
IN_CSV = {
    "deviation",
    "energy",
    "rise along x",
    "singular values",
}  # headings that a page is too narrow for
DIFFER = {True: "yes", False: "not shown", None: ""}
ELSEWHERE = ("command", "inputs", "version", "versions")  # choices that stand under provenance
LINE_COLUMNS = (
    Column("label", heading="eduction"), Column("name", heading="line"),
    Column("microphones", heading="microphones", text="d"),
    Column("from (m)"), Column("to (m)"), Column("", "places", "x (mm)", str),
    Column("height (m)", heading="H (mm)", text=".4g", scale=1e3),
    Column("mach", heading="M", text=".3g"), Column("source", heading="source"),
    Column("sound speed (m/s)", heading="c (m/s)", text=".5g"),
)  # fmt: skip


def report_wall(found: WallEduction | FieldFit, path: str | Path, *others: Educed) -> None:
    """One page of eductions, as ``report`` of the first with the others."""
    require_report()
    writable(path, ENDING)
    page_of_wall((found, *others)).write(path)


def page_of_wall(found: tuple[Educed, ...], path: Path | None = None) -> Page:
    """The page of eductions, of a file or in memory."""
    with naming(path) if path else nullcontext():  # what a file says of itself may be damaged
        return _page(found, path)


def _page(found: tuple[Educed, ...], path: Path | None) -> Page:
    """The whole page."""
    subject = WallSubject(found, path)
    notes = [note for one, line in zip(found, subject.lines, strict=True)
             for note in (*line.notes, *one.notes)]  # fmt: skip
    sections = [
        Section("answers", "Answer", _answers(subject)),
        Section("warnings", "Warnings", warnings_of(notes)),
        Section("asked", "What was asked", _asked(subject)),
        Section("frequencies", "Spectrum", spectrum(subject)),
        Section("along", "Along the wall", along_wall(subject)),
        Section("planes", "Complex planes", in_planes(subject)),
        Section("bars", "Error bars", _error_bars(subject)),
        Section("comparison", "Comparison", _compared(subject)),
        Section("origin", "Inputs and provenance", _origin(subject)),
        Section("cite", "Citation", citation()),
    ]
    titles = dict.fromkeys(shown(line.title or line.name) for line in subject.lines)
    return Page(f"Impedance from microphones: {'; '.join(titles)}", _sentence(subject), "",
                sections, FOOTER)  # fmt: skip


def _sentence(subject: WallSubject) -> str:
    """Z of each eduction with its interval, and of two how far they are apart."""
    frequency, there = subject.main, subject.there(subject.main)
    lead, count = f"At {frequency:g} Hz", len(subject.common)
    if count > 1:
        lead += f", the best fitted of {count} frequencies from {min(subject.common):g} to "
        lead += f"{max(subject.common):g} Hz,"
    parts, values = [], []
    for i, f in there:
        row, one = subject.rows[i][f], subject.found[i]
        label = f"source {one.source_side}" if len(there) == 1 else subject.labels[i]
        if not math.isfinite(abs(row["impedance"])):
            parts.append(f"no impedance ({label}: no wave runs away from the source)")
            continue
        values.append(row["impedance"])
        bounds = None if row["low"] is None else (row["low"], row["high"])
        interval = "without a statistical interval"
        if bounds:
            interval = f"{100 * LEVEL:g} % statistical interval: {format_bounds(bounds)}"
        parts.append(f"Z = {format_complex(row['impedance'])} ({label}; {interval})")
    methods = {shown(one.method) for one in subject.found}
    gives = "the methods give" if len(methods) > 1 else f"{methods.pop()} gives"
    text = f"{lead} {gives}, in units of ρc, {'; '.join(parts)}"
    if len(parts) == len(values) == 2:
        text += f": the two are {100 * _apart(*values):.3g} % apart"
    return typeset(f"{text}.")


def _apart(one: complex, other: complex) -> float:
    """|difference| over the mean of the moduli."""
    return 2 * abs(one - other) / (abs(one) + abs(other))


def _answers(subject: WallSubject) -> list[Block]:
    """A row an eduction and frequency, as in the table of the command."""
    kinds = dict.fromkeys(SHOWN[type(one)] for one in subject.found)
    common = set.intersection(*({c.heading for c in columns} for columns in kinds))
    rows = [row for rows in subject.rows for row in rows]
    columns = [c for c in next(iter(kinds)) if c.heading in common - IN_CSV]
    caption = (
        "Z = p/(ρc v) with exp(jωt − jαx), x along the flow. Residual: rms of what is left over "
        "that of the pressures. Over errors: residuals over the stated errors of the microphones, "
        "1 if the duct is right. Deviations, energies and singular values are in the CSV."
    )
    own = [Column("", "label", "eduction"), *columns]
    return [Grid("answer-table", caption, Table(rows, [*COLUMNS, *own], ".9g"))]


def _asked(subject: WallSubject) -> list[Block]:
    """The lines, then every choice, a column an eduction."""
    lines = [
        {"label": label, "name": shown(line.name), "microphones": line.microphones,
         "from (m)": float(line.x[0]), "to (m)": float(line.x[-1]),
         "places": f"{1e3 * float(line.x[0]):.4g} to {1e3 * float(line.x[-1]):.4g}",
         "height (m)": float(line.duct_height), "mach": float(one.choices.get("mach", line.mach)),
         "source": one.source_side, "sound speed (m/s)": float(line.fluid.sound_speed)}
        for label, line, one in zip(subject.labels, subject.lines, subject.found, strict=True)
    ]  # fmt: skip
    keys = dict.fromkeys(k for one in subject.found for k in one.choices if k not in ELSEWHERE)
    rows = [
        {"choice": key} | {str(i): _words(one.choices[key]) if key in one.choices else "-"
                           for i, one in enumerate(subject.found)}
        for key in keys
    ]  # fmt: skip
    columns = [Column("choice", heading="choice")]
    columns += [Column(label, str(i), label) for i, label in enumerate(subject.labels)]
    return [
        Grid("lines", "The microphones that were used.", Table(lines, LINE_COLUMNS, ".9g")),
        Grid("choices", "Every choice behind the result.", Table(rows, columns)),
    ]


def _error_bars(subject: WallSubject) -> list[Block]:
    """Where the intervals come from."""
    texts = []
    for one, label in zip(subject.found, subject.labels, strict=True):
        if one.draws is not None:
            level, phase = (one.choices.get(f"{key}_error", "?") for key in ("level", "phase"))
            text = f"{len(one.draws.impedance)} draws of the microphones' errors, {level} dB and {phase} degrees"
            scale = float(one.error_scale.max()) if isinstance(one, WallEduction) else 1.0
            text += f", up to {scale:.3g} times as large where the residual asks for it" if scale > 1 else ""
        elif one.covariance is None:
            text = "no interval, since the waves leave no degree of freedom"
        elif one.freedom is None:
            text = "the microphones' stated errors, to first order"
        else:
            text = f"what the waves leave, {one.freedom} degrees of freedom, to first order"
        texts.append((label, text))
    words = (
        f"What the {100 * LEVEL:g} % intervals of R and of X rest on. They say nothing of a wrong "
        "model: of waves that a method leaves out, of the flow's profile, of the duct's height."
    )
    return [Text(words), Facts(texts)]


def _compared(subject: WallSubject) -> list[Block]:
    """Each pair of eductions at every common frequency, then each less what is known."""
    rows: list[dict[str, Any]] = []
    for frequency in subject.common:
        there = subject.there(frequency)
        for (i, f), (k, g) in itertools.combinations(there, 2):
            one, other = subject.rows[i][f], subject.rows[k][g]
            rows.append(_difference(frequency, one, other["impedance"], other["label"], other))
        for i, f in there:
            rows += [_difference(frequency, subject.rows[i][f], value, name)
                     for name, value in subject.known(i, f).items()]  # fmt: skip
    if not rows:
        return [Text("One eduction, and nothing is known of the case from elsewhere.")]
    columns = [
        FREQUENCY, Column("between", heading="difference"),
        *impedance_columns("impedance", "{}", "+.3f"),
        Column("apart", heading="apart (%)", text=".3g", scale=100),
        Column("verdict", heading="differ?"),
    ]  # fmt: skip
    caption = (
        "The first less the second; apart: modulus of the difference over the mean of the moduli. "
        "The interval takes the errors of two lines as independent, and what is known from "
        "elsewhere as exact. Sources upstream and downstream of one wall that differ by more than "
        "the interval say that the model of the duct is wrong, or the wall no impedance."
    )
    return [Grid("compared-table", caption, Table(rows, columns, ".9g"))]


def _difference(frequency: float, row: dict[str, Any], value: complex, name: str, beside: Any = None) -> dict[str, Any]:
    """One row of the comparison; ``beside`` is that of the second, where it has an interval."""
    mine, bounds = row["impedance"], None
    if row["low"] is not None:
        bounds = _off((row["low"], row["high"]), value)
        if beside is not None:
            bounds = None if beside["low"] is None else _joint(row, beside)
    return {
        "frequency": frequency, "between": f"{row['label']} less {name}",
        **bounded(mine - value, bounds), "apart": _apart(mine, value),
        "verdict": DIFFER[None if bounds is None else _outside(bounds)],
    }  # fmt: skip


def _joint(one: dict[str, Any], other: dict[str, Any]) -> tuple[complex, complex]:
    """Bounds of a difference: the distances of both values to their bounds add as squares."""

    def reach(end: str, against: str) -> complex:
        a, b = one[end] - one["impedance"], other[against] - other["impedance"]
        return complex(math.hypot(a.real, b.real), math.hypot(a.imag, b.imag))

    middle = one["impedance"] - other["impedance"]
    return middle - reach("low", "high"), middle + reach("high", "low")


def _origin(subject: WallSubject) -> list[Block]:
    """Files with their hashes then and now, commands, what the lines say of themselves."""
    name = "" if subject.path else "these eductions, in memory"
    held = [each for one in subject.found for each in inputs_of(one)]
    known = {str(each["name"]) for each in held}
    files = [("microphones", named_file(line.name), line.name) for line in subject.lines
             if line.name not in known]  # fmt: skip
    blocks = [*files_of(held, [("result", subject.path, name), *files]),
              *typed([one.choices.get("command") for one in subject.found])]  # fmt: skip
    for label, line in zip(subject.labels, subject.lines, strict=True):
        if line.provenance:
            blocks.append(Folded(f"What the line says of its origin: {label}",
                                 [stated_origin(line.provenance)]))  # fmt: skip
    return [*blocks, versions(subject.found[0])]

"""The page of a line of stations."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torchliner.io.line_file import line_rows
from torchliner.records import ImpedanceLine
from torchliner.report.line_figures import draw_lines
from torchliner.report.page.answer import level_check_clause, state
from torchliner.report.page.asked import _words, liner_table
from torchliner.report.page.blocks import Block, Figure, Grid, Section, Text, shown
from torchliner.report.page.columns import FREQUENCY, bounded, impedance_columns
from torchliner.report.page.of_map import FOOTER
from torchliner.report.page.origin import citation, files_of, versions
from torchliner.report.page.render import Page
from torchliner.report.page.sizes import passing
from torchliner.report.page.subject import inputs_of
from torchliner.report.page.warned import as_notes, changed_inputs, listed
from torchliner.report.table import Column, Table, format_bounds, format_complex, plain_columns
from torchliner.report.typesetting import typeset


def page_of_line(line: ImpedanceLine, path: Path | None = None) -> Page:
    """The whole page."""
    flags = [f"{name}: {text}" for name, several in zip(line.names, line.flags, strict=True)
             for text in several]  # fmt: skip
    notes = as_notes([*changed_inputs(line), *line.notes, *flags])
    sections = [
        Section("answers", "Answer", _averages(line)),
        Section("warnings", "Warnings", listed([(note, passing(line, note)) for note in notes])),
        Section("asked", "What was asked", _asked(line)),
        Section("along", "Along the line", _along(line)),
        Section("stations-section", "Stations", [_stations(line)]),
        Section("comparison", "Comparison", _compared(line)),
        Section("origin", "Inputs and provenance", [
            *files_of(inputs_of(line), [("line", path, "" if path else "this line, in memory")]),
            versions(line),
        ]),
        Section("cite", "Citation", citation()),
    ]  # fmt: skip
    title = line.title or (path.name if path else "")
    return Page(f"Impedance line: {title}" if title else "Impedance line", _sentence(line),
                state(line, 0), sections, FOOTER)  # fmt: skip


def _sentence(line: ImpedanceLine) -> str:
    if line.average is None:
        return f"{line.stations} stations that have not been joined: no impedance of the line."
    frequency, found = float(line.frequency[0]), line.average
    text = (
        f"At {frequency:g} Hz the impedance of the line is Z = "
        f"{format_complex(complex(found.impedance[0]))} in units of ρc, from {found.stations} of "
        f"{line.stations} stations"
    )
    if found.interval is not None:
        text += f" ({_level(line)}: {format_bounds(found.interval.bounds(0))})"
    return typeset(f"{text}; {level_check_clause(line, 0)}.")


def _level(line: ImpedanceLine) -> str:
    return f"{100 * float(line.choices['interval']):g} % statistical interval"


def _averages(line: ImpedanceLine) -> list[Block]:
    found = line.average
    if found is None:
        return [Text("The stations have not been joined.")]
    rows: list[dict[str, Any]] = []
    for i, frequency in enumerate(line.frequency.tolist()):
        bounds = None if found.interval is None else found.interval.bounds(i)
        rows.append({"frequency": frequency, **bounded(complex(found.impedance[i]), bounds),
                     "spread": complex(found.spatial_spread[i])})  # fmt: skip
    columns = [
        FREQUENCY, *impedance_columns(),
        *impedance_columns("spread", "spread of {} along the line", bounds=False),
    ]  # fmt: skip
    caption = "Z = 1/mean(1/Z) over ρc over the stations that count; R and X of the spread."
    return [Grid("answer-table", caption, Table(rows, columns, ".9g"))]


def _asked(line: ImpedanceLine) -> list[Block]:
    rows = [{"choice": str(key), "value": _words(value)} for key, value in line.choices.items()
            if not isinstance(value, dict)]  # fmt: skip
    columns = [Column("choice", heading="choice"), Column("value", heading="value")]
    return [*liner_table(line.choices.get("liner")),
            Grid("choices", "Every choice behind the line.", Table(rows, columns))]  # fmt: skip


def _along(line: ImpedanceLine) -> list[Block]:
    z = line.impedance[:, 0]
    alt = (
        f"Resistance and reactance at {line.stations} stations along x, "
        f"{float(line.frequency[0]):g} Hz: R from {float(z.real.min()):.3f} to "
        f"{float(z.real.max()):.3f}, X from {float(z.imag.min()):.3f} to {float(z.imag.max()):.3f}."
    )
    caption = (
        f"Impedance of the stations at {float(line.frequency[0]):g} Hz. Light: three standard "
        "deviations over the segments; dark: statistical interval of the mean; crosses: stations "
        "that are in no average."
    )
    return [Figure("along-x", draw_lines(line), typeset(alt), caption, _station_rows(line))]


def _station_rows(line: ImpedanceLine) -> Table:
    rows = line_rows(line)
    return Table(rows, [Column(name) for name in rows[0]])


def _stations(line: ImpedanceLine) -> Grid:
    rows = line_rows(line)
    head = {
        "station": "", "x (m)": ".4g", "y (m)": ".4g", "frequency (Hz)": ".1f", "resistance": ".3f",
        "reactance": ".3f", "mean velocity (m/s)": ".3f", "velocity rms (m/s)": ".3f",
        "coherence": ".3f", "segments": ".0f", "bursts": ".0f", "counts": ".0f", "flags": ".0f",
    }  # fmt: skip
    columns = [Column(name, heading=head_of(name, head), text=head.get(name, "")) for name in rows[0]]
    return Grid("stations", "Stations, a row each and frequency.", Table(rows, columns))


def head_of(name: str, shown_names: dict[str, str]) -> str:
    """A heading for columns that are shown; "" for those of the CSV alone."""
    return name if name in shown_names else ""


def _compared(line: ImpedanceLine) -> list[Block]:
    known = {shown(name): complex(value) for name, value in line.reference.items()}
    if line.goodrich is not None:
        known["Goodrich (2.7), linear liner"] = complex(line.goodrich[0])
    if not known:
        return [Text("The line holds no reference.")]
    rows = [{"name": name, "impedance": value} for name, value in known.items()]
    columns = [Column("name", heading="known from elsewhere"), *plain_columns("impedance*"),
               Column("", "impedance", "Z", format_complex)]  # fmt: skip
    return [Grid("compared-table", "What is known of the case from elsewhere.", Table(rows, columns))]

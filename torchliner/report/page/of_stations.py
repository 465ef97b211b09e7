"""The pages of lines of stations and of impedances at points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from torchliner.io.line_file import line_rows
from torchliner.records import ImpedanceLine, PointImpedances
from torchliner.report.alongside import draw_cells, points_along_x
from torchliner.report.figure import (
    COLOURS,
    draw_curve,
    finish,
    impedance_panels,
    styled,
)
from torchliner.report.figure import Figure as Drawing
from torchliner.report.line_figures import draw_lines
from torchliner.report.page.blocks import Block, Figure, Grid, Section, shown
from torchliner.report.page.of_map import level_check_clause, one_of, state
from torchliner.report.page.render import Page
from torchliner.report.page.sections import FOOTER, asked, changed, citation, origin, warned
from torchliner.report.page.tables import (
    FREQUENCY,
    bounded,
    compared,
    difference,
    impedance_columns,
    off,
)
from torchliner.report.table import Column, Table, format_bounds, format_complex
from torchliner.report.typesetting import typeset

ORDERS = {"": "admittance over points", "_pressure_first": "pressure first"}


def page_of_line(line: ImpedanceLine, path: Path | None = None) -> Page:
    """Of a line of stations."""
    flags = [f"{name}: {text}" for name, several in zip(line.names, line.flags, strict=True) for text in several]
    frequency, found, rows = line.frequency.tolist(), line.average, line_rows(line)
    answer = f"{line.stations} stations that have not been joined: no impedance of the line."
    averages: list[Block] = []
    known: list[dict[str, Any]] = []
    if found is not None:
        ends = [None if found.interval is None else found.interval.bounds(i) for i in range(len(frequency))]
        values = [bounded(complex(z), end) for z, end in zip(found.impedance, ends, strict=True)]
        level = "" if ends[0] is None else f", statistical interval: {format_bounds(ends[0])}"
        answer = (
            f"At {one_of(frequency)}, the impedance of the line is Z = {format_complex(values[0]['impedance'])} in "
            f"units of ρc, from {found.stations} of {line.stations} stations{level}; {level_check_clause(line, 0)}."
        )
        listed = [{"frequency": f} | value for f, value in zip(frequency, values, strict=True)]
        table = Table(listed, [FREQUENCY, *impedance_columns()], ".9g")
        averages = [Grid("answer-table", "Z = 1/mean(1/Z) over ρc over the stations that count.", table)]
        beside = {shown(name): complex(z) for name, z in line.reference.items()}
        beside |= {} if line.goodrich is None else {"Goodrich (2.7), linear liner": complex(line.goodrich[0])}
        known = [difference(frequency[0], values[0], name, z, off(values[0], z)) for name, z in beside.items()]
    caption = (
        f"Impedance of the stations at {frequency[0]:g} Hz. Light: three standard deviations over the segments; dark: "
        "statistical interval of the mean; crosses: stations that are in no average."
    )
    numbers = Table(rows, [Column(name) for name in rows[0]])
    heads = {"station": "", "x (m)": ".4g", "y (m)": ".4g", "frequency (Hz)": ".1f", "resistance": ".3f",
             "reactance": ".3f", "coherence": ".3f", "segments": ".0f", "bursts": ".0f", "flags": ".0f"}  # fmt: skip
    columns = [Column(name, heading=name if name in heads else "", text=heads.get(name, "")) for name in rows[0]]
    return Page(
        f"Impedance line: {line.title or (path.name if path else 'in memory')}",
        typeset(answer),
        state(line, 0),
        [
            Section("answers", "Answer", averages),
            warned([*changed(line), *line.notes, *flags]),
            Section("along", "Along the line", [Figure("along-x", draw_lines(line), caption, numbers)]),
            Section("stations-section", "Stations", [Grid("stations", "A row a station and frequency.",
                                                          Table(rows, columns))]),
            Section("comparison", "Comparison", [compared(known, "The line less what is known from elsewhere.")]),
            asked(line.choices),
            origin([line], path),
            citation(),
        ],
        FOOTER,
    )  # fmt: skip


def page_of_points(found: PointImpedances, path: Path | None = None) -> Page:
    """Of impedances at points and cells, as an in situ measurement gives them."""
    frequency, rows = found.frequency.tolist(), []
    for i, f in enumerate(frequency):
        for end, order in ORDERS.items():
            where = {"frequency": f, "order": order}
            whole = bounded(getattr(found, f"liner_impedance{end}")[i], found.bounds_of_liner(end, i))
            rows.append({"place": "whole surface", **where, **whole})
            for cell, z in enumerate(getattr(found, f"cell_impedance{end}")[:, i]):
                rows.append({"place": f"cell {cell}", **where, **bounded(z, found.bounds_of_cell(cell, end, i))})
    columns = [Column("place", heading="place"), Column("order", heading="order of averaging"), FREQUENCY]
    columns += impedance_columns(bounds=found.uncertainty is not None)
    along: list[Block] = []
    if int(torch.isfinite(found.point_impedance[:, 0].real).sum()) > 1:
        caption = (
            f"Impedance along x at {frequency[0]:g} Hz; crosses: cells, filled, admittance over points, and open, "
            "pressure first."
        )
        along = [Figure("along-x", _draw_points(found), caption, points_along_x(found).table)]
    level, bounds = "", found.bounds_of_liner()
    if bounds is not None and found.uncertainty is not None:
        share = 100 * found.uncertainty.settings["level"]
        level = f"; {share:g} % statistical interval: {format_bounds(bounds)}"
    answer = (
        f"At {one_of(frequency)}, the impedance of the whole surface is Z = {format_complex(complex(found.answer[0]))} "
        f"in units of ρc ({shown(found.name)}, admittance over points{level})."
    )
    table = Grid("answer-table", "Z over ρc of the whole surface and of each cell.", Table(rows, columns, ".9g"))
    return Page(
        f"Impedances: {found.name}",
        typeset(answer),
        "",
        [
            Section("answers", "Answer", [table]),
            warned([*changed(found), *found.notes]),
            Section("along", "Along x", along),
            asked(found.choices),
            origin([found], path),
            citation(),
        ],
        FOOTER,
    )


@styled
def _draw_points(found: PointImpedances) -> Drawing:
    figure, panels = impedance_panels(3.0, "$x$ (mm)")
    for axis, part in panels:
        draw_curve(axis, points_along_x(found), part, COLOURS[0], 1e3, label="points")
        draw_cells(axis, found, part, 0, "")
    return finish(figure, None, legend=4)

"""The page of impedances at points and cells, as an in situ measurement gives them."""

from __future__ import annotations

from pathlib import Path

import torch

from torchliner.records import PointImpedances
from torchliner.report.alongside import draw_cells, points_along_x
from torchliner.report.figure import COLOURS, draw_curve, finish, impedance_panels, styled
from torchliner.report.figure import Figure as Drawing
from torchliner.report.page.asked import _words
from torchliner.report.page.blocks import Block, Figure, Grid, Section, Text, shown
from torchliner.report.page.columns import FREQUENCY, bounded, impedance_columns
from torchliner.report.page.of_map import FOOTER
from torchliner.report.page.origin import citation, files_of, versions
from torchliner.report.page.render import Page
from torchliner.report.page.subject import inputs_of
from torchliner.report.page.warned import changed_inputs, warnings_of
from torchliner.report.table import Column, Table, format_bounds, format_complex
from torchliner.report.typesetting import typeset

ORDERS = {"": "admittance over points", "_pressure_first": "pressure first"}


def page_of_points(found: PointImpedances, path: Path | None = None) -> Page:
    """The whole page."""
    source = str(found.choices.get("source", ""))
    files = [("points", path, "" if path else "these points, in memory")]
    files += [("pressures", Path(source), source)] if source else []
    bounds, z = found.bounds_of_liner(), complex(found.answer[0])
    level = ""
    if bounds is not None and found.uncertainty is not None:
        share = 100 * found.uncertainty.settings["level"]
        level = f"; {share:g} % statistical interval: {format_bounds(bounds)}"
    answer = (
        f"At {float(found.frequency[0]):g} Hz the impedance of the whole surface is Z = "
        f"{format_complex(z)} in units of ρc ({shown(found.name)}, admittance over points{level})."
    )
    choices = [{"choice": str(key), "value": _words(value)} for key, value in found.choices.items()]
    columns = [Column("choice", heading="choice"), Column("value", heading="value")]
    sections = [
        Section("answers", "Answer", [_table(found)]),
        Section("warnings", "Warnings", warnings_of([*changed_inputs(found), *found.notes])),
        Section("asked", "What was asked",
                [Grid("choices", "Every choice.", Table(choices, columns))] if choices else []),
        Section("along", "Along x", _along(found)),
        Section("origin", "Inputs and provenance",
                [*files_of(inputs_of(found), files), versions(found)]),
        Section("cite", "Citation", citation()),
    ]  # fmt: skip
    return Page(f"Impedances: {found.name}", typeset(answer), "", sections, FOOTER)


def _table(found: PointImpedances) -> Grid:
    """The whole surface, then the cells, in both orders."""
    rows = []
    for i, frequency in enumerate(found.frequency.tolist()):
        for end, order in ORDERS.items():
            where = {"frequency": frequency, "order": order}
            values = getattr(found, f"liner_impedance{end}")[i], found.bounds_of_liner(end, i)
            rows.append({"place": "whole surface", **where, **bounded(*values)})
            for cell, z in enumerate(getattr(found, f"cell_impedance{end}")[:, i]):
                values = z, found.bounds_of_cell(cell, end, i)
                rows.append({"place": f"cell {cell}", **where, **bounded(*values)})
    columns = [
        Column("place", heading="place"), Column("order", heading="order of averaging"),
        FREQUENCY, *impedance_columns(bounds=found.uncertainty is not None),
    ]  # fmt: skip
    return Grid("answer-table", "Z over ρc of the whole surface and of each cell.",
                Table(rows, columns, ".9g"))  # fmt: skip


def _along(found: PointImpedances) -> list[Block]:
    known = torch.isfinite(found.point_impedance[:, 0].real)
    if int(known.sum()) < 2:
        return [Text("Fewer than two points: there is nothing along x.")]
    curves = points_along_x(found)
    low = {part: (min(v), max(v)) for part, v in curves.values.items()}
    alt = f"Two curves along x at {float(found.frequency[0]):g} Hz: " + "; ".join(
        f"{part} from {a:.3f} to {b:.3f}" for part, (a, b) in low.items()
    ) + "."  # fmt: skip
    caption = (
        f"Impedance along x at {float(found.frequency[0]):g} Hz; crosses: cells, filled, "
        "admittance over points, and open, pressure first."
    )
    return [Figure("along-x", _draw(found), typeset(alt), caption, curves.table)]


@styled
def _draw(found: PointImpedances) -> Drawing:
    curves = points_along_x(found)
    figure, panels = impedance_panels(3.0, "$x$ (mm)")
    for axis, part in panels:
        draw_curve(axis, curves, part, COLOURS[0], 1e3, label="points")
        draw_cells(axis, found, part, 0, "")
    return finish(figure, None, legend=4)

"""The map beside what is known of the case from elsewhere, and beside the shipped truths."""

from __future__ import annotations

import math
from typing import Any

from torchliner.audits.known_truths import nearest_truth
from torchliner.records.impedance_map import ENDS
from torchliner.report.alongside import differences
from torchliner.report.page.blocks import Block, Grid, Text, shown
from torchliner.report.page.columns import FREQUENCY, bounded, impedance_columns
from torchliner.report.page.complex_plane import known_of
from torchliner.report.page.subject import MapSubject
from torchliner.report.table import Column, Table, format_complex, plain_columns
from torchliner.report.typesetting import typeset

COLUMNS = (
    FREQUENCY,
    Column("name", heading="known from elsewhere"),
    Column("", "impedance", "Z", format_complex),
    *plain_columns("impedance*"),
    *impedance_columns("difference", "map less that, {}", "+.3f"),
    Column("", "verdict", "do they differ?"),
)
VERDICTS = {True: "they differ", False: "no difference is shown", None: ""}


def compared(subject: MapSubject) -> list[Block]:
    """A row a reference and frequency; nearest known truth."""
    result, rows = subject.result, []
    for i, frequency in enumerate(result.frequency.tolist()):
        mine = complex(result.answer[i])
        seen = {row["between"].partition(" less ")[2]: row for row in differences([result], i)}
        for name, value in known_of(result, i).items():
            row = seen.get(name, {})
            bounds = None if row.get("low") is None else (row["low"], row["high"])
            if bounds is None:
                bounds = _off(result.bounds_of_liner(result.order, i), value)
                outside = None if bounds is None else _outside(bounds)
            else:
                outside = bool(row["differs"])
            rows.append({
                "frequency": frequency, "name": name, **bounded(value, bounds),
                "difference": mine - value, "verdict": VERDICTS[outside],
            })  # fmt: skip
    blocks: list[Block] = []
    if rows:
        caption = (
            f"The answer of the map ({result.order}) less what is known from elsewhere. The "
            "interval is the joint statistical one where both have one, else the map's alone."
        )
        if result.tone is not None and result.reference:
            caption += f" What the data file states is of its tone, {float(result.frequency[result.tone]):g} Hz."
        blocks.append(Grid("compared-table", caption, Table(rows, COLUMNS, ".9g")))
    else:
        text = "The map holds no reference: no true, in situ or other impedance."
        if result.reference:
            text = (
                f"What the data file states, {', '.join(result.reference)}, is of its tone, "
                "and no frequency of the map is known to be that."
            )
        blocks.append(Text(text))
    line = nearest_truth(result, subject.main)
    return [*blocks, Text(typeset(shown(line[:1].upper() + line[1:])))] if line else blocks


def _off(bounds: Any, value: complex) -> tuple[complex, complex] | None:
    return None if bounds is None else (bounds[0] - value, bounds[1] - value)


def _outside(bounds: tuple[complex, complex]) -> bool | None:
    low, high = bounds
    if math.isnan(abs(low)):
        return None
    return low.real > 0 or high.real < 0 or low.imag > 0 or high.imag < 0


def cells(subject: MapSubject) -> list[Block]:
    """Each cell: Z in the order of the answer, its interval, its closure."""
    result, rows = subject.result, []
    found, closure = result.uncertainty, result.closure
    values = result.of_cells(result.order)
    for i in subject.drawn:
        for cell, z in enumerate(values[:, i].tolist()):
            bounds = None if found is None else getattr(
                found, f"cells{ENDS[result.order]}").bounds(cell, i)  # fmt: skip
            off = None if closure is None else closure.cells.at(
                closure.orders.index(result.order), cell, i)["level"]  # fmt: skip
            rows.append({
                "cell": cell, "frequency": float(result.frequency[i]), **bounded(z, bounds),
                "x": float(result.cell_x[cell]), "z": float(result.cell_z[cell]), "closure": off,
            })  # fmt: skip
    if not rows:
        return [Text("No cell holds a probe.")]
    columns = [
        Column("cell", heading="cell", text="d"),
        Column("x (m)", "x", "x (mm)", ".2f", 1e3), Column("z (m)", "z", "z (mm)", ".2f", 1e3),
        FREQUENCY, *impedance_columns(bounds=found is not None),
    ]  # fmt: skip
    if closure is not None:
        columns.append(Column("closure (dB)", "closure", "closure (dB)", "+.2f"))
    caption = f"Impedance of each cell over ρc, {result.order}."
    return [Grid("cells", caption, Table(rows, columns, ".9g"))]

"""The map beside what is known of the case from elsewhere, and beside the shipped references."""

from __future__ import annotations

import math
from typing import Any

from torchliner.report.alongside import differences
from torchliner.report.page.blocks import Block, Grid, Text, shown
from torchliner.report.page.columns import FREQUENCY, bounded, impedance_columns
from torchliner.report.page.complex_plane import known_of
from torchliner.report.page.subject import MapSubject
from torchliner.report.table import Column, Table, format_complex, plain_columns
from torchliner.report.typesetting import typeset
from torchliner.studies.reference_cases import nearest_case

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
    """A row a reference and frequency; nearest reference case."""
    result, rows = subject.result, []
    for i, frequency in enumerate(result.frequency.tolist()):
        mine = complex(result.answer[i])
        seen = {row["between"].partition(" less ")[2]: row for row in differences([result], i)}
        for name, value in known_of(result, i).items():
            row = seen.get(name, {})
            bounds = None if row.get("low") is None else (row["low"], row["high"])
            if bounds is None:
                bounds = _off(result.bounds_of_liner(result.averaging, i), value)
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
            f"The answer of the map (averaging {result.averaging}) less what is known from elsewhere. The "
            "interval is the joint statistical one where both have one, else the map's alone."
        )
        if result.tone is not None and result.reference:
            caption += f" What the data file states is of its tone, {float(result.frequency[result.tone]):g} Hz."
        blocks.append(Grid("compared-table", caption, Table(rows, COLUMNS, ".9g")))
    else:
        text = "The map holds no reference impedance."
        if result.reference:
            text = (
                f"What the data file states, {', '.join(result.reference)}, is of its tone, "
                "and no frequency of the map is known to be that."
            )
        blocks.append(Text(text))
    line = nearest_case(result, subject.main)
    return [*blocks, Text(typeset(shown(line[:1].upper() + line[1:])))] if line else blocks


def _off(bounds: Any, value: complex) -> tuple[complex, complex] | None:
    return None if bounds is None else (bounds[0] - value, bounds[1] - value)


def _outside(bounds: tuple[complex, complex]) -> bool | None:
    low, high = bounds
    if math.isnan(abs(low)):
        return None
    return low.real > 0 or high.real < 0 or low.imag > 0 or high.imag < 0


def cells(subject: MapSubject) -> list[Block]:
    """Each cell: Z in the averaging of the answer, its interval, its level check."""
    result, rows = subject.result, []
    found, check = result.cells[result.averaging], result.level_check
    for i in subject.drawn:
        for cell, z in enumerate(found.impedance[:, i].tolist()):
            bounds = None if found.interval is None else found.interval.bounds(cell, i)
            off = None if check is None else check.cells.at(
                check.averagings.index(result.averaging), cell, i)["level"]  # fmt: skip
            rows.append({
                "cell": cell, "frequency": float(result.frequency[i]), **bounded(z, bounds), "level check": off,
                "x": float(result.cell_x[cell]), "z": float(result.cell_z[cell]),
            })  # fmt: skip
    if not rows:
        return [Text("No cell holds a probe.")]
    columns = [
        Column("cell", heading="cell", text="d"),
        Column("x (m)", "x", "x (mm)", ".2f", 1e3), Column("z (m)", "z", "z (mm)", ".2f", 1e3),
        FREQUENCY, *impedance_columns(bounds=found.interval is not None),
    ]  # fmt: skip
    if check is not None:
        columns.append(Column("level check (dB)", "level check", "level check (dB)", "+.2f"))
    caption = f"Impedance of each cell over ρc, averaging {result.averaging}."
    return [Grid("cells", caption, Table(rows, columns, ".9g"))]

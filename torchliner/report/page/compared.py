"""The map beside what is known of the case from elsewhere, and beside the shipped truths."""

from __future__ import annotations

import math
from typing import Any

from torchliner.audits.known_truths import nearest_truth
from torchliner.report.alongside import differences
from torchliner.report.page.blocks import Block, Grid, Text, shown, typeset
from torchliner.report.page.complex_plane import known_of
from torchliner.report.page.subject import MapSubject
from torchliner.report.table import Column, Table, format_bounds, format_complex, plain_columns

COLUMNS = (
    Column("frequency (Hz)", "frequency", "f (Hz)", ".1f"),
    Column("name", heading="known from elsewhere"),
    *plain_columns("impedance* difference* low* high*", None),
    Column("", "impedance", "Z", format_complex),
    Column("", "difference", "map less that", format_complex),
    Column("", lambda row: abs(row["difference"]), "|difference|", ".3f"),
    Column("", "bounds", "interval of the difference", format_bounds),
    Column("", lambda row: row["verdict"], "do they differ?"),
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
            low, high = bounds or (None, None)
            rows.append({
                "frequency": frequency, "name": name, "impedance": value, "low": low, "high": high,
                "difference": mine - value, "bounds": bounds, "verdict": VERDICTS[outside],
            })  # fmt: skip
    blocks: list[Block] = []
    if rows:
        caption = (
            f"The answer of the map ({result.order}) less what is known from elsewhere. The interval "
            "is the joint statistical one where both have one, else the map's alone."
        )
        blocks.append(Grid("compared-table", caption, Table(rows, COLUMNS, ".9g")))
    else:
        blocks.append(Text("The map holds no reference: no true, in situ or other impedance."))
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
    from torchliner.records.impedance_map import ENDS

    values = result.of_cells(result.order)
    for i in subject.drawn:
        for cell, z in enumerate(values[:, i].tolist()):
            bounds = None if found is None else getattr(
                found, f"cells{ENDS[result.order]}").bounds(cell, i)  # fmt: skip
            off = None if closure is None else closure.cells.at(
                closure.orders.index(result.order), cell, i)["level"]  # fmt: skip
            low, high = bounds or (None, None)
            rows.append({
                "cell": cell, "frequency": float(result.frequency[i]), "impedance": z,
                "x": float(result.cell_x[cell]), "z": float(result.cell_z[cell]),
                "low": low, "high": high, "bounds": bounds, "closure": off,
            })  # fmt: skip
    if not rows:
        return [Text("No cell holds a probe.")]
    columns = [
        Column("cell", heading="cell", text="d"),
        Column("x (m)", "x", "x (mm)", ".2f", 1e3), Column("z (m)", "z", "z (mm)", ".2f", 1e3),
        Column("frequency (Hz)", "frequency", "f (Hz)", ".1f"),
        *plain_columns("impedance* low* high*", None),
        Column("", lambda row: row["impedance"].real, "R", ".3f"),
        Column("", lambda row: row["impedance"].imag, "X", ".3f"),
    ]  # fmt: skip
    if found is not None:
        columns.append(Column("", "bounds", "statistical interval", format_bounds))
    if closure is not None:
        columns.append(Column("closure (dB)", "closure", "closure (dB)", "+.2f"))
    caption = f"Impedance of each cell over ρc, {result.order}."
    return [Grid("cells", caption, Table(rows, columns, ".9g"))]

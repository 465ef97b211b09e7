"""Which choices move the result: the audit that moments give at once."""

from __future__ import annotations

import warnings

from torchliner.checks import DataWarning
from torchliner.report.audit_report import draw_audit, plain_audit
from torchliner.report.page.blocks import Block, Bullets, Figure, Folded, Grid, Text, shown
from torchliner.report.page.columns import impedance_columns
from torchliner.report.page.subject import MapSubject, base_choices
from torchliner.report.table import Column, Table, format_complex
from torchliner.report.typesetting import typeset
from torchliner.studies.audit import audit
from torchliner.studies.factors import AUDITED

NOT_BASE = (*AUDITED, "averaging", "device")
COLUMNS = (
    Column("factor", heading="choice"), Column("variant", heading="changed to"),
    *impedance_columns(bounds=False), *impedance_columns("change", "change of {}", "+.3f", False),
    Column("level check (dB)", "level_check", "level check (dB)", "+.2f"),
)  # fmt: skip


def moved(subject: MapSubject) -> list[Block]:
    """A row a variant, the largest mover first; why there is none."""
    result, index = subject.result, subject.main
    reason = _missing(subject)
    if reason or subject.known is None:
        return [Text(reason)]
    frequency = float(result.frequency[index])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)  # those of the map stand above
            found = audit(
                subject.known, subject.model, frequency, averaging=result.averaging,
                **base_choices(result, NOT_BASE),
            )  # type: ignore[arg-type]  # fmt: skip
    except ValueError as error:
        return [Text(f"The choices cannot be varied: {shown(error)}.")]
    mine = complex(result.answer[index])
    rows = plain_audit(found)["rows"]
    largest = found.rows[0] if found.rows else None
    most = "" if largest is None else (
        f"The largest mover is {largest.factor}: {largest.variant} moves Z by "
        f"{format_complex(largest.change)}. "
    )  # fmt: skip
    text = (
        f"{most}Base: Z = {format_complex(found.base)} at {frequency:g} Hz, averaging {found.averaging}, phase "
        f"averaged; the map has {format_complex(mine)}. "
        "From moments, without reading the data again; choices that need the samples (drive, "
        "mean, averaging length, heights) are in torchliner audit."
    )
    alt = "Bars of resistance and reactance from the smallest to the largest value by choice: " + (
        "; ".join(f"{row.factor}, {row.variant}: {format_complex(row.change)}"
                  for row in found.rows[:6]) + "."
    )  # fmt: skip
    caption = (
        "What each choice does to Z by itself: bars from the smallest to the largest value, points "
        "are the variants; the grey band is the statistical interval."
    )
    table = Table(rows, COLUMNS, ".9g")
    blocks: list[Block] = [
        Text(typeset(text)),
        Figure("audit", draw_audit(found), typeset(alt), caption, table),
        Grid(
            "audit-table",
            typeset(
                f"Variants, by how far they move Z, at {frequency:g} Hz. Level check: {shown(found.level_check_words)}."
            ),
            table,
        ),
    ]
    if found.skipped:
        reasons = [f"{key}: {shown(why)}" for key, why in found.skipped.items()]
        blocks.append(Folded("Not varied with these data, and why", [Bullets(reasons)]))
    return blocks


def _missing(subject: MapSubject) -> str:
    """Why the choices are not varied; "" where they can be."""
    if subject.known is None:
        return (
            "Which choices move the result follows from the data or their moments, which are not "
            "given (--data, or data= in Python)."
        )
    if subject.result.choices.get("incident") is not None:
        return "The map is of a replayed wave; an audit is of tones."
    return subject.without

"""The answer in one sentence, and in a table: every order of averaging at every frequency."""

from __future__ import annotations

from typing import Any

from torchliner.records import ImpedanceMap
from torchliner.records.closure import CLOSES, FAILS, OPEN
from torchliner.report.map_table import NULL_TEST
from torchliner.report.page.blocks import Block, Grid, Text, shown
from torchliner.report.page.columns import FREQUENCY, bounded, impedance_columns
from torchliner.report.page.subject import MapSubject
from torchliner.report.table import Column, Table, format_bounds, format_complex
from torchliner.report.typesetting import typeset

VERDICTS = {CLOSES: "closes", OPEN: "stays open", FAILS: "fails"}


def sentence(subject: MapSubject) -> str:
    """Z of the liner, its interval and its closure check."""
    result, index = subject.result, subject.main
    value = complex(result.answer[index])
    frequency = float(result.frequency[index])
    if value != value:
        return f"No impedance at {frequency:g} Hz: every probe counts as wall or was left out."
    lead = f"At {frequency:g} Hz"
    if len(result.frequency) > 1:
        low, high = float(result.frequency.min()), float(result.frequency.max())
        lead += f", one of {len(result.frequency)} frequencies from {low:g} to {high:g} Hz,"
    what = "the impedance of the whole liner is"
    if is_null(result):
        what = "above a hard wall, a null test without any liner, the model gives"
    text = f"{lead} {what} Z = {format_complex(value)} in units of ρc"
    bounds = result.bounds_of_liner(result.order, index)
    if bounds is None:
        text += f" ({result.order}), without a statistical interval"
    else:
        level = 100 * float(result.uncertainty.settings["level"])  # type: ignore[union-attr]
        text += f" ({result.order}; {level:g} % statistical interval: {format_bounds(bounds)})"
    return typeset(f"{text}; {closure_clause(result, index)}.")


def closure_clause(result: Any, index: int, order: str | None = None) -> str:
    """'the closure check fails: -1.93 dB off ...', or why there is none."""
    closure, order = result.closure, order or getattr(result, "order", None)
    if closure is None:
        return f"closure: {shown(result.closure_words)}"
    order = order or closure.order
    verdict = closure.verdict(order, index)
    if not verdict:
        return "closure: no pressure is known at this frequency"
    off = closure.words(order, index).removesuffix(verdict).strip()
    return f"the closure check {VERDICTS[verdict]}: {off} {shown(result.closure_words)}"


def state(result: Any, index: int) -> str:
    """Of the closure check of the answer; "" without one."""
    return "" if result.closure is None else str(result.closure.verdict(result.closure.order, index))


def is_null(result: ImpedanceMap) -> bool:
    """Whether there is a hard wall and no liner."""
    return result.choices.get("surface") == "hard wall"


def answers(subject: MapSubject) -> list[Block]:
    """A row an order of averaging and frequency, that of the answer first."""
    result, closure, rows = subject.result, subject.result.closure, []
    orders = sorted(result.orders, key=lambda each: each != result.order)
    for i, frequency in enumerate(result.frequency.tolist()):
        for order in orders:
            z, bounds = complex(result.of_liner(order)[i]), result.bounds_of_liner(order, i)
            words = "-" if closure is None else typeset(closure.words(order, i))
            rows.append({"frequency": frequency, "order": order, **bounded(z, bounds),
                         "shown": f"{order} (the answer)" if order == result.order else order,
                         "closure": words})  # fmt: skip
    columns = [
        FREQUENCY, Column("order"), Column("", "shown", "order of averaging"),
        *impedance_columns(bounds=result.uncertainty is not None),
        Column("closure", heading="" if closure is None else "closure"),
    ]  # fmt: skip
    caption = f"Impedance of the whole liner over ρc, Z = R + jX. {MEANINGS}"
    blocks: list[Block] = [Grid("answer-table", caption, Table(rows, columns, ".9g"))]
    return [Text(NULL_TEST), *blocks] if is_null(result) else blocks


MEANINGS = (
    "Probes first: the admittance is averaged over the probes. Velocity first: the velocity is "
    "averaged over each cell and then replayed. Coherent first: only what of the velocity is "
    "periodic with the tone is averaged over the cell."
)

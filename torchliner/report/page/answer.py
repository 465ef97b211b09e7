"""The answer in one sentence, and in a table: every averaging at every frequency."""

from __future__ import annotations

from torchliner.records import ImpedanceLine, ImpedanceMap
from torchliner.records.level_check import INCONCLUSIVE
from torchliner.report.map_table import NULL_TEST
from torchliner.report.numbers import interval_words
from torchliner.report.page.blocks import Block, Grid, Text, shown
from torchliner.report.page.columns import FREQUENCY, bounded, impedance_columns
from torchliner.report.page.subject import MapSubject
from torchliner.report.table import Column, Table, format_bounds, format_complex
from torchliner.report.typesetting import typeset


def sentence(subject: MapSubject) -> str:
    """Z of the liner, its interval and its level check."""
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
    bounds = result.bounds_of_liner(result.averaging, index)
    if bounds is None:
        text += f" (averaging {result.averaging}), without a statistical interval"
    else:
        text += f" (averaging {result.averaging}; {interval_words(result)}: {format_bounds(bounds)})"
    return typeset(f"{text}; {level_check_clause(result, index)}.")


def level_check_clause(result: ImpedanceMap | ImpedanceLine, index: int) -> str:
    """'the level check fails: -1.93 dB off ...', or why there is none."""
    check, words = result.level_check, shown(result.level_check_words)
    if check is None:
        return f"level check: {words}"
    verdict = check.verdict(check.averaging, index)
    if not verdict:
        return "level check: no pressure is known at this frequency"
    off = check.words(check.averaging, index).removesuffix(verdict).strip()
    return f"the level check {'is ' * (verdict == INCONCLUSIVE)}{verdict}: {off} {words}"


def state(result: ImpedanceMap | ImpedanceLine, index: int) -> str:
    """Of the level check of the answer; "" without one."""
    check = result.level_check
    return "" if check is None else check.verdict(check.averaging, index)


def is_null(result: ImpedanceMap) -> bool:
    """Whether there is a hard wall and no liner."""
    return result.choices.get("surface") == "hard wall"


def answers(subject: MapSubject) -> list[Block]:
    """A row an averaging and frequency, that of the answer first."""
    result, check, rows = subject.result, subject.result.level_check, []
    for i, frequency in enumerate(result.frequency.tolist()):
        for name in sorted(result.averagings, key=lambda each: each != result.averaging):
            z, bounds = complex(result.liner[name].impedance[i]), result.bounds_of_liner(name, i)
            words = "-" if check is None else typeset(check.words(name, i))
            rows.append({"frequency": frequency, "averaging": name, **bounded(z, bounds),
                         "shown": f"{name} (the answer)" if name == result.averaging else name,
                         "level check": words})  # fmt: skip
    columns = [
        FREQUENCY, Column("averaging"), Column("", "shown", "averaging"),
        *impedance_columns(bounds=result.level is not None),
        Column("level check", heading="" if check is None else "level check"),
    ]  # fmt: skip
    caption = f"Impedance of the whole liner over ρc, Z = R + jX. {MEANINGS}"
    blocks: list[Block] = [Grid("answer-table", caption, Table(rows, columns, ".9g"))]
    return [Text(NULL_TEST), *blocks] if is_null(result) else blocks


MEANINGS = (
    "Admittance: each probe is driven by its own velocity, and the admittance is averaged over the probes. Velocity: "
    "the velocity is averaged over each cell. Phase-locked: only what of the velocity is periodic with the tone is "
    "averaged over the cell."
)

"""Maps as a short text table and for JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from torchliner.records import ImpedanceMap
from torchliner.records.level_matched import LevelMatched
from torchliner.report.alongside import alongside_surfaces, difference_lines, differences
from torchliner.report.level_check_report import level_check_lines, plain_level_check
from torchliner.report.numbers import HeightRow, against_height, case_title, interval_words
from torchliner.report.table import (
    Column,
    Table,
    format_bounds,
    format_complex,
    format_pair,
    format_references,
)
from torchliner.studies.reference_cases import nearest_case
from torchliner.velocity.background import background_words

NULL_TEST = (
    "NULL TEST, the wall below these data is hard and has no liner; the values only show how this "
    "model responds to such a velocity"
)
MATCHED = "|Z + 1| or |Z| measured by pressure and velocity, the phase by the model"
WHERE = (Column("", "height", "y mm", ".2f", 1e3), Column("", "frequency", "f Hz", ".1f"))


def format_maps(results: Sequence[ImpedanceMap]) -> str:
    """One row per height and frequency; intervals; results of other methods; the choices."""
    rows, answer = against_height(results), results[0].averaging
    averagings = sorted(results[0].averagings, key=lambda each: each != answer)
    lines = [Table(rows, (*WHERE, *_averages(averagings))).as_text()]
    words = interval_words(results[0])
    if words:
        intervals = [Column("", _of("interval", name), name, format_bounds) for name in averagings]
        lines.append(f"\n{words} (the spread above is that over probes, no uncertainty)\n"
                     f"{Table(rows, (*WHERE, *intervals)).as_text()}\n")  # fmt: skip
    lines += level_check_lines(results, WHERE)
    lines += [line for result in results for line in matched_lines(result)]
    lines += [*_beside(results), *difference_lines(results), *_nearest(results)]
    return "\n".join([*lines, _choices(results[0])])


def _of(name: str, averaging: str) -> Callable[[HeightRow], Any]:
    return lambda row: getattr(row, name).get(averaging)


def _averages(averagings: Sequence[str]) -> list[Column]:
    return [
        *(Column("", _of("impedance", name), f"Z, {name}", format_complex) for name in averagings),
        Column("", "spread", "spread R, X", format_pair),
        Column("", "coherence", "coherence", ".2f"),
        Column("", "level", "inferred incident dB, median", ".1f"),
    ]


def matched_lines(result: ImpedanceMap) -> list[str]:
    """The level-matched answer at each frequency that has one."""
    found, lines = result.level_matched, list[str]()
    if found is None:
        return lines
    for i, f in enumerate(result.frequency.tolist()):
        share, low, high = (float(each[i]) for each in (found.share, found.share_low, found.share_high))
        if not math.isfinite(share):
            continue
        bounds, between = "", ""
        if math.isfinite(low + high):
            bounds = f" ({format_bounds((complex(found.low[i]), complex(found.high[i])))})"
            between = f" ({low:.2g} to {high:.2g})"
        where = "" if result.height is None else f"y = {1e3 * result.height:.3g} mm, "
        lines.append(
            f"level-matched, {where}{f:g} Hz: {format_complex(complex(found.impedance[i]))}{bounds}, with {share:.3g}"
            f"{between} times the incoherent velocity; {MATCHED}, level +- {found.uncertainty:g} dB"
        )
    return lines


def _beside(results: Sequence[ImpedanceMap]) -> list[str]:
    """Other methods, references, the null test: each once."""
    seen: dict[str, None] = {}
    for i, f in enumerate(results[0].frequency.tolist()):
        beside = alongside_surfaces(results, i)
        seen |= dict.fromkeys(format_references(beside, f"{f:g} Hz, "))
    for result in results:
        case = case_title(result)
        tone = result.choices.get("tone")
        of = f"{case}, " if result.tone is not None or tone is None else f"{case}, {tone:g} Hz, "
        seen |= dict.fromkeys(format_references(result.reference, of))
        if result.choices.get("surface") == "hard wall":
            seen[f"{case}: {NULL_TEST}"] = None
    return list(seen)


def _nearest(results: Sequence[ImpedanceMap]) -> list[str]:
    """How good the default was in the shipped cases most like these."""
    return [line for line in dict.fromkeys(map(nearest_case, results)) if line]


def _choices(result: ImpedanceMap) -> str:
    choices = result.choices
    text = "Z is p/(rho c v), exp(+jwt)"
    text += "".join(f", {name} {choices[name]}" for name in ("phase", "drive") if name in choices)
    if (ratio := choices.get("velocity_ratio")) is not None:
        text += f"; velocity ratio |V1|/(phi M c) {ratio:.2g}"
    text += f"; {words}" if (words := background_words(choices)) else ""
    error = choices.get("model_error")
    return text if error is None else f"{text}; model-table error in R {error:.1e}"


def plain_matched(found: LevelMatched) -> dict[str, Any]:
    """For JSON, by field; None for what is not known."""
    values = {name: getattr(found, name) for name in vars(found) if name != "uncertainty"}
    plain = {
        name: [each if math.isfinite(abs(each)) else None for each in value.tolist()] for name, value in values.items()
    }
    return {**plain, "uncertainty": found.uncertainty}


def plain_map(result: ImpedanceMap) -> dict[str, Any]:
    """For JSON; ``spread`` is that over probes, ``interval`` the statistical one."""
    return {
        "title": result.title,
        "rows": [vars(row) for row in against_height([result])],
        "reference": dict(result.reference),
        "alongside": [
            {
                "frequency": f,
                "impedance": alongside_surfaces([result], i),
                "differences": differences([result], i),
            }
            for i, f in enumerate(result.frequency.tolist())
            if result.alongside
        ],
        "level_check": plain_level_check(result),
        "level_matched": None if result.level_matched is None else plain_matched(result.level_matched),
        "nearest_case": nearest_case(result) or None,
        "choices": dict(result.choices),
        "notes": [vars(note) for note in result.notes],
    }

"""Maps as a short text table and for JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torchliner.audits.known_truths import nearest_truth
from torchliner.records import ImpedanceMap
from torchliner.report.alongside import alongside_surfaces, difference_lines, differences
from torchliner.report.closure_report import closure_lines, plain_closure
from torchliner.report.numbers import against_height, case_title, interval_words
from torchliner.report.table import (
    Column,
    Table,
    format_bounds,
    format_complex,
    format_pair,
    format_references,
)

NULL_TEST = (
    "NULL TEST, the wall below these data is hard and has no liner; the values only show how this "
    "model responds to such a velocity"
)
WHERE = (Column("", "height", "y mm", ".2f", 1e3), Column("", "frequency", "f Hz", ".1f"))
AVERAGES = (
    Column("", "coherent_first", "Z, coherent first", format_complex),
    Column("", "probes_first", "Z, admittance over probes", format_complex),
    Column("", "spread", "spread R, X", format_pair),
    Column("", "velocity_first", "Z, velocity first", format_complex),
    Column("", "coherence", "coherence", ".2f"),
    Column("", "level", "inferred incident dB, median", ".1f"),
)
INTERVALS = (
    Column("", "interval_coherent_first", "coherent first", format_bounds),
    Column("", "interval", "admittance over probes", format_bounds),
    Column("", "interval_velocity_first", "velocity first", format_bounds),
)


def format_maps(results: Sequence[ImpedanceMap]) -> str:
    """One row per height and frequency; intervals; results of other methods; the choices."""
    rows = against_height(results)
    lines = [Table(rows, (*WHERE, *AVERAGES)).as_text()]
    words = interval_words(results[0])
    if words:
        lines.append(f"\n{words} (the spread above is that over probes, no uncertainty)\n"
                     f"{Table(rows, (*WHERE, *INTERVALS)).as_text()}\n")  # fmt: skip
    lines += closure_lines(results, WHERE)
    lines += [*_beside(results), *difference_lines(results), *_nearest(results)]
    return "\n".join([*lines, _choices(results[0])])


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
    return [line for line in dict.fromkeys(map(nearest_truth, results)) if line]


def _choices(result: ImpedanceMap) -> str:
    choices = result.choices
    of_kernel = ("edge", "kernel") if "kernel_error" in choices else ()
    names = ("engine", "phase", "drive", "window", *of_kernel)
    text = "Z is p/(rho c v), exp(+jwt); " + ", ".join(f"{key} {choices[key]}" for key in names)
    if "kernel_error" in choices:
        text += f"; kernel error in R {choices['kernel_error']:.1e}"
    if "model_error" in choices:
        text += f"; R(|v|) known to {choices['model_error']:.1e}"
    count = choices.get("readings")
    if count is None:
        return text
    return f"{text}; data read {('once', 'twice')[count - 1] if count < 3 else f'{count} times'}"


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
        "closure": plain_closure(result),
        "uncertainty": None if result.uncertainty is None else dict(result.uncertainty.settings),
        "nearest_truth": nearest_truth(result) or None,
        "choices": dict(result.choices),
        "notes": list(result.notes),
    }

"""Maps as a short text table and for JSON."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from torchliner.records import ImpedanceMap
from torchliner.report.alongside import alongside_surfaces
from torchliner.report.numbers import HeightRow, against_height
from torchliner.report.table import (
    Column,
    Table,
    format_complex,
    format_pair,
    format_range,
    format_references,
)

NULL_TEST = (
    "NULL TEST, there is a hard wall below these data and no liner; the values only show what this "
    "model makes of such a velocity"
)
WHERE = (
    Column("", "height", "y mm", ".2f", 1e3),
    Column("", "frequency", "f Hz", ".1f"),
)
AVERAGES = (
    Column("", "probes_first", "Z, admittance over probes", format_complex),
    Column("", "spread", "spread R, X", format_pair),
    Column("", "velocity_first", "Z, velocity first", format_complex),
    Column("", "coherence", "coherence", ".2f"),
    Column("", "level", "incident dB", ".1f"),
)


def _bounds(interval: str, part: str) -> Callable[[HeightRow], str]:
    def written(row: HeightRow) -> str:
        known = getattr(row, interval)
        return "-" if known is None else format_range(*(getattr(end, part) for end in known))

    return written


INTERVALS = (
    Column("", _bounds("interval", "real"), "R, over probes"),
    Column("", _bounds("interval", "imag"), "X, over probes"),
    Column("", _bounds("interval_velocity_first", "real"), "R, velocity first"),
    Column("", _bounds("interval_velocity_first", "imag"), "X, velocity first"),
)


def format_maps(results: Sequence[ImpedanceMap]) -> str:
    """A row a height and frequency; intervals; what other methods say; the choices."""
    rows = against_height(results)
    lines = [Table(rows, (*WHERE, *AVERAGES)).as_text()]
    found = results[0].uncertainty
    if found is not None:
        lines.append(
            f"\n{100 * found.settings['level']:g} % statistical interval (the spread above is that "
            f"over probes, no uncertainty)\n{Table(rows, (*WHERE, *INTERVALS)).as_text()}\n"
        )
    return "\n".join([*lines, *_beside(results), _choices(results[0])])


def _beside(results: Sequence[ImpedanceMap]) -> list[str]:
    """Other methods, references, the null test: each once."""
    seen: dict[str, None] = {}
    for i, f in enumerate(results[0].frequency.tolist()):
        beside = alongside_surfaces(results, i)
        seen |= dict.fromkeys(format_references(beside, f"{f:g} Hz, "))
    for result in results:
        case = result.title.split(", y =")[0]
        seen |= dict.fromkeys(format_references(result.reference, f"{case}, "))
        if result.choices.get("surface") == "hard wall":
            seen[f"{case}: {NULL_TEST}"] = None
    return list(seen)


def _choices(result: ImpedanceMap) -> str:
    choices = result.choices
    names = ("engine", "phase", "edge", "drive", "kernel")
    text = "Z is p/(rho c v), exp(+jwt); " + ", ".join(f"{key} {choices[key]}" for key in names)
    error = choices.get("kernel_error")
    return text if error is None else f"{text}; kernel error in R {error:.1e}"


def plain_map(result: ImpedanceMap) -> dict[str, Any]:
    """For JSON; ``spread`` is that over probes, ``interval`` the statistical one."""
    return {
        "title": result.title,
        "rows": [vars(row) for row in against_height([result])],
        "reference": dict(result.reference),
        "alongside": [
            {"frequency": f, "impedance": alongside_surfaces([result], i)}
            for i, f in enumerate(result.frequency.tolist())
            if result.alongside
        ],
        "uncertainty": None if result.uncertainty is None else dict(result.uncertainty.settings),
        "choices": dict(result.choices),
        "notes": list(result.notes),
    }

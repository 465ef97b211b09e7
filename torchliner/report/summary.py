"""Maps as a short text table and as plain values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torchliner.records import ImpedanceMap
from torchliner.report.alongside import alongside_surfaces
from torchliner.report.numbers import Bounds, HeightRow, against_height
from torchliner.report.table import format_complex

NULL_TEST = (
    "NULL TEST, there is a hard wall below these data and no liner; the values only show what this "
    "model makes of such a velocity"
)


def format_maps(results: Sequence[ImpedanceMap]) -> str:
    """A line a height and frequency; intervals; what other methods say; the choices."""
    rows = against_height(results)
    parts = [_averages(rows), _intervals(rows, results), _beside(results), _choices(results[0])]
    return "\n".join(part for part in parts if part)


def _where(row: HeightRow) -> str:
    height = "-" if row.height is None else f"{1e3 * row.height:.2f}"
    return f"{height:>6s} {row.frequency:7.1f}"


def _averages(rows: Sequence[HeightRow]) -> str:
    lines = [
        f"{'y mm':>6s} {'f Hz':>7s} {'Z, admittance over probes':>26s} {'spread R, X':>14s} "
        f"{'Z, velocity first':>18s} {'coherence':>9s} {'incident dB':>11s}"
    ]
    for row in rows:
        spread = f"{row.spread.real:.3f} {row.spread.imag:.3f}"
        lines.append(
            f"{_where(row)} {format_complex(row.probes_first):>26s} {spread:>14s} "
            f"{format_complex(row.velocity_first):>18s} {row.coherence:9.2f} {row.level:11.1f}"
        )
    return "\n".join(lines)


def _intervals(rows: Sequence[HeightRow], results: Sequence[ImpedanceMap]) -> str:
    """Apart from the spread over positions."""
    found = results[0].uncertainty
    if found is None:
        return ""
    lines = [
        f"\n{100 * found.settings['level']:g} % statistical interval (the spread above is that "
        "over probes, no uncertainty)",
        f"{'y mm':>6s} {'f Hz':>7s} {'R, over probes':>19s} {'X, over probes':>19s} "
        f"{'R, velocity first':>19s} {'X, velocity first':>19s}",
    ]
    for row in rows:
        cells = _ends(row.interval) + _ends(row.interval_velocity_first)
        lines.append(f"{_where(row)} " + " ".join(f"{cell:>19s}" for cell in cells))
    return "\n".join(lines) + "\n"


def _ends(bounds: Bounds | None) -> list[str]:
    if bounds is None:
        return ["-", "-"]
    low, high = bounds
    return [f"{low.real:.3f} to {high.real:.3f}", f"{low.imag:.3f} to {high.imag:.3f}"]


def _beside(results: Sequence[ImpedanceMap]) -> str:
    """Other methods, references, the null test: each once."""
    seen: dict[str, None] = {}
    for i, f in enumerate(results[0].frequency.tolist()):
        beside = alongside_surfaces(results, i)
        seen |= {f"{f:g} Hz, {n}: {format_complex(v)}": None for n, v in beside.items()}
    for result in results:
        case = result.title.split(", y =")[0]
        seen |= {f"{case}, {n}: {format_complex(v)}": None for n, v in result.reference.items()}
        if result.choices.get("surface") == "hard wall":
            seen[f"{case}: {NULL_TEST}"] = None
    return "\n".join(seen)


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

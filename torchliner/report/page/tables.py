"""Tables of impedances: R and X beside their intervals, differences from what is known."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from torchliner.report.page.blocks import Block, Grid, Text
from torchliner.report.table import Column, Table, format_complex, plain_columns

FREQUENCY = Column("frequency (Hz)", "frequency", "f (Hz)", ".1f")
Bounds = tuple[complex, complex] | None
DIFFER = {True: "yes", False: "not shown", None: ""}


def bounded(value: complex, bounds: Bounds) -> dict[str, Any]:
    """What ``impedance_columns`` shows: one value and both ends, None where they are unknown."""
    low, high = bounds or (None, None)
    return {"impedance": complex(value), "low": low, "high": high}


def impedance_columns(bounds: bool = True, number: str = ".3f") -> list[Column]:
    """R and X, their intervals beside them; all of it in the CSV."""
    columns = plain_columns("impedance* low* high*" if bounds else "impedance*", None)
    for name, side in (("R", "real"), ("X", "imag")):
        columns.append(Column("", _part(side), name, number))
        if bounds:
            columns.append(Column("", _ends(side), f"{name}, interval", _range))
    return columns


def _part(side: str) -> Any:
    return lambda row: round(getattr(row["impedance"], side), 12) + 0.0


def _ends(side: str) -> Any:
    return lambda row: None if row["low"] is None else (getattr(row["low"], side), getattr(row["high"], side))


def _range(ends: tuple[float, float] | None) -> str:
    return "-" if ends is None else f"{ends[0]:.3f} to {ends[1]:.3f}"


def difference(frequency: float, mine: Mapping[str, Any], name: str, other: complex, bounds: Bounds) -> dict[str, Any]:
    """One row of ``compared``: of ``bounded`` less another value; ``bounds``: of the difference."""
    differ = None
    if bounds is not None and not math.isnan(abs(bounds[0])):
        low, high = bounds
        differ = low.real > 0 or high.real < 0 or low.imag > 0 or high.imag < 0
    return {
        "frequency": frequency,
        "name": name,
        "other": complex(other),
        "differ": DIFFER[differ],
        **bounded(mine["impedance"] - other, bounds),
    }


def joint(one: Mapping[str, Any], other: Mapping[str, Any]) -> Bounds:
    """Bounds of a difference of independent values: distances to their bounds add as squares."""
    if one["low"] is None or other["low"] is None:
        return None

    def reach(end: str, against: str) -> complex:
        a, b = one[end] - one["impedance"], other[against] - other["impedance"]
        return complex(math.hypot(a.real, b.real), math.hypot(a.imag, b.imag))

    middle = one["impedance"] - other["impedance"]
    return middle - reach("low", "high"), middle + reach("high", "low")


def off(row: Mapping[str, Any], value: complex) -> Bounds:
    """Bounds of a value less one that is exact."""
    return None if row["low"] is None else (row["low"] - value, row["high"] - value)


def compared(rows: Iterable[Mapping[str, Any]], caption: str) -> Block:
    """A table of ``difference``; a sentence where there is none."""
    listed = list(rows)
    if not listed:
        return Text("Nothing is known of the case from elsewhere.")
    columns = [
        FREQUENCY,
        Column("name", heading="less"),
        Column("", "other", "Z of that", format_complex),
        *plain_columns("other*"),
        *impedance_columns(number="+.3f"),
        Column("differ", heading="differ?"),
    ]
    return Grid("compared-table", caption, Table(listed, columns, ".9g"))

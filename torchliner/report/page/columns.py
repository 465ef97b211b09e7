"""Columns that the tables of several sections share: Z with the bounds of its interval."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torchliner.report.table import Column, plain_columns

FREQUENCY = Column("frequency (Hz)", "frequency", "f (Hz)", ".1f")
SIDES = {"R": "real", "X": "imag"}
Row = Mapping[str, Any]


def bounded(value: complex, bounds: tuple[complex, complex] | None) -> dict[str, Any]:
    """What ``impedance_columns`` shows: one value and both ends, None where they are unknown."""
    low, high = bounds or (None, None)
    return {"impedance": complex(value), "low": low, "high": high}


def impedance_columns(
    value: str = "impedance", heading: str = "{}", number: str = ".3f", bounds: bool = True
) -> list[Column]:
    """R and X of a value, their intervals beside them; all of it in the CSV.

    Args:
        value: key of the complex number.  heading: "{}" becomes R or X.
        number: format.  bounds: whether rows have "low" and "high".
    """
    columns = plain_columns(f"{value}* low* high*" if bounds else f"{value}*", None)
    for name, side in SIDES.items():
        columns.append(Column("", _part(value, side), heading.format(name), number))
        if bounds:
            columns.append(Column("", _ends(side), f"{name}, interval", _range))
    return columns


def _part(key: str, side: str) -> Any:
    def value(row: Row) -> float | None:
        return None if row[key] is None else round(getattr(row[key], side), 12) + 0.0

    return value


def _ends(side: str) -> Any:
    def ends(row: Row) -> Any:
        low, high = row["low"], row["high"]
        return None if low is None else (getattr(low, side), getattr(high, side))

    return ends


def _range(ends: tuple[float, float] | None) -> str:
    return "-" if ends is None else f"{ends[0]:.3f} to {ends[1]:.3f}"

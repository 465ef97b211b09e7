"""Any study as a table: a value has one heading, whichever study it is of."""

from __future__ import annotations

import cmath
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from torch import Tensor

from torchliner.report.table import Column, Table, format_bounds, format_complex, format_pair
from torchliner.studies.rows import Row

PLAIN = (str, int, float, complex, Tensor, Mapping, list, tuple, type(None))


def ends_of(row: Row) -> tuple[complex, complex] | None:
    """low and high; None without."""
    return None if row.low is None else (row.low, row.high)


def _misses(value: complex | None) -> str:
    return "-" if value is None or not cmath.isfinite(value) else f"{value.real:+.1f}, {value.imag:+.1f} s.d."


HEADINGS: dict[str, tuple[Any, ...]] = {  # heading, format, scale, and where the value is
    "band": ("+- 95 %", format_pair, 1, lambda row: (row.high - row.low) / 2),
    "before": ("as it was", format_complex),
    "between": ("between", ".4f"),
    "bounds": ("bounds", lambda ends: f"{ends[0]:.4g} to {ends[1]:.4g}", 1, lambda row: (row.lowest, row.highest)),
    "change of R": ("dR", "+.3f", 1, "change.real"),
    "change of X": ("dX", "+.3f", 1, "change.imag"),
    "coherence": ("coherence", ".2f"),
    "difference": ("difference", format_complex),
    "differs_in": ("differs in",),
    "error": ("error left out", ".3f"),
    "factor": ("choice",),
    "first": ("Z, first", format_complex),
    "fitted": ("Z, fitted with it", format_complex),
    "frequency": ("f Hz", ".1f"),
    "drift": ("drift, (A1)", format_complex),
    "half_width": ("half-width", ".3g"),
    "height": ("y mm", ".2f", 1e3),
    "impedance": ("Z", format_complex),
    "interval": ("interval", format_bounds, 1, ends_of),
    "label": ("plane",),
    "judged": ("value", ".3g", 1, "value"),
    "level_check": ("level check dB", "+.2f"),
    "limit": ("limit", ".3g"),
    "lowest": ("least R", ".3f"),
    "misfit": ("misfit/noise", ".2f"),
    "misses": ("R, X off by", _misses),
    "model_error": ("error in R", ".0e"),
    "modulation": ("modulation v_rms", ".4f"),
    "outside": ("unseen %", ".0f", 100.0),
    "R": ("dR", "+.5f", 1, "impedance.real"),
    "X": ("dX", "+.5f", 1, "impedance.imag"),
    "range": (
        "95 % of the posterior",
        lambda ends: f"{ends[0]:.5g} to {ends[1]:.5g}",
        1,
        lambda row: (row.lower_95, row.upper_95),
    ),
    "rms": ("rms |v| m/s", ".3g"),
    "second": ("Z, second", format_complex),
    "seen": ("data", "", 1, lambda row: "" if row.seen else "not seen"),
    "fastest": ("95 % below", ".3g"),
    "slowest": ("5 % below", ".3g"),
    "slope of R": ("dR/dp", "+.4g", 1, "slope.real"),
    "slope of X": ("dX/dp", "+.4g", 1, "slope.imag"),
    "step of R": ("dR per 1 %", "+.5f", 1, "step.real"),
    "step of X": ("dX per 1 %", "+.5f", 1, "step.imag"),
    "speed": ("|v| m/s", ".3g"),
    "standard": ("u(R), u(X)", lambda value: format_pair(value, 4)),
    "true": ("reference", format_complex),
    "u(p)": ("u(p)", ".3g", 1, "standard"),
    "value": ("value", ".6g"),
    "variant": ("changed to",),
    "velocity_rms": ("v_rms m/s", ".3f"),
    "x": ("x mm", ".2f", 1e3),
    "z": ("z mm", ".2f", 1e3),
}


def table_of(rows: Sequence[Mapping[str, Any]], shown: str) -> Table:
    """Rows of a study: in text the values named, with commas between; in CSV every value.

    A complex value is two columns in CSV, ``first`` gives ``first_resistance`` and ``first_reactance``; of values by
    name each is one, ``distance`` gives ``distance true``, which text calls ``distance.true``.
    """
    names = dict.fromkeys(name for row in rows for name in row)
    flat: list[dict[str, Any]] = [{} for _ in rows]
    for name in names:
        _flatten(flat, name, [row.get(name) for row in rows])
    return Table(
        [Row({**row, **more}) for row, more in zip(rows, flat, strict=True)],
        [*(_column(name.strip()) for name in shown.split(",") if name), *map(Column, flat[0] if flat else ())],
        ".9g",
    )


def _flatten(flat: list[dict[str, Any]], name: str, values: Sequence[Any]) -> None:
    """One value of all rows as columns of CSV."""
    kind = next((value for value in values if value is not None), None)
    if isinstance(kind, Mapping):
        for key in dict.fromkeys(key for value in values for key in value or ()):
            _flatten(flat, f"{name} {key}", [(value or {}).get(key) for value in values])
    elif isinstance(kind, complex):
        for row, value in zip(flat, values, strict=True):
            row[f"{name}_resistance"], row[f"{name}_reactance"] = (
                (None, None) if value is None else (value.real, value.imag)
            )
    elif kind is None or isinstance(kind, (str, int, float)):
        for row, value in zip(flat, values, strict=True):
            row[name] = value


def _column(name: str) -> Column:
    group, _, key = name.partition(".")
    if key:
        heading = {"distance": f"|Z - {key}|", "level_check": f"level check dB, {key}"}.get(group, f"Z, {key}")
        text: Any = {"distance": ".3f", "level_check": "+.2f"}.get(group, format_complex)
        return Column("", lambda row: row[group].get(key), heading, text)
    entry = HEADINGS.get(name, (name,))
    heading, text, scale, of = entry + ("", 1, name)[len(entry) - 1 :]
    return Column("", of, heading, text, scale)


def plain_of(value: Any) -> Any:
    """What JSON can hold of a study; maps, fits and other records of the package are left out."""
    if isinstance(value, Tensor):
        return value.tolist()
    if isinstance(value, Mapping):
        return {name: plain_of(each) for name, each in value.items() if isinstance(each, PLAIN)}
    return [plain_of(each) for each in value] if isinstance(value, (list, tuple)) else value


def if_known(rows: Iterable[Row], *names: str) -> str:
    """Those of the names of which some row has a value."""
    rows = list(rows)
    return "".join(f",{name}" for name in names if any(row.get(name) is not None for row in rows))

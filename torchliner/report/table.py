"""One table for every outlet: text, page, CSV and JSON. How a quantity is shown stands in ``QUANTITIES``, once."""

from __future__ import annotations

import cmath
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torchliner.io.csv_rows import write_rows

Of = str | Callable[[Any], Any]
Bounds = tuple[complex, complex]
HARD = 1e6  # |Z| that a table calls rigid
STATISTICAL = "statistical, without model error"  # of the intervals of an eduction
GAP = "  "  # between the columns of a text table


def format_complex(value: complex | None) -> str:
    """'0.168-0.066j'; no zero has a minus; '-' if unknown; 'rigid' above ``HARD``."""
    if value is None or value != value:
        return "-"
    if abs(value) > HARD:
        return "rigid"
    real, imaginary = (round(part, 3) + 0.0 for part in (value.real, value.imag))
    return f"{real:.3f}{imaginary:+.3f}j"


def format_pair(value: complex | None, digits: int = 3) -> str:
    """'0.012, 0.034' of R and X; '-' if unknown; what would print as 0 but is not, as '2.1e-05'."""
    if value is None or value != value:
        return "-"
    if cmath.isinf(value):
        return "no bound"
    parts = (value.real, value.imag)
    small = [0 < abs(part) < 0.5 * 10**-digits for part in parts]
    return ", ".join(f"{part:.1e}" if tiny else f"{part:.{digits}f}" for part, tiny in zip(parts, small, strict=True))


def format_bounds(ends: Bounds | None, digits: int = 3) -> str:
    """'R 0.150 to 0.170, X -0.061 to -0.052'; '-' for None."""
    if ends is None or ends[0] != ends[0]:
        return "-"
    low, high = ends
    return f"R {low.real:.{digits}f} to {high.real:.{digits}f}, X {low.imag:.{digits}f} to {high.imag:.{digits}f}"


def _range(ends: tuple[float, float]) -> str:
    return f"{ends[0]:.4g} to {ends[1]:.4g}"


def _wavenumber(value: complex | None) -> str:
    return "-" if value is None or value != value else f"{value.real:.3f}{value.imag:+.3f}j"


def _misses(value: complex | None) -> str:
    return "-" if value is None or not cmath.isfinite(value) else f"{value.real:+.1f}, {value.imag:+.1f} s.d."


def bounds_of(row: Mapping[str, Any]) -> Bounds | None:
    """low and high of a row; None without."""
    return None if row.get("low") is None else (row["low"], row["high"])


def _together(*names: str) -> Callable[[Any], Any]:
    """Several values of a row as one."""
    return lambda row: tuple(row[name] for name in names)


# name: heading, format of a number or function of the value, scale, where the value is (default: of this name)
QUANTITIES: dict[str, tuple[Any, ...]] = {
    "attenuation": ("|G|", ".3f"),
    "band": ("+- 95 %", format_pair, 1, lambda row: (row["high"] - row["low"]) / 2),
    "before": ("as it was", format_complex),
    "between": ("between", ".4f"),
    "bounds": ("bounds", _range, 1, _together("lowest", "highest")),
    "bursts": ("bursts", "d"),
    "cell": ("cell", "d"),
    "change of R": ("dR", "+.3f", 1, "change.real"),
    "change of X": ("dX", "+.3f", 1, "change.imag"),
    "coherence": ("coherence", ".2f"),
    "decay": ("decay (dB/m)", ".2f"),
    "decay over liner": ("over the liner (dB)", ".2f"),
    "deviation": ("u(R), u(X)", lambda value: format_pair(value, 4)),
    "difference": ("difference", format_complex),
    "differs_in": ("differs in",),
    "distance_to_own": ("|dZ|", ".3f"),
    "distance_to_true": ("|Z - true|", ".3f"),
    "drift": ("drift", ".1e"),
    "drift of height": ("drift, (A1)", format_complex, 1, "drift"),
    "dropped": ("dropped", "d"),
    "duration": ("T (s)", ".3f"),
    "end_reflection": ("end reflection", format_complex),
    "energy_share": ("energy", ".3f"),
    "error": ("error left out", ".3f"),
    "factor": ("choice",),
    "fastest": ("95 % below", ".3g"),
    "first": ("Z, first", format_complex),
    "fitted": ("Z, fitted with it", format_complex),
    "fixed_point": ("Z(rms v)", format_complex),
    "flags": ("flags", "d"),
    "frequency": ("f (Hz)", ".1f"),
    "frozen": ("kernel's part", format_complex),
    "half_width": ("half-width", ".3g"),
    "height": ("y (mm)", ".2f", 1e3),
    "impedance": ("Z", format_complex),
    "incident_level": ("incident (dB)", ".1f"),
    "interval": ("interval", format_bounds, 1, bounds_of),
    "judged": ("value", ".3g", 1, "value"),
    "known": ("known Z", format_complex),
    "label": ("plane",),
    "level": ("level (dB)", ".1f"),
    "level_check": ("level check (dB)", "+.2f"),
    "limit": ("limit", ".3g"),
    "longest_gap": ("gap (ms)", ".2f", 1e3),
    "lowest": ("least R", ".3f"),
    "mean_velocity": ("v0 (m/s)", ".3f"),
    "misfit": ("misfit/noise", ".2f"),
    "misses": ("R, X off by", _misses),
    "mode": ("n", "d"),
    "model_error": ("error in R", ".0e"),
    "modulation": ("modulation v_rms", ".4f"),
    "off": ("Z - known", format_complex),
    "other": ("Z of that", format_complex),
    "outside": ("unseen (%)", ".0f", 100.0),
    "own": ("Z in the file", format_complex),
    "peak_speed": ("peak v (m/s)", ".4g"),
    "phase": ("phase (deg)", ".2f"),
    "R": ("dR", "+.5f", 1, "impedance.real"),
    "range": ("95 % of the posterior", _range, 1, _together("lower_95", "upper_95")),
    "rate": ("rate (1/s)", ".1f"),
    "residual": ("residual (%)", ".3f", 100),
    "rms": ("rms |v| (m/s)", ".3g"),
    "rms_speed": ("rms v (m/s)", ".4g"),
    "second": ("Z, second", format_complex),
    "seen": ("data", "", 1, lambda row: "" if row["seen"] else "not seen"),
    "segment_spread": ("spread of segments", format_pair),
    "share": ("share of incoherent v", ".3g"),
    "slope of R": ("dR/dp", "+.4g", 1, "slope.real"),
    "slope of X": ("dX/dp", "+.4g", 1, "slope.imag"),
    "slowest": ("5 % below", ".3g"),
    "speed": ("|v| (m/s)", ".3g"),
    "spl": ("SPL (dB)", ".3f"),
    "spread": ("spread of R, X", format_pair),
    "standard": ("u(R), u(X)", lambda value: format_pair(value, 4)),
    "statistical interval": (f"interval ({STATISTICAL})", format_bounds, 1, bounds_of),
    "step of R": ("dR per 1 %", "+.5f", 1, "step.real"),
    "step of X": ("dX per 1 %", "+.5f", 1, "step.imag"),
    "true": ("reference", format_complex),
    "tone_velocity": ("v at f (m/s)", ".3f"),
    "u(p)": ("u(p)", ".3g", 1, "standard"),
    "value": ("value", ".6g"),
    "variant": ("changed to",),
    "velocity_rms": ("v_rms (m/s)", ".3f"),
    "warnings": ("warnings", ".0f", 1, "notes"),
    "wavenumber": ("alpha (1/m)", _wavenumber),
    "X": ("dX", "+.5f", 1, "impedance.imag"),
    "x": ("x (mm)", ".2f", 1e3),
    "y": ("y (mm)", ".2f", 1e3),
    "z": ("z (mm)", ".2f", 1e3),
    # of values by name, such as "distance.true"
    "distance.": ("|Z - {}|", ".3f"),
    "level_check.": ("level check (dB), {}", "+.2f"),
    "": ("Z, {}", format_complex),
}


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Args:
        name: heading in CSV and key in JSON; "" for a column of the text alone.
        of: where a row has the value, such as "slope" or "slope.real", or a function of the row; default the name.
        heading: in text and pages, with the unit; "" for a column of CSV and JSON alone.
        text: format of a number in the text, such as ".3f", or a function that writes any value; without one the value
            stands as it is, to the left. Unknown numbers are "-".
        scale: factor of numbers in the text, such as 1e3 for mm.
    """

    name: str
    of: Of = ""
    heading: str = ""
    text: str | Callable[[Any], str] = ""
    scale: float = 1.0

    def value(self, row: Any) -> Any:
        """Of one row: a function, a value by its name, or part of one."""
        of = self.of or self.name
        if callable(of):
            return of(row)
        if of in row:
            return row[of]
        key, _, part = of.partition(".")
        whole = row.get(key)
        return whole.get(part) if isinstance(whole, Mapping) else getattr(whole, part, None)

    def cell(self, row: Any) -> str:
        """In the text."""
        value = self.value(row)
        if callable(self.text):
            return self.text(value)
        if value is None or value != value:
            return "-"
        if isinstance(value, str):
            return value
        return format(value if self.scale == 1.0 else self.scale * value, self.text)


@dataclass(frozen=True)
class Table:
    """Rows by name, and what is shown of them.

    Args:
        rows: at least one for ``write_csv``.  columns: in their order.
        csv: format of numbers in CSV; without one all their digits.
    """

    rows: Sequence[Mapping[str, Any]]
    columns: Sequence[Column]
    csv: str = ""

    @property
    def shown(self) -> list[Column]:
        """Columns of text and page."""
        return [column for column in self.columns if column.heading]

    def as_text(self, most: int | None = None) -> str:
        """Columns as wide as they need, numbers to the right; ``most`` rows."""
        rows = self.rows[:most]
        lines = [[column.heading for column in self.shown]]
        lines += [[column.cell(row) for column in self.shown] for row in rows]
        widths = [max(map(len, cells)) for cells in zip(*lines, strict=True)]
        sides = [">" if column.text else "<" for column in self.shown]
        return "\n".join(
            GAP.join(f"{cell:{side}{width}s}" for cell, side, width in zip(cells, sides, widths, strict=True)).rstrip()
            for cells in lines
        )

    def as_rows(self) -> list[dict[str, Any]]:
        """Values of the columns with a name: of CSV."""
        named = [column for column in self.columns if column.name]
        return [{column.name: column.value(row) for column in named} for row in self.rows]

    def write_csv(self, path: str | Path) -> None:
        """The columns with a name; None is an empty field."""
        write_rows(self.as_rows(), path, self.csv)


def table_of(rows: Iterable[Mapping[str, Any]], shown: str = "", csv: str | None = None) -> Table:
    """Rows as a table: in text and pages the quantities named, with commas between; in CSV every value.

    A complex value is two columns in CSV: ``resistance`` and ``reactance`` of ``impedance``, ``resistance_low`` and
    ``reactance_low`` of ``low``, ``first_resistance`` and ``first_reactance`` of ``first``, ``wavenumber_real`` and
    ``wavenumber_imaginary`` of what is no impedance. Of values by name each is
    a column, ``distance`` gives ``distance true``, which text calls ``distance.true``.

    Args:
        rows: values by name.
        shown: quantities of ``QUANTITIES``, or other names of values.
        csv: names of what is in the CSV; default every value.
    """
    rows = list(rows)
    columns = [_column(name.strip()) for name in shown.split(",") if name]
    for name in dict.fromkeys(name for row in rows for name in row) if csv is None else csv.split(","):
        columns += _plain_columns(name, [row.get(name) for row in rows], _of(name))
    return Table(rows, columns, ".9g")


ENDS = {"impedance": "", "low": "_low", "high": "_high"}
R_AND_X, REAL_AND_IMAGINARY = ("resistance", "reactance"), ("real", "imaginary")


def _plain_columns(name: str, values: Sequence[Any], get: Callable[[Any], Any]) -> Iterator[Column]:
    """The columns of CSV of one value, by its kind; ``get`` takes it from a row. Lists have none."""
    kind = next((value for value in values if value is not None), None)
    if isinstance(kind, Mapping):
        for key in dict.fromkeys(key for value in values for key in value or ()):
            inside = [(value or {}).get(key) for value in values]
            yield from _plain_columns(f"{name} {key}", inside, _inside(get, key))
    elif isinstance(kind, complex):
        for word, part in zip(parts_of(name), ("real", "imag"), strict=True):
            heading = f"{word}{ENDS[name]}" if name in ENDS else f"{name}_{word}"
            yield Column(heading, _part(get, part))
    elif kind is None or isinstance(kind, (str, int, float)):
        yield Column(name, get)


def parts_of(name: str) -> tuple[str, str]:
    """What the parts of a complex value are called: R and X, but of what is no impedance."""
    return REAL_AND_IMAGINARY if name in ("wavenumber", "end_reflection") else R_AND_X


def _of(name: str) -> Callable[[Any], Any]:
    return lambda row: row.get(name)


def _inside(get: Callable[[Any], Any], key: str) -> Callable[[Any], Any]:
    return lambda row: (get(row) or {}).get(key)


def _part(get: Callable[[Any], Any], part: str) -> Callable[[Any], Any]:
    return lambda row: getattr(get(row), part, None)


def _column(name: str) -> Column:
    group, _, key = name.partition(".")
    if key:
        heading, text = QUANTITIES.get(f"{group}.", QUANTITIES[""])
        return Column("", lambda row: (row.get(group) or {}).get(key), heading.format(key), text)
    known = QUANTITIES.get(name, (name,))
    heading, text, scale, of = known + ("", 1, name)[len(known) - 1 :]
    return Column("", of, heading, text, scale)


def if_known(rows: Iterable[Mapping[str, Any]], *names: str) -> str:
    """Those of the names of which some row has a value, as ``table_of`` takes them behind others."""
    rows = list(rows)
    return "".join(f",{n}" for n in names if any(row.get(n) is not None and row[n] == row[n] for row in rows))

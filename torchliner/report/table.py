"""One table for every outlet: text, page, CSV and JSON. How a quantity is shown stands in ``QUANTITIES``, once."""

import cmath
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torchliner.io.csv_rows import write_rows

Row = dict[str, Any]
Bounds = tuple[complex, complex]
HARD = 1e6  # |Z| that a table calls rigid
STATISTICAL = "statistical, without model error"  # of the intervals of an eduction
DIGITS = ".9g"  # of numbers in CSV


def format_complex(value: complex | None) -> str:
    """'0.168-0.066j'; no zero has a minus; '-' if unknown; 'rigid' above ``HARD``."""
    if value is None or value != value:
        return "-"
    if abs(value) > HARD:
        return "rigid"
    real, imaginary = (round(part, 3) + 0.0 for part in (value.real, value.imag))
    return f"{real:.3f}{imaginary:+.3f}j"


def format_pair(value: complex) -> str:
    """'0.012, 0.034' of the uncertainties of R and X."""
    return "no bound" if cmath.isinf(value) else f"{value.real:.2g}, {value.imag:.2g}"


def format_bounds(ends: Bounds | None) -> str:
    """'R 0.150 to 0.170, X -0.061 to -0.052'; '-' if unknown."""
    if ends is None or ends[0] != ends[0]:
        return "-"
    low, high = ends
    return f"R {low.real:.3f} to {high.real:.3f}, X {low.imag:.3f} to {high.imag:.3f}"


def bounds_of(row: Mapping[str, Any]) -> Bounds | None:
    """low and high of a row; None without, or where they are not finite."""
    low, high = row.get("low"), row.get("high")
    return None if low is None or high is None or not cmath.isfinite(low + high) else (low, high)


# Heading, format of a number or function of the value, scale. What is not here is shown by its name and four digits.
QUANTITIES: dict[str, tuple[Any, ...]] = {
    "change.real": ("dR", "+.3f"),
    "change.imag": ("dX", "+.3f"),
    "decay": ("decay (dB/m)", ".2f"),
    "deviation": ("u(R), u(X)", format_pair),
    "duration": ("T (s)", ".3f"),
    "frequency": ("f (Hz)", ".1f"),
    "height": ("y (mm)", ".2f", 1e3),
    "impedance": ("Z",),
    "impedance.real": ("dR", "+.5f"),
    "impedance.imag": ("dX", "+.5f"),
    "level": ("level (dB)", ".1f"),
    "level_check": ("level check (dB)", "+.2f"),
    "longest_gap": ("gap (ms)", ".2f", 1e3),
    "mean_velocity": ("v0 (m/s)", ".3f"),
    "phase": ("phase (deg)", ".2f"),
    "rate": ("rate (1/s)", ".1f"),
    "residual": ("residual (%)", ".3f", 100.0),
    "rms_speed": ("rms v (m/s)",),
    "segment_spread": ("spread of segments", format_pair),
    "slope.real": ("dR/dp", "+.4g"),
    "slope.imag": ("dX/dp", "+.4g"),
    "speed": ("|v| (m/s)", ".3g"),
    "spl": ("SPL (dB)", ".3f"),
    "spread": ("spread of R, X", format_pair),
    "standard": ("u", lambda value: format_pair(value) if isinstance(value, complex) else f"{value:.3g}"),
    "step.real": ("dR per 1 %", "+.5f"),
    "step.imag": ("dX per 1 %", "+.5f"),
    "tone_velocity": ("v at f (m/s)", ".3f"),
    "velocity_rms": ("v_rms (m/s)", ".3f"),
    "x": ("x (mm)", ".2f", 1e3),
    "y": ("y (mm)", ".2f", 1e3),
    "z": ("z (mm)", ".2f", 1e3),
    # of values by name, such as "distance.true"
    "distance.": ("|Z - {}|", ".3f"),
    "level_check.": ("level check (dB), {}", "+.2f"),
    ".": ("Z, {}",),
}


@dataclass(frozen=True)
class Column:
    """One column of text and pages.

    Args:
        heading: with the unit.
        of: where a row has the value, such as "slope" or "slope.real", or a function of the row.
        text: format of a number, or a function that writes any value; default by its kind. Unknown values are "-".
        scale: factor of numbers, such as 1e3 for mm.
    """

    heading: str
    of: str | Callable[[Any], Any]
    text: str | Callable[[Any], str] = ""
    scale: float = 1.0

    def value(self, row: Any) -> Any:
        """Of one row: of a function, by its name, or a part of what has a name; None for what is nan."""
        if callable(self.of):
            return self.of(row)
        key, _, part = self.of.partition(".")
        value = row.get(self.of, row.get(key))
        if self.of not in row and part:
            value = value.get(part) if isinstance(value, Mapping) else getattr(value, part, None)
        return value if value == value else None

    def cell(self, row: Any) -> str:
        """In text."""
        value = self.value(row)
        if value is None:
            return "-"
        if callable(self.text):
            return self.text(value)
        if isinstance(value, complex):
            return format_complex(value)
        if not isinstance(value, int | float):
            return str(value)
        form = self.text or ("" if isinstance(value, int) else ".4g")
        return format(value if self.scale == 1.0 else self.scale * value, form)


@dataclass(frozen=True)
class Table:
    """Rows by name, and what is shown of them.

    Args:
        rows: at least one for ``write_csv``.
        shown: columns of text and pages.
        csv: names of what CSV has; default every value.
    """

    rows: Sequence[Mapping[str, Any]]
    shown: Sequence[Column]
    csv: Sequence[str] | None = None

    def numeric(self, column: Column) -> bool:
        """Whether it has numbers, which stand to the right."""
        return not all(isinstance(column.value(row), str | None) for row in self.rows)

    def as_text(self, most: int | None = None) -> str:
        """Columns as wide as they need; ``most`` rows."""
        columns = []
        for column in self.shown:
            cells = [column.heading, *(column.cell(row) for row in self.rows[:most])]
            width = max(map(len, cells))
            columns.append([cell.rjust(width) if self.numeric(column) else cell.ljust(width) for cell in cells])
        return "\n".join("  ".join(cells).rstrip() for cells in zip(*columns, strict=True))

    def as_rows(self) -> list[Row]:
        """Of CSV: numbers and texts alone.

        A complex value is two: ``resistance`` and ``reactance`` of ``impedance``, ``resistance_low`` of ``low``,
        ``first_resistance`` of ``first``, ``wavenumber_real`` of what is no impedance. Of values by name each is one,
        ``distance`` gives ``distance true``.
        """
        kinds: Row = {}
        for row in self.rows:
            kinds |= {name: value for name, value in row.items() if kinds.get(name) is None}
        names = kinds if self.csv is None else self.csv
        return [
            {key: value for name in names for key, value in _flat(name, kinds.get(name), row.get(name))}
            for row in self.rows
        ]

    def write_csv(self, path: str | Path) -> None:
        """``as_rows``; None is an empty field."""
        write_rows(self.as_rows(), path, DIGITS)


def table_of(rows: Iterable[Mapping[str, Any]], shown: str = "", csv: str | None = None) -> Table:
    """Rows as a table.

    Args:
        rows: values by name.
        shown: names of values, with commas between, those that some row has; see ``QUANTITIES``.
        csv: names of what is in the CSV; default every value.
    """
    rows = list(rows)
    columns = [_column(name) for name in shown.split(",") if name]
    known = [column for column in columns if any(column.value(row) not in (None, "") for row in rows)]
    return Table(rows, known, None if csv is None else csv.split(","))


def parts_of(name: str) -> tuple[str, str]:
    """What the parts of a complex value are called: R and X, but of what is no impedance."""
    return ("real", "imaginary") if name in ("wavenumber", "end_reflection") else ("resistance", "reactance")


ENDS = {"impedance": "", "low": "_low", "high": "_high"}


def _flat(name: str, kind: Any, value: Any) -> Iterator[tuple[str, Any]]:
    """Names and values of one; ``kind`` is a known value of that name. Lists have none."""
    if isinstance(kind, Mapping):
        for key, inside in kind.items():
            yield from _flat(f"{name} {key}", inside, (value or {}).get(key))
    elif isinstance(kind, complex):
        for word, part in zip(parts_of(name), ("real", "imag"), strict=True):
            yield f"{word}{ENDS[name]}" if name in ENDS else f"{name}_{word}", getattr(value, part, None)
    elif kind is None or isinstance(kind, str | int | float):
        yield name, value


def _column(name: str) -> Column:
    if name == "interval":  # of a whole row
        return Column(name, bounds_of, format_bounds)
    group, _, key = name.partition(".")
    if key and name not in QUANTITIES:
        heading, *form = QUANTITIES.get(f"{group}.", QUANTITIES["."])
        return Column(heading.format(key), name, *form)
    heading, *form = QUANTITIES.get(name, (name.replace("_", " "),))
    return Column(heading, name, *form)

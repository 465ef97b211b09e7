"""One table for every outlet: text, page, CSV and JSON. How a quantity is shown stands in ``QUANTITIES``, once."""

import cmath
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from torchliner.io.result_writers import write_rows
from torchliner.records.notes import Note

Row = dict[str, Any]
Bounds = tuple[complex, complex]
HARD = 1e6  # |Z| that a table calls rigid
STATISTICAL = "statistical, without model error"  # of the intervals of an eduction
DIGITS = ".9g"  # of numbers in CSV
MOST_LISTED = 8  # values of a fact


def format_complex(value: complex | None) -> str:
    """'0.168-0.066j'; '-' if unknown; 'rigid' above ``HARD``."""
    if value is None or value != value:
        return "-"
    return "rigid" if abs(value) > HARD else f"{value:.3f}"


def format_bounds(ends: Bounds | None) -> str:
    """'R 0.150 to 0.170, X -0.061 to -0.052'; '-' if unknown."""
    if ends is None:
        return "-"
    low, high = ends
    return f"R {low.real:.3f} to {high.real:.3f}, X {low.imag:.3f} to {high.imag:.3f}"


def bounds_of(row: Mapping[str, Any]) -> Bounds | None:
    """low and high of a row; None without, or where they are not finite."""
    low, high = row.get("low"), row.get("high")
    return None if low is None or high is None or not cmath.isfinite(low + high) else (low, high)


# Heading, format of a number, scale. What is not here is shown by its name with four digits, Z with three decimals.
QUANTITIES: dict[str, tuple[Any, ...]] = {
    "change": ("dZ", "+.3f"),
    "decay": ("decay (dB/m)", ".2f"),
    "deviation": ("u(R) + j u(X)", ".2g"),
    "duration": ("T (s)", ".3f"),
    "frequency": ("f (Hz)", ".1f"),
    "height": ("y (mm)", ".2f", 1e3),
    "impedance": ("Z",),
    "level": ("level (dB)", ".1f"),
    "level_check": ("level check (dB)", "+.2f"),
    "longest_gap": ("gap (ms)", ".2f", 1e3),
    "mean_velocity": ("v0 (m/s)", ".3f"),
    "phase": ("phase (deg)", ".2f"),
    "rate": ("rate (1/s)", ".1f"),
    "residual": ("residual (%)", ".3f", 100.0),
    "rms_speed": ("rms v (m/s)",),
    "segment_spread": ("spread of segments", ".2g"),
    "slope": ("dZ/dp", "+.4g"),
    "speed": ("|v| (m/s)", ".3g"),
    "spl": ("SPL (dB)", ".3f"),
    "spread": ("spread", ".2g"),
    "standard": ("u", ".3g"),
    "step": ("dZ per 1 %", "+.5f"),
    "tone_velocity": ("v at f (m/s)", ".3f"),
    "velocity_rms": ("v_rms (m/s)", ".3f"),
    "x": ("x (mm)", ".2f", 1e3),
    "y": ("y (mm)", ".2f", 1e3),
    "z": ("z (mm)", ".2f", 1e3),
    # of values by name, such as "distance.true"
    "distance.": ("|Z - {}|", ".3f"),
    "impedance.": ("Z, {}",),
    "level_check.": ("dB off, {}", "+.2f"),
}


class Column(NamedTuple):
    """One column of text and pages: a name in the rows, or "group.name" of values by name."""

    name: str
    heading: str
    form: str = ""
    scale: float = 1.0

    def value(self, row: Mapping[str, Any]) -> Any:
        """Of one row; None for what is nan."""
        group, _, key = self.name.partition(".")
        value: Any = bounds_of(row) if group == "interval" else row.get(group)
        value = (value or {}).get(key) if key else value
        return value if value == value else None

    def cell(self, row: Mapping[str, Any]) -> str:
        """In text."""
        value = self.value(row)
        if self.name == "interval":
            return format_bounds(value)
        if value is None or (isinstance(value, complex) and not self.form):
            return format_complex(value)
        if not isinstance(value, int | float | complex):
            return str(value)
        form = self.form or ("" if isinstance(value, int) else ".4g")
        return format(value if self.scale == 1.0 else self.scale * value, form)


@dataclass(frozen=True)
class Table:
    """Rows by name, at least one for ``write_csv``, which has every value; what text and pages show of them."""

    rows: Sequence[Mapping[str, Any]]
    shown: Sequence[Column] = ()

    def numeric(self, column: Column) -> bool:
        """Whether it has numbers, which stand to the right."""
        return not all(isinstance(column.value(row), str | None) for row in self.rows)

    def as_text(self, most: int | None = None, width: int | None = None) -> str:
        """Columns as wide as they need; ``most`` rows; the first columns that fit into ``width`` characters."""
        columns, left = list[list[str]](), width or 1 << 20
        for column in self.shown:
            cells = [column.heading, *(column.cell(row) for row in self.rows[:most])]
            own = max(map(len, cells))
            if (left := left - own - 2) < -2:
                break
            columns.append([cell.rjust(own) if self.numeric(column) else cell.ljust(own) for cell in cells])
        return "\n".join("  ".join(cells).rstrip() for cells in zip(*columns, strict=True))

    def as_rows(self) -> list[Row]:
        """Of CSV: numbers and texts alone; of a complex value both parts, of values by name each: ``resistance`` and
        ``reactance`` of ``impedance``, ``resistance_low`` of ``low``, ``distance true`` of ``distance``."""
        kinds: Row = {}
        for row in self.rows:
            kinds |= {name: value for name, value in row.items() if kinds.get(name) is None}
        return [
            {key: value for name, kind in kinds.items() for key, value in _flat(name, kind, row.get(name))}
            for row in self.rows
        ]

    def write_csv(self, path: str | Path) -> None:
        """``as_rows``; None is an empty field."""
        write_rows(self.as_rows(), path, DIGITS)


def table_of(rows: Iterable[Mapping[str, Any]], shown: str = "") -> Table:
    """Rows as a table that shows what ``shown`` names, with commas between, and some row has; see ``QUANTITIES``."""
    rows, columns = list(rows), list[Column]()
    for name in shown.split(",") if shown else ():
        group, _, key = name.partition(".")
        heading, *form = QUANTITIES.get(f"{group}." if key else name, (name.replace("_", " "),))
        columns.append(Column(name, heading.format(key), *form))
    return Table(rows, [each for each in columns if any(each.value(row) not in (None, "") for row in rows)])


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


def plain_of(value: Any, name: str = "") -> Any:
    """What JSON can hold: a complex value in two parts, what is not finite as null; records are left out."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Note):
        return vars(value)
    if isinstance(value, complex):
        return dict(zip(parts_of(name), (plain_of(value.real), plain_of(value.imag)), strict=True))
    if isinstance(value, Mapping):
        plain = (str, int, float, complex, Mapping, list, tuple, Note, type(None))
        kept = {key: each for key, each in value.items() if isinstance(each, plain) or hasattr(each, "tolist")}
        return {str(key): plain_of(each, str(key)) for key, each in kept.items()}
    if isinstance(value, (list, tuple)):
        return [plain_of(each, name) for each in value]
    return None if isinstance(value, float) and not cmath.isfinite(value) else value


def flat_words(values: Mapping[Any, Any], before: str = "") -> Iterator[tuple[str, str]]:
    """Names and values in words, those of a mapping behind its name; of many values the first; nothing of None."""
    for key, value in values.items():
        name, several = f"{before}{key}", value if isinstance(value, list | tuple) else [value]
        if isinstance(value, Mapping) or (value and isinstance(several[0], Mapping)):
            yield from flat_words(value if isinstance(value, Mapping) else dict(enumerate(several, 1)), f"{name}, ")
        elif value is not None:
            more = f" ... ({len(several)} values)" if len(several) > MOST_LISTED else ""
            words = (f"{each:.6g}" if isinstance(each, float) else str(each) for each in several[:MOST_LISTED])
            yield name, ", ".join(words) + more

"""One table: rows and columns, as text to read, as CSV and as values for JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

from torchliner.io.csv_rows import write_rows

Of = str | Callable[[Any], Any]
GAP = "  "  # between the columns of a text table


def value_of(row: Any, of: Of) -> Any:
    """A key of a mapping or an attribute, and perhaps one of its attributes, or a function."""
    if callable(of):
        return of(row)
    if not isinstance(row, Mapping):
        return attrgetter(of)(row)
    if of in row:
        return row[of]
    key, _, attribute = of.partition(".")
    return attrgetter(attribute)(row[key]) if attribute else row[key]


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Args:
        name: heading in CSV and key in JSON; "" for a column of the text alone.
        of: where a row has the value, such as "slope" or "slope.real", or a function of the row;
            default the name.
        heading: in the text, with the unit; "" for a column of CSV and JSON alone.
        text: format of a number in the text, such as ".3f", or a function that writes any value;
            without one the value stands as it is, to the left. Unknown numbers are "-".
        scale: factor of numbers in the text, such as 1e3 for mm.
    """

    name: str
    of: Of = ""
    heading: str = ""
    text: str | Callable[[Any], str] = ""
    scale: float = 1.0

    def value(self, row: Any) -> Any:
        """Of one row."""
        return value_of(row, self.of or self.name)

    def cell(self, row: Any) -> str:
        """In the text."""
        value = self.value(row)
        if callable(self.text):
            return self.text(value)
        if value is None or value != value:
            return "-"
        return format(value if self.scale == 1.0 else self.scale * value, self.text)


def real_and_imaginary(real: str, imaginary: str, of: Of, missing: Any = math.nan) -> tuple[Column, Column]:
    """Two columns of CSV and JSON for one complex value; ``missing`` stands for None."""

    def part(name: str) -> Callable[[Any], Any]:
        return lambda row: missing if (value := value_of(row, of)) is None else getattr(value, name)

    return Column(real, part("real")), Column(imaginary, part("imag"))


def plain_columns(names: str, missing: Any = math.nan) -> list[Column]:
    """Columns of CSV and JSON alone, by the names of values; a star marks complex ones.

    "frequency true*" gives frequency, true_resistance and true_reactance.
    """
    found: list[Column] = []
    for name in names.split():
        stem = name.rstrip("*")
        two = real_and_imaginary(f"{stem}_resistance", f"{stem}_reactance", stem, missing)
        found += two if name.endswith("*") else [Column(name)]
    return found


@dataclass(frozen=True)
class Table:
    """Rows, mappings or objects, and what is shown of them.

    Args:
        rows: at least one for ``write_csv``.  columns: in their order.
        csv: format of numbers in CSV; without one all their digits.
    """

    rows: Sequence[Any]
    columns: Sequence[Column]
    csv: str = ""

    def as_text(self) -> str:
        """Columns with a heading, as wide as they need; numbers to the right."""
        shown = [column for column in self.columns if column.heading]
        lines = [[column.heading for column in shown]]
        lines += [[column.cell(row) for column in shown] for row in self.rows]
        widths = [max(map(len, cells)) for cells in zip(*lines, strict=True)]
        sides = [">" if column.text else "<" for column in shown]
        return "\n".join(
            GAP.join(f"{cell:{side}{width}s}" for cell, side, width in zip(cells, sides, widths, strict=True)).rstrip()
            for cells in lines
        )

    def as_rows(self) -> list[dict[str, Any]]:
        """Values of the columns with a name, for JSON."""
        named = [column for column in self.columns if column.name]
        return [{column.name: column.value(row) for column in named} for row in self.rows]

    def write_csv(self, path: str | Path) -> None:
        """The columns with a name; None is an empty field."""
        write_rows(self.as_rows(), path, self.csv)


def format_complex(value: complex | None) -> str:
    """'0.168-0.066j'; no zero has a minus; '-' if unknown."""
    if value is None or value != value:
        return "-"
    real, imaginary = (round(part, 3) + 0.0 for part in (value.real, value.imag))
    return f"{real:.3f}{imaginary:+.3f}j"


def format_pair(value: complex | None, digits: int = 3) -> str:
    """'0.012, 0.034' of R and X; '-' if unknown; what would print as 0 but is not, as '2.1e-05'."""
    if value is None or value != value:
        return "-"
    parts = (value.real, value.imag)
    small = [0 < abs(part) < 0.5 * 10**-digits for part in parts]
    return ", ".join(f"{part:.1e}" if tiny else f"{part:.{digits}f}" for part, tiny in zip(parts, small, strict=True))


def format_range(low: float, high: float, digits: int = 3) -> str:
    """'0.150 to 0.170'."""
    return f"{low:.{digits}f} to {high:.{digits}f}"


def format_bounds(ends: tuple[complex, complex] | None, digits: int = 3) -> str:
    """'R 0.150 to 0.170, X -0.061 to -0.052'; '-' for None."""
    if ends is None:
        return "-"
    low, high = ends
    return (f"R {format_range(low.real, high.real, digits)}, "
            f"X {format_range(low.imag, high.imag, digits)}")  # fmt: skip


def format_references(references: Mapping[str, complex], lead: str = "") -> list[str]:
    """'true: 0.168-0.066j', a line each."""
    return [f"{lead}{name}: {format_complex(value)}" for name, value in references.items()]

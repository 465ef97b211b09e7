"""What a section of a page is made of: text, facts, tables, code and figures with their numbers."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from torchliner.io.csv_rows import fill_csv
from torchliner.io.whole_file import printable
from torchliner.report.page.svg import inline_svg
from torchliner.report.table import Column, Table
from torchliner.report.typesetting import typeset

MOST_ROWS = 400  # of a table on the page; all of them are in its CSV


def csv_link(table: Table) -> str:
    """The columns with a name as a data URI; "" where there are none."""
    rows = table.as_rows()
    if not rows or not rows[0]:
        return ""
    file = io.StringIO()
    fill_csv(file, rows, table.csv)
    content = base64.b64encode(file.getvalue().encode("utf-8")).decode("ascii")
    return f"data:text/csv;charset=utf-8;base64,{content}"


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str
    kind: ClassVar[str] = "text"


@dataclass(frozen=True)
class Bullets:
    """A list, in order of size where ``ordered``; ``beside``: what stands beside each."""

    items: Sequence[str]
    ordered: bool = False
    beside: Sequence[str] = ()
    kind: ClassVar[str] = "bullets"


@dataclass(frozen=True)
class Facts:
    """Names and values."""

    pairs: Sequence[tuple[str, str]]
    kind: ClassVar[str] = "facts"


@dataclass(frozen=True)
class Code:
    """Lines to copy."""

    label: str
    text: str
    kind: ClassVar[str] = "code"


@dataclass(frozen=True)
class Cell:
    """One cell: what is shown, and the number it is sorted by, "" for texts."""

    text: str
    value: str


@dataclass(frozen=True)
class Grid:
    """A table that sorts by a click.

    Args:
        name: of its CSV file, without ending.  caption: above it.
        table: columns with a heading are shown, those with a name are in the CSV.
    """

    name: str
    caption: str
    table: Table
    kind: ClassVar[str] = "grid"

    @property
    def headings(self) -> list[tuple[str, bool]]:
        """Each with whether its column holds numbers."""
        return [(c.heading, bool(c.text)) for c in self.table.columns if c.heading]

    @property
    def rows(self) -> list[list[Cell]]:
        """Cells of the rows that are shown."""
        shown = [column for column in self.table.columns if column.heading]
        return [
            [Cell(_cell_text(column, row), _number(column.value(row))) for column in shown]
            for row in self.table.rows[:MOST_ROWS]
        ]

    @property
    def left_out(self) -> int:
        """Rows that are in the CSV alone."""
        return max(0, len(self.table.rows) - MOST_ROWS)

    @property
    def csv(self) -> str:
        """Data URI."""
        return csv_link(self.table)


@dataclass(frozen=True)
class Figure:
    """A drawing with its numbers.

    Args:
        name: of its CSV file, and id on the page.
        drawn: matplotlib figure.
        caption: below it.
        table: its numbers.
    """

    name: str
    drawn: Any
    caption: str
    table: Table
    kind: ClassVar[str] = "figure"

    @property
    def alt(self) -> str:
        """For those who cannot see it: the caption, and the extent of each column of numbers."""
        extents = []
        for name, values in _columns_of(self.table).items():
            known = [v for v in values if isinstance(v, int | float) and math.isfinite(v)]
            if known:
                extents.append(f"{name} {min(known):.4g} to {max(known):.4g}")
        return typeset(f"{self.caption} {'; '.join(extents)}.")

    @property
    def svg(self) -> str:
        """Inline."""
        return inline_svg(self.drawn, self.name)

    @property
    def csv(self) -> str:
        """Data URI."""
        return csv_link(self.table)


Block = Text | Bullets | Facts | Code | Grid | Figure


@dataclass(frozen=True)
class Section:
    """Of a page; one without blocks is left out."""

    name: str
    title: str
    blocks: Sequence[Block] = field(default_factory=tuple)


def _columns_of(table: Table) -> dict[str, list[Any]]:
    """Values by the name of their column."""
    rows = table.as_rows()
    return {name: [row[name] for row in rows] for name in (rows[0] if rows else {})}


def _cell_text(column: Column, row: Any) -> str:
    """Numbers with true minus signs; texts in one line; drawings as they are."""
    value = column.value(row)
    if hasattr(value, "__html__"):
        return value
    return typeset(column.cell(row)) if column.text else shown(column.cell(row))


def _number(value: Any) -> str:
    """For sorting: of a complex number its real part."""
    value = value.real if isinstance(value, complex) else value
    known = isinstance(value, (int, float)) and math.isfinite(value)
    return repr(float(value)) if known else ""


def shown(text: Any) -> str:
    """Text from a file in one line; the template escapes it."""
    return " ".join(printable(str(text)).split())

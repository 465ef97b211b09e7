"""Any result as its outlets show it: a screen of text, JSON, CSV, pictures, a page.

A kind of result is a function from the result to an ``Answer``; ``answer_of`` knows all of them.
"""

import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from torchliner.names import resolve
from torchliner.records.notes import Note
from torchliner.report.table import Bounds, Table, bounds_of, format_bounds, format_complex, plain_of, table_of

FIRST = ("null-test", "level-check", "model-misfit")  # codes of what makes Z another quantity, whatever its size
MOST_ROWS, MOST_WARNINGS, WIDTH, WIDEST = 12, 3, 120, 160  # of a screen, its text and its table
HOMES: dict[str, str] = {  # type of a result, or a value that only this kind of study has: what makes its answer
    "ImpedanceMap": "of_map:of_maps",
    "ImpedanceLine": "of_line:of_line",
    "PointImpedances": "of_line:of_points",
    "Station": "of_line:of_stations",
    "WallEduction": "of_duct:of_wall",
    "FieldFit": "of_duct:of_wall",
    "MicrophoneLine": "of_duct:of_line",
    "Fit": "of_studies:of_fit",
    "candidates": "of_studies:of_identification",
    "LevelCurve": "of_studies:of_curve",
    "slopes": "of_studies:of_sensitivities",
    "skipped": "of_studies:of_audit",
    "words": "of_studies:of_comparison",
    "references": "of_studies:of_models",
    "judged": "of_studies:of_heights",
}


EMPTY = Table(())


class Grid(NamedTuple):
    """A table with a name, of its CSV on a page and in JSON, and a caption."""

    name: str
    caption: str
    table: Table


class Picture(NamedTuple):
    """A drawing and its numbers."""

    name: str  # of its files
    caption: str
    draw: Callable[[Any], Any]  # takes the path of a picture, or None; returns the figure
    rows: Callable[[], Sequence[Mapping[str, Any]]]  # makes the rows of what is drawn


@dataclass(frozen=True)
class Answer:
    """What there is to show of a result."""

    title: str
    lines: Sequence[str]  # the answer in sentences: Z with its interval, the level check
    table: Table = EMPTY  # the rows behind the answer, of CSV, JSON, pages and a verbose screen
    brief: Sequence[Mapping[str, Any]] | None = None  # the rows of a screen; default all
    caption: str = "The answer."  # of the table
    grids: Sequence[Grid] = ()  # further tables, of JSON, a verbose screen and a page
    remarks: Sequence[str] = ()  # what the tables rest on, of a verbose screen and a page
    notes: Sequence[Note | str] = ()  # warnings
    step: str = ""  # what to do next, one sentence; "" where nothing is to be done
    state: str = ""  # of the level check: "passes", "inconclusive", "fails" or ""
    pictures: Sequence[Picture] = ()  # the first is the one that a command draws
    results: Sequence[Any] = ()  # whose ``choices`` name inputs, versions and the command; those of the first are shown
    more: Any = field(default_factory=dict)  # values by name for JSON alone; all of JSON where there is no table
    source: Path | None = None  # file of the result

    @property
    def plain(self) -> Any:
        """What JSON holds."""
        if not self.tables:
            return plain_of(self.more)
        found = {"title": self.title, "rows": self.table.rows, "notes": list(self.notes), "choices": self.choices}
        return plain_of({grid.name: grid.table.rows for grid in self.grids} | found | self.more)

    @property
    def choices(self) -> Mapping[str, Any]:
        """Those behind the result."""
        return next((one.choices for one in self.results), {})

    @property
    def tables(self) -> list[Grid]:
        """All that have rows to show."""
        every = [Grid("answer", self.caption, self.table), *self.grids]
        return [grid for grid in every if grid.table.shown]

    @property
    def on_screen(self) -> Table:
        """What a screen shows of the table."""
        return self.table if self.brief is None else replace(self.table, rows=self.brief)

    def screen(self, verbose: bool = False, warnings: bool = True) -> str:
        """Text for a terminal: the answer, three warnings and the next step, or all there is; a command writes the
        ``warnings`` to standard error."""
        parts, brief, notes = [self.title, *self.lines], self.on_screen, ordered(self.notes)
        if verbose:
            for grid in self.tables:
                parts += ["", grid.caption, grid.table.as_text()]
            parts += ["", *self.remarks] if self.remarks else []
        elif brief.rows and brief.shown:
            parts.append(brief.as_text(MOST_ROWS, WIDEST))
            if (more := len(brief.rows) - MOST_ROWS) > 0:
                parts.append(f"... {more} more rows (--verbose)")
        if warnings:
            most = len(notes) if verbose else MOST_WARNINGS
            for note in notes[:most]:
                size = "" if note.size is None else f" (may move Z by {note.size:.2g})"
                text = f"warning{size}: {note.text}"
                parts.append(textwrap.fill(text, WIDTH, subsequent_indent="  ", break_on_hyphens=False))
            parts += [f"more warnings: {len(notes) - most} (--verbose)"] if len(notes) > most else []
        return "\n".join([*parts, *([f"next: {self.step}"] if self.step else [])])

    def html(self) -> str:
        """For notebooks: title, answer and rows."""
        shown, rows = self.table.shown, (self.on_screen.rows or self.table.rows)[:MOST_ROWS]
        table = [[column.heading for column in shown], *([column.cell(row) for column in shown] for row in rows)]
        cells = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in table)
        lines = "".join(f"<p>{escape(line)}</p>" for line in self.lines)
        return f"<div><b>{escape(self.title)}</b>{lines}<table>{cells}</table></div>"

    def draw(self, path: Path) -> None:
        """The first picture; ValueError where there is none."""
        if not self.pictures:
            raise ValueError(f"{path}: {self.title}: there is nothing to draw")
        self.pictures[0].draw(path)

    def write_pictures(self, folder: Path) -> None:
        """Every picture as PNG, each with its numbers as CSV beside it."""
        folder.mkdir(parents=True, exist_ok=True)
        for each in self.pictures:
            each.draw(folder / f"{each.name}.png")
            table_of(each.rows()).write_csv(folder / f"{each.name}.csv")


def answer_of(result: Any, *others: Any, source: Path | None = None, **about: Any) -> Answer:
    """Of any result, or several that belong together, such as maps of several heights; a TypeError for what is none.

    ``source`` is the file it is from, ``about`` what a kind of result wants to know besides.
    """
    several = [*(result if isinstance(result, (list, tuple)) else [result]), *others]
    first = several[0]
    names = [type(first).__name__, *(first if isinstance(first, dict) else ())]
    home = next((HOMES[name] for name in names if name in HOMES), None)
    if home is None:
        raise TypeError(f"{names[0]} is no result that can be shown")
    found: Answer = resolve(f"torchliner.report.{home}")(*several, **about)
    named = "" if source is None or ":" in found.title else f": {source.name}"
    return replace(found, source=source, title=found.title + named)


def ordered(notes: Iterable[Note | str]) -> list[Note]:
    """Each once: what makes Z another quantity, then by how far Z may be off, then those of unknown size."""
    each = dict.fromkeys(Note("", note) if isinstance(note, str) else note for note in notes)
    return sorted(each, key=lambda n: (n.code not in FIRST, n.size is None, -(n.size or 0.0)))


def impedance_words(value: complex, bounds: Bounds | None = None, level: float | None = None) -> str:
    """'Z = 0.168-0.066j (95 % interval: R 0.160 to 0.176, X -0.070 to -0.062)'."""
    words = "" if bounds is None or level is None else f" ({100 * level:g} % interval: {format_bounds(bounds)})"
    return f"Z = {format_complex(value)}{words}"


def row_words(row: Mapping[str, Any], level: float | None) -> str:
    """The same of a row with impedance, low and high."""
    return impedance_words(row["impedance"], bounds_of(row), level)

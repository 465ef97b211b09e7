"""Any result as its outlets show it: a screen of text, JSON, CSV, pictures, a page.

A kind of result is a function from the result to an ``Answer``; ``answer_of`` knows all of them.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

from torchliner.names import resolve
from torchliner.records.notes import Note
from torchliner.report.table import Bounds, Table, bounds_of, format_bounds, format_complex, table_of

FIRST = ("null-test", "level-check", "model-misfit")  # codes of what makes Z another quantity, whatever its size
DIFFER = {True: "yes", False: "not shown"}
MOST_ROWS, MOST_WARNINGS, WIDTH = 12, 3, 100  # of a screen
HOMES: dict[str, str] = {  # type of a result, or a value that only this kind of study has: what makes its answer
    "ImpedanceMap": "of_map:of_maps",
    "ImpedanceLine": "of_line:of_line",
    "PointImpedances": "of_line:of_points",
    "WallEduction": "of_wall:of_wall",
    "FieldFit": "of_wall:of_wall",
    "MicrophoneLine": "of_duct:of_line",
    "Station": "of_bursts:of_stations",
    "LevelCurve": "of_bursts:of_curve",
    "Fit": "of_fits:of_fit",
    "Sensitivities": "of_studies:of_sensitivities",
    "skipped": "of_studies:of_audit",
    "same_run": "of_studies:of_comparison",
    "sorted_by": "of_studies:of_models",
    "candidates": "of_fits:of_identification",
    "first_decay": "of_studies:of_heights",
    "educed": "of_fits:of_validation",
}


@dataclass(frozen=True)
class Grid:
    """A table with a name, of its CSV on a page, and a caption."""

    name: str
    caption: str
    table: Table


@dataclass(frozen=True)
class Picture:
    """A drawing and its numbers.

    Args:
        name: of its files.
        caption: below it.
        draw: takes the path of a picture, or None; returns the figure.
        numbers: what is drawn, as a table.
    """

    name: str
    caption: str
    draw: Callable[[Any], Any]
    numbers: Callable[[], Table]


@dataclass(frozen=True)
class Answer:
    """What there is to show of a result.

    Args:
        title: what it is.
        lines: the answer in sentences: Z with its interval, the level check.
        table: the rows behind the answer, of CSV, pages and a verbose screen.
        brief: those of a screen; default the same.
        caption: of the table.
        plain: what JSON holds: values by name, of Python's own types and complex.
        grids: further tables, of a verbose screen and of a page.
        remarks: what the tables rest on, likewise.
        notes: warnings.
        step: what to do next, one sentence; "" where nothing is to be done.
        state: of the level check: ``passes``, ``inconclusive``, ``fails`` or "".
        pictures: the first is the one that a command draws.
        results: whose ``choices`` name inputs, versions and the command.
        choices: that are shown; default those of the first result.
        facts: names and values of the case.
        source: file of the result.
    """

    title: str
    lines: Sequence[str]
    table: Table
    plain: Any
    brief: Table | None = None
    caption: str = ""
    grids: Sequence[Grid] = ()
    remarks: Sequence[str] = ()
    notes: Sequence[Note | str] = ()
    step: str = ""
    state: str = ""
    pictures: Sequence[Picture] = ()
    results: Sequence[Any] = ()
    choices: Mapping[str, Any] = field(default_factory=dict)
    facts: Sequence[tuple[str, str]] = ()
    source: Path | None = None

    def screen(self, verbose: bool = False, warnings: bool = True) -> str:
        """Text for a terminal: the answer, three warnings and the next step, or all there is.

        Args:
            verbose: all tables, remarks and warnings.
            warnings: whether they stand in it; a command writes them to standard error.
        """
        parts = [self.title, *self.lines]
        if verbose:
            for grid in (Grid("", self.caption, self.table), *self.grids):
                if grid.table.rows and grid.table.shown:
                    parts += ["", *filter(None, [grid.caption]), grid.table.as_text()]
            parts += ["", *self.remarks] if self.remarks else []
        else:
            brief = self.table if self.brief is None else self.brief
            parts += [brief.as_text(MOST_ROWS)] if brief.rows and brief.shown else []
            if (more := len(brief.rows) - MOST_ROWS) > 0:
                parts.append(f"... {more} more rows (--verbose)")
        step = [f"next: {self.step}"] if self.step else []
        told = _warnings(self.notes, verbose) if warnings else []
        return "\n".join([*parts, *told, *step])

    def draw(self, path: Path) -> None:
        """The first picture; of one that has a sibling a frequency, as NAME_1500Hz, each of them.

        Raises:
            ValueError: there is nothing to draw.
        """
        if not self.pictures:
            raise ValueError(f"{path}: {self.title}: there is nothing to draw")
        first, *others = self.pictures
        stem, _, frequency = first.name.partition("_")
        first.draw(path.with_stem(f"{path.stem}_{frequency}") if frequency else path)
        for each in others if frequency else ():
            each.draw(path.with_stem(path.stem + each.name.removeprefix(stem)))

    def write_pictures(self, folder: Path) -> None:
        """Every picture as PNG, each with its numbers as CSV beside it."""
        folder.mkdir(parents=True, exist_ok=True)
        for each in self.pictures:
            each.draw(folder / f"{each.name}.png")
            each.numbers().write_csv(folder / f"{each.name}.csv")


def ordered(notes: Iterable[Note | str]) -> list[Note]:
    """Each once: what makes Z another quantity, then by how far Z may be off, then those of unknown size."""
    each = dict.fromkeys(Note("", note) if isinstance(note, str) else note for note in notes)
    return sorted(each, key=lambda n: (n.code not in FIRST, n.size is None, -(n.size or 0.0)))


def _warnings(notes: Iterable[Note | str], verbose: bool) -> list[str]:
    """A paragraph each."""
    found = ordered(notes)
    shown = found if verbose else found[:MOST_WARNINGS]
    lines = []
    for note in shown:
        size = "" if note.size is None else f" (may move Z by {note.size:.2g})"
        lines.append(
            textwrap.fill(f"warning{size}: {note.text}", WIDTH, subsequent_indent="  ", break_on_hyphens=False)
        )
    if left := len(found) - len(shown):
        lines.append(f"{left} more warnings (--verbose)" if left > 1 else "one more warning (--verbose)")
    return lines


def impedance_words(value: complex, bounds: Any = None, level: float | None = None) -> str:
    """'Z = 0.168-0.066j (95 %: R 0.160 to 0.176, X -0.070 to -0.062)'."""
    interval = "" if bounds is None or bounds[0] != bounds[0] else f": {format_bounds(bounds)}"
    known = f" ({100 * level:g} % interval{interval})" if interval and level is not None else ""
    return f"Z = {format_complex(value)}{known}"


def row_words(row: Mapping[str, Any], level: float | None) -> str:
    """The same of a row with impedance, low and high."""
    return impedance_words(row["impedance"], bounds_of(row), level)


def difference_row(
    frequency: float, z: complex, bounds: Bounds | None, name: str, other: complex, its: Any
) -> dict[str, Any]:
    """Z minus what is known from elsewhere; half-widths of both intervals add as squares, of one it is its own."""
    row: dict[str, Any] = {"frequency": frequency, "minus": name, "other": other, "difference": z - other}
    row |= {"low": None, "high": None, "differs": ""}
    if bounds is not None and math.isfinite(abs(other)):
        found = joint_bounds(bounds, its or (other, other))
        row |= found | {"differs": DIFFER[found["differs"]]}
    return row


def joint_bounds(mine: Bounds, theirs: Bounds) -> dict[str, Any]:
    """Bounds of a difference of independent values, infinite where either has no bound, and whether 0 lies outside
    those of R or of X."""
    ends = []
    for part in ("real", "imag"):
        (a, b), (c, d) = ([getattr(end, part) for end in pair] for pair in (mine, theirs))
        reach = math.hypot(b - a, d - c) / 2
        middle = (a + b - c - d) / 2 if reach < math.inf else 0.0  # else inf minus inf
        ends.append((middle - reach, middle + reach))
    low, high = (complex(ends[0][i], ends[1][i]) for i in (0, 1))
    return {"low": low, "high": high, "differs": any(a > 0 or b < 0 for a, b in ends)}


def difference_grid(rows: Sequence[Mapping[str, Any]]) -> Grid:
    """The table of ``difference_row``."""
    caption = "The answer minus what is known from elsewhere; the interval is the joint one where both have one."
    return Grid("compared-table", caption, table_of(rows, "frequency,minus,other,difference,interval,differs"))


def answer_of(result: Any, *others: Any, source: Path | None = None, **about: Any) -> Answer:
    """Of any result.

    Args:
        result: a result, or a list of those that belong together, such as maps of several heights.
        others: more of them.
        source: the file it is from.
        about: what a kind of result wants to know besides.
    Raises:
        TypeError: no result.
    """
    several = [*(result if isinstance(result, (list, tuple)) else [result]), *others]
    first = several[0]
    names = [type(first).__name__, *(first if isinstance(first, dict) else ())]
    home = next((HOMES[name] for name in names if name in HOMES), None)
    if home is None:
        raise TypeError(f"{names[0]} is no result that can be shown")
    found: Answer = resolve(f"torchliner.report.{home}")(several, source=source, **about)
    return found


def screen_of(result: Any) -> str:
    """A short text of any result."""
    return answer_of(result).screen()


def html_of(result: Any) -> str:
    """For notebooks: title, answer and rows of any result."""
    answer = answer_of(result)
    brief = answer.table if answer.brief is None else answer.brief
    heads = "".join(f"<th>{escape(column.heading)}</th>" for column in brief.shown)
    cells = [[escape(str(column.cell(row))) for column in brief.shown] for row in brief.rows[:MOST_ROWS]]
    rows = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in cells)
    lines = "".join(f"<p>{escape(line)}</p>" for line in answer.lines)
    return f"<div><b>{escape(answer.title)}</b>{lines}<table><tr>{heads}</tr>{rows}</table></div>"


def plain_of(value: Any) -> Any:
    """What JSON can hold; maps, fits and other records of the package are left out."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Note):
        return vars(value)
    if isinstance(value, Mapping):
        return {str(name): plain_of(each) for name, each in value.items() if _is_plain(each)}
    return [plain_of(each) for each in value] if isinstance(value, (list, tuple)) else value


def _is_plain(value: Any) -> bool:
    plain = (str, int, float, complex, Mapping, list, tuple, Note, type(None))
    return isinstance(value, plain) or hasattr(value, "tolist")

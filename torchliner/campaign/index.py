"""The index of a campaign, a row a unit and frequency as CSV, and the page that is made of it."""

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from torchliner.io.csv_rows import write_rows
from torchliner.io.whole_file import writable
from torchliner.names import __version__
from torchliner.records.level_check import FAILS
from torchliner.report.answer import Answer, Picture
from torchliner.report.page import ENDING, shown, write_page
from torchliner.report.studies import draw_cases
from torchliner.report.table import Column, Table, format_bounds

Z = tuple(f"{part}{end}" for end in ("", "_low", "_high") for part in ("resistance", "reactance"))
NUMBERS = ("height", "frequency", "notes", "seconds", *Z)  # all else is text
COLUMNS = (
    *("unit", "file", "height", "source_side", "liner", "choices", "averaging", "frequency"),
    *Z,
    *("level_check", "notes", "status", "error", "seconds", "hash", "campaign", "version"),
)
DONE, FAILED = "done", "failed"
MOST_DRAWN = 60  # cases
Row = Mapping[str, Any]


def full_row(**known: Any) -> dict[str, Any]:
    """All columns, those not known as nan or an empty text."""
    return {name: known.get(name, math.nan if name in NUMBERS else "") for name in COLUMNS}


def index_table(rows: Sequence[Row]) -> Table:
    """The chief columns; all of them in CSV."""
    columns = [
        Column("case", "unit"),
        Column("y (mm)", "height", ".2f", 1e3),
        Column("f (Hz)", "frequency", ".1f"),
        Column("Z", _impedance),
        Column("interval", _interval, format_bounds),
        Column("level check", "level_check"),
        Column("warnings", "notes", ".0f"),
        Column("status", lambda row: row["error"] or row["status"]),
    ]
    return Table(rows, columns, COLUMNS)


def _impedance(row: Row, end: str = "") -> complex | None:
    """Z of a row, or an end of its interval, ``_low`` or ``_high``; None where there is none."""
    found = complex(row[f"resistance{end}"], row[f"reactance{end}"])
    return None if math.isnan(found.real) else found


def _interval(row: Row) -> tuple[complex, complex] | None:
    low, high = _impedance(row, "_low"), _impedance(row, "_high")
    return None if low is None or high is None else (low, high)


def write_index(rows: Sequence[Row], folder: Path, title: str) -> None:
    """``index.csv`` of a folder; what is not known stays empty."""
    about = {"campaign": title, "version": __version__}
    known = [{name: value if value == value else None for name, value in {**row, **about}.items()} for row in rows]
    write_rows(known or [dict.fromkeys(COLUMNS)], folder / "index.csv")


def read_index(folder: Path) -> list[dict[str, Any]]:
    """Rows of ``index.csv`` in a folder; none where there is none.

    Raises:
        ValueError: that of another version of this package, or a damaged one.
    """
    path = folder / "index.csv"
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8", errors="replace") as file:
        reader = csv.DictReader(file)
        if reader.fieldnames != [*COLUMNS]:
            raise ValueError(
                f"{path} is no index of this version: its columns are {', '.join(reader.fieldnames or ())[:200]}; name "
                "another --output, or take the torchliner that wrote it"
            )
        try:
            return [{k: float(row[k] or "nan") if k in NUMBERS else row[k] for k in COLUMNS} for row in reader]
        except (ValueError, TypeError, csv.Error) as error:
            raise ValueError(f"{path} is damaged: {error}; run the campaign again") from error


def report_campaign(folder: Path, output: Path) -> Answer:
    """The page of a folder that ``torchliner run`` keeps: all rows, and R and X of every case. Returns what is on it.

    Raises:
        ImportError: jinja2 or matplotlib is not installed.
        OSError, ValueError: no campaign; an output that cannot be written.
    """
    rows = sorted(read_index(folder), key=lambda row: (row["unit"], row["frequency"]))
    if not rows:
        raise ValueError(f"{folder} holds no index.csv; it is the folder of no campaign (torchliner run writes one)")
    writable(output, ENDING)
    done = [row for row in rows if row["status"] == DONE]
    failed = {row["unit"]: row["error"] for row in rows if row["status"] != DONE}
    fails = [row for row in done if str(row["level_check"]).endswith(FAILS)]
    units = {row["unit"] for row in rows}
    ranges = [
        f"{part} from {min(known):.3f} to {max(known):.3f}"
        for part in ("resistance", "reactance")
        if (known := [row[part] for row in done if math.isfinite(row[part])])
    ]
    notes = [f"{unit}: failed: {shown(error)}" for unit, error in failed.items()]
    notes += [f"level check at {r['frequency']:g} Hz fails, {r['unit']}: {r['level_check']}" for r in fails]
    notes += [f"warnings in the map of {row['unit']}: {int(row['notes'])}" for row in done if row["notes"] > 0]
    first = [*{row["unit"]: row for row in reversed(done)}.values()][::-1][:MOST_DRAWN]
    ends = [_interval(row) or (None, None) for row in first]
    dots = [
        {"name": row["unit"], "impedance": _impedance(row), "low": low, "high": high}
        for row, (low, high) in zip(first, ends, strict=True)
    ]
    caption = "R and X over ρc of each case at its first frequency, with its interval."
    picture = Picture("cases", caption, lambda path: draw_cases(dots, path), lambda: index_table(first).as_rows())
    answer = Answer(
        title=f"Campaign: {rows[0]['campaign'] or folder.name}",
        lines=[
            f"{len(units)} cases, {len(units) - len(failed)} done and {len(failed)} failed: "
            f"{'; '.join(ranges)} over ρc.",
            f"The level check fails in {len(fails)} of {sum(bool(row['level_check']) for row in done)} rows in which a "
            "pressure is known.",
        ],
        table=index_table(rows),
        caption="A row a case and frequency, as in index.csv.",
        notes=notes,
        state=FAILS if fails else "",
        pictures=[picture] if first else [],
        results=[SimpleNamespace(choices={"version": rows[0]["version"]})],
        source=folder / "index.csv",
    )
    write_page(answer, output)
    return answer

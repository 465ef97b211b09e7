"""What a campaign leaves: a table with a row per unit and frequency, and a page of it."""

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from torchliner.io.result_writers import write_rows
from torchliner.io.whole_file import printable
from torchliner.records.level_check import FAILS
from torchliner.report.answer import Answer, Picture
from torchliner.report.page import write_page
from torchliner.report.studies import MOST_DRAWN, draw_cases
from torchliner.report.table import Row, Table, bounds_of, table_of

EMPTY: Row = {  # a row of which nothing is known
    **dict.fromkeys(("unit", "file", "liner", "choices", "averaging", "source_side"), ""),
    **dict.fromkeys(("height", "frequency", "notes"), math.nan),
    **dict.fromkeys(("impedance", "low", "high"), complex(math.nan, math.nan)),
    **dict.fromkeys(("level_check", "status", "error", "hash", "campaign", "version"), ""),
}
COLUMNS = list(table_of([EMPTY]).as_rows()[0])  # of CSV
DONE, FAILED = "done", "failed"


def full_row(**known: Any) -> Row:
    """All values of a row."""
    return {name: empty if known.get(name) is None else known[name] for name, empty in EMPTY.items()}


def index_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """All values in CSV, the chief ones in text."""
    return table_of(rows, "unit,height,frequency,impedance,interval,level_check,notes,status,error")


def write_index(rows: Sequence[Row], path: Path) -> None:
    """As CSV; what is not known stays empty."""
    flat = [{k: v if v == v else None for k, v in row.items()} for row in table_of(rows).as_rows()]
    write_rows(flat or [dict.fromkeys(COLUMNS)], path)


def read_index(path: Path) -> list[Row]:
    """What ``write_index`` wrote, none where there is no file; a ValueError for that of another version, or damaged."""
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8", errors="replace") as file:
        reader = csv.DictReader(file)
        if reader.fieldnames != COLUMNS:
            raise ValueError(f"{path} is no index of this version; name another --output")
        try:
            return [_row_of(row) for row in reader]
        except (ValueError, TypeError, csv.Error) as error:
            raise ValueError(f"{path} is damaged: {error}; run the campaign again") from error


def _row_of(line: Mapping[str, str]) -> Row:
    """The values of a line of CSV."""
    values, row = iter(line.values()), Row()
    for name, empty in EMPTY.items():
        if isinstance(empty, str):
            row[name] = (next(values) or "").removeprefix("'")  # which spreadsheets need
        else:
            row[name] = type(empty)(*(float(next(values) or "nan") for _ in range(1 + isinstance(empty, complex))))
    return row


def report_campaign(folder: Path, output: Path) -> Answer:
    """The page of a folder that ``torchliner run`` keeps: all rows, and R and X of every case. Returns its answer."""
    rows = sorted(read_index(folder / "index.csv"), key=lambda row: (row["unit"], row["frequency"]))
    if not rows:
        raise ValueError(f"{folder} holds no index.csv; it is the folder of no campaign (torchliner run writes one)")
    done, failed = ([row for row in rows if (row["status"] == DONE) == well] for well in (True, False))
    fails = [row for row in done if row["level_check"].endswith(FAILS)]
    notes = [f"{row['unit']}: failed: {printable(row['error'])}" for row in failed]
    notes += [f"level check at {r['frequency']:g} Hz fails, {r['unit']}: {r['level_check']}" for r in fails]
    notes += [f"warnings in the map of {row['unit']}: {int(row['notes'])}" for row in done if row["notes"] > 0]
    first = [*{row["unit"]: row for row in reversed(done)}.values()][::-1][:MOST_DRAWN]
    ends = (dict(zip(("low", "high"), bounds_of(row) or (None, None), strict=True)) for row in first)
    drawn = [row | {"name": row["unit"]} | bounds for row, bounds in zip(first, ends, strict=True)]
    caption = "R and X over ρc of each case at its first frequency, with its interval."
    count = len({row["unit"] for row in rows})
    answer = Answer(
        title=f"Campaign: {rows[0]['campaign'] or folder.name}",
        lines=[
            f"{count} cases, {count - len(failed)} done and {len(failed)} failed.",
            f"The level check fails in {len(fails)} of {sum(bool(row['level_check']) for row in done)} rows in which a "
            "pressure is known.",
        ],
        table=index_table(rows),
        caption="A row a case and frequency, as in index.csv.",
        notes=notes,
        state=FAILS if fails else "",
        pictures=[Picture("cases", caption, lambda path: draw_cases(drawn, path), lambda: first)] if first else [],
        results=[SimpleNamespace(choices={"version": rows[0]["version"]})],
        source=folder / "index.csv",
    )
    write_page(answer, output)
    return answer

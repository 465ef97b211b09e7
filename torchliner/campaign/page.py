"""The page of a campaign: all rows, a picture of R and X of every case, links to their own pages."""

from __future__ import annotations

import html
import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import quote

from torchliner.campaign.index import COLUMNS, DONE, impedance, interval, read_index
from torchliner.io.whole_file import writable, writable_folder
from torchliner.records.level_check import FAILS
from torchliner.report.answer import Answer, Picture
from torchliner.report.page import ENDING, report_file, require_report, shown, write_page
from torchliner.report.studies import draw_cases
from torchliner.report.table import Column, Table, format_bounds, format_complex

Rows = Sequence[Mapping[str, Any]]
MOST_DRAWN = 60  # cases


def report_campaign(folder: Path, output: Path, *, cases: bool = False) -> tuple[Answer, list[Path]]:
    """The page of a folder that ``torchliner run`` keeps.

    Args:
        folder: with ``index.csv`` and ``maps/``.  output: of the page, .html.
        cases: a page of each map too, in OUTPUT_cases beside.
    Returns:
        What is on the page, and all files that were written.
    Raises:
        ImportError: jinja2 or matplotlib is not installed.
        OSError, ValueError: no campaign; an output that cannot be written.
    """
    require_report()
    rows = read_index(folder)
    writable(output, ENDING)
    beside = output.with_name(f"{output.stem}_cases")
    rows = sorted(rows, key=lambda row: (row["unit"], row["frequency"]))
    units = {name: list(several) for name, several in itertools.groupby(rows, lambda row: row["unit"])}
    written: list[Path] = []
    if cases:
        writable_folder(beside)
        beside.mkdir(exist_ok=True)
        for name in units:
            path = folder / "maps" / f"{name}.h5"
            if path.exists() and any(row["status"] == DONE for row in units[name]):
                written.append(beside / f"{name}{ENDING}")
                report_file(path, written[-1])
    links = {path.stem: f"{quote(beside.name)}/{quote(path.name)}" for path in written}
    answer = _answer(folder, units, links)
    write_page(answer, output)
    return answer, [output, *written]


def _answer(folder: Path, units: Mapping[str, Rows], links: Mapping[str, str]) -> Answer:
    rows = [row for several in units.values() for row in several]
    done = [row for row in rows if row["status"] == DONE]
    failed = {row["unit"]: row["error"] for row in rows if row["status"] != DONE}
    fails = [row for row in done if str(row["level_check"]).endswith(FAILS)]
    ranges = [
        f"{part} from {min(known):.3f} to {max(known):.3f}"
        for part in ("resistance", "reactance")
        if (known := [row[part] for row in done if math.isfinite(row[part])])
    ]
    checked = sum(bool(row["level_check"]) for row in done)
    notes = [f"{unit}: failed: {shown(error)}" for unit, error in failed.items()]
    notes += [f"level check at {r['frequency']:g} Hz fails, {r['unit']}: {r['level_check']}" for r in fails]
    notes += [f"warnings in the map of {row['unit']}: {int(row['notes'])}" for row in done if row["notes"] > 0]
    first = [several[0] for several in units.values() if several[0]["status"] == DONE][:MOST_DRAWN]
    dots = [
        {
            "name": row["unit"],
            "impedance": impedance(row),
            **dict(zip(("low", "high"), interval(row) or (None, None), strict=True)),
        }
        for row in first
    ]
    caption = "R and X over ρc of each case at its first frequency, with its interval."
    picture = Picture("cases", caption, lambda path: draw_cases(dots, path), lambda: _table(first, links))
    return Answer(
        title=f"Campaign: {(rows[0]['campaign'] if rows else '') or folder.name}",
        lines=[
            f"{len(units)} cases, {len(units) - len(failed)} done and {len(failed)} failed: "
            f"{'; '.join(ranges)} over ρc.",
            f"The level check fails in {len(fails)} of {checked} rows in which a pressure is known.",
        ],
        table=_table(rows, links),
        caption="A row a case and frequency, as in index.csv.",
        plain=rows,
        notes=notes,
        state=FAILS if fails else "",
        pictures=[picture] if first else [],
        results=[SimpleNamespace(choices={"version": rows[0]["version"] if rows else ""})],
        source=folder / "index.csv",
    )


def _table(rows: Rows, links: Mapping[str, str]) -> Table:
    """All columns in the CSV, the chief ones on the page."""
    import markupsafe

    def case(row: Mapping[str, Any]) -> Any:
        name = html.escape(shown(row["unit"])).replace("__", "__<wbr>")
        link = links.get(row["unit"])
        return markupsafe.Markup(name if link is None else f'<a href="{html.escape(link)}">{name}</a>')

    columns = [
        Column("", case, "case"),
        Column("", "height", "y (mm)", ".2f", 1e3),
        Column("", "frequency", "f (Hz)", ".1f"),
        Column("", impedance, "Z", format_complex),
        Column("", interval, "interval", format_bounds),
        Column("", "level_check", "level check"),
        Column("", "notes", "warnings", ".0f"),
        Column("", "status", "status"),
    ]
    return Table(rows, [*columns, *map(Column, COLUMNS)])

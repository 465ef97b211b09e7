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

from torchliner.campaign.index import COLUMNS, DONE, read_index
from torchliner.io.whole_file import writable, writable_folder
from torchliner.report.figure import COLOURS, PARTS, finish, styled, subplots
from torchliner.report.figure import Figure as Drawing
from torchliner.report.page.blocks import Figure, Grid, Section, shown
from torchliner.report.page.opening import report_file
from torchliner.report.page.render import ENDING, Page, require_report
from torchliner.report.page.sections import FOOTER, citation, origin, warned
from torchliner.report.table import Column, Table, format_complex
from torchliner.report.typesetting import typeset

Rows = Sequence[Mapping[str, Any]]
ROW_HEIGHT = 0.22  # inches
MOST_DRAWN = 60  # cases


def report_campaign(folder: Path, output: Path, *, cases: bool = False) -> tuple[Page, list[Path]]:
    """The page of a folder that ``torchliner run`` keeps.

    Args:
        folder: with ``index.csv`` and ``maps/``.  output: of the page, .html.
        cases: a page of each map too, in OUTPUT_cases beside.
    Returns:
        The page and all files that were written.
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
    page = _page(folder, units, links)
    page.write(output)
    return page, [output, *written]


def _page(folder: Path, units: Mapping[str, Rows], links: Mapping[str, str]) -> Page:
    rows = [row for several in units.values() for row in several]
    done = [row for row in rows if row["status"] == DONE]
    failed = {row["unit"]: row["error"] for row in rows if row["status"] != DONE}
    fails = [row for row in done if str(row["level_check"]).endswith("fails")]
    ranges = [
        f"{part} from {min(known):.3f} to {max(known):.3f}"
        for part in ("resistance", "reactance")
        if (known := [row[part] for row in done if math.isfinite(row[part])])
    ]
    checked = sum(bool(row["level_check"]) for row in done)
    answer = (
        f"{len(units)} cases, {len(units) - len(failed)} done and {len(failed)} failed: {'; '.join(ranges)} over ρc; "
        f"the level check fails in {len(fails)} of {checked} rows in which a pressure is known."
    )
    notes = [f"{unit}: failed: {shown(error)}" for unit, error in failed.items()]
    notes += [f"level check at {r['frequency']:g} Hz fails, {r['unit']}: {r['level_check']}" for r in fails]
    notes += [f"warnings in the map of {row['unit']}: {int(row['notes'])}" for row in done if row["notes"] > 0]
    first = [several[0] for several in units.values() if several[0]["status"] == DONE][:MOST_DRAWN]
    caption = "R and X over ρc of each case at its first frequency, with its statistical interval."
    pictures = [Figure("cases", _draw(first), caption, _table(first, links))] if first else []
    index = [Grid("index", "A row a case and frequency, as in index.csv.", _table(rows, links))]
    made = SimpleNamespace(choices={"version": rows[0]["version"] if rows else ""})
    return Page(
        f"Campaign: {(rows[0]['campaign'] if rows else '') or folder.name}",
        typeset(answer),
        "fails" if fails else "",
        [
            Section("cases-section", "Cases", pictures),
            Section("rows", "All rows", index),
            warned(dict.fromkeys(notes)),
            origin([made], folder / "index.csv"),
            citation(),
        ],
        FOOTER,
    )


def _table(rows: Rows, links: Mapping[str, str]) -> Table:
    """All columns in the CSV, the chief ones on the page."""
    import markupsafe

    def case(row: Mapping[str, Any]) -> Any:
        name = html.escape(shown(row["unit"])).replace("__", "__<wbr>")
        link = links.get(row["unit"])
        return markupsafe.Markup(name if link is None else f'<a href="{html.escape(link)}">{name}</a>')

    return Table(
        rows,
        [
            Column("", case, "case"),
            Column("", "height", "y (mm)", ".2f", 1e3),
            Column("", "frequency", "f (Hz)", ".1f"),
            Column("", lambda row: complex(row["resistance"], row["reactance"]), "Z", format_complex),
            Column("", "level_check", "level check"),
            Column("", "notes", "warnings", ".0f"),
            Column("", "status", "status"),
            *map(Column, COLUMNS),
        ],
    )


@styled
def _draw(rows: Rows) -> Drawing:
    """A dot a case with its interval, R beside X."""
    figure, axes = subplots(1, 2, 0.8 + ROW_HEIGHT * len(rows), beside=True)
    for axis, (part, label) in zip(axes[0], PARTS, strict=True):
        for place, row in enumerate(rows):
            ends = [row[f"{part}_{end}"] for end in ("low", "high")]
            axis.plot(ends, [place] * 2, color=COLOURS[0], linewidth=2, alpha=0.5, zorder=2)
            axis.plot(row[part], place, "o", color=COLOURS[0], markersize=4, zorder=3)
        names = [shown(row["unit"]).replace("$", r"\$") for row in rows]
        axis.set_yticks(range(len(rows)), names if part == "resistance" else [])
        axis.set_ylim(len(rows) - 0.5, -0.5)
        axis.set_xlabel(label)
        axis.minorticks_off()
    return finish(figure, None)

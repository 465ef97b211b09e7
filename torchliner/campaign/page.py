"""The page of a campaign: one row a case with small multiples of R and X, and links."""

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
from torchliner.report.page.blocks import (
    Block,
    Drawn,
    Facts,
    Grid,
    Section,
    shown,
)
from torchliner.report.page.of_map import FOOTER
from torchliner.report.page.opening import report_file
from torchliner.report.page.origin import citation, files_of, versions
from torchliner.report.page.render import ENDING, Page, require_report
from torchliner.report.page.warned import warnings_of
from torchliner.report.table import Column, Table, format_complex
from torchliner.report.typesetting import typeset

PARTS = {"R": "resistance", "X": "reactance"}
WIDTH, HEIGHT, EDGE = 120.0, 22.0, 5.0  # of a small multiple, px
Rows = Sequence[Mapping[str, Any]]


def report_campaign(folder: Path, output: Path, *, cases: bool = False) -> tuple[Page, list[Path]]:
    """The page of a folder that ``torchliner run`` keeps.

    Args:
        folder: with ``index.nc`` and ``maps/``.  output: of the page, .html.
        cases: a page of each map too, in OUTPUT_cases beside.
    Returns:
        The page and all files that were written.
    Raises:
        ImportError: jinja2 or matplotlib is not installed.
        OSError, ValueError: no campaign; an output that cannot be written.
    """
    require_report()
    rows, title, version = read_index(folder)
    writable(output, ENDING)
    beside = output.with_name(f"{output.stem}_cases")
    ordered = sorted(rows, key=lambda row: (row["unit"], row["frequency"]))
    units = {name: list(rows) for name, rows in itertools.groupby(ordered, lambda r: r["unit"])}
    written: list[Path] = []
    if cases:
        writable_folder(beside)
        beside.mkdir(exist_ok=True)
        for name in units:
            path = folder / "maps" / f"{name}.h5"
            if path.exists() and any(row["status"] == DONE for row in units[name]):
                written.append(beside / f"{name}{ENDING}")
                report_file(path, written[-1])
    page = _page(folder, title, version, rows, units, beside, written)
    page.write(output)
    return page, [output, *written]


def _page(
    folder: Path, title: str, version: str, rows: Rows, units: Mapping[str, Rows], beside: Path,
    written: Sequence[Path],
) -> Page:  # fmt: skip
    done = [row for row in rows if row["status"] == DONE]
    failed = {row["unit"]: row["error"] for row in rows if row["status"] != DONE}
    fails = sum(str(row["level_check"]).endswith("fails") for row in done)
    checked = sum(bool(row["level_check"]) for row in done)
    ranges = "; ".join(
        f"{name} from {min(known):.3f} to {max(known):.3f}" for name, part in PARTS.items()
        if (known := [row[part] for row in done if math.isfinite(row[part])])
    )  # fmt: skip
    answer = (
        f"{len(units)} cases, {len(units) - len(failed)} done and {len(failed)} failed: "
        f"{ranges or 'no impedance'} over ρc; the level check fails in {fails} of {checked} rows "
        "in which a pressure is known."
    )
    warned = [f"{unit}: failed: {shown(error)}" for unit, error in failed.items()]
    warned += [
        f"level check at {row['frequency']:g} Hz fails, {row['unit']}: {row['level_check']}"
        for row in done if str(row["level_check"]).endswith("fails")
    ]  # fmt: skip
    noted = {row["unit"]: int(row["notes"]) for row in done if row["notes"] > 0}
    warned += [f"warnings in the map of {unit}: {count}" for unit, count in noted.items()]
    every: list[Block] = [Grid("index", "A row a case and frequency, as in index.csv.", _index(rows))]
    sections = [
        Section("cases", "Cases", [_cases(units, beside, {path.stem for path in written})]),
        Section("warnings", "Warnings", warnings_of(warned)),
        Section("rows", "All rows", every),
        Section("origin", "Inputs and provenance", [
            *files_of([], [("index", folder / "index.nc", "")]),
            Facts([(unit, f"{shown(several[0]['file'])}; hash of data, choices and version: "
                          f"{several[0]['hash']}") for unit, several in units.items()]),
            versions(SimpleNamespace(choices={"version": version})),
        ]),
        Section("cite", "Citation", citation()),
    ]  # fmt: skip
    return Page(f"Campaign: {title or folder.name}", typeset(answer), "fails" if fails else "",
                sections, FOOTER)  # fmt: skip


def _cases(units: Mapping[str, Rows], beside: Path, linked: set[str]) -> Grid:
    """One row a case: its impedance at the first frequency, and strips of R and X."""
    import markupsafe

    every = [row for several in units.values() for row in several]
    limits = {part: _limits(every, part) for part in PARTS.values()}
    table = []
    for name, several in units.items():
        first = several[0]
        link = f"{quote(beside.name)}/{quote(name)}{ENDING}"
        title = html.escape(shown(name)).replace("__", "__<wbr>")
        if name in linked:
            title = f'<a href="{html.escape(link)}">{title}</a>'
        table.append({
            "case": name, "link": markupsafe.Markup(title), "averaging": first["averaging"],
            "frequencies": len(several), "height": first["height"],
            "impedance": complex(first["resistance"], first["reactance"]),
            "level_check": first["level_check"] or "-", "notes": first["notes"], "status": first["status"],
            **{f"{part}_strip": Drawn(first[part], _strip(several, part, limits[part]))
               for part in PARTS.values()},
        })  # fmt: skip
    columns = [
        Column("case"), Column("", "link", "case"),
        Column("height (m)", "height", "y (mm)", ".2f", 1e3),
        Column("", "impedance", "Z", lambda z: "-" if z != z else format_complex(z)),
        *(Column("", f"{part}_strip", typeset("{}, {:.2f} to {:.2f}".format(name, *limits[part])))
          for name, part in PARTS.items()),
        Column("level_check", heading="level check"), Column("", "notes", "warnings", ".0f"),
        Column("status", heading="status"),
    ]  # fmt: skip
    most = max((len(several) for several in units.values()), default=1)
    what = (
        "dots with their statistical intervals"
        if most == 1
        else "curves over frequency, with their statistical intervals as bands"
    )
    caption = (
        f"One row a case. Z over ρc at its first frequency; R and X as {what}, on one scale for "
        "all cases; what reaches an end of the scale goes on beyond it."
    )
    return Grid("cases-table", typeset(caption), Table(table, columns))


def _limits(rows: Rows, part: str) -> tuple[float, float]:
    """Of all values, and of their intervals as far as these do not squash the values."""
    known = [row[part] for row in rows if math.isfinite(row[part])]
    if not known:
        return 0.0, 1.0
    span = (max(known) - min(known)) or abs(known[0]) or 1.0
    lows = [row[f"{part}_low"] for row in rows if math.isfinite(row[f"{part}_low"])]
    highs = [row[f"{part}_high"] for row in rows if math.isfinite(row[f"{part}_high"])]
    low = max(min([*known, *lows]), min(known) - span / 2)
    high = min(max([*known, *highs]), max(known) + span / 2)
    return low - 0.02 * span, high + 0.02 * span


def _strip(rows: Rows, part: str, limits: tuple[float, float]) -> str:
    """A small multiple as SVG; its sort key is the first value."""
    low, high = limits
    known = [row for row in rows if math.isfinite(row[part])]
    if not known:
        return "-"

    def across(value: float) -> float:
        share = min(max((value - low) / (high - low), 0.0), 1.0)
        return EDGE + (WIDTH - 2 * EDGE) * share

    if len(known) == 1:
        row, middle = known[0], HEIGHT / 2
        drawn = ""
        if math.isfinite(row[f"{part}_low"]):
            ends = (across(row[f"{part}_low"]), across(row[f"{part}_high"]))
            line = f"M{ends[0]:.1f} {middle}H{ends[1]:.1f}"
            drawn = f'<path d="{line}" stroke="var(--blue)" stroke-width="2"/>'
        drawn += f'<circle cx="{across(row[part]):.1f}" cy="{middle}" r="3.2" fill="var(--blue)"/>'
    else:
        drawn = _curve(known, part, limits)
    words = ", ".join(f"{row[part]:.3f} at {row['frequency']:g} Hz" for row in known[:6])
    label = html.escape(f"{part} {typeset(words)}{' ...' * (len(known) > 6)}")
    return (
        f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" width="{WIDTH:g}" height="{HEIGHT:g}" role="img" '
        f'aria-label="{label}"><path d="M{EDGE} {HEIGHT - 1}H{WIDTH - EDGE}" stroke="var(--line)"/>'
        f"{drawn}</svg>"
    )


def _curve(rows: Rows, part: str, limits: tuple[float, float]) -> str:
    """R or X over frequency, upwards, with its band."""
    low, high = limits
    first, last = rows[0]["frequency"], rows[-1]["frequency"]

    def at(row: Mapping[str, Any], end: str = "") -> str:
        x = EDGE + (WIDTH - 2 * EDGE) * (row["frequency"] - first) / ((last - first) or 1)
        share = min(max((row[f"{part}{end}"] - low) / (high - low), 0.0), 1.0)
        y = (HEIGHT - 2) * (1 - share) + 1
        return f"{x:.1f},{y:.1f}"

    line = " ".join(at(row) for row in rows)
    ends = [row for row in rows if math.isfinite(row[f"{part}_low"])]
    band = " ".join([*(at(row, "_low") for row in ends),
                     *(at(row, "_high") for row in reversed(ends))])  # fmt: skip
    return (
        f'<polygon points="{band}" fill="var(--blue)" fill-opacity="0.25"/>'
        f'<polyline points="{line}" fill="none" stroke="var(--blue)" stroke-width="1.4"/>'
    )


def _index(rows: Rows) -> Table:
    """All columns in the CSV, the chief ones on the page."""
    heads = {
        "unit": ("case", ""), "frequency": ("f (Hz)", ".1f"), "resistance": ("R", ".3f"),
        "reactance": ("X", ".3f"), "level_check": ("level check", ""), "liner": ("liner", ""),
        "seconds": ("time (s)", ".2f"), "status": ("status", ""),
    }  # fmt: skip
    ordered = sorted(rows, key=lambda row: (row["unit"], row["frequency"]))
    return Table(ordered, [Column(name, name, *heads.get(name, ("", ""))) for name in COLUMNS])

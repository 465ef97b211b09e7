"""Bursts of one station from columns of text: CSV, files without a header, and Dantec's export "DXEX" v3 and v5.

A CSV has '# key = value unit' lines, a header with units, the bursts. In DXEX, line 1 is the version, 2 the project, 3
the time of day, 4 the position, 5 a label, 6 the quoted names of the columns; bursts from line 7, tab-separated. A
second channel with arrival times of its own (non-coincidence) has columns AT{2}, TT{2}, LDA2{2}, padded with blanks.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from torchliner.checks import require_choice
from torchliner.names import SEPARATORS
from torchliner.records import BurstRecord
from torchliner.records.burst_record import COMPONENTS
from torchliner.records.declared import variables_of
from torchliner.text_columns import Array, header_line, read_lines, read_stated, read_table
from torchliner.units import si_factor

QUANTITIES = {"arrival_time": "time", "transit_time": "time", **dict.fromkeys(COMPONENTS, "velocity")}
OPTIONAL, PASSED_OVER = ("transit_time", *COMPONENTS), ("row", "skip")
EXAMPLE = f"NAME [UNIT] with NAME one of {', '.join((*QUANTITIES, *PASSED_OVER))}"
LAYOUT: dict[str, Any] = {"example": EXAMPLE, "optional": OPTIONAL, "others": PASSED_OVER}
STATED = {row.field: row.unit for row in variables_of(BurstRecord) if not row.dims}
STATED |= dict.fromkeys(("title", "source_side", "liner"), "text")
# Of DXEX.
HEADER_LINES = 6
USUAL = {2: ("streamwise", "wall_normal"), 3: ("streamwise", "wall_normal", "skip")}
MEANINGS = (*COMPONENTS, *(f"-{name}" for name in COMPONENTS), "skip")
TIMES = {"AT": "arrival_time", "TT": "transit_time"}
POSITION = re.compile(r"([-+]?\d+(?:[.,]\d*)?(?:[eE][-+]?\d+)?)\s*(.*)")  # 1.50 mm
LABEL = re.compile(r"([A-Za-z]+)(\d*)(?:\{(\d+)\})?\s*(?:\[(.*)\])?")  # LDA2{2} [m/s]


def read_burst_columns(
    path: str | Path, columns: str | Sequence[str] | None = None, separator: str = "blank", **about: Any
) -> BurstRecord:
    """Bursts of one station from columns of numbers.

    Args:
        path: text, UTF-8 or latin-1, decimal point or comma.
        columns: of a file without a header, names with units in the order of the file, separated by commas (in Python
            also a list): "row, arrival_time [ms], transit_time [us], streamwise [m/s], wall_normal [m/s]". ``row`` and
            ``skip`` are passed over; a minus turns a velocity round.
        separator: of such a file: ``blank`` (any white space), ``tab``, ``comma`` or ``semicolon``.
        about: fields of the record instead of those of the file: x, y, z (m), frequency, fluid, ...
    Raises:
        As ``read_lines``, ``read_stated``, ``read_table`` and ``BurstRecord``.
    """
    lines = read_lines(path)
    if columns is None:
        about = read_stated(lines[: header_line(lines, path)], STATED, path) | about
        found = read_table(lines, QUANTITIES, path, **LAYOUT)
    else:
        labels = [label.strip() for label in (columns.split(",") if isinstance(columns, str) else columns)]
        between = SEPARATORS[require_choice("separator", separator, SEPARATORS)]
        found = read_table(lines, QUANTITIES, path, labels=labels, separator=between, **LAYOUT)
    return _record(found, path, {"format": "columns"}, **about)


def _record(columns: Mapping[str, Array], path: str | Path, provenance: dict[str, Any], **about: Any) -> BurstRecord:
    path = Path(path)
    usual = {"title": path.stem, "name": str(path), "provenance": {"file": path.name, **provenance}}
    return BurstRecord(**usual | dict(columns) | about)


def read_dantec(path: str | Path, components: Sequence[str] | None = None, **about: Any) -> BurstRecord:
    """Bursts of one exported file.

    Args:
        path: DXEX v3 or v5, UTF-8 or latin-1, decimal point or comma.
        components: what LDA1, LDA2 and so on hold, in order: ``streamwise``, ``wall_normal`` or ``skip``, with a minus
            where the optics count the other way. Default for two and three channels: streamwise, wall_normal(, skip); a
            single one must be stated. Of channels with their own arrival times the wall-normal one is read, and a note
            says so.
        about: further fields of the record, e.g. ``frequency``, ``fluid``; x, y, z override the position line.
    Raises:
        As ``read_burst_columns``; another version, no position, channels that ``components`` do not tell.
    """
    lines = read_lines(path)
    place = dict(zip("xyz", position_of(lines, path), strict=True))
    version, project, time, _, label, header = (line.strip() for line in lines[:HEADER_LINES])
    names = [name.strip().strip('"').strip() for name in header.split("\t")]
    parsed = [LABEL.fullmatch(name) for name in names]
    channels = sorted((m for m in parsed if m and m[1].upper() == "LDA"), key=lambda m: int(m[2] or 0))
    if not channels or any(m[2].startswith("0") for m in channels):
        raise ValueError(f"{path}: columns 'LDA1 [m/s]', ... from 1 are needed; there are: {', '.join(names)}")
    meant = USUAL.get(len(channels), ()) if components is None else components
    used = [require_choice("component", name, MEANINGS).lstrip("-") for name in meant if name != "skip"]
    if len(meant) != len(channels) or not used or len({*used}) < len(used):
        raise ValueError(
            f"{path} has channels {', '.join(f'LDA{m[2]}' for m in channels)}, and components are "
            f"{', '.join(meant) or 'not stated'}; name one for each: wall_normal or streamwise at most once, one at "
            "least, with a minus where it counts the other way, or skip"
        )
    taken = dict(zip(channels, meant, strict=True))
    groups = {name.lstrip("-"): m[3] or "1" for m, name in taken.items() if name != "skip"}  # of equal arrival times
    own, labels = groups.get("wall_normal", groups[used[0]]), []
    for m in parsed:
        word = "skip"
        if m and (m[3] or "1") == own:
            word = taken.get(m, "skip" if m[2] else TIMES.get(m[1].upper(), "skip"))
        labels.append(f"{word} [{m[4] or ''}]" if m and word != "skip" else "skip")
    layout = LAYOUT | {"example": f"'AT [ms]', 'LDA1 [m/s]'; the export has {', '.join(names)}"}
    found = read_table(lines, QUANTITIES, path, labels=labels, start=HEADER_LINES, separator="\t", **layout)
    apart = [name for name, group in groups.items() if group != own]
    notes = tuple(f"not in coincidence: {name} has its own arrival times and is left out" for name in apart)
    told = {f"LDA{m[2]}": name for m, name in taken.items()}
    provenance = {"format": version, "project": project, "time": time, "label": label, "channels": told}
    return _record(found, path, provenance, **place | {"title": label or Path(path).stem, "notes": notes} | about)


def position_of(lines: Sequence[str], path: str | Path) -> tuple[float, float, float]:
    """x, y, z in m from line 4 of an export, ``[point;]x mm;y mm;z mm``."""
    if lines[0].strip() not in ("DXEX v3", "DXEX v5"):
        raise ValueError(f"{path}: line 1 is {lines[0].strip()[:40]!r}; export as 'DXEX v3' or 'DXEX v5'")
    if len(lines) < HEADER_LINES:
        raise ValueError(f"{path} ends after line {len(lines)}; the header has {HEADER_LINES}")
    parts = [part.strip() for part in lines[3].split(";") if part.strip()]
    found = [match for part in parts[len(parts) == 4 :] if (match := POSITION.fullmatch(part))]
    if len(found) != 3 or len(parts) > 4:
        raise ValueError(f"{path}: line 4 is {lines[3].strip()[:60]!r}; '[point;]x mm;y mm;z mm' is needed")
    where = f"{path}: the position on line 4"
    x, y, z = (float(match[1].replace(",", ".")) * si_factor("length", match[2], where) for match in found)
    return x, y, z

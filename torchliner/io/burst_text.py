"""Bursts of one station from columns of text: CSV, files without a header, and Dantec's export "DXEX" v3 and v5.

A CSV has '# key = value unit' lines, a header with units, the bursts. In DXEX, line 1 is the version, 2 the project, 3
the time of day, 4 the position, 5 a label, 6 the quoted names of the columns; bursts from line 7, tab-separated. A
second channel with arrival times of its own (non-coincidence) has columns AT{2}, TT{2}, LDA2{2}, padded with blanks.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.checks import require_choice
from torchliner.names import SEPARATORS
from torchliner.records import BurstRecord
from torchliner.records.burst_record import COMPONENTS
from torchliner.records.declared import variables_of
from torchliner.text_columns import (
    Array,
    Column,
    cells_of,
    find_columns,
    header_line,
    read_columns,
    read_lines,
    read_stated,
    separator_of,
)
from torchliner.units import si_factor

QUANTITIES = {"arrival_time": "time", "transit_time": "time", **dict.fromkeys(COMPONENTS, "velocity")}
OPTIONAL, PASSED_OVER = ("transit_time", *COMPONENTS), ("row", "skip")
EXAMPLE = f"NAME [UNIT] with NAME one of {', '.join((*QUANTITIES, *PASSED_OVER))}"
NOT_FINITE = "not a number in the file"
STATED = {row.field: row.unit for row in variables_of(BurstRecord) if not row.dims}
STATED |= dict.fromkeys(("title", "source_side", "liner"), "text")
# Of DXEX.
HEADER_LINES = 6
USUAL = {2: ("streamwise", "wall_normal"), 3: ("streamwise", "wall_normal", "skip")}
MEANINGS = (*COMPONENTS, *(f"-{name}" for name in COMPONENTS), "skip")
TIMES = {"AT": "arrival_time", "TT": "transit_time"}
POSITION = re.compile(r"([-+]?\d+(?:[.,]\d*)?(?:[eE][-+]?\d+)?)\s*(.*)")  # 1.50 mm
LABEL = re.compile(r"([A-Za-z]+)(\d*)(?:\{(\d+)\})?\s*(?:\[(.*)\])?")  # LDA2{2} [m/s]


def _columns(labels: Sequence[str], path: str | Path, example: str = EXAMPLE) -> list[Column]:
    """Columns from labels such as ``wall_normal [m/s]``, with a minus before the name of a velocity that is turned."""
    plain = [label.removeprefix("-") for label in labels]
    columns = find_columns(plain, QUANTITIES, path, example=example, optional=OPTIONAL, others=PASSED_OVER)
    turned = {i for i, label in enumerate(labels) if label.startswith("-")}
    if any(column.index in turned and column.quantity == "time" for column in columns):
        raise ValueError(f"{path}: a time has a sign in {', '.join(labels)}; only velocities have one")
    if not {*COMPONENTS} & {column.name for column in columns}:
        raise ValueError(f"{path}: no velocity; a column 'wall_normal' or 'streamwise' is needed")
    return [replace(c, factor=-c.factor) if c.index in turned else c for c in columns]


def _bursts(
    lines: Sequence[str], first: int, columns: Sequence[Column], path: str | Path, count: int, separator: str | None
) -> dict[str, Array]:
    """Columns of the lines from number ``first``, from 1, to the last in which one of them holds something."""
    rows = {i: cells_of(line, separator) for i, line in enumerate(lines[first - 1 :], first)}
    used = [column.index for column in columns]
    while rows and not any([*(row := [*rows.values()][-1])[count:], *(row[i] for i in used if i < len(row))]):
        rows.popitem()
    if not rows:
        raise ValueError(f"{path} holds no bursts: the file ends before line {first + 1}")
    return read_columns(rows, columns, path, count)


def _record(columns: Mapping[str, Array], path: str | Path, **about: Any) -> BurstRecord:
    """A record of the bursts whose values, SI, are all finite; the others are counted. ``about`` are further fields."""
    path = Path(path)
    good = np.asarray(np.isfinite(np.stack(list(columns.values()))).all(0))
    if not good.any():
        raise ValueError(f"{path}: none of the {len(good)} bursts is finite in all columns")
    about["dropped"] = {**about.get("dropped", {}), **({} if good.all() else {NOT_FINITE: int((~good).sum())})}
    about["provenance"] = {"file": path.name, **about.get("provenance", {})}
    kept: dict[str, Any] = {name: values[good] for name, values in columns.items()}
    return BurstRecord(**{"title": path.stem, **kept, "name": str(path), **about})


def read_burst_csv(path: str | Path, **about: Any) -> BurstRecord:
    """Bursts of one station from a CSV; ``about`` are fields of the record instead of those of the file. Errors are
    those of ``read_lines``, ``read_stated``, ``find_columns`` and ``read_columns``; no bursts are a ValueError."""
    lines = read_lines(path)
    start = header_line(lines, path)
    stated, separator = read_stated(lines[:start], STATED, path), separator_of(lines[start])
    labels = cells_of(lines[start], separator)
    found = _bursts(lines, start + 2, _columns(labels, path), path, len(labels), separator)
    return _record(found, path, **{"provenance": {"format": "csv"}, **stated, **about})


def read_burst_columns(
    path: str | Path, columns: str | Sequence[str], separator: str = "blank", **about: Any
) -> BurstRecord:
    """Bursts of one station from columns of numbers without a header.

    Args:
        path: text, UTF-8 or latin-1, decimal point or comma.
        columns: names with units in the order of the file, separated by commas (in Python also a list):
            "row, arrival_time [ms], transit_time [us], streamwise [m/s], wall_normal [m/s]".
            ``row`` and ``skip`` are passed over; a minus turns a velocity round.
        separator: ``blank`` (any white space), ``tab``, ``comma`` or ``semicolon``.
        about: further fields of the record: x, y, z (m), frequency, fluid, ...
    Raises:
        As ``read_burst_csv``; another number of columns than stated.
    """
    labels = [label.strip() for label in (columns.split(",") if isinstance(columns, str) else columns)]
    wanted = _columns(labels, path)
    between = SEPARATORS[require_choice("separator", separator, SEPARATORS)]
    lines = read_lines(path)
    count = len(cells_of(lines[0], between))
    if count != len(labels):
        stated = f"{len(labels)} columns are stated: {', '.join(labels)}"
        raise ValueError(f"{path}: line 1 has {count} cells, {stated}; name every column, 'skip' included")
    found = _bursts(lines, 1, wanted, path, count, between)
    return _record(found, path, **{"provenance": {"format": "columns", "columns": labels}, **about})


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
        As ``read_burst_csv``; another version, no position, channels that ``components`` do not tell.
    """
    lines = read_lines(path)
    place = position_of(lines, path)
    version, project, time, _, label, header = (line.strip() for line in lines[:HEADER_LINES])
    names = [name.strip().strip('"').strip() for name in header.split("\t")]
    channels, groups = _channels(names, components, path)
    example = f"'AT [ms]', 'LDA1 [m/s]'; the export has {', '.join(names)}"
    wanted = [_columns(labels, path, example) for labels in groups]
    read = [_bursts(lines, HEADER_LINES + 1, each, path, len(names), "\t") for each in wanted]
    columns, *others = sorted(read, key=lambda each: "wall_normal" not in each)
    text = "not in coincidence: {} ({} bursts) has its own arrival times and is left out"
    left_out = [(name, len(each["arrival_time"])) for each in others for name in each if name in COMPONENTS]
    provenance = {"format": version, "project": project, "time": time, "label": label, "channels": channels}
    facts = dict(zip("xyz", place, strict=True)) | {"title": label or Path(path).stem, "provenance": provenance}
    return _record(columns, path, **facts | {"notes": tuple(text.format(*each) for each in left_out)} | about)


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


def _channels(
    names: Sequence[str], components: Sequence[str] | None, path: str | Path
) -> tuple[dict[str, str], list[list[str]]]:
    """What each channel of an export is taken for; labels of all its columns as we write them, for each group of equal
    arrival times in which a channel counts."""
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
    groups = dict.fromkeys(m[3] or "1" for m, name in taken.items() if name != "skip")

    def label_of(match: re.Match[str] | None, group: str) -> str:
        own = match is not None and (match[3] or "1") == group
        word = taken.get(match, "" if match[2] else TIMES.get(match[1].upper(), "")) if match and own else ""
        return f"{word} [{match[4] or ''}]" if match and word not in ("", "skip") else "skip"

    said = {f"LDA{m[2]}": name for m, name in taken.items()}
    return said, [[label_of(match, group) for match in parsed] for group in groups]

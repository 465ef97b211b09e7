"""Dantec's text export of burst analysers, "DXEX" v3 and v5.

Line 1 is the version, 2 the project, 3 the time of day, 4 the position, 5 a label, 6 the quoted names of the columns;
bursts from line 7, tab-separated. A second channel of its own arrival times (non-coincidence) has columns AT{2}, TT{2},
LDA2{2}, padded with blanks.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from torchliner.checks import require_choice
from torchliner.io.burst_text import HEAD, QUANTITIES, BurstFormat, read_bursts_of, record_of
from torchliner.records import BurstRecord
from torchliner.records.burst_record import COMPONENTS
from torchliner.text_columns import Column, read_lines
from torchliner.units import si_factor

HEADER_LINES = 6
USUAL = {2: ("streamwise", "wall_normal"), 3: ("streamwise", "wall_normal", "skip")}
MEANINGS = (*COMPONENTS, *(f"-{name}" for name in COMPONENTS), "skip")
POSITION = re.compile(r"([-+]?\d+(?:[.,]\d*)?(?:[eE][-+]?\d+)?)\s*(.*)")  # 1.50 mm
LABEL = re.compile(r"([A-Za-z]+)(\d*)(?:\{(\d+)\})?\s*(?:\[(.*)\])?")  # LDA2{2} [m/s]


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
        FileNotFoundError, OSError: no such file, a folder.
        ValueError: empty, another version, no position, a column missing or with a wrong unit, an unreadable cell,
            mixed decimal marks.
    """
    lines = read_lines(path)
    place = _place(lines, path)
    version, project, time, _, label, header = (line.strip() for line in lines[:HEADER_LINES])
    names = [name.strip().strip('"').strip() for name in header.split("\t")]
    groups, chosen = _channels(names, components, path)
    read = [read_bursts_of(lines, HEADER_LINES + 1, group, path, len(names), "\t") for group in groups]
    columns, *others = sorted(read, key=lambda each: "wall_normal" not in each)
    text = "not in coincidence: {} ({} bursts) has its own arrival times and is left out"
    left_out = [(name, len(each["arrival_time"])) for each in others for name in each if name in COMPONENTS]
    provenance = {"format": version, "project": project, "time": time, "label": label, "channels": chosen}
    facts = dict(zip("xyz", place, strict=True)) | {"title": label or Path(path).stem, "provenance": provenance}
    return record_of(columns, path, **facts | {"notes": tuple(text.format(*each) for each in left_out)} | about)


def _place(lines: Sequence[str], path: str | Path) -> tuple[float, float, float]:
    """x, y, z in m from line 4, ``[point;]x mm;y mm;z mm``."""
    if lines[0].strip() not in ("DXEX v3", "DXEX v5"):
        raise ValueError(f"{path}: line 1 is {lines[0].strip()[:40]!r}; export as 'DXEX v3' or 'DXEX v5'")
    if len(lines) < HEADER_LINES:
        raise ValueError(f"{path} ends after line {len(lines)}; the header has {HEADER_LINES}")
    parts = [part.strip() for part in lines[3].split(";") if part.strip()]
    found = [POSITION.fullmatch(part) for part in parts[len(parts) == 4 :]]
    if len(found) != 3 or None in found:
        raise ValueError(f"{path}: line 4 is {lines[3].strip()[:60]!r}; '[point;]x mm;y mm;z mm' is needed")
    where = f"{path}: the position on line 4"
    x, y, z = (float(m[1].replace(",", ".")) * si_factor("length", m[2], where) for m in found if m)
    return x, y, z


def _channels(
    names: Sequence[str], components: Sequence[str] | None, path: str | Path
) -> tuple[list[list[Column]], dict[str, str]]:
    """Columns of each group of equal arrival times, and what each channel was taken for."""
    parsed = {i: m for i, name in enumerate(names) if (m := LABEL.fullmatch(name)) is not None}
    there = {(m[1].upper(), m[2], m[3] or "1"): (i, m[4] or "") for i, m in parsed.items()}
    channels = sorted((key for key in there if key[0] == "LDA"), key=lambda key: int(key[1] or 0))
    if not channels or any(key[1].startswith("0") for key in channels):
        raise ValueError(f"{path}: columns 'LDA1 [m/s]', ... from 1 are needed; there are: {', '.join(names)}")
    labels = [f"LDA{number}" for _, number, _ in channels]
    meant = USUAL.get(len(channels), ()) if components is None else components
    used = [require_choice("component", name, MEANINGS).lstrip("-") for name in meant if name != "skip"]
    if len(meant) != len(channels) or not used or len({*used}) < len(used):
        raise ValueError(
            f"{path} has channels {', '.join(labels)}, and components are {', '.join(meant) or 'not stated'}; name one "
            "for each: wall_normal or streamwise at most once, one at least, with a minus where it counts the other "
            "way, or skip"
        )
    groups: dict[str, list[Column]] = {}
    for (_, number, group), name in zip(channels, meant, strict=True):
        if name != "skip":
            if ("AT", "", group) not in there:
                suffix = "" if group == "1" else f"{{{group}}}"
                raise ValueError(f"{path}: column 'AT{suffix} [ms]' is missing; there are: {', '.join(names)}")
            wanted = {name.lstrip("-"): ("LDA", number, group)}
            if group not in groups:
                wanted |= {"arrival_time": ("AT", "", group), "transit_time": ("TT", "", group)}
            for own, key in wanted.items():
                if key in there:
                    index, unit = there[key]
                    factor = si_factor(QUANTITIES[own], unit, f"{path}: column {own!r}")
                    turned = name.startswith("-") and own in COMPONENTS
                    groups.setdefault(group, []).append(Column(own, index, -factor if turned else factor))
    return list(groups.values()), dict(zip(labels, meant, strict=True))


FORMAT = BurstFormat(
    recognises=lambda path, _: read_lines(path, HEAD)[0].lstrip().startswith("DXEX"),
    places=lambda path: [_place(read_lines(path, HEAD), path)],
    read=lambda path, _, options, about: read_dantec(path, options["components"], **about),
    takes=("components",),
)

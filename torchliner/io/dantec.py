"""Dantec's text export of burst analysers, "DXEX" v3 and v5.

Line 1 is the version, 2 the project, 3 the time of day, 4 the position, 5 a label, 6 the quoted
names of the columns; bursts from line 7, tab-separated. A second channel of its own arrival times
(non-coincidence) has columns AT{2}, TT{2}, LDA2{2}, padded with blanks.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.checks import require_positive
from torchliner.io.burst_format import BurstFormat, read_head
from torchliner.io.burst_text import QUANTITIES, read_bursts_of, record_of
from torchliner.names import did_you_mean
from torchliner.records import BurstRecord
from torchliner.records.burst_record import COMPONENTS
from torchliner.text_columns import Array, Column, read_lines
from torchliner.units import si_factor

VERSIONS = ("3", "5")
HEADER_LINES = 6
NO_PARTNER = "no partner within the coincidence window"
USUAL = {2: ("streamwise", "wall_normal"), 3: ("streamwise", "wall_normal", "skip")}
NUMBER = r"[-+]?\d+(?:[.,]\d*)?(?:[eE][-+]?\d+)?"


@dataclass(frozen=True)
class Header:
    """Lines 1 to 6: version, project, time, position (m) and label as they stand; columns."""

    version: str
    project: str
    time: str
    position: tuple[float, float, float]
    label: str
    columns: tuple[str, ...]


def is_dantec(path: str | Path) -> bool:
    """Whether a file begins with the letters DXEX."""
    with Path(path).open("rb") as file:
        return file.read(16).removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"DXEX")


def read_dantec(
    path: str | Path,
    components: Sequence[str] | None = None,
    coincidence_window: float | None = None,
    **about: Any,
) -> BurstRecord:
    """Bursts of one exported file.

    Args:
        path: DXEX v3 or v5, UTF-8 or latin-1, decimal point or comma.
        components: what LDA1, LDA2 and so on hold, in order: ``streamwise``, ``wall_normal`` or
            ``skip``, with a minus where the optics count the other way. Default for two and three
            channels: streamwise, wall_normal(, skip); a single one must be stated.
        coincidence_window: s; pairs the channels of a non-coincidence file. Without it the
            wall-normal channel is read alone, and a note says so.
        about: further fields of the record, e.g. ``frequency``, ``fluid``; x, y, z override the
            position line.
    Raises:
        FileNotFoundError, OSError: no such file, a folder.
        ValueError: empty, another version, no position, a column missing, with a wrong unit, or of
            another length; mixed decimal marks; times of two channels that do not increase.
    """
    lines = read_lines(path)
    header = read_header(lines, path)
    groups, chosen = _channels(header.columns, components, path)
    # Also where a channel is skipped: its columns may be the longer ones.
    padded, count = any("{" in name for name in header.columns), len(header.columns)
    read = [read_bursts_of(lines, HEADER_LINES + 1, group, path, count, "\t", padded)
            for group in groups]  # fmt: skip
    if padded:
        _require_equal(read, path)
    columns, notes, dropped = _joined(read, coincidence_window, path)
    place = dict(zip("xyz", header.position, strict=True))
    provenance = {"format": f"DXEX v{header.version}", "project": header.project,
                  "time": header.time, "label": header.label, "channels": chosen}  # fmt: skip
    about = {**place, "title": header.label or Path(path).stem, **about}
    return record_of(columns, path, provenance=provenance, notes=notes, dropped=dropped, **about)


def read_header(lines: Sequence[str], path: str | Path) -> Header:
    """The first six lines.

    Raises:
        ValueError: another version, fewer lines, no position.
    """
    found = re.fullmatch(r"\s*DXEX v(\d+)\s*", lines[0])
    if found is None or found.group(1) not in VERSIONS:
        raise ValueError(
            f"{path}: line 1 is {lines[0].strip()[:40]!r}; 'DXEX v3' or 'DXEX v5' is needed (set "
            "the export to one of them, or read it as columns)"
        )
    if len(lines) < HEADER_LINES:
        raise ValueError(f"{path} ends after line {len(lines)}; the header has {HEADER_LINES}")
    names = tuple(name.strip().strip('"') for name in lines[5].rstrip("\t ").split("\t"))
    place = read_position(lines[3], path)
    project, time, label = (lines[i].strip() for i in (1, 2, 4))
    return Header(found.group(1), project, time, place, label, names)


def read_position(line: str, path: str | Path) -> tuple[float, float, float]:
    """x, y, z in m from ``[point;]x mm;y mm;z mm``.

    Raises:
        ValueError: the line reads otherwise, or has another unit than of length.
    """
    parts = [part.strip() for part in line.split(";") if part.strip()]
    parts = parts[-3:] if len(parts) == 4 else parts
    found = [match for part in parts if (match := re.fullmatch(rf"({NUMBER})\s*(.*)", part))]
    if not len(parts) == len(found) == 3:
        raise ValueError(
            f"{path}: line 4 is {line.strip()[:60]!r}; a position such as '[point;]x mm;y mm;z mm' is needed"
        )
    where = f"{path}: the position on line 4"
    x, y, z = (float(m[1].replace(",", ".")) * si_factor("length", m[2], where) for m in found)
    return x, y, z


def _channels(
    names: Sequence[str], components: Sequence[str] | None, path: str | Path
) -> tuple[list[list[Column]], dict[str, str]]:
    """Columns of each group of equal arrival times, and what each channel was taken for."""
    parsed = [re.fullmatch(r"\s*([A-Za-z]+)(\d*)(?:\{(\d+)\})?\s*(?:\[(.*)\])?\s*", n)
              for n in names]  # fmt: skip
    there = {(m.group(1).upper(), m.group(2), m.group(3) or "1"): (i, m.group(4))
             for i, m in enumerate(parsed) if m is not None}  # fmt: skip
    channels = sorted((k for k in there if k[0] == "LDA"), key=lambda key: int(key[1] or 0))
    listed = ", ".join(names)
    if any(key[1].startswith("0") for key in channels):
        raise ValueError(f"{path}: channels count from 1, and its columns are {listed}; one is misnamed")
    if not channels:
        raise ValueError(f"{path}: no column 'LDA1 [m/s]' or the like; there are: {listed}")
    meant = _meanings([f"LDA{key[1]}" for key in channels], components, path)
    groups: dict[str, list[Column]] = {}
    for key, name in zip(channels, meant, strict=True):
        if name == "skip":
            continue
        index, unit = there[key]
        sign = -1.0 if name.startswith("-") else 1.0
        if key[2] not in groups:
            groups[key[2]] = _times(there, key[2], listed, path)
        groups[key[2]].append(_column(name.lstrip("-"), index, unit, path, sign))
    chosen = {f"LDA{key[1]}": name for key, name in zip(channels, meant, strict=True)}
    return list(groups.values()), chosen


def _times(
    there: dict[tuple[str, str, str], tuple[int, str | None]], group: str, listed: str,
    path: str | Path,
) -> list[Column]:  # fmt: skip
    suffix = "" if group == "1" else f"{{{group}}}"
    if ("AT", "", group) not in there:
        raise ValueError(f"{path}: column 'AT{suffix} [ms]' is missing; there are: {listed}")
    pairs = (("AT", "arrival_time"), ("TT", "transit_time"))
    return [_column(name, *there[key, "", group], path)
            for key, name in pairs if (key, "", group) in there]  # fmt: skip


def _column(name: str, index: int, unit: str | None, path: str | Path, sign: float = 1.0) -> Column:
    factor = si_factor(QUANTITIES[name], unit or "", f"{path}: column {name!r}")
    return Column(name, index, sign * factor)


def _meanings(channels: Sequence[str], components: Sequence[str] | None, path: str | Path) -> Sequence[str]:
    if components is None:
        if len(channels) not in USUAL:
            raise ValueError(
                f"{path} has {len(channels)} channel{'s' * (len(channels) > 1)}, "
                f"{', '.join(channels)}; say what it measures: components = wall_normal or "
                "streamwise, with a minus where it counts the other way"
            )
        return USUAL[len(channels)]
    if len(components) != len(channels):
        raise ValueError(
            f"{path} has channels {', '.join(channels)}, but components names {len(components)}: "
            f"{', '.join(components)}; name one for each, 'skip' included"
        )
    known = [*COMPONENTS, *(f"-{name}" for name in COMPONENTS), "skip"]
    for name in components:
        if name not in known:
            raise ValueError(f"unknown component {name!r}{did_you_mean(name, known)}; one of {', '.join(known)}")
    used = [name.lstrip("-") for name in components if name != "skip"]
    if not used or len(set(used)) < len(used):
        raise ValueError(
            f"components is {', '.join(components)}; name wall_normal and streamwise once each at "
            "most, and one of them at least"
        )
    return components


def _require_equal(read: Sequence[dict[str, Array]], path: str | Path) -> None:
    """Columns of a channel are as long as its arrival times."""
    for columns in read:
        counts = {name: len(values) for name, values in columns.items()}
        if len(set(counts.values())) > 1:
            lengths = ", ".join(f"{name} {count}" for name, count in counts.items())
            raise ValueError(
                f"{path}: columns of one channel have unequal lengths: {lengths}; the columns of a "
                "burst have equal lengths"
            )


def _joined(
    read: Sequence[dict[str, Array]], window: float | None, path: str | Path
) -> tuple[dict[str, Array], tuple[str, ...], dict[str, int]]:
    """One set of bursts from one or two channels."""
    if len(read) == 1:
        return read[0], (), {}
    wall, other = sorted(read, key=lambda columns: "wall_normal" not in columns)
    if window is None:
        left_out = next(name for name in other if name in COMPONENTS)
        note = (
            f"not in coincidence: {left_out} ({len(other['arrival_time'])} bursts) has its own "
            "arrival times and is left out; a coincidence window pairs it"
        )
        return wall, (note,), {}
    for columns in read:
        if bool((np.diff(columns["arrival_time"]) < 0).any()):
            raise ValueError(
                f"{path}: the arrival times of a channel run backwards; coincidence needs them in "
                "order. Read without a window, or sort the export"
            )
    mine, partner = pair_coincident(wall["arrival_time"], other["arrival_time"], window)
    if len(mine) == 0:
        raise ValueError(
            f"{path}: no two bursts of the channels are within {1e6 * window:g} us; widen the coincidence window"
        )
    joined = {name: values[mine] for name, values in wall.items()}
    joined |= {n: v[partner] for n, v in other.items() if n in COMPONENTS}
    # The wall-normal channel is the record; what it misses is what was dropped.
    return joined, (), {NO_PARTNER: len(wall["arrival_time"]) - len(mine)}


def pair_coincident(first: Array, second: Array, window: float) -> tuple[np.ndarray, np.ndarray]:
    """Bursts of two channels that belong to the same particle.

    Each burst takes the nearest of the other channel; a pair counts where the choice is mutual and no further apart
    than the window, so that no burst is used twice.

    Args:
        first, second: arrival times, s, increasing, (N,), (M,).  window: s, largest difference.
    Returns:
        Indices of the pairs into ``first`` and ``second``, each (P,).
    Raises:
        ValueError: the window is not above 0.
    """
    require_positive("coincidence window (s)", window)
    there, back = _nearest(first, second), _nearest(second, first)
    mine = np.arange(len(first))
    mutual = (back[there] == mine) & (np.abs(second[there] - first) <= window)
    return mine[mutual], there[mutual]


def _nearest(times: Array, others: Array) -> np.ndarray:
    """Index of the nearest of ``others``, increasing, to each of ``times``."""
    right = np.searchsorted(others, times).clip(max=len(others) - 1)
    left = (right - 1).clip(min=0)
    return np.where(np.abs(times - others[left]) <= np.abs(times - others[right]), left, right)


FORMAT = BurstFormat(
    recognises=lambda path, _: is_dantec(path),
    places=lambda path: [read_header(read_head(path)[: HEADER_LINES + 1], path).position],
    read=lambda path, _, options, about: read_dantec(
        path, options["components"], options["coincidence_window"], **about
    ),
    takes=("components", "coincidence_window"),
)

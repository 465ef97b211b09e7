"""Restarts of one run as one plane: ordered in time, overlaps compared, gaps refused."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import date
from fractions import Fraction
from typing import Any, NoReturn

import torch
from torch import Tensor

from torchliner.checks import require_choice, tell
from torchliner.io.plane_format import Stored
from torchliner.names import OVERLAPS
from torchliner.records import VelocityPlane
from torchliner.records.same_case import require_same_probes
from torchliner.records.slabs import slab_bounds

JOINED = "joined"  # in the provenance
OFF = 0.1  # of a sampling interval, by which restarts may miss the clock of the first
JULIAN = 1582  # last year in which the standard calendar was another
EPOCH = re.compile(
    r"(?P<year>\d{4})-(?P<month>\d{1,2})-(?P<day>\d{1,2})"
    r"(?:[T ]\s*(?P<hour>\d{1,2})(?::(?P<minute>\d{1,2})(?::(?P<s>\d{1,2}(?:\.\d*)?))?)?)?"
    r"\s*(?:Z|UTC|GMT|(?P<sign>[+-])(?P<east>\d{1,2}):?(?P<more>\d\d)?)?"
    r" (?:standard|gregorian|proleptic_gregorian)"
)
Clock = tuple[str, Fraction] | None  # epoch and calendar of times, and the first of these, s
SAME_VALUE = 1e-5  # of the largest |v|: what text and single precision round


def named_planes(plane: VelocityPlane) -> list[tuple[str, str]]:
    """What a plane is and its name, for ``origin_of``; of a joined one those it was joined of."""
    parts = plane.provenance.get(JOINED)
    known = parts if isinstance(parts, list) else []  # a file may hold anything of that name
    names = [str(part["file"]) for part in known if isinstance(part, dict) and "file" in part]
    return [("velocity", name) for name in names or [plane.name]]


@dataclass
class JoinedVelocity(Stored):
    """Velocity whose samples stand in several files.

    Args:
        pieces: first sample of each, in order, and its velocity, in memory or in its file; of what several hold the
            first of them counts.
        shape: of the whole, (..., T).
    """

    pieces: list[tuple[int, VelocityPlane]]
    shape: tuple[int, ...]

    def __post_init__(self) -> None:
        self.dtype = max((piece.velocity.dtype for _, piece in self.pieces),
                         key=lambda dtype: dtype.itemsize)  # fmt: skip
        self.label = f"{min(self.pieces, key=lambda each: each[0])[1].name} and {len(self.pieces) - 1} more"
        for name in ("tile_rows", "tile_bytes"):
            found = max(getattr(piece.velocity, name, 0) for _, piece in self.pieces)
            setattr(self, name, max(found, 1) if name == "tile_rows" else found)

    def read(self, begin: int, end: int, out: Tensor | None = None) -> Tensor:
        """Samples begin .. end - 1 of every probe, m/s, (t, P), each from the first that has it."""
        end = min(end, self.shape[-1])
        out, place = self.rows(begin, end, out), begin
        while place < end:
            owner = next(i for i, (at, piece) in enumerate(self.pieces) if at <= place < at + piece.samples)
            first, piece = self.pieces[owner]
            ahead = [at for at, _ in self.pieces[:owner] if place < at]  # of those that count more
            last = min(first + piece.samples, end, *ahead)
            own, into = piece.stored, out[place - begin : last - begin]
            if own is not None and own.dtype == self.dtype:
                own.read(place - first, last - first, into)
            else:
                into.copy_(piece.read(place - first, last - first))
            place = last
        return out


def join_planes(
    planes: Sequence[VelocityPlane], clocks: Sequence[Clock] = (), overlap: str = "refuse"
) -> VelocityPlane:
    """One plane of the pieces of one run, by the times that they state.

    Args:
        planes: in any order; one is given back as it is.
        clocks: of each, the epoch and calendar of its times and the first of these, s; None, or
            none at all: ``start`` counts.
        overlap: what counts of samples in two files: ``earlier`` or ``later``, the one that begins so;
            ``refuse`` where they differ, as after a restart from before a crash.
    Raises:
        ValueError: other probes, another case or sampling rate; a gap; an overlap with other
            values; two clocks; times since an epoch beside times since none.
    Warns:
        DataWarning: samples that stand in two files with the same values.
    """
    if len(planes) == 1:
        return planes[0]
    require_choice("overlap", overlap, OVERLAPS)
    placed, rate = on_one_clock(planes, clocks)
    pieces = sorted(placed, key=lambda piece: piece[0])
    ordered = [piece for _, piece in pieces]
    first = ordered[0]
    notes = []
    end, owner = first.samples, pieces[0]
    for place, piece in pieces[1:]:
        if place > end:
            refuse_gap(owner[1], piece, place - end, rate)
        if place < end:
            notes.append(compare(owner[1], piece, place - owner[0], overlap))
        if place + piece.samples > end:
            end, owner = place + piece.samples, (place, piece)
    tell(notes, depth=2)
    pieces = pieces[::-1] if overlap == "later" else pieces
    streams: Any = None
    if all(each.streamwise is not None for each in ordered):
        streams = JoinedVelocity([(at, replace(p, velocity=p.streamwise)) for at, p in pieces],
                                 (*first.probe_shape, end))  # fmt: skip
    joined = [{"file": each.name, "start": each.start, "samples": each.samples}
              for each in ordered]  # fmt: skip
    return replace(
        first,
        velocity=JoinedVelocity(pieces, (*first.probe_shape, end)),
        streamwise=streams,
        sampling_rate=rate,
        name=f"{first.name} and {len(ordered) - 1} more",
        provenance={**first.provenance, JOINED: joined, "overlaps": notes},
    )


def on_one_clock(
    planes: Sequence[VelocityPlane], clocks: Sequence[Clock] = ()
) -> tuple[list[tuple[int, VelocityPlane]], float]:
    """The pieces of one run, their ``start`` on the clock of the earliest of them.

    Args:
        planes, clocks: as for ``join_planes``.
    Returns:
        Of each, in the order given, the sample of the whole at which it begins, and the piece; and
        the rate of all, Hz.
    Raises:
        ValueError: as ``join_planes``, but for gaps and overlaps.
    """
    moments = _moments(planes, clocks)
    first = planes[moments.index(min(moments))]
    # Dates are far from their epoch, and whole numbers of ns: their differences alone are floats.
    after = [float(moment - min(moments)) for moment in moments]
    placed = [replace(plane, start=first.start + t) for plane, t in zip(planes, after, strict=True)]
    for other in placed:
        _require_one_run(first, other)
    # The common rate is that of the longest piece: its stamps are rounded least.
    rate = max(placed, key=lambda plane: plane.samples).sampling_rate
    places = [_place(first, *each, rate) for each in zip(placed, after, strict=True)]
    return list(zip(places, placed, strict=True)), rate


def _require_one_run(first: VelocityPlane, other: VelocityPlane) -> None:
    require_same_probes(first, other)
    drift = abs(other.sampling_rate / first.sampling_rate - 1) * max(first.samples, other.samples)
    if drift > OFF:
        raise ValueError(
            f"{first.name} and {other.name} cannot be joined: they are sampled at "
            f"{first.sampling_rate:.9g} and {other.sampling_rate:.9g} Hz, two time bases; files "
            "of one plane share their rate: resample one, or give them one by one"
        )


def _moments(planes: Sequence[VelocityPlane], clocks: Sequence[Clock]) -> list[Fraction]:
    """Times of the first samples on one clock, s."""
    known = [clock for clock in clocks if clock is not None]
    if not known:
        return [Fraction(plane.start) for plane in planes]
    if len(known) < len(planes):
        raise ValueError(
            f"{planes[clocks.index(None)].name} cannot be joined with "
            f"{planes[clocks.index(known[0])].name}, whose times are since {known[0][0]}: its own "
            "are since no date; write it into their units, or give the files one by one"
        )
    # The same words are the same clock, whatever they mean.
    one = len({epoch for epoch, _ in known}) == 1
    return [since if one else since + _seconds(epoch, plane.name)
            for plane, (epoch, since) in zip(planes, known, strict=True)]  # fmt: skip


def _seconds(epoch: str, name: str) -> Fraction:
    """An epoch on a common clock."""
    found = EPOCH.fullmatch(epoch)
    with suppress(ValueError):
        if found is not None and int(found["year"]) > JULIAN:
            day = date(int(found["year"]), int(found["month"]), int(found["day"])).toordinal()
            hours, minutes = (int(found[each] or 0) for each in ("hour", "minute"))
            zone = 60 * int(found["east"] or 0) + int(found["more"] or 0)
            west = 60 * (-zone if found["sign"] == "-" else zone)
            return 86400 * day + 3600 * hours + 60 * minutes - west + Fraction(found["s"] or 0)
    raise ValueError(
        f"{name} cannot be joined with files of another epoch: its times are since {epoch!r}; a "
        f"date YYYY-MM-DD hh:mm:ss after {JULIAN}, of the standard calendar, is needed"
    )


def _place(first: VelocityPlane, other: VelocityPlane, after: float, rate: float) -> int:
    """Sample of the whole at which a piece begins, which does so some seconds after the first."""
    exact = after * rate
    if abs(exact - round(exact)) > OFF:
        raise ValueError(
            f"{other.name} begins {exact:.6g} sampling intervals after {first.name}, at "
            f"{other.start:.9g} s, between the samples of its clock: two time bases; shift one"
        )
    return round(exact)


def refuse_gap(before: VelocityPlane, after: VelocityPlane, gap: int, rate: float) -> NoReturn:
    """Say how many samples are missing between two pieces."""
    end = before.start + (before.samples - 1) / before.sampling_rate
    raise ValueError(
        f"{gap} samples are missing between {before.name}, which ends at {end:.9g} s, and "
        f"{after.name}, which begins at {after.start:.9g} s (one sample is {1 / rate:.6g} s); give "
        "the file between them, or each side on its own"
    )


def compare(before: VelocityPlane, after: VelocityPlane, shift: int, overlap: str) -> str:
    """What is said of samples in both, the second beginning ``shift`` samples after the first.

    Raises:
        ValueError: they differ, also where one alone is nan, and ``overlap`` is ``refuse``.
    """
    samples = min(before.samples - shift, after.samples)
    worst, at, largest = 0.0, 0, 0.0
    for begin, end in slab_bounds(samples, before.probes):
        one, two = before.read(begin + shift, end + shift), after.read(begin, end)
        wide = one.to(torch.float64), two.to(torch.float64)
        off = (wide[0] - wide[1]).abs().nan_to_num(0.0)
        off[wide[0].isnan() != wide[1].isnan()] = torch.inf
        largest = max(largest, float(wide[0].abs().nan_to_num(0.0).max()))
        if float(off.max()) > worst:
            worst, at = float(off.max()), begin + int(off.amax(1).argmax())
    twice = f"{samples} samples of {after.name} stand in {before.name} too"
    if overlap != "refuse":
        return f"{twice}, and differ by up to {worst:.3g} m/s; the {overlap} ones count"
    if worst > SAME_VALUE * largest:
        same = " (both begin at the same time: does the second count from 0 again?)"
        raise ValueError(
            f"{before.name} and {after.name} share {samples} samples but not their values: they "
            f"differ by up to {worst:.4g} m/s, most at sample {at} of the second, "
            f"{after.start + at / after.sampling_rate:.9g} s"
            f"{same if shift == 0 else ''}; say which count with overlap='later' or 'earlier' (--overlap), or "
            "leave one out"
        )
    return f"{twice}, and count once"

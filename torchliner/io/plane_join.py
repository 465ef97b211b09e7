"""Restarts of one run as one plane: ordered in time, overlaps compared, gaps refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import zip_longest

import torch
from torch import Tensor

from torchliner.checks import require_choice, tell
from torchliner.io.plane_format import Clock, Stored
from torchliner.names import OVERLAPS
from torchliner.records import VelocityPlane
from torchliner.records.same_case import require_same_probes
from torchliner.records.slabs import slab_bounds

JOINED = "joined"  # in the provenance
OFF = 0.1  # of a sampling interval, by which restarts may miss the clock of the first
SAME_VALUE = 1e-5  # of the largest |v|: what text and single precision round


def named_planes(plane: VelocityPlane) -> list[tuple[str, str]]:
    """What a plane is and its name, for ``origin_of``; of a joined one those it was joined of."""
    parts = plane.provenance.get(JOINED)
    known = parts if isinstance(parts, list) else []  # a file may hold anything of that name
    names = [str(part["file"]) for part in known if isinstance(part, dict) and "file" in part]
    return [("velocity", name) for name in names or [plane.name]]


@dataclass
class JoinedVelocity(Stored):
    """Velocity whose samples stand in several files: the first sample of each piece, and the piece; of what several
    hold the first of them counts."""

    pieces: list[tuple[int, VelocityPlane]]
    shape: tuple[int, ...]

    def __post_init__(self) -> None:
        velocities = [piece.velocity for _, piece in self.pieces]
        self.dtype = max((each.dtype for each in velocities), key=lambda dtype: dtype.itemsize)
        self.label = f"{min(self.pieces, key=lambda each: each[0])[1].name} and {len(self.pieces) - 1} more"
        self.files = tuple(file for each in velocities for file in getattr(each, "files", ()))

    def fill(self, begin: int, end: int, out: Tensor) -> None:
        """As ``Stored.fill``, each sample from the first piece that has it."""
        at = begin
        while at < end:
            owner = next(i for i, (low, piece) in enumerate(self.pieces) if low <= at < low + piece.samples)
            first, piece = self.pieces[owner]
            ahead = [low for low, _ in self.pieces[:owner] if at < low]  # of those that count more
            last = min(first + piece.samples, end, *ahead)
            own, into = piece.stored, out[at - begin : last - begin]
            if own is not None and own.dtype == self.dtype:
                own.read(at - first, last - first, into)
            else:
                into.copy_(piece.read(at - first, last - first))
            at = last


def join_planes(
    planes: Sequence[VelocityPlane], clocks: Sequence[Clock | None] = (), overlap: str = "refuse"
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
    pieces, rate = _on_one_clock(planes, clocks)
    first, notes = pieces[0][1], []
    end, (at, owner) = first.samples, pieces[0]
    for low, piece in pieces[1:]:
        if low > end:
            raise ValueError(
                f"{low - end} samples of {1 / rate:.6g} s are missing between {owner.name}, which ends at "
                f"{owner.start + (owner.samples - 1) / rate:.9g} s, and {piece.name}, which begins at "
                f"{piece.start:.9g} s; give the file between them, or each side on its own"
            )
        if low < end:
            notes.append(_compared(owner, piece, low - at, overlap))
        if low + piece.samples > end:
            end, at, owner = low + piece.samples, low, piece
    tell(notes, depth=2)
    joined = [{"file": each.name, "start": each.start, "samples": each.samples} for _, each in pieces]
    pieces = pieces[::-1] if overlap == "later" else pieces
    shape, streams = (*first.probe_shape, end), None
    if all(each.streamwise is not None for _, each in pieces):
        streams = JoinedVelocity([(low, replace(each, velocity=each.streamwise)) for low, each in pieces], shape)
    return replace(
        first,
        velocity=JoinedVelocity(pieces, shape),
        streamwise=streams,
        sampling_rate=rate,
        name=f"{first.name} and {len(pieces) - 1} more",
        provenance={**first.provenance, JOINED: joined, "overlaps": notes},
    )


def _on_one_clock(
    planes: Sequence[VelocityPlane], clocks: Sequence[Clock | None]
) -> tuple[list[tuple[int, VelocityPlane]], float]:
    """The pieces in the order of time, their ``start`` on the clock of the earliest, and the sample of the whole at
    which each begins; the rate of all, Hz."""
    moments = _moments(planes, clocks)
    first = planes[moments.index(min(moments))]
    # The common rate is that of the longest piece: its stamps are rounded least.
    rate, found = max(planes, key=lambda plane: plane.samples).sampling_rate, []
    for plane, moment in zip(planes, moments, strict=True):
        # Dates are far from their epoch, and whole numbers of ns: their differences alone are floats.
        after = float(moment - min(moments))
        piece = replace(plane, start=first.start + after)
        require_same_probes(first, piece)
        drift = abs(piece.sampling_rate / first.sampling_rate - 1) * max(first.samples, piece.samples)
        if drift > OFF or abs(after * rate - round(after * rate)) > OFF:
            raise ValueError(
                f"{first.name} and {piece.name} cannot be joined: they are sampled at {first.sampling_rate:.9g} and "
                f"{piece.sampling_rate:.9g} Hz, and the second begins {after * rate:.6g} sampling intervals after the "
                "first: two time bases; resample or shift one"
            )
        found.append((round(after * rate), piece))
    return sorted(found, key=lambda piece: piece[0]), rate


def _moments(planes: Sequence[VelocityPlane], clocks: Sequence[Clock | None]) -> list[Fraction]:
    """Times of the first samples on one clock, s; the same words are the same clock, whatever they mean."""
    epochs = {clock[0] if clock else "no date" for clock in clocks}
    if len(epochs) > 1:
        raise ValueError(
            f"{planes[0].name} and {len(planes) - 1} more cannot be joined: their times are since "
            f"{', '.join(sorted(epochs))}; write one epoch into the units of all"
        )
    return [clock[1] if clock else Fraction(plane.start) for plane, clock in zip_longest(planes, clocks)]


def _compared(before: VelocityPlane, after: VelocityPlane, shift: int, overlap: str) -> str:
    """What is said of samples in both, the second beginning ``shift`` samples after the first; a ValueError where they
    differ, also where one alone is nan, and ``overlap`` is ``refuse``."""
    samples = min(before.samples - shift, after.samples)
    worst, at, largest = 0.0, 0, 0.0
    for begin, end in slab_bounds(samples, before.probes):
        one = before.read(begin + shift, end + shift).to(torch.float64)
        two = after.read(begin, end).to(torch.float64)
        off = (one - two).abs().nan_to_num(0.0)
        off[one.isnan() != two.isnan()] = torch.inf
        largest = max(largest, float(one.abs().nan_to_num(0.0).max()))
        if float(off.max()) > worst:
            worst, at = float(off.max()), begin + int(off.amax(1).argmax())
    twice = f"{samples} samples of {after.name} stand in {before.name} too"
    if overlap != "refuse":
        return f"{twice}, and differ by up to {worst:.3g} m/s; the {overlap} ones count"
    if worst > SAME_VALUE * largest:
        same = " (both begin at the same time: does the second count from 0 again?)" if shift == 0 else ""
        raise ValueError(
            f"{before.name} and {after.name} share {samples} samples but not their values: they differ by up to "
            f"{worst:.4g} m/s, most at sample {at} of the second, {after.start + at / after.sampling_rate:.9g} s{same};"
            " say which count with overlap='later' or 'earlier' (--overlap), or leave one out"
        )
    return f"{twice}, and count once"

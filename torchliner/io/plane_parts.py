"""Planes from several files, and parts of planes: restarts of one run joined in time, a stretch of time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_choice, tell
from torchliner.io.plane_format import Stored
from torchliner.names import OVERLAPS
from torchliner.records import VelocityPlane
from torchliner.records.case import require_same_probes
from torchliner.records.slabs import slab_bounds

JOINED = "joined"  # in the provenance
OFF = 0.1  # of a sampling interval, by which restarts may miss the clock of the first
SAME_VALUE = 1e-5  # of the largest |v|: what text and single precision round
Piece = tuple[int, VelocityPlane]  # first sample, counted in the whole


def named_planes(plane: VelocityPlane) -> list[tuple[str, str]]:
    """What a plane is and its name, for ``origin_of``; for a joined plane, those of its pieces."""
    return [("velocity", part["file"]) for part in plane.provenance.get(JOINED, ({"file": plane.name},))]


@dataclass
class JoinedVelocity(Stored):
    """Velocity of several files. A sample that several pieces hold is that of the first of them in the list."""

    pieces: list[Piece]
    shape: tuple[int, ...]
    label: str

    def __post_init__(self) -> None:
        velocities = [piece.velocity for _, piece in self.pieces]
        self.dtype = max((each.dtype for each in velocities), key=lambda dtype: dtype.itemsize)
        self.files = tuple(file for each in velocities for file in getattr(each, "files", ()))

    def fill(self, begin: int, end: int, out: Tensor) -> None:
        """As ``Stored.fill``."""
        for low, piece in reversed(self.pieces):
            first, last = max(begin, low), min(end, low + piece.samples)
            if first < last:
                out[first - begin : last - begin] = piece.read(first - low, last - low)


def join_planes(planes: Sequence[VelocityPlane], overlap: str = "refuse") -> VelocityPlane:
    """One plane from the pieces of one run, in any order, placed by the times at which they ``start``.

    ``overlap`` says which file counts where two hold the same samples: ``earlier`` or ``later``, the one that begins
    so; by ``refuse`` their values must agree. A ValueError where probes, case or rate are others, or samples are
    missing between two.
    """
    if len(planes) == 1:
        return planes[0]
    require_choice("overlap", overlap, OVERLAPS)
    first = min(planes, key=lambda plane: plane.start)
    # The stamps of the longest are rounded least.
    rate, pieces = max(planes, key=lambda plane: plane.samples).sampling_rate, list[Piece]()
    for piece in planes:
        after = (piece.start - first.start) * rate
        require_same_probes(first, piece)
        drift = abs(piece.sampling_rate / first.sampling_rate - 1) * max(first.samples, piece.samples)
        if drift > OFF or abs(after - round(after)) > OFF:
            raise ValueError(
                f"{first.name} and {piece.name} have two time bases: they are at {first.sampling_rate:.9g} and "
                f"{piece.sampling_rate:.9g} Hz, and the second begins {after:.6g} samples later; resample or shift one"
            )
        pieces.append((round(after), piece))
    pieces.sort(key=lambda each: each[0])
    notes, (at, owner) = [], pieces[0]
    for low, piece in pieces[1:]:
        end = at + owner.samples
        if low > end:
            raise ValueError(
                f"{low - end} samples of {1 / rate:.6g} s are missing between {owner.name} and {piece.name}, which "
                f"begins at {piece.start:.9g} s; give the file between them, or each side on its own"
            )
        if low < end:
            notes.append(_compared(owner, piece, low - at, overlap))
        if low + piece.samples > end:
            at, owner = low, piece
    tell(notes, depth=2)
    joined = [{"file": each.name, "start": each.start, "samples": each.samples} for _, each in pieces]
    name, shape = f"{first.name} and {len(pieces) - 1} more", (*first.probe_shape, at + owner.samples)
    pieces = pieces[::-1] if overlap == "later" else pieces
    return replace(
        first,
        velocity=JoinedVelocity(pieces, shape, name),
        sampling_rate=rate,
        name=name,
        provenance={**first.provenance, JOINED: joined, "overlaps": notes},
    )


def _compared(before: VelocityPlane, after: VelocityPlane, shift: int, overlap: str) -> str:
    """What is said of samples that both hold, the second beginning ``shift`` samples after the first; a ValueError
    where they differ, also where one alone is nan, and ``overlap`` is ``refuse``."""
    samples, worst, largest = min(before.samples - shift, after.samples), 0.0, 0.0
    for begin, end in slab_bounds(samples, before.probes):
        one, two = before.read(begin + shift, end + shift).double(), after.read(begin, end).double()
        off = (one - two).abs().nan_to_num(0.0).masked_fill(one.isnan() != two.isnan(), torch.inf)
        worst, largest = max(worst, float(off.max())), max(largest, float(one.abs().nan_to_num(0.0).max()))
    twice = f"{samples} samples of {after.name}, from {after.start:.9g} s on, stand in {before.name} too"
    if overlap != "refuse":
        return f"{twice}, and differ by up to {worst:.3g} m/s; the {overlap} ones count"
    if worst > SAME_VALUE * largest:
        raise ValueError(
            f"{twice}, and differ by up to {worst:.4g} m/s; say which count with overlap='later' or 'earlier' "
            "(--overlap), or leave one out (does the second count from 0 again?)"
        )
    return f"{twice}, and count once"


@dataclass
class SelectedVelocity(Stored):
    """Some samples and probes (all without ``columns``) of a velocity that stays in its file."""

    stored: Any
    shape: tuple[int, ...]
    begin: int = 0
    columns: Tensor | None = None

    def __post_init__(self) -> None:
        self.dtype, self.label = self.stored.dtype, getattr(self.stored, "label", "velocity")
        self.files = getattr(self.stored, "files", ())

    def fill(self, begin: int, end: int, out: Tensor) -> None:
        """As ``Stored.fill``."""
        if self.columns is None:
            self.stored.read(self.begin + begin, self.begin + end, out)
        else:
            out[:] = self.stored.read(self.begin + begin, self.begin + end)[:, self.columns]


def select(plane: VelocityPlane, start: float | None = None, stop: float | None = None) -> VelocityPlane:
    """The samples from ``start`` on and before ``stop``, s; nothing is read. A ValueError where there are none."""
    chosen = {name: value for name, value in (("start", start), ("stop", stop)) if value is not None}
    if not chosen:
        return plane
    times = (plane.start if start is None else float(start), math.inf if stop is None else float(stop))
    # The rounding of a stamp does not shut out the sample that it names.
    at = [(time - plane.start) * plane.sampling_rate - 1e-3 for time in times]
    begin, end = (math.ceil(min(max(each, 0), plane.samples)) for each in at)
    if begin >= end:
        raise ValueError(
            f"{plane.name} has no sample from {times[0]:g} to {times[1]:g} s; it runs from {plane.start:.9g} to "
            f"{plane.start + (plane.samples - 1) / plane.sampling_rate:.9g} s"
        )
    kept: Any = plane.velocity
    if isinstance(kept, Tensor):
        kept = kept[..., begin:end]
    else:
        kept = SelectedVelocity(kept, (*plane.probe_shape, end - begin), begin)
    provenance, after = {**plane.provenance, "selected": chosen}, begin / plane.sampling_rate
    return replace(plane, velocity=kept, start=plane.start + after, provenance=provenance)

"""Planes from several files, and parts of planes: restarts of one run joined in time, a stretch of time, a region."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_choice, tell, whole_number
from torchliner.io.plane_format import Stored
from torchliner.names import OVERLAPS
from torchliner.records import VelocityPlane
from torchliner.records.case import require_same_probes
from torchliner.records.slabs import slab_bounds

JOINED = "joined"  # in the provenance
OFF = 0.1  # of a sampling interval, by which restarts may miss the clock of the first
SAME_VALUE = 1e-5  # of the largest |v|: what text and single precision round
Limits = tuple[float | None, float | None]
Piece = tuple[int, VelocityPlane]  # first sample, counted in the whole

# Restarts


def named_planes(plane: VelocityPlane) -> list[tuple[str, str]]:
    """What a plane is and its name, for ``origin_of``; for a joined plane, those of its pieces."""
    parts = plane.provenance.get(JOINED)
    known = parts if isinstance(parts, list) else []  # a file may hold anything of that name
    names = [str(part["file"]) for part in known if isinstance(part, dict) and "file" in part]
    return [("velocity", name) for name in names or [plane.name]]


@dataclass
class JoinedVelocity(Stored):
    """Velocity of several files. A sample that several pieces hold is that of the first of them in the list."""

    pieces: list[Piece]
    shape: tuple[int, ...]

    def __post_init__(self) -> None:
        velocities = [piece.velocity for _, piece in self.pieces]
        self.dtype = max((each.dtype for each in velocities), key=lambda dtype: dtype.itemsize)
        self.label = f"{min(self.pieces, key=lambda each: each[0])[1].name} and {len(self.pieces) - 1} more"
        self.files = tuple(file for each in velocities for file in getattr(each, "files", ()))

    def fill(self, begin: int, end: int, out: Tensor) -> None:
        """As ``Stored.fill``."""
        at = begin
        while at < end:
            owner = next(i for i, (low, piece) in enumerate(self.pieces) if low <= at < low + piece.samples)
            first, piece = self.pieces[owner]
            ahead = [low for low, _ in self.pieces[:owner] if at < low]  # where a piece that counts more begins
            last = min(first + piece.samples, end, *ahead)
            out[at - begin : last - begin] = piece.read(at - first, last - first)
            at = last


def join_planes(planes: Sequence[VelocityPlane], overlap: str = "refuse") -> VelocityPlane:
    """One plane from the pieces of one run, in any order, placed by the times at which they ``start``.

    ``overlap`` says which file counts where two hold the same samples, with a DataWarning: ``earlier`` or ``later``,
    the one that begins so; by ``refuse`` their values must agree. A ValueError as well where probes, case or rate are
    others, or samples are missing between two.
    """
    if len(planes) == 1:
        return planes[0]
    require_choice("overlap", overlap, OVERLAPS)
    pieces, rate = _on_one_clock(planes)
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


def _on_one_clock(planes: Sequence[VelocityPlane]) -> tuple[list[Piece], float]:
    """The pieces in the order of time, and the common rate, Hz: that of the longest, whose stamps are rounded least."""
    first = min(planes, key=lambda plane: plane.start)
    rate, found = max(planes, key=lambda plane: plane.samples).sampling_rate, []
    for piece in planes:
        after = piece.start - first.start
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


def _compared(before: VelocityPlane, after: VelocityPlane, shift: int, overlap: str) -> str:
    """What is said of samples that both hold, the second beginning ``shift`` samples after the first; a ValueError
    where they differ, also where one alone is nan, and ``overlap`` is ``refuse``."""
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


# Parts


@dataclass
class SelectedVelocity(Stored):
    """Some samples and probes (all without ``columns``) of a velocity that stays in its file."""

    stored: Any
    shape: tuple[int, ...]
    begin: int = 0
    every: int = 1
    columns: Tensor | None = None

    def __post_init__(self) -> None:
        self.dtype, self.label = self.stored.dtype, getattr(self.stored, "label", "velocity")
        self.files = getattr(self.stored, "files", ())

    def fill(self, begin: int, end: int, out: Tensor) -> None:
        """As ``Stored.fill``; as many samples at once as are wanted, so that memory does not grow with ``every``."""
        rows, low = end - begin, self.begin + begin * self.every
        if self.every == 1 and self.columns is None:
            self.stored.read(low, low + rows, out)
            return
        most = max(1, rows // self.every)
        for first in range(0, rows, most):
            last = min(first + most, rows)
            slab = self.stored.read(low + first * self.every, low + (last - 1) * self.every + 1)[:: self.every]
            out[first:last] = slab if self.columns is None else slab[:, self.columns]


def select(
    plane: VelocityPlane,
    start: float | None = None,
    stop: float | None = None,
    every: int = 1,
    region: Sequence[Limits] | str | None = None,
) -> VelocityPlane:
    """A part of a plane, arguments as for ``read_plane``; nothing is read. A ValueError where it would be empty, or the
    plane has no coordinates for a region."""
    every = whole_number("every", every)
    if every < 1:
        raise ValueError(f"every is {every}; keep every n-th sample, n at least 1")
    stated = {"start": start, "stop": stop, "region": region, "every": None if every == 1 else every}
    chosen = {name: value for name, value in stated.items() if value is not None}
    if not chosen:
        return plane
    times = (plane.start if start is None else float(start), math.inf if stop is None else float(stop))
    # The rounding of a stamp does not shut out the sample that it names.
    at = [(time - plane.start) * plane.sampling_rate - 1e-3 for time in times]
    begin, end = (math.ceil(min(max(each, 0), plane.samples)) for each in at)
    samples = len(range(begin, end, every))
    if not samples:
        raise ValueError(
            f"{plane.name} has no sample from {times[0]:g} to {times[1]:g} s; it runs from {plane.start:.9g} to "
            f"{plane.start + (plane.samples - 1) / plane.sampling_rate:.9g} s"
        )
    columns, shape, about = (None, plane.probe_shape, {}) if region is None else _region(plane, region)
    for name in ("velocity", "streamwise"):
        value = getattr(plane, name)
        if isinstance(value, Tensor):
            part = value[..., begin:end:every].reshape(-1, samples)
            about[name] = (part if columns is None else part[columns]).reshape(*shape, samples)
        elif value is not None:
            about[name] = SelectedVelocity(value, (*shape, samples), begin, every, columns)
    return replace(
        plane,
        sampling_rate=plane.sampling_rate / every,
        start=plane.start + begin / plane.sampling_rate,
        provenance={**plane.provenance, "selected": chosen},
        **about,
    )


def _region(plane: VelocityPlane, region: Sequence[Limits] | str) -> tuple[Tensor, tuple[int, ...], dict[str, Any]]:
    """Numbers of the probes in a region, the shape of these, and what else of the plane goes with them."""
    limits = parse_region(region) if isinstance(region, str) else [tuple(each) for each in region]
    grid = len(plane.probe_shape) == 2
    places = {name: value for name in "xz" if (value := getattr(plane, name)) is not None}
    inside = [torch.ones(n, dtype=torch.bool) for n in (plane.probe_shape[::-1] if grid else (plane.probes,) * 2)]
    for i, (name, (low, high)) in enumerate(zip("xz", limits, strict=False)):
        if (low, high) != (None, None) and name not in places:
            raise ValueError(f"{plane.name} states no {name}, so that no region of it is known")
        if name in places:
            inside[i] = places[name] >= (-math.inf if low is None else low)
            inside[i] &= places[name] <= (math.inf if high is None else high)
    inside = inside if grid else [inside[0] & inside[1]] * 2
    if not all(bool(each.any()) for each in inside):
        runs = ", ".join(f"{name} from {float(v.min()):g} to {float(v.max()):g} m" for name, v in places.items())
        raise ValueError(f"{plane.name} has no probe in the region {region}; it has {runs}")
    chosen = (inside[1][:, None] & inside[0]).reshape(-1) if grid else inside[0]
    about: dict[str, Any] = {name: value[inside["xz".index(name)]] for name, value in places.items()}
    about |= {} if plane.area is None else {"area": plane.area[chosen]}
    counts = [int(each.sum()) for each in inside[::-1]]
    return chosen.nonzero()[:, 0], tuple(counts if grid else counts[:1]), about


def parse_region(text: str) -> list[Limits]:
    """Limits of x and of z, m, from "0:0.1,-0.01:0.01"; a side that is left out has no limit."""
    found: list[Limits] = []
    try:
        for part in text.split(","):
            low, high = (float(each) if each.strip() else None for each in part.split(":"))
            found.append((low, high))
        if len(found) > 2 or "nan" in text:
            raise ValueError
    except ValueError:
        raise ValueError(f"region {text!r} cannot be read; write X0:X1 or X0:X1,Z0:Z1, in m") from None
    for low, high in found:
        if low is not None and high is not None and low > high:
            raise ValueError(f"region {text!r} is upside down: {low:g} is above {high:g}")
    return found

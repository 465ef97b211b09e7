"""A plane that is still being written: its map, its interval, and how long until that is small."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.campaign.growing import GrowingMoments
from torchliner.campaign.inputs import open_plane
from torchliner.checks import FEWEST_PERIODS, tell
from torchliner.engine.moments import Moments, without_velocity
from torchliner.file_checks import DAMAGE, Unwritten
from torchliner.io.plane_join import Clock, compare, on_one_clock, refuse_gap
from torchliner.io.planes import HEAD, format_of
from torchliner.io.whole_file import HDF5
from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane

PIECE_VALUES = 1 << 24  # velocities that are read at once
SETTLED = 5.0  # s without a change, after which nobody is in the middle of one


@dataclass(frozen=True)
class Standing:
    """What is known at a moment.

    Args:
        samples, duration: of the whole blocks so far; s of the record.
        frequency: Hz.
        impedance: of the whole liner.
        half_width: of its statistical interval, the wider of resistance and reactance; nan where
            there are too few blocks.
        needed: duration at which that is as small as wished, s: it falls as 1/sqrt(duration).
        remaining: s of waiting until then, at the rate at which samples have come; nan where
            unknown.
    """

    samples: int
    duration: float
    frequency: float
    impedance: complex
    half_width: float
    needed: float
    remaining: float


class Frames:
    """Samples of a plane that grows, or of files that come into a folder, in the order of names
    (numbers in them count as numbers), each going on where the one before ended by its times.

    A file is read as far as it goes. The last one may be in the middle of a change: it is tried
    again, and ``error`` says what was wrong.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.error: Exception | None = None
        self._done: dict[Path, int] = {}  # samples taken of each file
        self._heads: dict[Path, Tensor] = {}  # first sample of each
        self._places: dict[Path, int] = {}  # of that sample in the whole
        # The first file and the longest, whose rate is the best known, without the open files, by
        # which HDF5 would not see that they grow.
        self._known: dict[Path, tuple[VelocityPlane, Clock]] = {}

    @property
    def liner(self) -> str:
        """That the first file names."""
        return open_plane(self._files()[0]).liner

    def _files(self) -> list[Path]:
        inside = sorted(self.path.iterdir(), key=_natural) if self.path.is_dir() else []
        return [each for each in inside if each.suffix.lower() in HDF5] or [self.path]

    def new(self) -> Iterator[VelocityPlane]:
        """What has come since, piece by piece, with all that is stated of the plane.

        Raises:
            OSError, ValueError: a file cannot be read that others follow, or is no plane; one
                became shorter or other; a later one does not join, as ``join_planes`` has it.
        Warns:
            DataWarning: samples are there twice; those of the later file are left out.
        """
        files, self.error = self._files(), None
        for path in files:
            seen = self._done.get(path, 0)
            try:
                plane = open_plane(path)
            except (OSError, ValueError) as error:
                if path != files[-1] or not (seen or may_heal(path, error)):
                    raise
                self.error = error
                return
            if plane.samples < seen:
                raise OSError(f"{path} had {seen} samples and has {plane.samples}; it was replaced")
            if path in self._heads and not torch.equal(self._heads[path], _head(plane)):
                raise OSError(f"{path} begins with other values than before; it was replaced")
            clock = getattr(plane.velocity, "clock", None)
            if path not in self._heads:
                seen = self._joined(plane, clock, path)
                self._heads[path] = _head(plane)
            self._known[path] = without_velocity(plane), clock
            longest = max(self._known, key=lambda each: self._known[each][0].samples)
            kept = (next(iter(self._known)), longest)
            self._known = {each: self._known[each] for each in kept}
            rows = max(1, PIECE_VALUES // plane.probes)
            for begin in range(seen, plane.samples, rows):
                slab = plane.read(begin, min(begin + rows, plane.samples))
                velocity = slab.T.reshape(*plane.probe_shape, -1)
                about = {key: value for key, value in vars(plane).items() if key != "velocity"}
                self._done[path] = begin + len(slab)
                yield VelocityPlane(velocity, **about | {"streamwise": None})

    def _joined(self, plane: VelocityPlane, clock: Clock, path: Path) -> int:
        """Samples of a new file that are known already; as ``read_plane`` joins files."""
        try:
            known = self._placed(plane, clock, path)
        except ValueError as error:
            raise ValueError(
                f"{path} does not join the files before it in the order of their names: {error}"
            ) from error
        if known:
            tell(f"{path} begins {known} samples before the end of the file before; they are left "
                 "out")  # fmt: skip
        return known

    def _placed(self, plane: VelocityPlane, clock: Clock, path: Path) -> int:
        """The same, after the place of the file is found and what it shares compared."""
        planes, clocks = zip(*self._known.values(), (plane, clock), strict=True)
        pieces, rate = on_one_clock(planes, clocks)
        (zero, first), (place, new) = pieces[0], pieces[-1]
        place -= zero
        ends = {each: self._places[each] + count for each, count in self._done.items()}
        end = max(ends.values(), default=place)
        if end - place >= plane.samples:
            raise ValueError(
                f"it goes from {new.start:g} to {new.start + new.duration:g} s, and the next "
                f"sample is that of {first.start + end / rate:g} s: it holds nothing new"
            )
        for other in [each for each in ends if ends[each] > place or ends[each] == end < place]:
            begin = self._places[other]
            old = replace(open_plane(other), start=first.start + begin / rate)
            if end < place:
                refuse_gap(old, new, place - end, rate)
            if ends[other] > place:
                two = (old, new) if begin <= place else (new, old)
                compare(*two, abs(place - begin))
        self._places[path] = place
        return end - place


def _head(plane: VelocityPlane) -> Tensor:
    return plane.read(0, 1).clone().nan_to_num()


def may_heal(path: Path, error: Exception) -> bool:
    """Whether a file that cannot be opened may be one that somebody still writes: it is not there,
    empty, or has just changed; it lacks samples; or its format is known and it ends too early. What
    a check refuses, and what no format knows, stays so."""
    if isinstance(error, FileNotFoundError | Unwritten) or not path.is_file():
        return True
    status = path.stat()
    if time.time() - max(status.st_mtime, status.st_ctime) < SETTLED:
        return True
    if isinstance(error, ValueError):
        return isinstance(error.__cause__, DAMAGE)
    with suppress(OSError):
        format_of(path)
        return True
    with path.open("rb") as file:
        return not any(file.read(HEAD))  # a library has left place for its header


def _natural(path: Path) -> list[Any]:
    """Numbers as numbers: p9 before p10."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", path.name)]


class Following:
    """Moments that are updated as frames come.

    Args:
        path: plane file that grows, or folder of files.
        liner: model.
        frequency: Hz; default the tone of the plane.
        until: half-width that is wished for.
        choices: of ``GrowingMoments``.
    """

    def __init__(
        self, path: Path, liner: LinerModel, frequency: Any = None, *, until: float | None = None,
        **choices: Any,
    ) -> None:  # fmt: skip
        self.frames, self.liner, self.frequency = Frames(path), liner, frequency
        self.until, self.choices = until, choices
        self.going: GrowingMoments | None = None
        self.rate = math.nan  # samples of the record a second of waiting
        self._first: tuple[float, int] | None = None  # clock and samples when they were first seen
        self._samples = 0

    def update(self) -> int:
        """Take what has come; how many samples."""
        before = self._samples
        for piece in self.frames.new():
            if self.going is None:
                self.going = GrowingMoments(
                    piece, cell_pitch=self.liner.cell_pitch, frequency=self.frequency,
                    **self.choices,
                )  # fmt: skip
            else:
                self.going.update(piece.velocity)
            self._samples += piece.samples
        now = time.monotonic()
        if self._first is None:
            self._first = (now, self._samples) if self._samples else None
        elif self._samples > self._first[1] and now > self._first[0]:
            self.rate = (self._samples - self._first[1]) / (now - self._first[0])
        return self._samples - before

    def standing(self) -> list[Standing]:
        """At each frequency; none before the first blocks are whole."""
        if self.going is None or self.going.periods < FEWEST_PERIODS:
            return []
        known = self.going.moments()
        found = known.educe(self.liner, self.frequency, **{"averaging": "admittance"} | self.choices)
        plane = known.plane
        duration = plane.samples / plane.sampling_rate
        rows = []
        for i, (f, z) in enumerate(zip(found.frequency.tolist(), found.answer.tolist(), strict=True)):
            bounds = found.bounds_of_liner(found.averaging, i)
            width = math.nan
            if bounds is not None:
                width = max(bounds[1].real - bounds[0].real, bounds[1].imag - bounds[0].imag) / 2
            needed = duration * (width / self.until) ** 2 if self.until else math.nan
            left = max(0.0, needed - duration) * plane.sampling_rate / self.rate
            rows.append(Standing(plane.samples, duration, f, z, width, needed, left))
        return rows

    def moments(self) -> Moments:
        """Of the whole blocks so far.

        Raises:
            ValueError: there are none.
        """
        if self.going is None:
            raise ValueError(f"{self.frames.path}: no samples have come")
        return self.going.moments()


def follow(
    following: Following, tell: Callable[[list[Standing]], None], *, every: float, idle: float,
    sleep: Callable[[float], None] = time.sleep,
) -> bool:  # fmt: skip
    """Wait for frames, until the interval is small enough or none have come for a while.

    Args:
        following: is updated.
        tell: called with each new standing.
        every: s between two looks.
        idle: s without new samples that end it.
        sleep: waits.
    Returns:
        Whether the wished half-width was reached.
    Raises:
        OSError, ValueError: the last file could not be read for so long; as ``Frames.new``.
    """
    waited = 0.0
    while True:
        if following.update():
            waited = 0.0
            tell(rows := following.standing())
            if rows and following.until and all(r.half_width <= following.until for r in rows):
                return True
        elif waited >= idle:
            if following.frames.error is not None:
                raise following.frames.error
            return False
        sleep(every)
        waited += every

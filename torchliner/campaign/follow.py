"""A plane that is still being written: its map, its interval, and how long until that is small."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from torch import Tensor

from torchliner.campaign.growing import GrowingMoments
from torchliner.checks import FEWEST_PERIODS, require_positive
from torchliner.engine.moments import Moments
from torchliner.io.planes import read_plane
from torchliner.io.whole_file import HDF5
from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane

PIECE_VALUES = 1 << 24  # velocities that are read at once


@dataclass(frozen=True)
class Standing:
    """What is known at a moment."""

    samples: int  # of the whole blocks so far
    duration: float  # s of the record
    frequency: float  # Hz
    impedance: complex  # of the whole liner
    half_width: float  # of its statistical interval, the wider of resistance and reactance; nan with too few blocks
    needed: float  # duration at which that is as small as wished, s: it falls as 1/sqrt(duration)


class Frames:
    """Samples of a plane that grows, or of a folder that fills with HDF5 files, which are joined as restarts are.

    Args:
        path: file or folder; of a folder the files are read in the order of their names, numbers as numbers.
        request: further arguments of ``read_plane``.
    """

    def __init__(self, path: Path, request: Mapping[str, Any] | None = None) -> None:
        self.path, self.request = path, dict(request or {})
        self.error: Exception | None = None  # of the last file, which somebody may still write
        self._seen: list[Any] = []  # names, sizes and times of change at the last look
        self._done = 0
        self._head: Tensor | None = None

    def files(self) -> list[Path]:
        """As they are now."""
        inside = sorted(self.path.iterdir(), key=_natural) if self.path.is_dir() else []
        return [each for each in inside if each.suffix.lower() in HDF5] or [self.path]

    def new(self) -> Iterator[VelocityPlane]:
        """What has come since, piece by piece, with all that is stated of the plane.

        Raises:
            OSError, ValueError: a file cannot be read that others follow; files do not join; what was read before has
                become shorter or other.
        Warns:
            DataWarning: samples stand in two files.
        """
        files = self.files()
        seen = [(each, (status := each.stat()).st_size, status.st_mtime_ns) for each in files if each.exists()]
        if seen == self._seen and self.error is None:
            return
        self._seen = seen
        plane = self._whole(files)
        if plane is None:
            return
        head = plane.read(0, 1).clone().nan_to_num()
        if plane.samples < self._done or (self._head is not None and not head.equal(self._head)):
            raise OSError(
                f"{plane.name} had {self._done} samples and has {plane.samples}, or begins with other values than "
                "before; it was replaced"
            )
        self._head = head
        rows = max(1, PIECE_VALUES // plane.probes)
        for begin in range(self._done, plane.samples, rows):
            slab = plane.read(begin, min(begin + rows, plane.samples))
            self._done = begin + len(slab)
            yield replace(plane, velocity=slab.T.reshape(*plane.probe_shape, -1), streamwise=None)

    def _whole(self, files: list[Path]) -> VelocityPlane | None:
        """All that can be read; without the last file, which is tried again, while that cannot be read by itself."""
        self.error = None
        try:
            return read_plane(files, lazy=True, **self.request)
        except (OSError, ValueError) as error:
            before = read_plane(files[:-1], lazy=True, **self.request) if len(files) > 1 else None
            try:
                read_plane(files[-1], lazy=True, **self.request)
            except (OSError, ValueError) as own:
                self.error = own
                return before
            raise error


def _natural(path: Path) -> list[Any]:
    """Numbers as numbers: p9 before p10."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", path.name)]


class Following:
    """Moments that are updated as frames come.

    Args:
        frames: where they come from.
        liner: model.
        frequency: Hz; default the tone of the plane.
        until: half-width that is wished for.
        choices: of ``GrowingMoments``.
    Raises:
        ValueError: ``until`` is not above 0, or no interval is asked for that it could be held against.
    """

    def __init__(
        self, frames: Frames, liner: LinerModel, frequency: Any = None, *, until: float | None = None, **choices: Any
    ) -> None:
        if until is not None:
            require_positive("until", until)
            if choices.get("interval", "") is None:
                raise ValueError(f"until is {until:g}, a half-width of the interval; leave out interval=None")
        self.frames, self.liner, self.frequency = frames, liner, frequency
        self.until, self.choices = until, {"averaging": "admittance"} | choices
        self.going: GrowingMoments | None = None

    def update(self) -> int:
        """Take what has come; how many samples."""
        count = 0
        for piece in self.frames.new():
            if self.going is None:
                about = {"cell_pitch": self.liner.cell_pitch, "frequency": self.frequency} | self.choices
                self.going = GrowingMoments(piece, **about)
            else:
                self.going.update(piece.velocity)
            count += piece.samples
        return count

    def standing(self) -> list[Standing]:
        """At each frequency; none before the first blocks are whole."""
        if self.going is None or self.going.periods < FEWEST_PERIODS:
            return []
        found = self.moments().educe(self.liner, self.frequency, **self.choices)
        samples, rate = found.choices["samples"], found.choices["sampling_rate"]
        rows = []
        for i, (f, z) in enumerate(zip(found.frequency.tolist(), found.answer.tolist(), strict=True)):
            low, high = found.bounds_of_liner(found.averaging, i) or (complex(math.nan), complex(math.nan))
            width = max(high.real - low.real, high.imag - low.imag) / 2
            needed = samples / rate * (width / self.until) ** 2 if self.until else math.nan
            rows.append(Standing(samples, samples / rate, f, z, width, needed))
        return rows

    def moments(self) -> Moments:
        """Of the whole blocks so far.

        Raises:
            ValueError: there are none.
        """
        if self.going is None:
            raise ValueError(f"{self.frames.path}: no samples have come")
        return self.going.moments()

    def run(
        self,
        tell: Callable[[list[Standing]], None],
        *,
        every: float,
        idle: float,
        sleep: Callable[[float], None] = time.sleep,
    ) -> bool:
        """Look every few seconds, until the interval is small enough or nothing has come for a while, both in s.

        Args:
            tell: called with each new standing.
        Returns:
            Whether the wished half-width was reached.
        Raises:
            OSError, ValueError: the last file could not be read for so long; as ``Frames.new``.
        """
        waited = 0.0
        while True:
            if self.update():
                waited = 0.0
                tell(rows := self.standing())
                if rows and self.until and all(row.half_width <= self.until for row in rows):
                    return True
            elif waited >= idle:
                if self.frames.error is not None:
                    raise self.frames.error
                return False
            sleep(every)
            waited += every

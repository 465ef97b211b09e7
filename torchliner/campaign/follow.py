"""A plane that is still being written: moments that grow with it, Z, its interval, and how long until that is small.

Sums are kept of whole periods; samples beyond the last whole one wait in memory. What is periodic with the tone is
known at the end of a record only, so that ``phase-locked`` averaging is not to be had before.
"""

import dataclasses
import math
import re
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import FEWEST_PERIODS, require_positive
from torchliner.engine.blocks import Blocks
from torchliner.engine.moments import Moments, ReducedVelocity
from torchliner.engine.sums import Held, Job, reduce
from torchliner.engine.survey import survey_of
from torchliner.io.planes import read_plane
from torchliner.io.whole_file import HDF5
from torchliner.liners.model import Liner, LinerModel
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.report.table import Row
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import SURVEY, reading_of

PIECE_VALUES = 1 << 24  # velocities that are read at once
MOST = 64  # blocks, then neighbours become one: memory does not grow
FIXED = {"drive": "instantaneous", "mean": "kept", "missing": "refuse"}


def _stated(plane: VelocityPlane, samples: int) -> VelocityPlane:
    """What is stated of a plane, with so many samples that are not there."""
    left = ReducedVelocity((*plane.probe_shape, samples), plane.velocity.dtype, plane.name)
    return dataclasses.replace(plane, velocity=left)


def _joined(job: Job, one: Tensor, other: Tensor) -> Tensor:
    """What a job finds in two neighbours as one block."""
    sums = one.shape[1] - job.largest
    return torch.cat([(one + other)[:, :sums], torch.maximum(one, other)[:, sums:]], 1)


class GrowingMoments:
    """Moments of a record that goes on: samples are added as they come, Z is educed at any moment.

    Args:
        plane: the first samples, (..., t), with all that is stated of the record.
        frequency, cell_pitch: as for ``moments``, of any liner.
        choices: as for ``moments``; ``averaging`` is ``admittance`` (the default here) or ``velocity``.
    Raises:
        ValueError: choices that need the whole record; samples that are nan or inf.
    """

    def __init__(
        self, plane: VelocityPlane, frequency: Any = None, *, cell_pitch: float | None = None, **choices: Any
    ) -> None:
        chosen = Choices(**{"averaging": "admittance"} | choices)
        for name, value in FIXED.items():
            if getattr(chosen, name) != value:
                raise ValueError(f"a record that goes on has {name} {value!r} alone; leave it out")
        if chosen.averaging == "phase-locked":
            raise ValueError("averaging 'phase-locked' needs the whole record; take 'admittance' or 'velocity'")
        lowest = float(plane.asked(frequency).min())
        self.period = plane.sampling_rate / (plane.frequency or lowest)  # samples
        self.each, self.borders = 1, [0]  # periods of a block; borders of all blocks
        several = math.ceil(5 * max(self.period, plane.sampling_rate / lowest))  # periods
        self._reading = reading_of(_stated(plane, several), [], frequency, chosen, cell_pitch=cell_pitch)
        self._jobs = self._reading.jobs()
        self._rows: list[list[Tensor]] = []  # of each block, what each job finds
        self._waiting = torch.empty(0, plane.probes, dtype=plane.velocity.dtype)
        self.update(plane.load().velocity)

    @property
    def periods(self) -> int:
        """Whole ones so far."""
        return self.each * len(self._rows)

    def update(self, samples: Any) -> None:
        """Add what comes next, v in m/s, (..., t), as the first samples."""
        v, shape = torch.as_tensor(samples, dtype=self._waiting.dtype), self._reading.plane.probe_shape
        if tuple(v.shape[:-1]) != shape:
            raise ValueError(f"samples have shape {tuple(v.shape)}; they are of probes {shape}, time last")
        new = v.movedim(-1, 0).reshape(v.shape[-1], self._waiting.shape[1])
        wrong = ~torch.isfinite(new.sum(0))
        if bool(wrong.any()):
            first = int(wrong.nonzero()[0])
            raise ValueError(f"{int(wrong.sum())} of {len(wrong)} probes hold nan or inf, the first is probe {first}")
        rows = torch.cat([self._waiting, new])
        while (size := round(len(self.borders) * self.each * self.period) - self.borders[-1]) <= len(rows):
            self._add(rows[:size].to(self._reading.device, self._reading.dtype))
            rows = rows[size:]
        self._waiting = rows.clone()

    def _add(self, samples: Tensor) -> None:
        """A block, (t, P); neighbours become one before there are ``MOST``."""
        each, begin, end = self.each, self.borders[-1], self.borders[-1] + len(samples)
        read = Held(lambda low, high: samples[low - begin : high - begin], end, samples.shape[1], samples.device)
        jobs, blocks = [*self._jobs.values()], Blocks((begin, end), self._reading.blocks.sampling_rate, each)
        rows, borders = [*self._rows, reduce(read, blocks, jobs)], [*self.borders, end]
        if len(rows) == MOST:
            pairs = zip(rows[::2], rows[1::2], strict=True)
            rows, borders, each = [[*map(_joined, jobs, *pair)] for pair in pairs], borders[::2], 2 * each
        self.each, self.borders, self._rows = each, borders, rows  # at once, whoever interrupts

    def moments(self) -> Moments:
        """Of the whole periods so far, a ValueError before the first; later samples leave them alone."""
        plane = self._reading.plane
        if not self.periods:
            raise ValueError(f"{plane.name} holds {len(self._waiting)} samples; a period has {self.period:g}")
        blocks = Blocks(tuple(self.borders), plane.sampling_rate, self.periods)
        reading = dataclasses.replace(self._reading, plane=_stated(plane, self.borders[-1]), blocks=blocks)
        found = dict(zip(self._jobs, map(torch.cat, zip(*self._rows, strict=True)), strict=True))
        return reading.moments(survey_of(found[SURVEY], blocks, reading.lines, reading.harmonics), None, found)

    def educe(self, liner: Liner, frequency: Any = None, **choices: Any) -> ImpedanceMap:
        """The map of the whole periods so far."""
        averaging = {"averaging": self._reading.chosen.averaging}
        found: ImpedanceMap = self.moments().educe(liner, frequency, **averaging | choices)
        return found


class Frames:
    """Samples of a plane that grows, or of a folder that fills with HDF5 files, which are joined as restarts are.

    Args:
        path: file or folder; of a folder the files are read in the order of their names, numbers as numbers.
        request: further arguments of ``read_plane``.
    """

    def __init__(self, path: Path, request: Mapping[str, Any] | None = None) -> None:
        self.path, self.request = path, dict(request or {})
        self.error: Exception | None = None  # of what somebody may still write
        self._done = 0

    def files(self) -> list[Path]:
        """As they are now; p9 before p10."""
        inside = [each for each in self.path.iterdir() if each.suffix.lower() in HDF5] if self.path.is_dir() else []
        order = {each: [int(p) if p.isdecimal() else p for p in re.split(r"(\d+)", each.name)] for each in inside}
        return sorted(inside, key=lambda each: order[each]) or [self.path]

    def new(self) -> Iterator[VelocityPlane]:
        """What has come since, piece by piece, with all that is stated of the plane. An OSError or a ValueError where
        a file cannot be read that others follow, or what was read before has become shorter."""
        files, self.error = self.files(), None
        try:
            plane = read_plane(files, lazy=True, **self.request)
        except (OSError, ValueError) as error:  # the last file is tried again
            self.error = error
            if len(files) < 2:
                return
            plane = read_plane(files[:-1], lazy=True, **self.request)
        if plane.samples < self._done:
            raise OSError(f"{plane.name} had {self._done} samples and has {plane.samples}; it was replaced")
        rows = max(1, PIECE_VALUES // plane.probes)
        for begin in range(self._done, plane.samples, rows):
            slab = plane.read(begin, min(begin + rows, plane.samples))
            self._done = begin + len(slab)
            yield dataclasses.replace(plane, velocity=slab.T.reshape(*plane.probe_shape, -1))


def follow(
    frames: Frames,
    liner: LinerModel,
    frequency: Any = None,
    *,
    every: float,
    idle: float,
    until: float | None = None,
    sleep: Callable[[float], None] = time.sleep,
    **choices: Any,
) -> Iterator[tuple[GrowingMoments, list[Row]]]:
    """What is known of a plane that grows, each time that samples have come.

    Args:
        frames: where the samples come from.  frequency: Hz; default the tone of the plane.
        every: s between two looks.  idle: s without samples after which it ends.
        until: half-width of the interval that ends it.  choices: of ``GrowingMoments``.
    Yields:
        The moments, which go on growing, and a row a frequency, none before the first blocks are whole: samples (of
        the whole blocks), duration (s), frequency (Hz), impedance (of the whole liner), half_width (of its interval,
        the wider of R and X; None with too few blocks), needed (duration at which that is as small as wished, s: it
        falls as 1/sqrt(duration)).
    Raises:
        ValueError: ``until`` is not above 0, or no interval is asked for that it could be held against.
        OSError, ValueError: the last file could not be read, or joined, for as long as ``idle``; as ``Frames.new``.
    """
    if until is not None:
        require_positive("until", until)
        if choices.get("interval", "") is None:
            raise ValueError(f"until is {until:g}, a half-width of the interval; leave out interval=None")
    growing, waited = None, 0.0
    while True:
        count = 0
        for piece in frames.new():
            if growing is None:
                growing = GrowingMoments(piece, frequency=frequency, cell_pitch=liner.cell_pitch, **choices)
                yield growing, []  # whoever is interrupted from here on has what there is
            else:
                growing.update(piece.velocity)
            count += piece.samples
        if growing is not None and count:
            waited, rows = 0.0, list[Row]()
            if growing.periods >= FEWEST_PERIODS:
                rows = _standing(growing.educe(liner, frequency, **choices), until)
            yield growing, rows
            if rows and until and all((row["half_width"] or math.inf) <= until for row in rows):
                return
        elif waited >= idle:
            if frames.error is not None:
                raise frames.error
            return
        sleep(every)
        waited += every


def _standing(found: ImpedanceMap, until: float | None) -> list[Row]:
    """A row a frequency, as ``follow`` says."""
    samples, rows = found.choices["samples"], list[Row]()
    duration = samples / found.choices["sampling_rate"]
    for i, (f, z) in enumerate(zip(found.frequency.tolist(), found.answer.tolist(), strict=True)):
        row = {"samples": samples, "duration": duration, "frequency": f, "impedance": z, "half_width": None}
        if (bounds := found.bounds_of_liner(found.averaging, i)) is not None:
            width = bounds[1] - bounds[0]
            row["half_width"] = max(width.real, width.imag) / 2
        known = until and row["half_width"]
        rows.append(row | {"needed": duration * (row["half_width"] / until) ** 2 if known else None})
    return rows

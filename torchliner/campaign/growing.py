"""Moments of a record that goes on: samples are added as they come, Z is educed at any moment."""

from __future__ import annotations

import dataclasses
from typing import Any

import torch
from torch import Tensor

from torchliner.engine.blocks import Blocks
from torchliner.engine.moments import Moments, ReducedVelocity, without_velocity
from torchliner.engine.nodes import ANY_LINER, Nodes, choose_nodes
from torchliner.engine.sums import Held, reduce
from torchliner.liners.model import Liner, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import Reading
from torchliner.velocity.review import refuse_beyond_table

MOST = 64  # blocks, then neighbours become one: memory does not grow
FIXED = {"drive": "instantaneous", "mean": "kept", "missing": "refuse"}


class GrowingMoments:
    """Sums over whole periods; samples beyond the last whole one wait in memory.

    Args:
        plane: the first samples, (..., t), with all that is stated of the record.
        liner, frequency, cell_pitch: as for ``moments``.
        choices: as for ``moments``; ``averaging`` is ``admittance`` (the default here) or ``velocity``: what is
            periodic with the tone is known at the end of a record only.
    Raises:
        ValueError: choices that need the whole record; samples that are nan or inf.
    """

    def __init__(
        self,
        plane: VelocityPlane,
        liner: Liner | None = None,
        frequency: Any = None,
        *,
        cell_pitch: float | None = None,
        **choices: Any,
    ) -> None:
        chosen = Choices(**{"averaging": "admittance"} | choices)
        for name, value in FIXED.items():
            if getattr(chosen, name) != value:
                raise ValueError(f"a record that goes on has {name} {value!r} alone; leave it out")
        if chosen.averaging == "phase-locked":
            raise ValueError("averaging 'phase-locked' needs the whole record; take 'admittance' or 'velocity'")
        model = None if liner is None else as_liner(liner)
        asked = plane.asked(frequency)
        nodes: Nodes = ANY_LINER
        if model is not None:
            nodes = choose_nodes([model], asked, chosen.tolerance(plane.velocity.dtype))
        pitch = cell_pitch if model is None else model.cell_pitch
        self.period = plane.sampling_rate / (plane.frequency or float(asked.min()))  # samples
        self.each, self.borders = 1, [0]  # periods of a block; borders of all blocks
        self._about = without_velocity(plane)
        self._reading = Reading.of(self._plane(round(4 * self.period)), chosen, asked, nodes, pitch)
        self._jobs = self._reading.first_jobs()
        self._rows: dict[str, Tensor] = {}
        self._waiting = torch.empty(0, plane.probes, dtype=plane.velocity.dtype)
        self.update(plane.load().velocity)

    @property
    def periods(self) -> int:
        """Whole ones so far."""
        return self.each * (len(self.borders) - 1)

    def update(self, samples: Any) -> None:
        """Add what comes next, v in m/s, (..., t), as the first samples."""
        v = torch.as_tensor(samples, dtype=self._about.velocity.dtype)
        if tuple(v.shape[:-1]) != (shape := self._about.probe_shape):
            raise ValueError(f"samples have shape {tuple(v.shape)}; they are of probes {shape}, time last")
        new = v.movedim(-1, 0).reshape(v.shape[-1], self._about.probes)
        wrong = ~torch.isfinite(new.sum(0))
        if bool(wrong.any()):
            raise ValueError(
                f"{int(wrong.sum())} of {len(wrong)} probes hold nan or inf among the new samples, the first is probe "
                f"{int(wrong.nonzero()[0])}; nothing of them was added: repair them"
            )
        done, rows = self.borders[-1], torch.cat([self._waiting, new])
        while True:
            count = len(self.borders)
            ahead = (round((count + i) * self.each * self.period) for i in range(MOST + 1 - count))
            borders = [self.borders[-1], *(border for border in ahead if border <= done + len(rows))]
            if len(borders) == 1:
                break
            self._add(rows, done, borders)
            if len(self.borders) > MOST:  # neighbours become one block
                for name, sums in self._rows.items():
                    found, later = sums.unflatten(0, (-1, 2)).unbind(1)
                    self._jobs[name].join(found, later)
                    self._rows[name] = found.clone()
                self.each, self.borders = 2 * self.each, self.borders[::2]
        self._waiting = rows[self.borders[-1] - done :].clone()

    def _add(self, rows: Tensor, first: int, borders: list[int]) -> None:
        """Blocks between borders, of rows that begin with sample ``first``."""
        reading = self._reading
        dtype = reading.chosen.working_dtype(rows.dtype)

        def read(begin: int, end: int) -> Tensor:
            return rows[begin - first : end - first].to(reading.device, dtype)

        blocks = Blocks(tuple(borders), reading.plane.sampling_rate, self.each * (len(borders) - 1))
        record = Held(read, borders[-1], rows.shape[1], reading.device)
        found = reduce(record, blocks, list(self._jobs.values()))
        for name, new in zip(self._jobs, found, strict=True):
            self._rows[name] = torch.cat([self._rows[name], new]) if name in self._rows else new
        self.borders += borders[1:]

    def _plane(self, samples: int) -> VelocityPlane:
        about = self._about
        left = ReducedVelocity((*about.probe_shape, samples), about.velocity.dtype, about.name)
        return dataclasses.replace(about, velocity=left)

    def moments(self) -> Moments:
        """Of the whole periods so far; later samples leave them alone.

        Raises:
            ValueError: not one period is whole; |v| beyond the liner's table.
        """
        if not self.periods:
            raise ValueError(
                f"{self._about.name} holds {len(self._waiting)} samples so far; a period has {self.period:g}"
            )
        blocks = Blocks(tuple(self.borders), self._about.sampling_rate, self.periods)
        reading = dataclasses.replace(self._reading, plane=self._plane(self.borders[-1]), blocks=blocks)
        known = reading.moments(reading.survey(self._rows), None, self._rows)
        refuse_beyond_table(known.plane, known)
        return known

    def educe(self, liner: Liner, frequency: Any = None, **choices: Any) -> ImpedanceMap:
        """The map of the whole periods so far."""
        averaging = {"averaging": self._reading.chosen.averaging}
        found: ImpedanceMap = self.moments().educe(liner, frequency, **averaging | choices)
        return found

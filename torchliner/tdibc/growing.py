"""Moments of a record that goes on: samples are added as they come, Z is educed at any moment."""

from __future__ import annotations

import dataclasses
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_positive, stated_frequency
from torchliner.liners.model import Liner, as_liner
from torchliner.names import ORDERS
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.cells import sort_into_cells
from torchliner.reduction.basis import ANY_LINER, Basis, Chebyshev, choose_basis
from torchliner.reduction.line_means import lines_needed
from torchliner.reduction.moments import SETTINGS, Moments, PlaneSums, ReducedVelocity
from torchliner.reduction.parts import PartVelocity
from torchliner.reduction.plan import ENDLESS, PassPlan
from torchliner.reduction.probe_velocity import ProbeVelocity
from torchliner.reduction.readings import Wanted, first_of, first_pass, running_sums
from torchliner.reduction.speed_sums import GroupMoments, SpeedSums
from torchliner.replay.phase_rule import phase_rule
from torchliner.signals.blocks import MOST_BLOCKS, Blocks
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.requested import AnyLiner, without_velocity


class GrowingMoments:
    """Sums over whole blocks of periods; samples beyond the last whole one wait in memory.

    When there are ``MOST_BLOCKS`` of them, neighbours become one: the memory does not grow.

    Args:
        plane: the first samples, (..., t), with all that is stated of the record.
        liner, frequency, cell_pitch: as for ``moments``.
        periods: of the tone in a block.
        choices: as for ``moments``; ``order`` is ``probes first`` (the default here) or ``velocity
            first``, since what is coherent with the tone is known at the end of a record alone.
    Raises:
        ValueError: choices that need the whole record; samples that are nan or inf.
    """

    def __init__(
        self, plane: VelocityPlane, liner: Liner | None = None, frequency: Any = None, *,
        periods: int = 1, cell_pitch: float | None = None, **choices: Any,
    ) -> None:  # fmt: skip
        chosen = Choices(**{"order": ORDERS[0]} | choices)
        kept = {"drive": "instantaneous", "mean": "kept", "pre_roll": 0.0, "engine": "spectral"}
        for name, value in kept.items():
            if getattr(chosen, name) != value:
                raise ValueError(f"a record that goes on has {name} {value!r} alone; leave it out")
        if chosen.order == ORDERS[2] or not chosen.whole_periods:
            raise ValueError(
                f"order {ORDERS[2]!r} and windows need the whole record; take order={ORDERS[0]!r} "
                f"or {ORDERS[1]!r}, and leave window out"
            )
        require_positive("periods", periods)
        model = AnyLiner(cell_pitch) if liner is None else as_liner(liner)
        asked = stated_frequency(frequency, plane.frequency, plane.name, plane.sampling_rate)
        basis: Basis = Chebyshev(*ANY_LINER)
        if liner is not None:
            basis = choose_basis([model], asked, chosen.model_tolerance(plane.velocity.dtype))
        rule = phase_rule(chosen.phase)
        self.unit = periods * plane.sampling_rate / (plane.frequency or float(asked.min()))
        self.periods = periods
        self.done, self.units, self.level = 0, 0, 0  # samples, blocks of ``periods``, halvings
        self._lines = lines_needed([(0.0, 1.0)], rule.turns(asked))
        plan = dataclasses.replace(self._plan(plane.sampling_rate), samples=ENDLESS)
        wanted = Wanted(
            plan, asked, torch.ones(1, dtype=torch.float64), basis, plane.frequency,
            keeps_blocks=chosen.interval is not None, velocity_blocks=rule.needs_velocity,
        )  # fmt: skip
        cells = sort_into_cells(plane, model.cell_pitch)
        device, dtype = torch.device("cpu"), chosen.working_dtype(plane.velocity.dtype)
        self._velocity = ProbeVelocity(plane, cells, dtype, device, memory=chosen.slab_memory)
        self._surveys, self._sums = running_sums(self._velocity, wanted, part=True)
        slots = range(MOST_BLOCKS + 1)  # the last one for the block that is not full yet
        self._sums = [
            SpeedSums(each.plan, basis, each.width, dtype, device, wanted.keeps_blocks, slots) for each in self._sums
        ]
        self._wanted, self._cells, self._pitch = wanted, cells, model.cell_pitch
        self._settings = {name: getattr(chosen, name) for name in SETTINGS}
        self._about = without_velocity(plane)
        self._waiting = torch.empty(0, plane.probes, dtype=plane.velocity.dtype)
        self.update(plane.load().velocity)

    def update(self, samples: Any) -> None:
        """Add what comes next, v in m/s, (..., t), as the first samples."""
        v = torch.as_tensor(samples, dtype=self._about.velocity.dtype)
        shape = self._about.probe_shape
        if tuple(v.shape[:-1]) != shape:
            raise ValueError(f"samples have shape {tuple(v.shape)}; they are of probes {shape}, time last")
        new = v.movedim(-1, 0).reshape(v.shape[-1], self._about.probes)
        wrong = ~torch.isfinite(new.sum(0))
        if bool(wrong.any()):
            raise ValueError(
                f"{int(wrong.sum())} of {len(wrong)} probes hold nan or inf among the new samples, "
                f"the first is probe {int(wrong.nonzero()[0])}; nothing of them was added: repair "
                "them"
            )
        if len(self._waiting):  # as few rows as complete a block are copied
            needed = self._border(self.units + 1) - self.done - len(self._waiting)
            joint, new = torch.cat([self._waiting, new[:needed]]), new[needed:]
            joint = self._add_blocks(joint)
            if len(joint):
                self._waiting = joint
                return
        self._waiting = self._add_blocks(new).clone()

    def _add_blocks(self, rows: Tensor) -> Tensor:
        """All whole ones; what is left."""
        while True:
            most = MOST_BLOCKS << self.level  # then neighbours become one
            units = min(most, int((self.done + len(rows) + 0.5) / self.unit))
            while self._border(units) > self.done + len(rows):
                units -= 1
            if units <= self.units:
                return rows
            end = self._border(units)
            count = end - self.done
            self._add(rows[:count], end, units)
            rows = rows[count:]

    def _border(self, units: int) -> int:
        return round(units * self.unit)

    def _plan(self, rate: float) -> PassPlan:
        each = 1 << self.level
        borders = tuple(self._border(i * each) for i in range(self.units // each + 1))
        blocks = Blocks(borders, each * self.periods)
        return PassPlan(self.done, rate, 0, self.done, blocks, self._lines)

    def _add(self, rows: Tensor, end: int, units: int) -> None:
        """Samples up to the border of a block."""
        first, self.done, self.units = self.done, end, units
        plan = self._plan(self._about.sampling_rate)
        for sums in self._sums:
            sums.plan = plan
        for survey in self._surveys:
            survey.plan = plan
        part = dataclasses.replace(self._about, velocity=rows.T, x=None, z=None)
        velocity = self._velocity
        velocity.plane = dataclasses.replace(part, velocity=PartVelocity(part, first, end))
        velocity.samples, velocity.span = end, (first, end)
        first_pass(velocity, self._surveys, self._sums, None)
        if units == MOST_BLOCKS << self.level:
            self._halve()

    def _halve(self) -> None:
        self.level += 1
        for survey in self._surveys:
            survey.halved()
        for sums in self._sums:
            if sums.of_blocks is not None:
                pairs = sums.of_blocks[:MOST_BLOCKS].unflatten(0, (-1, 2)).sum(1)
                sums.of_blocks.zero_()[: len(pairs)] = pairs

    def moments(self, *, keep: bool = True) -> Moments:
        """Of the whole blocks so far.

        Args:
            keep: a copy, that later samples leave alone.
        Raises:
            ValueError: not one block is whole.
        """
        if not self.units:
            raise ValueError(
                f"{self._about.name} holds {len(self._waiting)} samples so far; a block of "
                f"{self.periods} periods has {self.unit:g}"
            )
        plan = self._plan(self._about.sampling_rate)
        wanted = dataclasses.replace(self._wanted, plan=plan)
        used = torch.ones(self._about.probes, dtype=torch.bool)
        surveys = [survey.so_far(plan) for survey in self._surveys]
        seen = first_of(surveys, [], wanted, self._cells, used).survey
        groups = []
        for sums in self._sums:
            own = None if sums.of_blocks is None else sums.of_blocks[: plan.rest + 1]
            group = GroupMoments(sums.totals, own)
            if keep:
                group = GroupMoments(sums.totals.clone(), None if own is None else own.clone())
            groups.append(group)
        about = self._about
        left = ReducedVelocity((*about.probe_shape, plan.samples), about.velocity.dtype, about.name)
        sums_so_far = PlaneSums(plan, wanted.tones, seen, self._cells, used, None, wanted.basis, tuple(groups))
        plane = dataclasses.replace(about, velocity=left)
        return Moments(plane, sums_so_far, self._settings, self._pitch)

    def educe(self, liner: Liner, frequency: Any = None, **choices: Any) -> ImpedanceMap:
        """The map of the whole blocks so far."""
        order = {"order": self._settings["order"]}
        found: ImpedanceMap = self.moments(keep=False).educe(liner, frequency, **order | choices)
        return found

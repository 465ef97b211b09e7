"""A plane that is read for many answers: its moments, and those of other |v|, which share one more reading."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import cast

import torch
from torch import Tensor

from torchliner.engine.blocks import Blocks
from torchliner.engine.membership import Membership
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import Nodes
from torchliner.engine.sums import Job, Record, reduce
from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane
from torchliner.records.boxes import Windows
from torchliner.velocity.averages import Asked, Averages, average
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import SURVEY, Progress, Reading, reading_of, take_moments


@dataclass(frozen=True, eq=False)
class Further:
    """Another |v| of a plane.

    Args:
        chosen: its drive, mean and averaging.
        windows: over which v is averaged in place of the cells, averaging ``velocity``; None for the cells.
    """

    chosen: Choices
    windows: Windows | None = None


class Source:
    """A plane with its moments, which may be read again.

    Args:
        plane: wall-normal velocity.
        liner: whose cells are averaged over.
        frequency: Hz, (F,).
        nodes: that serve all liners that will be asked for.
        chosen: of the moments.
        more_turns: Hz, of waves that the sums are weighed with beside those of the phase rule.
        progress: called with numbers of samples read.
    Raises:
        ValueError: as ``educe``.
    """

    def __init__(
        self,
        plane: VelocityPlane,
        liner: LinerModel,
        frequency: Tensor,
        nodes: Nodes,
        chosen: Choices,
        *,
        more_turns: Iterable[float] = (),
        progress: Progress | None = None,
    ) -> None:
        self.nodes, self.progress, self.readings = nodes, progress, 0
        reading = reading_of(plane, [], frequency, chosen, cell_pitch=liner.cell_pitch, nodes=nodes)
        turns = torch.cat([reading.turns, torch.tensor([*more_turns], dtype=torch.float64)])
        self.reading = dataclasses.replace(reading, turns=turns)
        self.known = known = take_moments(self.reading, self._reduce, progress)
        if not bool(known.used.all()):
            self.reading = self.reading.without(~known.used)

    def _reduce(
        self, record: Record, blocks: Blocks, jobs: Sequence[Job], only: Iterable[int] | None = None
    ) -> list[Tensor]:
        self.readings += 1
        return reduce(record, blocks, jobs, only)

    def others(self, wanted: Sequence[Further]) -> list[Moments]:
        """Moments of each, in one reading."""
        ways = [self._way(each) for each in wanted]
        jobs = [job for _, each in ways for job in each.values()]
        record, blocks = self.reading.record(self.progress), self.reading.blocks
        found = iter(self._reduce(record, blocks, jobs) if jobs else [])
        return [
            self._moments(each, reading, dict(zip(own, found, strict=False)))
            for each, (reading, own) in zip(wanted, ways, strict=True)
        ]

    def _way(self, further: Further) -> tuple[Reading, dict[str, Job]]:
        """How it is read, and what is summed."""
        frequency = self.reading.frequency
        chosen = further.chosen
        reading = dataclasses.replace(
            self.reading,
            chosen=chosen,
            nodes=None if chosen.drive == "rms" else self.nodes,
            turns=frequency[:0] if chosen.phase == "averaged" else 2 * frequency,
        )
        if further.windows is not None:
            # They have the means and sums of a Membership, which is all that averaging ``velocity`` asks for.
            reading = dataclasses.replace(reading, membership=cast(Membership, further.windows))
        locked = self.known.locked if "phase-locked" in chosen.averagings else None
        jobs = reading.first_jobs() | reading.second_jobs(self.known.survey, locked)
        left_out = {SURVEY, *(["square of cells"] if chosen.drive != "rms" else [])}
        left_out |= set() if further.windows is None else {"admittance"}
        return reading, {name: job for name, job in jobs.items() if name not in left_out}

    def _moments(self, further: Further, reading: Reading, found: dict[str, Tensor]) -> Moments:
        locked = self.known.locked if "phase-locked" in reading.chosen.averagings else None
        made = reading.moments(self.known.survey, locked, found)
        if further.windows is not None:
            made = dataclasses.replace(made, cells=dataclasses.replace(made.cells, weight=None))
        return made


def average_of(
    known: Moments, liner: LinerModel, frequency: Tensor, chosen: Choices, averaging: str, psi: float | None = None
) -> Averages:
    """R under one averaging; with phase ``given`` psi (rad) is that of the sound at all probes."""
    phase = None if psi is None else torch.full((known.plane.probes, 1), psi, dtype=torch.float64)
    with torch.no_grad():
        return average(known, Asked.of(known, liner, frequency, chosen, phase), averaging)

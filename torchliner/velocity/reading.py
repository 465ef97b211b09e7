"""How a plane is read: which sums the one loop makes of it, in one reading or, for phase-locked averaging, in two."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.engine.blocks import Blocks
from torchliner.engine.drives import CellMean, LessMean, PhaseLocked, RunningRms, as_measured, phase_locked
from torchliner.engine.membership import Membership
from torchliner.engine.moments import SETTINGS, Moments, without_velocity
from torchliner.engine.nodes import Nodes
from torchliner.engine.plane_record import PlaneRecord
from torchliner.engine.sums import Drive, Job, ones, reduce, square, wave_rows
from torchliner.engine.survey import Survey, harmonics_of, merged_lines, survey_jobs, survey_of
from torchliner.engine.workers import Reduce
from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells, sort_into_cells
from torchliner.velocity.choices import Choices

Progress = Callable[[int], object]


@dataclass(frozen=True, eq=False)
class Reading:
    """What is asked of a record, and all that follows from it without a look at the data.

    Args:
        plane: the record.
        chosen: all choices.
        frequency: asked for, Hz, (F,), on the host.
        nodes: whose functions of |v| are summed; None with drive ``rms``, which needs none.
        cell_pitch: L_c of the liner, m, or None.
        cells: that hold probes.
        used: probes that count, (P,), on the host.
        blocks: of the record.
        harmonics: H, of the tone of the data.
        lines: Hz, the harmonics and then other frequencies asked for, (L,), on the host.
        turns: Hz, beside 1 the sums are weighed with the waves of these, (Q,): 2 f for a phase rule that needs it.
        device: of the work.
        projection: of the K sums of each block, see ``engine.sums.Job``.
    """

    plane: VelocityPlane
    chosen: Choices
    frequency: Tensor
    nodes: Nodes | None
    cell_pitch: float | None
    cells: Cells
    used: Tensor
    blocks: Blocks
    harmonics: int
    lines: Tensor
    turns: Tensor
    device: torch.device
    projection: Tensor | None = None

    @classmethod
    def of(
        cls,
        plane: VelocityPlane,
        chosen: Choices,
        frequency: Tensor,
        nodes: Nodes | None,
        cell_pitch: float | None,
        projection: Tensor | None = None,
    ) -> Reading:
        """From what was asked for; ``frequency`` in Hz, (F,)."""
        rate = plane.sampling_rate
        alone = float(frequency[0]) if len(frequency) == 1 else None
        harmonics = harmonics_of(plane.frequency or alone, rate)
        lines = torch.tensor(merged_lines(harmonics, frequency.tolist()), dtype=torch.float64)
        blocks = Blocks.of(plane.samples, rate, plane.frequency or float(frequency.min()))
        turns = frequency[:0] if chosen.phase == "averaged" else 2 * frequency
        cells = sort_into_cells(plane, cell_pitch)
        used = torch.ones(plane.probes, dtype=torch.bool)
        velocity = plane.velocity
        device = chosen.working_device(velocity.device if isinstance(velocity, Tensor) else torch.device("cpu"))
        projection = None if projection is None else projection.to(device)
        count = len(harmonics)
        return cls(
            plane, chosen, frequency, nodes, cell_pitch, cells, used, blocks, count, lines, turns, device, projection
        )

    def record(self, progress: Progress | None = None) -> PlaneRecord:
        """What the loop reads."""
        excluded = None if bool(self.used.all()) else ~self.used.to(self.device)
        dtype = self.chosen.working_dtype(self.plane.velocity.dtype)
        return PlaneRecord(self.plane, dtype, self.device, excluded, progress)

    def membership(self) -> Membership:
        """Probes by cell, on the device."""
        return Membership.of(self.cells.labels, self.cells.count, self.device)

    def without(self, faulty: Tensor) -> Reading:
        """The same without some probes, bool, (P,), on the host."""
        used = self.used & ~faulty
        return dataclasses.replace(self, used=used, cells=self.cells.kept(used))

    def first_jobs(self, cells: Membership) -> dict[str, Job]:
        """Of the first reading: survey, and the sums of every averaging that needs no survey."""
        lines, rate = self.lines.to(self.device), self.plane.sampling_rate
        jobs = dict(zip(SURVEY, survey_jobs(as_measured, lines, rate), strict=True))
        if self.projection is None:  # of a record that is kept, or of drive ``rms``
            jobs["square of cells"] = Job(CellMean(cells), ones(self.device), square)
        if self.nodes is not None and self.chosen.mean == "kept":
            jobs |= {name: self._moments(drive) for name, drive in _plain(cells).items()}
        return jobs

    def survey(self, found: dict[str, Tensor]) -> Survey:
        """From the results of ``first_jobs``, of all blocks."""
        return survey_of([found[name] for name in SURVEY], self.blocks, self.lines, self.harmonics)

    def second_jobs(self, seen: Survey, cells: Membership, locked: PhaseLocked | None) -> dict[str, Job]:
        """Of the second reading; none where the first one was enough."""
        if self.nodes is None:
            return {}
        drives: dict[str, Drive] = {}
        if self.chosen.mean == "removed":
            means = {"admittance": seen.mean, "velocity": cells.mean(seen.mean)}
            drives = {name: LessMean(drive, means[name]) for name, drive in _plain(cells).items()}
        if locked is not None:
            star: Drive = locked
            if self.chosen.mean == "removed":
                star = LessMean(star, locked.survey(seen).mean)
            drives["phase-locked"] = star
        return {name: self._moments(drive) for name, drive in drives.items()}

    def locked(self, seen: Survey, cells: Membership) -> PhaseLocked | None:
        """The drive of phase-locked averaging, if that is asked for."""
        if "phase-locked" not in self.chosen.averagings:
            return None
        return phase_locked(seen, cells, self.chosen.background_rms)

    def moments(self, seen: Survey, locked: PhaseLocked | None, found: dict[str, Tensor]) -> Moments:
        """The record of what the readings found."""
        return Moments(
            plane=without_velocity(self.plane),
            settings={name: getattr(self.chosen, name) for name in SETTINGS},
            cell_pitch=self.cell_pitch,
            cells=self.cells,
            used=self.used,
            survey=seen,
            locked=locked,
            nodes=self.nodes,
            turns=self.turns,
            sums={name: value for name, value in found.items() if name not in SURVEY},
            projected=None if self.projection is None else self.frequency,
        )

    def _moments(self, drive: Drive) -> Job:
        assert self.nodes is not None
        reach, device = 0, self.device
        if self.chosen.drive == "running-rms":
            assert self.chosen.running_window is not None
            window = max(1, round(self.chosen.running_window * self.plane.sampling_rate))
            drive = RunningRms(drive, window, self.plane.samples)
            reach = drive.reach
        rows = wave_rows(self.turns.to(device), self.plane.sampling_rate) if len(self.turns) else ones(device)
        return Job(drive, rows, self.nodes.sums, reach, projection=self.projection)


SURVEY = ("lines", "square", "largest")


def _plain(cells: Membership) -> dict[str, Drive]:
    """The averagings that need no survey."""
    return {"admittance": as_measured, "velocity": CellMean(cells)}


def measure(reading: Reading, run: Reduce = reduce, progress: Progress | None = None) -> Moments:
    """Read a plane once, and once more where an averaging needs to know the whole record first.

    Args:
        reading: what is asked.
        run: the loop; of ``engine.workers`` where others do it.
        progress: called with numbers of samples read.
    Raises:
        ValueError: ``missing`` is ``exclude``, and no probe is without nan or inf.
    """
    first, cells = _read(reading, reading.first_jobs, run, progress)
    if reading.chosen.missing == "exclude":
        faulty = faulty_probes(first["square"]).cpu()
        if bool(faulty.any()):
            if bool(faulty.all()):
                raise ValueError(f"{reading.plane.name}: every probe holds nan or inf; there is nothing left to educe")
            reading = reading.without(faulty)
            first, cells = _read(reading, reading.first_jobs, run, progress)
    seen = reading.survey(first)
    locked = reading.locked(seen, cells)
    jobs = reading.second_jobs(seen, cells, locked)
    second = _run(jobs, reading, run, progress) if jobs else {}
    known = reading.moments(seen, locked, first | second)
    vars(known)["membership"] = cells  # its cached property, not to be uploaded again
    return known


def _read(
    reading: Reading, jobs: Callable[[Membership], dict[str, Job]], run: Reduce, progress: Progress | None
) -> tuple[dict[str, Tensor], Membership]:
    cells = reading.membership()
    return _run(jobs(cells), reading, run, progress), cells


def _run(jobs: dict[str, Job], reading: Reading, run: Reduce, progress: Progress | None) -> dict[str, Tensor]:
    found = run(reading.record(progress), reading.blocks, list(jobs.values()), None)
    return dict(zip(jobs, found, strict=True))


def faulty_probes(squares: Tensor) -> Tensor:
    """Probes whose samples are not all finite, bool, (P,), from the sums of v^2, (S, 1, 1, P)."""
    return ~torch.isfinite(squares.sum((0, 1, 2)))


def first_fault(plane: VelocityPlane, blocks: Blocks, probe: int) -> int:
    """The first sample that is nan or inf, of a probe that has one."""
    for batch in blocks.batches(1 << 14):
        begin, end = batch[0].begin, batch[-1].end
        wrong = ~torch.isfinite(plane.read(begin, end)[:, probe])
        if bool(wrong.any()):
            return begin + int(wrong.int().argmax())
    raise ValueError(f"{plane.name}: sums of v^2 at probe {probe} are beyond the range of numbers; check the unit")

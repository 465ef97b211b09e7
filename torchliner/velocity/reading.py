"""How a plane is read: which sums the one loop makes of it, in one reading or, for phase-locked averaging, in two."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.engine.blocks import MOST_BLOCKS, Blocks
from torchliner.engine.drives import Drive, phase_locked, survey_of_locked
from torchliner.engine.intervals import FEWEST_BLOCKS
from torchliner.engine.moments import SETTINGS, Layout, Moments, without_velocity
from torchliner.engine.nodes import ANY_LINER, Chebyshev, Levels, Nodes, OfOneLiner, choose_nodes, response
from torchliner.engine.sums import Job, PlaneRecord, is_differentiated, linear, reduce, square
from torchliner.engine.survey import Membership, Survey, harmonics_of, merged_lines, survey_of, survey_sums
from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane
from torchliner.records.cells import sort_into_cells
from torchliner.records.origin import state_of
from torchliner.velocity import review
from torchliner.velocity.background import with_background
from torchliner.velocity.choices import Choices
from torchliner.velocity.workers import Reduce

Progress = Callable[[int], object]
SURVEY = "survey"
MOST_OF_LINES = 1 << 28  # bytes of the lines of v at all frequencies asked for; beyond, those of the tone alone
MOST_OF_SUMS = 1 << 30  # bytes of all sums; of very many probes there are fewer blocks


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Reading(Layout):
    """What is asked of a record, and all that follows from it without a look at the data.

    Args:
        chosen: all choices.
        frequency: asked for, Hz, (F,), on the host.
        blocks: of the record.
        harmonics: H, of the tone of the data.
        lines: Hz, the harmonics and then other frequencies asked for, (L,), on the host.
        device: of the work.
    """

    chosen: Choices
    frequency: Tensor
    blocks: Blocks
    harmonics: int
    lines: Tensor
    device: torch.device

    @classmethod
    def of(
        cls,
        plane: VelocityPlane,
        chosen: Choices,
        frequency: Tensor,
        nodes: Nodes | None,
        cell_pitch: float | None,
    ) -> Reading:
        """From what was asked for; ``frequency`` in Hz, (F,)."""
        rate, probes, cells = plane.sampling_rate, plane.probes, sort_into_cells(plane, cell_pitch)
        alone = float(frequency[0]) if len(frequency) == 1 else None
        harmonics = harmonics_of(plane.frequency or alone, rate)
        asked = merged_lines(harmonics, frequency.tolist())
        size = 8 * MOST_BLOCKS * (1 + 2 * len(asked)) * probes
        if size > MOST_OF_LINES and chosen.wall_filter is None and chosen.phase != "self-consistent":
            asked = harmonics
        turns = frequency[:0] if chosen.phase == "averaged" else 2 * frequency
        columns = (1 + ("phase-locked" in chosen.averagings)) * probes + cells.count
        of_nodes = 0 if nodes is None else nodes.count * (1 + 2 * len(turns)) * columns
        most = MOST_OF_SUMS // (8 * ((1 + 2 * len(asked)) * probes + of_nodes))
        tone, most = plane.frequency or float(frequency.min()), min(MOST_BLOCKS, max(FEWEST_BLOCKS, most))
        device = chosen.working_device(plane.device)
        return cls(
            plane=plane,
            chosen=chosen,
            frequency=frequency,
            nodes=nodes,
            cell_pitch=cell_pitch,
            cells=cells,
            membership=Membership.of(cells.labels, cells.count, device),
            used=torch.ones(probes, dtype=torch.bool),
            blocks=Blocks.of(plane.samples, rate, tone, most),
            harmonics=len(harmonics),
            lines=torch.tensor(asked, dtype=torch.float64),
            turns=turns,
            device=device,
        )

    def record(self, progress: Progress | None = None) -> PlaneRecord:
        """What the loop reads."""
        excluded = None if bool(self.used.all()) else ~self.used.to(self.device)
        dtype = self.chosen.working_dtype(self.plane.velocity.dtype)
        return PlaneRecord(self.plane, dtype, self.device, excluded, progress)

    def without(self, faulty: Tensor) -> Reading:
        """The same without some probes, bool, (P,), on the host."""
        used = self.used & ~faulty
        cells = self.cells.kept(used)
        membership = Membership.of(cells.labels, cells.count, self.device)
        return dataclasses.replace(self, used=used, cells=cells, membership=membership)

    def first_jobs(self) -> dict[str, Job]:
        """Of the first reading: survey, and the sums of every averaging that needs no survey."""
        cells = self.membership
        jobs = {SURVEY: Job(Drive(), survey_sums, self.lines.to(self.device), largest=1)}
        if not isinstance(self.nodes, OfOneLiner):  # of a record that is kept, or of drive ``rms``
            jobs["square of cells"] = Job(Drive(cells), square)
        drives = {"admittance": Drive(), "velocity": Drive(cells)}
        return jobs | (self._moments(drives) if self.chosen.mean == "kept" else {})

    def second_jobs(self, seen: Survey, locked: Drive | None) -> dict[str, Job]:
        """Of the second reading; none where the first one was enough."""
        removed, drives = self.chosen.mean == "removed", dict[str, Drive]()
        if removed:
            cells = self.membership
            drives = {"admittance": Drive().less(seen.mean), "velocity": Drive(cells).less(cells.mean(seen.mean))}
        if locked is not None:
            drives["phase-locked"] = locked.less(survey_of_locked(locked, seen).mean) if removed else locked
        return self._moments(drives)

    def _moments(self, drives: dict[str, Drive]) -> dict[str, Job]:
        if self.nodes is None:
            return {}
        window, lines = self.chosen.window(self.frequency), self.turns.to(self.device) if len(self.turns) else None
        if window is not None:
            steps, samples = max(1, round(window * self.plane.sampling_rate)), self.plane.samples
            drives = {name: dataclasses.replace(each, window=steps, samples=samples) for name, each in drives.items()}
        return {name: Job(drive, self.nodes.sums, lines, drive.reach) for name, drive in drives.items()}

    def survey(self, found: dict[str, Tensor]) -> Survey:
        """From the results of ``first_jobs``, of all blocks."""
        return survey_of(found[SURVEY], self.blocks, self.lines, self.harmonics)

    def moments(self, seen: Survey, locked: Drive | None, found: dict[str, Tensor]) -> Moments:
        """The record of what the readings found."""
        stated = self.chosen.describe()
        layout = {each.name: getattr(self, each.name) for each in dataclasses.fields(Layout)}
        return Moments(
            **layout | {"plane": without_velocity(self.plane)},
            settings={name: stated[name] for name in SETTINGS} | {"running_window": self.chosen.window(self.frequency)},
            survey=seen,
            locked=locked,
            sums={name: value for name, value in found.items() if name != SURVEY},
        )

    def with_drive(self, known: Moments, locked: Drive) -> Moments:
        """Moments of the same reading with another phase-locked drive, for which the plane is read once more."""
        reading = self if bool(known.used.all()) else self.without(~known.used)
        jobs = reading.second_jobs(known.survey, locked)
        sums = run_jobs({"phase-locked": jobs["phase-locked"]} if jobs else {}, reading)
        return dataclasses.replace(known, locked=locked, sums={**known.sums, **sums})


def reading_of(
    plane: VelocityPlane,
    liners: Sequence[LinerModel],
    frequency: Any,
    chosen: Choices,
    *,
    cell_pitch: float | None = None,
    nodes: Chebyshev | Levels | None = None,
    projected: bool = False,
) -> Reading:
    """How a plane is read for liners of one pitch, with the warnings that need no sample.

    Args:
        liners: for which nodes are chosen; none: for any liner, in cells of ``cell_pitch``, m.
        nodes: default those that suit the liners.
        projected: for the first liner at these frequencies (Hz) alone.
    Raises:
        TypeError: no plane.
        ValueError: the velocity carries derivatives; too short a record.
    """
    if not isinstance(plane, VelocityPlane):
        raise TypeError(f"plane is {type(plane).__name__}; make a VelocityPlane of your data first")
    if torch.is_grad_enabled() and isinstance(plane.velocity, Tensor) and is_differentiated(plane.velocity):
        raise ValueError(
            f"{plane.name}: velocity carries a gradient, which sums over |v| would lose; replay gives the reflected "
            "signal with its derivatives, or detach the velocity"
        )
    liners = [liner.in_flow(plane.mach) for liner in liners]
    first = liners[0] if liners else None
    asked, pitch = plane.asked(frequency), cell_pitch if first is None else first.cell_pitch
    review.require_periods(plane, asked, chosen)
    chosen = with_background(plane, chosen, first, pitch)
    if nodes is None:
        nodes = choose_nodes(liners, asked, chosen.tolerance(plane.velocity.dtype)) if liners else ANY_LINER
    kept: Nodes | None = None if chosen.drive == "rms" else nodes
    if kept is not None and projected and 2 * len(asked) < nodes.count:
        known = nodes.coefficients(response(liners[0], asked, nodes.speeds))
        if not is_differentiated(known):  # which the loop over the data would lose
            kept = OfOneLiner.of(nodes, known.to(chosen.working_device(plane.device)), asked)
    reading = Reading.of(plane, chosen, asked, kept, pitch)
    return dataclasses.replace(
        reading, notes=tuple(review.review_reading(plane, pitch, asked, reading.blocks, chosen, first))
    )


def measure(reading: Reading, run: Reduce = reduce, progress: Progress | None = None) -> Moments:
    """Read a plane once, and once more where an averaging needs to know the whole record first.

    ``run`` is the loop, of ``velocity.workers`` where others do it; ``progress`` is told numbers of samples read.

    Raises:
        ValueError: ``missing`` is ``exclude``, and no probe is without nan or inf.
        OSError: the file was changed meanwhile.
    """
    # Of what was imported there are no files, so that a run may add frames.
    files = getattr(reading.plane.stored, "files", ())
    before = [state_of(path) for path in files]
    first = run_jobs(reading.first_jobs(), reading, run, progress)
    if reading.chosen.missing == "exclude":
        faulty = ~torch.isfinite(first[SURVEY][:, -2].sum((0, 1))).cpu()
        if bool(faulty.all()):
            raise ValueError(f"{reading.plane.name}: every probe holds nan or inf; there is nothing left to educe")
        if bool(faulty.any()):
            reading = reading.without(faulty)
            first = run_jobs(reading.first_jobs(), reading, run, progress)
    seen, locked, background = reading.survey(first), None, reading.chosen.background
    if "phase-locked" in reading.chosen.averagings:
        cells = reading.membership
        locked = phase_locked(seen, cells, None if background is None else background.scale(seen, cells))
    second = run_jobs(reading.second_jobs(seen, locked), reading, run, progress)
    if [state_of(path) for path in files] != before:
        raise OSError(f"{reading.plane.name} was changed while it was read; read it when it is complete")
    return reading.moments(seen, locked, first | second)


def take_moments(reading: Reading, run: Reduce = reduce, progress: Progress | None = None) -> Moments:
    """``measure``, and what is to be said of the data.

    Raises:
        ValueError: nan or inf; |v| beyond the speed of sound, or beyond a table.
    """
    known = measure(reading, run, progress)
    notes = review.review_moments(reading.plane, known, reading.cells)
    return dataclasses.replace(known, notes=(*known.notes, *notes))


def run_jobs(
    jobs: dict[str, Job], reading: Reading, run: Reduce = reduce, progress: Progress | None = None
) -> dict[str, Tensor]:
    """What each job of a reading gives."""
    found = run(reading.record(progress), reading.blocks, list(jobs.values()), None) if jobs else []
    return dict(zip(jobs, found, strict=True))


def time_moments(plane: VelocityPlane) -> tuple[Tensor, Tensor]:
    """Time mean of v and of v squared, m/s and m2/s2, each (P,), in float64."""
    jobs = [Job(Drive(), measure) for measure in (linear, square)]
    blocks = Blocks((0, plane.samples), plane.sampling_rate, 1)
    mean, mean_square = reduce(PlaneRecord(plane, torch.float64, torch.device("cpu")), blocks, jobs)
    return mean.flatten() / plane.samples, mean_square.flatten() / plane.samples

"""The one or two readings of a plane: survey and moments, and moments that need the survey."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from torch import Tensor

from torchliner.records.cells import Cells
from torchliner.reduction.basis import Basis
from torchliner.reduction.coherent_survey import with_coherent
from torchliner.reduction.drive import DriveSpeed
from torchliner.reduction.moments import PlaneSums
from torchliner.reduction.periodic import Harmonics, PeriodicPart, PeriodicSums, periodic_part
from torchliner.reduction.plan import PassPlan
from torchliner.reduction.probe_velocity import ProbeVelocity, with_smaller_slabs
from torchliner.reduction.sources import Columns
from torchliner.reduction.speed_sums import GroupMoments, SpeedSums, constant_moments
from torchliner.reduction.sums import add, sums_alone
from torchliner.reduction.survey import Survey, SurveySums

Progress = Callable[[int], None]


@dataclass(frozen=True)
class Wanted:
    """What is asked of the readings.

    Args:
        plan: pieces, blocks and rows.
        tones: Hz, whose lines in v and coherence are measured, (F,).
        weights: window of these lines, float64, (n,).
        basis: functions of |v|; None for a survey alone.
        sound: Hz, of the tone in the data; None if it is unknown.
        drive, mean: see ``DriveSpeed``.
        running_samples: of the drive ``running-rms``.
        harmonics: of the periodic part, for the order ``coherent first``; else None.
        oncoming_rms: m/s, see ``PeriodicPart.with_oncoming``.
        keeps_blocks: whether sums over blocks are kept, for error bars.
        velocity_blocks: whether those of v too, of all columns rather than of cells alone.
        true_extremes: whether those of v* are wanted, not bounds of them.
    """

    plan: PassPlan
    tones: Tensor
    weights: Tensor
    basis: Basis | None
    sound: float | None
    drive: str = "instantaneous"
    mean: str = "kept"
    running_samples: int = 1
    harmonics: Harmonics | None = None
    oncoming_rms: float | None = None
    keeps_blocks: bool = True
    velocity_blocks: bool = False
    true_extremes: bool = False

    @property
    def needs_survey(self) -> bool:
        """Whether |v| of the probes follows from the survey or from neighbouring samples."""
        return self.drive != "instantaneous" or self.mean == "removed"


@dataclass(frozen=True)
class First:
    """What the first reading leaves.

    Args:
        survey: of probes and cells.
        periodic: of the probes, or None.
        sums: moments of probes and cells; none where they need the survey.
    """

    survey: Survey
    periodic: PeriodicPart | None
    sums: list[SpeedSums]


def read_once(
    velocity: ProbeVelocity, wanted: Wanted, cells: Cells, used: Tensor, progress: Progress | None
) -> tuple[First, list[str]]:
    """First reading: survey, periodic part and, unless they need the survey, moments.

    Args:
        velocity: probes and averages over cells.
        wanted: what for.
        cells: of the averages.
        used: probes without faults, (P,).
        progress: called with numbers of samples done.
    Returns:
        What was summed; a note if memory ran out and slabs were made smaller.
    """

    def work() -> First:
        surveys, sums = running_sums(velocity, wanted)
        first_pass(velocity, surveys, sums, progress)
        return first_of(surveys, sums, wanted, cells, used)

    return with_smaller_slabs(velocity, work)


def running_sums(
    velocity: ProbeVelocity, wanted: Wanted, *, part: bool = False
) -> tuple[list[SurveySums], list[SpeedSums]]:
    """Of a first reading, before its first sample; of a whole record, or of parts of it."""
    periodic: list[PeriodicSums | None] = [None] * len(velocity.widths)
    if wanted.harmonics is not None:
        periodic = [PeriodicSums(wanted.harmonics, width, velocity.device) for width in velocity.widths]
    last = len(velocity.widths) - 1
    surveys = [
        SurveySums(
            wanted.plan, wanted.tones, wanted.weights, width, velocity.device,
            wanted.keeps_blocks and (wanted.velocity_blocks or i == last),
            periodic[i], wanted.sound, part,
        )
        for i, width in enumerate(velocity.widths)
    ]  # fmt: skip
    widths = () if wanted.needs_survey else velocity.widths
    return surveys, _speed_sums(velocity, wanted.plan, wanted.basis, widths, wanted.keeps_blocks)


def first_of(surveys: list[SurveySums], sums: list[SpeedSums], wanted: Wanted, cells: Cells, used: Tensor) -> First:
    """What the running sums of a first reading say in the end."""
    found = [each.result() for each in surveys]
    joined = Survey.join(found)
    if not wanted.velocity_blocks:
        joined = dataclasses.replace(joined, blocks=None)
    joined = dataclasses.replace(joined, cell_blocks=found[-1].blocks)
    probes, of_cells = surveys[0].periodic, surveys[-1].periodic
    part = None
    if probes is not None and of_cells is not None:
        part = periodic_part(probes, of_cells, cells, used)
    return First(joined, part, sums)


def read_part(
    velocity: ProbeVelocity, wanted: Wanted, progress: Progress | None
) -> tuple[list[SurveySums], list[SpeedSums]]:
    """First reading of the samples ``velocity.span`` of a record."""

    def work() -> tuple[list[SurveySums], list[SpeedSums]]:
        surveys, sums = running_sums(velocity, wanted, part=True)
        first_pass(velocity, surveys, sums, progress)
        return surveys, sums

    return with_smaller_slabs(velocity, work)[0]


def _speed_sums(
    source: ProbeVelocity | DriveSpeed, plan: PassPlan, basis: Basis | None,
    widths: Sequence[int], keeps_blocks: bool,
) -> list[SpeedSums]:  # fmt: skip
    velocity = source.velocity if isinstance(source, DriveSpeed) else source
    whole = velocity.span == (0, velocity.samples)
    numbers = None if whole else plan.numbers(*velocity.span)
    dtype, device = source.dtype, source.device
    return [SpeedSums(plan, basis, width, dtype, device, keeps_blocks, numbers) for width in widths if basis]


def first_pass(
    velocity: ProbeVelocity, surveys: list[SurveySums], sums: list[SpeedSums],
    progress: Progress | None,
) -> None:  # fmt: skip
    """Add the samples ``velocity.span`` to running sums of all groups, and of the first ones."""
    bounds = velocity.bounds()
    with sums_alone(velocity.device):
        for (begin, end), slabs in zip(bounds, velocity.slabs(bounds), strict=True):
            weights = surveys[0].weights_of(begin, slabs[0])
            for i, (survey, slab) in enumerate(zip(surveys, slabs, strict=True)):
                asked = survey.asked(weights)
                speeds = sums[i].asked(begin, Columns(slab)) if sums else None
                add(slab, [asked.lines, *(each.lines for each in asked.segments)], speeds)
                survey.add(asked, slab)
            if progress is not None:
                progress(end - begin)


def read_again(
    velocity: ProbeVelocity,
    wanted: Wanted,
    first: First,
    cells: Cells,
    used: Tensor,
    progress: Progress | None,
) -> tuple[DriveSpeed, PlaneSums, list[str]]:
    """What needs the survey: v* of ``coherent first``, and |v| that a statistic enters.

    Args:
        velocity, wanted, cells, used, progress: as for ``read_once``.
        first: of ``read_once``.
    Returns:
        |v| for the other engines; all sums; notes.
    """
    drive, seen = driven(velocity, wanted, first, cells, used)
    if drive.periodic is not None and wanted.true_extremes:
        seen = drive.with_extremes(seen)
    known = [each.result() for each in first.sums]
    groups, notes = moments_of(drive, wanted.plan, wanted.basis, known, wanted.keeps_blocks, progress)
    found = PlaneSums(wanted.plan, wanted.tones, seen, cells, used, drive.periodic, wanted.basis, groups)
    return drive, found, notes


def driven(
    velocity: ProbeVelocity, wanted: Wanted, first: First, cells: Cells, used: Tensor
) -> tuple[DriveSpeed, Survey]:
    """|v| once the survey is known, and the survey with the columns of v*."""
    seen, periodic = first.survey, first.periodic
    if periodic is not None:
        if wanted.oncoming_rms is not None:
            squares = seen.mean_square[: len(used)]
            periodic = periodic.with_oncoming(wanted.oncoming_rms, squares, cells)
        blocks = wanted.plan.blocks if wanted.keeps_blocks else None
        seen = with_coherent(seen, periodic, cells, wanted.tones, wanted.weights, blocks)
    drive = DriveSpeed(velocity, wanted.drive, wanted.mean, seen, wanted.running_samples, periodic)
    return drive, seen


def moments_of(
    drive: DriveSpeed,
    plan: PassPlan,
    basis: Basis | None,
    known: Sequence[GroupMoments],
    keeps_blocks: bool,
    progress: Progress | None = None,
) -> tuple[tuple[GroupMoments, ...], list[str]]:
    """Of every group of |v|: a reading for those that are not known yet, if any.

    Args:
        drive: |v|; the rms over the record needs no reading.
        plan, basis, keeps_blocks, progress: see ``Wanted`` and ``read_once``.
        known: of the first groups.
    Returns:
        Moments, none without a basis; notes.
    """
    if basis is None or len(known) == len(drive.widths):
        if progress is not None:
            progress(drive.samples)
        return tuple(known), []
    if drive.drive == "rms":
        return tuple(constant_moments(plan, basis, rms.double()) for rms in drive.rms), []
    more, notes = read_rest(drive, plan, basis, len(known), keeps_blocks, progress)
    return (*known, *(each.result() for each in more)), notes


def read_rest(
    drive: DriveSpeed, plan: PassPlan, basis: Basis | None, known: int, keeps_blocks: bool,
    progress: Progress | None,
) -> tuple[list[SpeedSums], list[str]]:  # fmt: skip
    """Second reading, of the groups beyond the ``known`` first; of a part if that is all there."""
    missing = range(known, len(drive.widths))

    def work() -> list[SpeedSums]:
        sums = _speed_sums(drive, plan, basis, drive.widths[known:], keeps_blocks)
        _second(drive, missing, sums, progress)
        return sums

    return with_smaller_slabs(drive.velocity, work)


def _second(drive: DriveSpeed, groups: range, sums: list[SpeedSums], progress: Progress | None) -> None:
    bounds = drive.bounds()
    with sums_alone(drive.device):
        for (begin, end), slabs in zip(bounds, drive.slabs(bounds, groups), strict=True):
            for each, columns in zip(sums, slabs, strict=True):
                each.add(begin, columns)
            if progress is not None:
                progress(end - begin)

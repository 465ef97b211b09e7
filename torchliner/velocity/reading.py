"""How a plane is read: which sums the one loop makes of it, in one reading or, for phase-locked averaging, in two."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import FEWEST_PERIODS
from torchliner.engine.blocks import MOST_BLOCKS, Blocks
from torchliner.engine.drives import Drive, phase_locked, survey_of_locked
from torchliner.engine.intervals import FEWEST_BLOCKS
from torchliner.engine.moments import SETTINGS, Layout, Moments, ReducedVelocity
from torchliner.engine.nodes import ANY_LINER, Nodes, choose_nodes
from torchliner.engine.sums import Job, PlaneRecord, Record, is_differentiated, reduce, square
from torchliner.engine.survey import Membership, Survey, lines_of, survey_of, survey_sums
from torchliner.liners.model import LinerModel, reflection_of
from torchliner.records import VelocityPlane
from torchliner.records.cells import sort_into_cells
from torchliner.records.origin import state_of
from torchliner.velocity import review
from torchliner.velocity.background import Background, background_of
from torchliner.velocity.choices import TOLERANCES, Choices

Progress = Callable[[int], object]
Reduce = Callable[[Record, Blocks, Sequence[Job]], list[Tensor]]  # ``reduce``, or another way to the same bits
SURVEY, CELLS = "survey", "square of cells"
MOST_OF_LINES = 1 << 28  # bytes of the lines of v at all frequencies asked for; beyond, those of the tone alone
MOST_OF_SUMS = 1 << 30  # bytes of all sums; of very many probes there are fewer blocks


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Reading(Layout):
    """What is asked of a record, and all that follows from it without a look at the data."""

    chosen: Choices
    frequency: Tensor  # asked for, Hz, (F,), on the host
    blocks: Blocks
    harmonics: int  # H, of the tone of the data
    lines: Tensor  # Hz, the harmonics and then other frequencies asked for, (L,), on the host
    device: torch.device
    dtype: torch.dtype

    def without(self, faulty: Tensor) -> Reading:
        """The same without some probes, bool, (P,), on the host."""
        used = self.used & ~faulty
        cells = self.cells.kept(used)
        return dataclasses.replace(self, used=used, cells=cells, membership=Membership.of(cells, used, self.device))

    def jobs(self, seen: Survey | None = None, locked: Drive | None = None) -> dict[str, Job]:
        """Of the first reading: the survey, and the sums of every averaging that needs none. Of the second one, with
        what the first found, the others; none where the first was enough."""
        cells, removed, jobs, drives = self.membership, self.chosen.mean == "removed", dict[str, Job](), {}
        if seen is None:
            jobs[SURVEY] = Job(Drive(), survey_sums, self.lines.to(self.device), largest=1)
            if self.onto is None:  # of a record that is kept, or of drive ``rms``
                jobs[CELLS] = Job(Drive(cells), square)
        if (nodes := self.nodes) is None:
            return jobs
        if (seen is None) != removed:
            drives = {"admittance": Drive(), "velocity": Drive(cells)}
        if seen is not None and removed:
            means = {"admittance": seen.mean, "velocity": cells.mean(seen.mean)}
            drives = {name: each.less(means[name]) for name, each in drives.items()}
        if seen is not None and locked is not None:
            drives["phase-locked"] = locked.less(survey_of_locked(locked, seen).mean) if removed else locked
        onto, window, reach = self.onto, self.chosen.running_window, 0
        own = nodes.sums if onto is None else (lambda weights, columns: onto @ nodes.sums(weights, columns))
        lines = self.turns.to(self.device) if len(self.turns) else None
        if window is not None:
            steps, samples = max(1, round(window * self.plane.sampling_rate)), self.plane.samples
            drives = {name: dataclasses.replace(each, window=steps, samples=samples) for name, each in drives.items()}
            reach = steps // 2 + 1
        return jobs | {name: Job(drive, own, lines, reach) for name, drive in drives.items()}

    def run(self, jobs: dict[str, Job], run: Reduce = reduce, progress: Progress | None = None) -> dict[str, Tensor]:
        """One reading: what its jobs give, by name; ``run`` is the loop, which others may share."""
        record = PlaneRecord(self.plane, self.dtype, self.device, self.used, progress)
        return dict(zip(jobs, run(record, self.blocks, list(jobs.values())) if jobs else [], strict=True))

    def moments(self, seen: Survey, locked: Drive | None, found: dict[str, Tensor]) -> Moments:
        """The record of what the readings found."""
        left, v, stated = copy.copy(self.plane), self.plane.velocity, self.chosen.describe()
        # All else that is stated of the plane was checked when it was made.
        vars(left).update(velocity=ReducedVelocity(tuple(v.shape), v.dtype, left.name))
        layout = {each.name: getattr(self, each.name) for each in dataclasses.fields(Layout)}
        return Moments(
            **layout | {"plane": left},
            settings={name: stated[name] for name in SETTINGS},
            survey=seen,
            locked=locked,
            sums={name: value for name, value in found.items() if name != SURVEY},
        )

    def with_drive(self, known: Moments, locked: Drive) -> Moments:
        """Moments of the same reading with another phase-locked drive, for which the plane is read once more."""
        reading = self if bool(known.used.all()) else self.without(~known.used)
        jobs = {name: job for name, job in reading.jobs(known.survey, locked).items() if name == "phase-locked"}
        return dataclasses.replace(known, locked=locked, sums={**known.sums, **reading.run(jobs)})


def reading_of(
    plane: VelocityPlane,
    liners: Sequence[LinerModel],
    frequency: Any,
    chosen: Choices,
    *,
    cell_pitch: float | None = None,
    nodes: Nodes | None = None,
    projected: bool = False,
    summed: bool = True,
) -> Reading:
    """How a plane is read for liners of one pitch.

    Args:
        liners: for which nodes are chosen; none: for any liner, in cells of ``cell_pitch``, m.
        nodes: default those that suit the liners.
        projected: for the first liner at these frequencies (Hz) alone.
        summed: False for a survey alone.
    """
    if not isinstance(plane, VelocityPlane):
        raise TypeError(f"plane is {type(plane).__name__}; make a VelocityPlane of your data first")
    if summed and torch.is_grad_enabled() and isinstance(plane.velocity, Tensor) and is_differentiated(plane.velocity):
        raise ValueError(
            f"{plane.name}: velocity carries a gradient, which sums over |v| would lose; replay gives the reflected "
            "signal with its derivatives, or detach the velocity"
        )
    liners = [liner.in_flow(plane.mach) for liner in liners]
    first, asked = liners[0] if liners else None, plane.asked(frequency)
    device, dtype = chosen.working(plane.velocity)
    pitch, rate, probes = cell_pitch if first is None else first.cell_pitch, plane.sampling_rate, plane.probes
    chosen, onto = settled(plane, chosen, asked, first, pitch), None
    if not summed or chosen.drive == "rms":
        nodes = None
    elif nodes is None:
        nodes = choose_nodes(liners, asked, TOLERANCES[dtype]) if liners else ANY_LINER
    if nodes is not None and projected and 2 * len(asked) < nodes.count:
        known = nodes.coefficients(reflection_of(liners[0], asked[:, None], nodes.speeds))
        if not is_differentiated(known):  # which the loop over the data would lose
            onto = torch.cat([known.real, known.imag]).to(device)

    lines, harmonics = lines_of(plane.frequency or (float(asked[0]) if len(asked) == 1 else None), rate, asked)
    coherent = chosen.wall_filter is not None or chosen.hears_tone  # needs all lines
    if 8 * MOST_BLOCKS * (1 + 2 * len(lines)) * probes > MOST_OF_LINES and not coherent:
        lines = lines[:harmonics]
    cells, used = sort_into_cells(plane, pitch), torch.ones(probes, dtype=torch.bool)
    members = Membership.of(cells, used, device)
    turns = asked[:0] if chosen.phase == "averaged" else 2 * asked
    # Numbers of a block: lines of each probe, and sums of each column.
    size = (0 if nodes is None else nodes.count if onto is None else len(onto)) * (1 + 2 * len(turns))
    size *= (1 + (chosen.averaging == "phase-locked")) * probes + members.count
    most = MOST_OF_SUMS // (8 * ((1 + 2 * len(lines)) * probes + size))
    tone = plane.frequency or float(asked.min())
    blocks = Blocks.of(plane.samples, rate, tone, min(MOST_BLOCKS, max(FEWEST_BLOCKS, most)))
    return Reading(
        plane=plane,
        chosen=chosen,
        frequency=asked,
        nodes=nodes,
        onto=onto,
        cell_pitch=pitch,
        cells=cells,
        membership=members,
        used=used,
        blocks=blocks,
        harmonics=harmonics,
        lines=lines,
        turns=turns,
        device=device,
        dtype=dtype,
    )


def settled(
    plane: VelocityPlane, chosen: Choices, frequency: Tensor, liner: LinerModel | None, pitch: float | None
) -> Choices:
    """Choices with what follows from a plane, from frequencies in Hz, (F,), and from a liner in cells of ``pitch``, m:
    the window of a running rms and the background, measured."""
    lowest = float(frequency.min())
    periods = lowest * plane.samples / plane.sampling_rate
    if periods < FEWEST_PERIODS * (1 - 1e-6) and not chosen.allow_short:
        raise ValueError(
            f"{plane.name} holds {periods:.3g} periods of {lowest:g} Hz, fewer than {FEWEST_PERIODS:g}; pass "
            "allow_short=True if that is meant"
        )
    quiet = chosen.background
    if quiet is not None and not isinstance(quiet, Background):
        own = Choices("admittance", mean=chosen.mean, missing=chosen.missing, allow_short=True, dtype="float64")

        def survey(each: VelocityPlane) -> Moments:
            """Of a run without sound, with the tone of this plane, which it need not state."""
            each = dataclasses.replace(each, frequency=plane.frequency or each.frequency)
            return take_moments(reading_of(each, [], each.frequency or frequency, own, cell_pitch=pitch, summed=False))

        quiet = background_of(plane, quiet, liner, pitch, survey)
    window = 1 / lowest if chosen.drive == "running-rms" and chosen.running_window is None else chosen.running_window
    return dataclasses.replace(chosen, background=quiet, running_window=window)


def take_moments(
    reading: Reading, run: Reduce = reduce, progress: Progress | None = None, *, reviewed: bool = True
) -> Moments:
    """Read a plane once, and once more where an averaging needs to know the whole record first.

    ``run`` is the loop, which others may share; ``progress`` is told numbers of samples read;
    ``reviewed``: with what is to be said of the data, for which sums are brought to the host, or raised.
    """
    # Of what was imported there are no files, so that a run may add frames.
    plane, cells, locked = reading.plane, reading.membership.count, None
    files = getattr(plane.velocity, "files", ())
    before = [state_of(path) for path in files]
    first = reading.run(reading.jobs(), run, progress)
    if reading.chosen.missing == "exclude":
        faulty = ~torch.isfinite(first[SURVEY][:, -2].sum((0, 1))).cpu()
        if bool(faulty.all()):
            raise ValueError(f"{plane.name}: every probe holds nan or inf; there is nothing left to educe")
        if bool(faulty.any()):
            reading = reading.without(faulty)
            first = reading.run(reading.jobs(), run, progress)
    seen = survey_of(first[SURVEY], reading.blocks, reading.lines, reading.harmonics)
    background, members = reading.chosen.background, reading.membership
    if reading.chosen.averaging == "phase-locked":
        locked = phase_locked(seen, members, None if background is None else background.scale(seen, members))
    second = reading.run(reading.jobs(seen, locked), run, progress)
    if [state_of(path) for path in files] != before:
        raise OSError(f"{plane.name} was changed while it was read; read it when it is complete")
    known = reading.moments(seen, locked, first | second)
    return dataclasses.replace(known, notes=tuple(review.review_moments(plane, known, cells))) if reviewed else known

"""Moments of a record from parts of it in time, each reduced by itself."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import tell, whole_number
from torchliner.liners.model import Liner
from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells, sort_into_cells
from torchliner.records.same_case import require_same_probes
from torchliner.reduction.drive import DriveSpeed
from torchliner.reduction.moments import SETTINGS, Moments, PlaneSums
from torchliner.reduction.parts import MomentsPart, PartVelocity, first_reading, joined
from torchliner.reduction.probe_velocity import ProbeVelocity
from torchliner.reduction.readings import First, Wanted, driven, first_of, read_part, read_rest
from torchliner.reduction.speed_sums import constant_moments
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.prepared import Progress
from torchliner.tdibc.reading import refuse_bad_probes, wanted_of
from torchliner.tdibc.requested import AnyLiner, Request, requested, without_velocity
from torchliner.tdibc.review import review_coherent, review_survey


def moments_part(
    plane: VelocityPlane,
    liner: Liner | None = None,
    frequency: Any = None,
    *,
    first_sample: int,
    of_samples: int | None = None,
    given: Moments | None = None,
    cell_pitch: float | None = None,
    progress: Progress | None = None,
    **choices: Any,
) -> MomentsPart:
    """Sums over a part of a record in time; ``Moments.sum`` makes the record's of all of them.

    What needs a statistic of the whole record before |v| is known (order ``coherent first``, the
    default; ``mean`` removed) takes two steps: the sum of all parts, then the parts once more with
    that sum as ``given``, whose sum is complete. Cuts at multiples of 256 samples leave every
    moment as it is, to the bit.

    Args:
        plane: some samples of the record, (..., t) m/s.
        liner, frequency, cell_pitch, progress, choices: as for ``moments``, the same in all parts.
        first_sample: place of the first of them in the record.
        of_samples: samples of the record, T.
        given: sum of the first reading, which knows all of this but ``first_sample``.
    Raises:
        TypeError: plane is no VelocityPlane.
        ValueError: data or options that cannot give an answer; samples beyond the record's end;
            faulty probes without ``missing="exclude"``.
    """
    if not isinstance(plane, VelocityPlane):
        raise TypeError(f"plane is {type(plane).__name__}; one VelocityPlane is needed")
    if given is not None:
        if liner is not None or frequency is not None or choices or cell_pitch is not None:
            raise ValueError("given moments know liner, frequency and choices; leave these out")
        _require_of(plane, given)
        whole = _placed(plane, first_sample, given.sums.plan.samples)
        return second_part(whole, (first_sample, plane.samples), given, progress)
    if of_samples is None:
        raise ValueError("of_samples is needed: the samples of the whole record")
    whole = _placed(plane, first_sample, of_samples)
    request = Request(liner, frequency, cell_pitch, choices)
    return first_part(whole, (first_sample, plane.samples), request, progress)


def first_part(
    whole: VelocityPlane, span: tuple[int, int], request: Request, progress: Progress | None = None
) -> MomentsPart:
    """First reading of some samples of a record.

    Args:
        whole: the record, of which ``span`` can be read.
        span: the first of these samples, and how many.
        request: as for the whole record.
        progress: called with numbers of samples done.
    """
    asked, model, chosen, basis = requested(whole, request)
    if chosen.drive == "running-rms":
        raise ValueError("drive 'running-rms' looks across the ends of a part; reduce the whole record at once")
    # Bounds of v* serve where its extremes would take a reading of their own.
    wanted = dataclasses.replace(wanted_of(asked, model, chosen, basis), true_extremes=False)
    cells = sort_into_cells(whole, model.cell_pitch)
    used = torch.ones(whole.probes, dtype=torch.bool)
    while True:
        held = cells.kept(used)
        velocity = _velocity_of(whole, held, used, span, chosen)
        surveys, sums = read_part(velocity, wanted, progress)
        good = used & (surveys[0].bad == 0).cpu()
        if bool(good.all()) or bool((good == used).all()):
            break
        refuse_bad_probes(whole, surveys[0], good, chosen)
        used = good  # once more without them, whose cells they spoil
    return MomentsPart(
        without_velocity(whole), span[0], sum(span), wanted, held, used, tuple(surveys),
        tuple(sums), {name: getattr(chosen, name) for name in SETTINGS}, model.cell_pitch,
    )  # fmt: skip


def _placed(plane: VelocityPlane, first: int, samples: int) -> VelocityPlane:
    """The record that a part belongs to, of which only the part can be read."""
    first, samples = whole_number("first_sample", first), whole_number("of_samples", samples)
    if not 0 <= first <= samples - plane.samples:
        raise ValueError(
            f"{plane.name} has {plane.samples} samples: from sample {first} on they reach beyond a "
            f"record of {samples}; first_sample is 0 to {max(0, samples - plane.samples)}"
        )
    velocity = PartVelocity(plane, first, samples)
    return dataclasses.replace(plane, velocity=velocity, streamwise=None)


def _velocity_of(
    whole: VelocityPlane, cells: Cells, used: Tensor, span: tuple[int, int], chosen: Choices
) -> ProbeVelocity:
    """Slabs of ``span``: the first sample, and how many."""
    dtype = chosen.working_dtype(whole.velocity.dtype)
    device = chosen.working_device(torch.device("cpu"))
    velocity = ProbeVelocity(whole, cells, dtype, device, used, chosen.slab_memory)
    velocity.span = span[0], span[0] + span[1]
    return velocity


def second_part(
    whole: VelocityPlane, span: tuple[int, int], given: Moments, progress: Progress | None = None
) -> MomentsPart:
    """Moments of the groups that ``given`` lacks, of the same samples as ``first_part``."""
    sums, settings = given.sums, given.settings
    chosen = Choices(**settings)
    velocity = _velocity_of(whole, sums.cells, sums.used, span, chosen)
    drive = DriveSpeed(velocity, chosen.drive, chosen.mean, sums.survey, 1, sums.periodic)
    if len(sums.groups) == len(drive.widths):
        raise ValueError(_complete(given))
    keeps = sums.survey.cell_blocks is not None
    more, _ = read_rest(drive, sums.plan, sums.basis, len(sums.groups), keeps, progress)
    wanted = Wanted(
        sums.plan, sums.tones, torch.empty(0), sums.basis, given.plane.frequency, chosen.drive,
        chosen.mean, keeps_blocks=keeps,
    )  # fmt: skip
    return MomentsPart(
        without_velocity(whole), span[0], sum(span), wanted, sums.cells, sums.used, (),
        tuple(more), settings, given.cell_pitch, first_reading(sums),
    )  # fmt: skip


def _complete(given: Moments) -> str:
    return f"the moments of {given.plane.name} are complete; leave given out, or name the sum of the first reading"


def _require_of(plane: VelocityPlane, given: Moments) -> None:
    """Refuse a part of another record."""
    require_same_probes(given.plane, plane)
    if plane.sampling_rate != given.plane.sampling_rate:
        raise ValueError(
            f"{plane.name} is sampled at {plane.sampling_rate:g} Hz, the given moments of "
            f"{given.plane.name} at {given.plane.sampling_rate:g} Hz: it is of another record"
        )


def sum_parts(parts: Sequence[MomentsPart], given: Moments | None = None) -> Moments:
    """Moments of a record, of which all parts are there, in any order.

    Args:
        parts: of ``moments_part``.
        given: sum of the first reading, if these are of the second.
    Raises:
        TypeError: something else than parts.
        ValueError: of another record or by other choices; samples overlap or are missing.
    """
    whole = joined(list(parts))
    plane, samples = whole.plane, whole.wanted.plan.samples
    if (whole.first, whole.end) != (0, samples):
        raise ValueError(
            f"{plane.name}: there are samples {whole.first} to {whole.end - 1} of {samples}; add "
            "the parts that are missing"
        )
    groups = tuple(each.result() for each in whole.sums)
    if given is not None and whole.after != first_reading(given.sums):
        raise ValueError(
            f"the parts of {plane.name} were not reduced with the given sum of {given.plane.name}: "
            + ("they are of a second reading; give the sum that they were reduced with"
               if whole.after else "they are of a first reading; leave given out")
        )  # fmt: skip
    if not whole.surveys:
        if given is None:
            raise ValueError("parts of a second reading need given=, the sum of the first")
        if len(given.sums.groups) + len(groups) > 2 + (given.sums.periodic is not None):
            raise ValueError(_complete(given))
        sums = dataclasses.replace(given.sums, groups=(*given.sums.groups, *groups))
        return dataclasses.replace(given, sums=sums, readings=given.readings + 1)
    wanted, cells, used = whole.wanted, whole.cells, whole.used
    running = [each.whole() for each in whole.surveys]
    first: First = first_of(running, [], wanted, cells, used)
    notes = review_survey(plane, first.survey, used)
    if first.periodic is not None:
        chosen, asked = Choices(**whole.settings), wanted.tones
        liner = AnyLiner(whole.cell_pitch)
        notes += review_coherent(plane, cells, first.periodic, asked, liner, chosen)
    device = first.survey.mean.device
    velocity = ProbeVelocity(plane, cells, plane.velocity.dtype, device, used)
    drive, seen = driven(velocity, wanted, first, cells, used)
    if wanted.drive == "rms" and wanted.basis is not None:
        groups = tuple(constant_moments(wanted.plan, wanted.basis, rms.double()) for rms in drive.rms)
    sums = PlaneSums(wanted.plan, wanted.tones, seen, cells, used, drive.periodic, wanted.basis, groups)
    tell(notes)
    return Moments(plane, sums, whole.settings, whole.cell_pitch, tuple(notes), readings=1)

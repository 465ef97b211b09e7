"""Everything a replay needs before it starts: record, first pass, drive, levels, kernels."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import stated_frequency
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.names import ORDERS
from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells, sort_into_cells
from torchliner.replay.coherent_survey import with_coherent
from torchliner.replay.drive import DriveSpeed
from torchliner.replay.edges import Record
from torchliner.replay.kernels import KernelTable, build_kernels
from torchliner.replay.periodic import (
    Harmonics,
    PeriodicPart,
    PeriodicSums,
    coherent_tones,
)
from torchliner.replay.phase_rule import phase_rule
from torchliner.replay.probe_velocity import ProbeVelocity, with_smaller_slabs
from torchliner.replay.survey import Survey, survey
from torchliner.replay.waves import Tones
from torchliner.signals.blocks import Blocks, plan_blocks
from torchliner.signals.bootstrap import can_resample
from torchliner.signals.segments import segment_starts
from torchliner.signals.windows import make_window
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.level_range import kernel_band, review_signal, velocity_grid
from torchliner.tdibc.prepared import Prepared, Progress
from torchliner.tdibc.review import (
    needs_kernels,
    review_cells,
    review_coherent,
    review_liner,
    review_record,
    review_survey,
)
from torchliner.tdibc.review_kernels import frequencies_read, review_tables

MOST_LINES = 200  # frequencies of a broadband map unless more are asked for


def prepare(
    planes: Sequence[VelocityPlane],
    liner: Liner,
    frequency: Any,
    chosen: Choices,
    progress: Progress | None = None,
) -> list[Prepared]:
    """Check the data, survey them once, build levels and kernels, which all planes share.

    Raises:
        ValueError: see ``educe``.
    """
    model = as_liner(liner)
    surveyed = [_survey(plane, model, frequency, chosen, progress) for plane in planes]
    grid = velocity_grid(planes, [each["survey"] for each in surveyed], model, chosen)
    read = [frequencies_read(each["record"], each["frequency"], chosen) for each in surveyed]
    band = kernel_band(model, torch.cat(read), chosen)
    made: dict[float, KernelTable] = {}
    prepared = []
    for known in surveyed:
        kernels, record, notes = None, known["record"], known.pop("notes")
        if needs_kernels(record, known["frequency"], chosen):
            rate = record.sampling_rate
            if rate not in made:
                made[rate] = build_kernels(model, grid, rate, kind=chosen.kernel, band=band)
            kernels = made[rate]
            kernels.require_band(known["frequency"])
            notes += review_signal(kernels, chosen, known["sent"])
        ready = Prepared(
            **known, liner=model, chosen=chosen, grid=grid, kernels=kernels, notes=tuple(notes)
        )
        notes += review_tables(ready)
        prepared.append(dataclasses.replace(ready, notes=tuple(notes)))
    return prepared


def _survey(
    plane: VelocityPlane,
    liner: LinerModel,
    frequency: Any,
    chosen: Choices,
    progress: Progress | None,
) -> dict[str, Any]:
    """What ``Prepared`` holds of one plane alone."""
    record = _record(plane, chosen)
    sent = None
    if chosen.incident is not None:
        sent = chosen.incident.sampled(plane.samples, plane.sampling_rate)
        frequency = _signal_lines(plane, record, chosen) if frequency is None else frequency
    wanted = stated_frequency(frequency, plane.frequency, plane.name, plane.sampling_rate)
    notes = review_record(plane, wanted, record, chosen) + review_liner(plane, liner)
    cells = sort_into_cells(plane, liner.cell_pitch)
    blocks = _blocks(plane, wanted, record, chosen, notes)
    velocity, seen, used, cells, periodic = _first_pass(
        plane, cells, wanted, record, blocks, chosen, progress, notes
    )
    notes += review_survey(plane, seen, used)
    if periodic is not None:
        notes += review_coherent(plane, cells, periodic, wanted, liner, chosen)
        if chosen.oncoming_rms is not None:
            squares = seen.mean_square[: plane.probes]
            periodic = periodic.with_oncoming(chosen.oncoming_rms, squares, cells)
        weights = record.weights(0, plane.samples)
        seen = with_coherent(seen, periodic, cells, wanted, weights, blocks)
    running = chosen.running_window or 1 / float(wanted.min())
    samples = max(1, round(running * plane.sampling_rate))
    drive = DriveSpeed(velocity, chosen.drive, chosen.mean, seen, samples, periodic)
    if periodic is not None and not (liner.speed_max is None and chosen.velocity_max is None):
        seen = drive.with_extremes(seen)
    return {
        "plane": plane, "frequency": wanted, "record": record, "cells": cells, "used": used,
        "survey": seen, "drive": drive, "sent": sent, "blocks": blocks, "notes": notes,
    }  # fmt: skip


def _record(plane: VelocityPlane, chosen: Choices) -> Record:
    start = round(chosen.pre_roll * plane.sampling_rate)
    if start >= plane.samples:
        raise ValueError(
            f"pre_roll is {chosen.pre_roll:g} s, but {plane.name} lasts {plane.duration:g} s"
        )
    window = make_window(chosen.window, plane.samples - start)
    return Record(plane.samples, start, window, chosen.edge, plane.sampling_rate)


def _signal_lines(plane: VelocityPlane, record: Record, chosen: Choices) -> Tensor | None:
    """Lines of the segments in the incident signal's band, evenly thinned to ``MOST_LINES``."""
    wave = chosen.incident
    if isinstance(wave, Tones):
        return wave.frequency
    if wave.band is None:
        return None
    _, length = segment_starts(plane.samples, record.start, chosen.segment, plane.sampling_rate)
    spacing = plane.sampling_rate / length
    first = math.ceil(wave.band[0] / spacing - 1e-9)
    last = math.floor(wave.band[1] / spacing + 1e-9)
    step = max(1, math.ceil((last - first + 1) / MOST_LINES))
    return spacing * torch.arange(first, last + 1, step, dtype=torch.float64)


def _blocks(
    plane: VelocityPlane, frequency: Tensor, record: Record, chosen: Choices, notes: list[str]
) -> Blocks | None:
    """Blocks of whole periods of the tone in the data, else of the lowest frequency."""
    if chosen.interval is None or chosen.incident is not None:
        return None
    tone = plane.frequency or float(frequency.min())
    blocks = plan_blocks(record.samples, record.start, record.sampling_rate / tone)
    if can_resample(blocks.count):
        return blocks
    notes.append(
        f"{plane.name}: no error bars, since the record holds {blocks.count} whole periods of "
        f"{tone:g} Hz; two runs of two periods are the least, and 16 periods give a fair interval"
    )
    return None


def _first_pass(
    plane: VelocityPlane,
    cells: Cells,
    frequency: Tensor,
    record: Record,
    blocks: Blocks | None,
    chosen: Choices,
    progress: Progress | None,
    notes: list[str],
) -> tuple[ProbeVelocity, Survey, Tensor, Cells, PeriodicPart | None]:
    """Over the probes and the cell averages; probes with faults are found and left out, (P,), and
    with them the cells that hold no other."""
    like = plane.velocity
    device = chosen.working_device(like.device if isinstance(like, Tensor) else torch.device("cpu"))
    dtype = chosen.working_dtype(like.dtype)
    weights = record.weights(0, plane.samples)
    moves = phase_rule(chosen.phase).needs_velocity or chosen.drive == "rms"
    rate = plane.sampling_rate
    harmonics = None
    if chosen.order == ORDERS[2]:
        harmonics = Harmonics.of(coherent_tones(plane.frequency, frequency), rate)

    def over(
        used: Tensor, report: Progress | None
    ) -> tuple[ProbeVelocity, Survey, PeriodicPart | None]:
        held = cells.kept(used)
        velocity = ProbeVelocity(plane, held, dtype, device, used, chosen.slab_memory)
        if harmonics is not None:
            velocity.derived = plane.probes

        def work() -> tuple[Survey, PeriodicPart | None]:
            sums = None
            if harmonics is not None:
                sums = PeriodicSums(harmonics, plane.samples, held, used, device)
            seen = survey(velocity, frequency, rate, weights, report, blocks, moves, sums)
            return seen, None if sums is None else sums.result()

        (seen, periodic), more = with_smaller_slabs(velocity, work)
        notes.extend(more)
        return velocity, seen, periodic

    velocity, seen, periodic = over(torch.ones(plane.probes, dtype=torch.bool), progress)
    used = (seen.bad[: plane.probes] == 0).cpu()
    if not bool(used.all()):
        _refuse_bad_probes(plane, seen, used, chosen)
        velocity, seen, periodic = over(used, None)
        notes += review_cells(plane, cells, used)
    return velocity, seen, used, cells.kept(used), periodic


def _refuse_bad_probes(plane: VelocityPlane, seen: Survey, used: Tensor, chosen: Choices) -> None:
    first = int((~used).nonzero()[0])
    place = tuple(int(i) for i in torch.unravel_index(torch.tensor(first), plane.probe_shape))
    text = (
        f"{plane.name} holds {int(seen.bad[: plane.probes].sum())} nan or inf at "
        f"{int((~used).sum())} of {plane.probes} probes, the first at probe {place}, sample "
        f"{int(seen.first_bad[first])}"
    )
    if chosen.missing == "refuse":
        raise ValueError(f"{text}; repair them, or leave these probes out with missing='exclude'")
    if not bool(used.any()):
        raise ValueError(f"{text}; no probe is left")

"""Everything an eduction needs: record, moments of the data, |v| and kernels of other engines."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY, stated_frequency
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.records import VelocityPlane
from torchliner.reduction.basis import Basis, choose_basis, interpolation_error, response_of
from torchliner.reduction.line_means import LineReader
from torchliner.reduction.moments import Moments
from torchliner.reduction.sources import in_full_precision
from torchliner.reduction.survey import Survey
from torchliner.replay.edges import Record
from torchliner.replay.kernels import KernelTable, build_kernels
from torchliner.replay.phase_rule import phase_rule
from torchliner.replay.waves import Tones
from torchliner.signals.blocks import Blocks, plan_blocks
from torchliner.signals.bootstrap import can_resample
from torchliner.signals.segments import segment_starts
from torchliner.signals.windows import make_window
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.level_range import kernel_band, review_signal, velocity_grid
from torchliner.tdibc.prepared import Prepared, Progress, kernel_response, top_speed
from torchliner.tdibc.reading import Asked, read_plane, reader_lines, turns_of
from torchliner.tdibc.reduced import fitted, record_of
from torchliner.tdibc.review import needs_kernels, review_liner, review_model, review_record
from torchliner.tdibc.review_kernels import frequencies_read, review_tables
from torchliner.tdibc.several_tones import each_alone, review_tones
from torchliner.tdibc.tone_share import review_other_tones

MOST_LINES = 200  # frequencies of a broadband map unless more are asked for
LARGEST_MODEL_ERROR = 1e-3  # in R, of the interpolation over |v|
ROUNDED = 1e-11  # below, it is of rounding
DOUBTFUL_MODEL_ERROR = 1e-5  # that goes without a note, unless another tolerance is stated


@in_full_precision
def prepare(
    planes: Sequence[VelocityPlane | Moments],
    liner: Liner,
    frequency: Any,
    chosen: Choices,
    progress: Progress | None = None,
    *,
    every_rule: bool = False,
    basis: Basis | None = None,
    further_lines: Sequence[float] = (),
) -> list[Prepared]:
    """Check the data and read them, once or twice; basis, levels and kernels all planes share.

    Args:
        planes: those that are reduced already are not read.
        liner, frequency, progress: see ``educe``.
        chosen: all choices.
        every_rule: keep what any phase rule can be read off; default what the chosen one needs.
        basis: functions of |v|, for liners that are read later; default the fewest that this one
            needs.
        further_lines: Hz, waves that are summed beside those of window and phase rule.
    Raises:
        ValueError: see ``educe``.
    """
    model = as_liner(liner)
    asked = [ask(plane, model, frequency, chosen) for plane in planes]
    read = torch.cat([frequencies_read(each.record, each.frequency, chosen) for each in asked])
    if chosen.incident is not None or (chosen.engine != "spectral" and chosen.interval is None):
        basis = None
    elif basis is None and any(each.known is None for each in asked):
        tolerance = min(chosen.model_tolerance(each.plane.velocity.dtype) for each in asked)
        basis = choose_basis([model], read, tolerance)
    found = [
        read_plane(
            each, model, chosen, basis, every_rule=every_rule, progress=progress,
            further_lines=further_lines,
        )
        for each in asked
    ]  # fmt: skip
    surveys = [sums.survey for _, sums, _ in found]
    grid = velocity_grid([each.plane for each in asked], surveys, model, chosen)
    band = kernel_band(model, read, chosen)
    made: dict[tuple[float, Basis | None], KernelTable] = {}
    prepared = []
    for each, (drive, sums, notes) in zip(asked, found, strict=True):
        record, kernels, response = each.record, None, response_of(model)
        if needs_kernels(chosen):
            rate = record.sampling_rate
            key = rate, sums.basis
            if key not in made:
                levels = grid if sums.basis is None or chosen.engine != "spectral" else sums.basis
                made[key] = build_kernels(model, levels, rate, kind=chosen.kernel, band=band)
            kernels = made[key]
            kernels.require_band(each.frequency)
            notes += review_signal(kernels, chosen, each.sent)
            if chosen.engine == "spectral":
                response = kernel_response(kernels)
        reader, error = None, None
        if sums.basis is not None:
            lines = reader_lines(record, chosen)
            turns = turns_of(each.frequency, chosen, every_rule)
            try:
                reader = LineReader(sums.plan, sums.basis, lines, each.frequency, response, turns)
            except ValueError as reason:
                raise ValueError(f"{each.plane.name}: {reason}") from reason
            error, doubt = _review_basis(sums.basis, model, read, sums.survey, each, chosen)
            notes += doubt
        ready = Prepared(
            each.plane, model, chosen, each.frequency, record, sums.cells, sums.used,
            sums.survey.to_frequencies(_places(sums.tones, each.frequency)), drive, sums, reader,
            error, each.sent, _resampled(each, chosen, notes), grid, kernels, (),
        )  # fmt: skip
        if phase_rule(chosen.phase).several_tones:
            ready = each_alone(ready)
        notes += review_tables(ready) + review_other_tones(ready)
        prepared.append(dataclasses.replace(ready, notes=tuple(notes)))
    return prepared


def _review_basis(
    basis: Basis, model: LinerModel, read: Tensor, seen: Survey, asked: Asked, chosen: Choices
) -> tuple[float, list[str]]:
    """Largest error in R of the interpolation over |v|, up to the largest |v| of the data, and what
    to say of it.

    Raises:
        ValueError: it is too large for any digit that is printed.
    """
    top = top_speed(seen, model)
    error, speed = interpolation_error(basis, response_of(model), read, top)
    text = (
        f"R of {type(model).__name__} is known to {error:.2g} only at |v| = {speed:.4g} m/s from "
        f"its values at {basis.count} speeds"
    )
    if asked.known is not None:
        text = f"{asked.plane.name}: {text}, those that the data were reduced with"
        remedy = "reduce them again with this liner and these frequencies"
    else:
        remedy = (
            "it is not smooth in |v| there; give it as a TabulatedLiner with its kinks among the "
            "speeds, or state speed_max and speed_kinks"
        )
    if error > LARGEST_MODEL_ERROR:
        raise ValueError(f"{text} (limit {LARGEST_MODEL_ERROR:g}): {remedy}")
    limit = max(chosen.tolerance or DOUBTFUL_MODEL_ERROR, ROUNDED)
    if error <= limit:
        return error, []
    return error, [f"{text}, beyond {limit:g}: {remedy}"]


def _places(tones: Tensor, frequency: Tensor) -> Tensor:
    """Where each frequency stands among the tones that were measured, -1 for nowhere, (F,)."""
    known = tones.tolist()
    found = []
    for f in frequency.tolist():
        near = [i for i, tone in enumerate(known) if abs(tone / f - 1) < SAME_FREQUENCY]
        found.append(near[0] if near else -1)
    return torch.tensor(found, dtype=torch.int64)


def ask(given: VelocityPlane | Moments, liner: LinerModel, frequency: Any, chosen: Choices) -> Asked:
    """What is asked of a plane: frequencies, record, blocks, and the first doubts.

    Raises:
        ValueError: it cannot be answered from such a record, or from such moments.
    """
    if isinstance(given, Moments):
        plane, plan = given.plane, given.sums.plan
        wanted = stated_frequency(frequency, plane.frequency, plane.name, plane.sampling_rate)
        given = fitted(given, chosen, liner, wanted)
        record = record_of(given, chosen)
        found = [*review_record(plane, wanted, record, chosen), *review_model(plane, liner)]
        notes = list(dict.fromkeys([*given.notes, *found]))
        return Asked(plane, wanted, record, plan.blocks, None, notes, given)
    plane, sent = given, None
    start = round(chosen.pre_roll * plane.sampling_rate)
    if start >= plane.samples:
        raise ValueError(f"pre_roll is {chosen.pre_roll:g} s, but {plane.name} lasts {plane.duration:g} s")
    if chosen.incident is not None:
        sent = chosen.incident.sampled(plane.samples, plane.sampling_rate)
        frequency = _signal_lines(plane, start, chosen) if frequency is None else frequency
    wanted = stated_frequency(frequency, plane.frequency, plane.name, plane.sampling_rate)
    period = plane.sampling_rate / (plane.frequency or float(wanted.min()))
    blocks = plan_blocks(plane.samples, start, period)
    if chosen.whole_periods:
        whole = plan_blocks(plane.samples, start, period, most=1).borders[-1]
        end = whole if whole > start else plane.samples
        window = make_window("boxcar", end - start)
    else:
        window = make_window(chosen.window, plane.samples - start)
    record = Record(plane.samples, start, window, chosen.edge, plane.sampling_rate)
    if phase_rule(chosen.phase).several_tones:
        review_tones(plane.name, wanted, record, chosen)
    notes = review_record(plane, wanted, record, chosen) + review_liner(plane, liner)
    return Asked(plane, wanted, record, blocks, sent, notes)


def _resampled(asked: Asked, chosen: Choices, notes: list[str]) -> Blocks | None:
    """Blocks for error bars, of whole periods of the tone in the data, else of the lowest one."""
    if chosen.interval is None or chosen.incident is not None:
        return None
    if can_resample(asked.blocks.count):
        return asked.blocks
    plane, tone = asked.plane, asked.plane.frequency or float(asked.frequency.min())
    notes.append(
        f"{plane.name}: no error bars, since the record holds {asked.blocks.count} whole periods "
        f"of {tone:g} Hz; two runs of two periods are the least, and 16 periods give a fair "
        "interval"
    )
    return None


def _signal_lines(plane: VelocityPlane, start: int, chosen: Choices) -> Tensor | None:
    """Lines of the segments in the incident signal's band, evenly thinned to ``MOST_LINES``."""
    wave = chosen.incident
    if isinstance(wave, Tones):
        return wave.frequency
    if wave.band is None:
        return None
    _, length = segment_starts(plane.samples, start, chosen.segment, plane.sampling_rate)
    spacing = plane.sampling_rate / length
    first = math.ceil(wave.band[0] / spacing - 1e-9)
    last = math.floor(wave.band[1] / spacing + 1e-9)
    step = max(1, math.ceil((last - first + 1) / MOST_LINES))
    return spacing * torch.arange(first, last + 1, step, dtype=torch.float64)

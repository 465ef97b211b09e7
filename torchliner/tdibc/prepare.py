"""Everything a replay needs before it starts: record, first pass, drive, levels, kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torch import Tensor

from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.records import VelocityPlane
from torchliner.records.cells import sort_into_cells
from torchliner.replay.drive import DriveSpeed
from torchliner.replay.edges import Record
from torchliner.replay.kernels import KernelTable, build_kernels
from torchliner.signals.blocks import Blocks, plan_blocks
from torchliner.signals.bootstrap import can_resample
from torchliner.signals.windows import make_window
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.first_pass import first_pass
from torchliner.tdibc.frequencies import frequencies_of
from torchliner.tdibc.level_range import kernel_band, review_signal, velocity_grid
from torchliner.tdibc.prepared import Examined, Prepared, Progress
from torchliner.tdibc.review import needs_kernels, review_liner, review_record, review_survey


def prepare(
    planes: Sequence[VelocityPlane],
    liner: Liner,
    frequency: Any,
    chosen: Choices,
    progress: Progress | None = None,
) -> list[Prepared]:
    """Check the data, survey them once, build levels and kernels, which all planes share.

    Raises:
        ValueError: see ``velocity.educe``.
    """
    model = as_liner(liner)
    examined = [_examine(plane, model, frequency, chosen, progress) for plane in planes]
    grid = velocity_grid(examined, model, chosen)
    band = kernel_band(model, examined, chosen)
    made: dict[float, KernelTable] = {}
    ready = []
    for one in examined:
        kernels, notes = None, one.notes
        if needs_kernels(one.record, one.frequency, chosen):
            rate = one.record.sampling_rate
            if rate not in made:
                made[rate] = build_kernels(model, grid, rate, kind=chosen.kernel, band=band)
            kernels = made[rate]
            kernels.require_band(one.frequency)
            notes += review_signal(kernels, chosen, one.sent)
        known = {**vars(one), "notes": notes}
        ready.append(Prepared(**known, liner=model, chosen=chosen, grid=grid, kernels=kernels))
    return ready


def _examine(
    plane: VelocityPlane,
    liner: LinerModel,
    frequency: Any,
    chosen: Choices,
    progress: Progress | None,
) -> Examined:
    record = _record(plane, chosen)
    sent = None
    if chosen.incident is not None:
        sent = chosen.incident.sampled(plane.samples, plane.sampling_rate)
    wanted = frequencies_of(plane, frequency, record, chosen)
    notes = review_record(plane, wanted, record, chosen) + review_liner(plane, liner)
    cells = sort_into_cells(plane, liner.cell_pitch)
    blocks, said = _blocks(plane, wanted, record, chosen)
    notes += said
    velocity, seen, used, said = first_pass(plane, cells, wanted, record, blocks, chosen, progress)
    notes += said + review_survey(plane, seen, used)
    running = chosen.running_window or 1 / float(wanted.min())
    samples = max(1, round(running * plane.sampling_rate))
    drive = DriveSpeed(velocity, chosen.drive, chosen.mean, seen, samples)
    return Examined(plane, wanted, record, cells, used, seen, drive, sent, blocks, tuple(notes))


def _record(plane: VelocityPlane, chosen: Choices) -> Record:
    start = round(chosen.pre_roll * plane.sampling_rate)
    if start >= plane.samples:
        raise ValueError(
            f"pre_roll is {chosen.pre_roll:g} s, but {plane.name} lasts {plane.duration:g} s"
        )
    window = make_window(chosen.window, plane.samples - start)
    return Record(plane.samples, start, window, chosen.edge, plane.sampling_rate)


def _blocks(
    plane: VelocityPlane, frequency: Tensor, record: Record, chosen: Choices
) -> tuple[Blocks | None, list[str]]:
    """Blocks of whole periods of the tone in the data, else of the lowest frequency."""
    if chosen.interval is None or chosen.incident is not None:
        return None, []
    tone = plane.frequency or float(frequency.min())
    blocks = plan_blocks(record.samples, record.start, record.sampling_rate / tone)
    if can_resample(blocks.count):
        return blocks, []
    return None, [
        f"{plane.name}: no error bars, since the record holds {blocks.count} whole periods of "
        f"{tone:g} Hz; two runs of two periods are the least, and 16 periods give a fair interval"
    ]

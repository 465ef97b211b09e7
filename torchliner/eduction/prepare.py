"""Everything a replay needs before it starts: record, first pass, drive, levels, kernels."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor
from torchliner.eduction.averaging import Cells, sort_into_cells
from torchliner.eduction.choices import Choices
from torchliner.eduction.drive import DriveSpeed, ProbeVelocity
from torchliner.eduction.review import needs_kernels, review_liner, review_record, review_survey
from torchliner.eduction.survey import Survey, survey
from torchliner.records import VelocityPlane
from torchliner.replay.edges import Record
from torchliner.replay.kernels import KernelTable, Liner, build_kernels
from torchliner.replay.levels import VelocityGrid
from torchliner.signals.windows import make_window

Progress = Callable[[int], None]


@dataclass(frozen=True)
class Prepared:
    """A plane ready to be replayed.

    Args:
        plane, liner, chosen: as given.
        frequency: Hz, (F,).
        record: window and edge rule.
        cells: probes by cell; the cell averages follow the probes in every (P + C, ...) tensor.
        used: probes without faults, (P,).
        seen: first pass, over probes and cell averages.
        drive: |v| for the engines.
        grid: velocity levels.
        kernels: None where no impulse response is needed.
        notes: doubts so far.
    """

    plane: VelocityPlane
    liner: Liner
    chosen: Choices
    frequency: Tensor
    record: Record
    cells: Cells
    used: Tensor
    seen: Survey
    drive: DriveSpeed
    grid: VelocityGrid
    kernels: KernelTable | None
    notes: tuple[str, ...]


def prepare(
    plane: VelocityPlane,
    liner: Liner,
    frequency: Any,
    chosen: Choices,
    progress: Progress | None = None,
) -> Prepared:
    """Check the data, survey them once, build levels and kernels.

    Raises:
        ValueError: see ``velocity.educe``.
    """
    wanted = _frequencies(plane, frequency)
    record = _record(plane, chosen)
    notes = review_record(plane, wanted, record, chosen) + review_liner(plane, liner)
    cells = sort_into_cells(plane, getattr(liner, "cell_pitch", None))
    velocity, seen, used = _survey(plane, cells, wanted, record, chosen, progress)
    notes += review_survey(plane, seen, used)
    running = chosen.running_window or 1 / float(wanted.min())
    samples = max(1, round(running * plane.sampling_rate))
    drive = DriveSpeed(velocity, chosen.drive, chosen.mean, seen, samples)
    grid = _velocity_grid(plane, liner, seen, chosen)
    kernels = _kernels(liner, grid, wanted, record, chosen)
    return Prepared(
        plane, liner, chosen, wanted, record, cells, used, seen, drive, grid, kernels, tuple(notes)
    )


def _frequencies(plane: VelocityPlane, frequency: Any) -> Tensor:
    if frequency is None:
        frequency = plane.frequency
    if frequency is None:
        raise ValueError(f"{plane.name} states no frequency; give frequency=..., in Hz")
    return frequency_tensor(frequency, plane.sampling_rate).cpu()


def _record(plane: VelocityPlane, chosen: Choices) -> Record:
    start = round(chosen.pre_roll * plane.sampling_rate)
    if start >= plane.samples:
        raise ValueError(
            f"pre_roll is {chosen.pre_roll:g} s, but {plane.name} lasts {plane.duration:g} s"
        )
    window = make_window(chosen.window, plane.samples - start)
    return Record(plane.samples, start, window, chosen.edge, plane.sampling_rate)


def _survey(
    plane: VelocityPlane,
    cells: Cells,
    frequency: Tensor,
    record: Record,
    chosen: Choices,
    progress: Progress | None,
) -> tuple[ProbeVelocity, Survey, Tensor]:
    """First pass: over the probes and the cell averages; faulty probes are found and left out."""
    like = plane.velocity
    device = chosen.working_device(like.device if isinstance(like, Tensor) else torch.device("cpu"))
    dtype = chosen.working_dtype(like.dtype)
    weights = torch.zeros(plane.samples, dtype=torch.float64)
    weights[record.start :] = record.window.weights
    everything = torch.ones(plane.probes, dtype=torch.bool)

    def look(used: Tensor, report: Progress | None) -> tuple[ProbeVelocity, Survey]:
        velocity = ProbeVelocity(plane, cells, dtype, device, used, chosen.memory_bytes)
        return velocity, survey(velocity, frequency, plane.sampling_rate, weights, report)

    velocity, seen = look(everything, progress)
    used = (seen.bad[: plane.probes] == 0).cpu()
    if not bool(used.all()):
        _refuse_bad_probes(plane, seen, used, chosen)
        velocity, seen_again = look(used, None)
        seen = seen_again
    return velocity, seen, used


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


def _velocity_grid(
    plane: VelocityPlane, liner: Liner, seen: Survey, chosen: Choices
) -> VelocityGrid:
    """Levels over the whole record's range; the top is rounded up so that the tables, and with
    them the last digits of a probe, rarely depend on which other probes are in the plane."""
    peak = torch.maximum(seen.largest.abs(), seen.smallest.abs())
    if chosen.mean == "removed":
        peak = peak + seen.mean.abs()
    fastest = int(peak[: plane.probes].argmax())
    top = float(peak[fastest])
    limit = chosen.velocity_max
    table_limit = getattr(liner, "speed_max", None)
    if limit is None:
        limit = 2.0 ** (math.ceil(2 * math.log2(max(top, 1e-3))) / 2) * (1 + 1e-9)
        if table_limit is not None:
            limit = min(limit, table_limit)
    if top > limit or (table_limit is not None and limit > table_limit):
        place = tuple(int(i) for i in torch.unravel_index(torch.tensor(fastest), plane.probe_shape))
        kind = "velocity_max" if chosen.velocity_max is not None else "the liner's table"
        ceiling = limit if table_limit is None else min(limit, table_limit)
        raise ValueError(
            f"{plane.name} reaches |v| = {top:.4g} m/s at probe {place}, above {kind}, "
            f"{ceiling:.4g} m/s; extend it to at least {top * 1.01:.3g} m/s"
        )
    return VelocityGrid(limit, chosen.levels, chosen.spacing, chosen.interpolation)


def _kernels(
    liner: Liner, grid: VelocityGrid, frequency: Tensor, record: Record, chosen: Choices
) -> KernelTable | None:
    if not needs_kernels(record, frequency, chosen):
        return None
    low, high = chosen.band
    known = getattr(liner, "frequency_range", None)
    if known is not None:
        low, high = max(low, known[0]), min(high, known[1])
    kernels = build_kernels(liner, grid, record.sampling_rate, kind=chosen.kernel, band=(low, high))
    kernels.require_band(frequency)
    return kernels

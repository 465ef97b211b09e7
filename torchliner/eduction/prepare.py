"""Everything a replay needs before it starts: record, first pass, drive, levels, kernels."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor
from torchliner.eduction.averaging import Cells, sort_into_cells
from torchliner.eduction.choices import Choices
from torchliner.eduction.drive import DriveSpeed, ProbeVelocity
from torchliner.eduction.recovery import with_smaller_slabs
from torchliner.eduction.review import needs_kernels, review_liner, review_record, review_survey
from torchliner.eduction.survey import Survey, survey
from torchliner.records import VelocityPlane
from torchliner.replay.edges import Record
from torchliner.replay.kernels import BAND, KernelTable, Liner, build_kernels
from torchliner.replay.levels import VelocityGrid
from torchliner.replay.waves import Tones
from torchliner.signals.blocks import Blocks, plan_blocks
from torchliner.signals.bootstrap import can_resample
from torchliner.signals.segments import segment_starts
from torchliner.signals.tones import WindowSums
from torchliner.signals.windows import make_window

Progress = Callable[[int], None]
SMALL_SHARE = 1e-3  # of a recorded signal's energy
MOST_LINES = 200  # frequencies of a broadband map unless more are asked for


@dataclass(frozen=True)
class Examined:
    """A plane after the first pass.

    Args:
        plane: as given.
        frequency: Hz, (F,).
        record: window and edge rule.
        cells: probes by cell; the cell averages follow the probes in every (P + C, ...) tensor.
        used: probes without faults, (P,).
        seen: first pass, over probes and cell averages.
        drive: |v| for the engines.
        sent: incident signal on the record, (n,); None for tones.
        blocks: of the record, for error bars; None where there are none.
        notes: doubts so far.
    """

    plane: VelocityPlane
    frequency: Tensor
    record: Record
    cells: Cells
    used: Tensor
    seen: Survey
    drive: DriveSpeed
    sent: Tensor | None
    blocks: Blocks | None
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Prepared(Examined):
    """A plane ready to be replayed.

    Args:
        liner, chosen: as given.
        grid: velocity levels.
        kernels: None where no impulse response is needed.
    """

    liner: Liner
    chosen: Choices
    grid: VelocityGrid
    kernels: KernelTable | None

    @functools.cached_property
    def window_sums(self) -> WindowSums:
        """The window's own sums at each frequency, on the device of the drive."""
        window = WindowSums.of(
            self.record.window.weights, self.record.start, self.frequency, self.plane.sampling_rate
        )
        device = self.drive.device
        return WindowSums(window.zero.to(device), window.twice.to(device))

    @property
    def velocity_amplitude(self) -> Tensor:
        """Half the complex peak amplitude of v into the liner (which is -v), m/s, (P + C, F)."""
        return self.window_sums.tone_amplitude(-self.seen.line)

    def whole_speed(self) -> Tensor:
        """All of |v| at once, (P + C, n), for the reference engine."""
        slabs = self.drive.slabs([(0, self.drive.samples)])
        return torch.cat([part.speed for slab in slabs for part in slab], dim=1).T


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
    examined = [_examine(plane, liner, frequency, chosen, progress) for plane in planes]
    grid = _velocity_grid(examined, liner, chosen)
    band = kernel_band(liner, examined, chosen)
    made: dict[float, KernelTable] = {}
    ready = []
    for one in examined:
        kernels, notes = None, one.notes
        if needs_kernels(one.record, one.frequency, chosen):
            rate = one.record.sampling_rate
            if rate not in made:
                made[rate] = build_kernels(liner, grid, rate, kind=chosen.kernel, band=band)
            kernels = made[rate]
            kernels.require_band(one.frequency)
            notes += _review_signal(kernels, chosen, one.sent)
        known = {**vars(one), "notes": notes}
        ready.append(Prepared(**known, liner=liner, chosen=chosen, grid=grid, kernels=kernels))
    return ready


def _examine(
    plane: VelocityPlane, liner: Liner, frequency: Any, chosen: Choices, progress: Progress | None
) -> Examined:
    record = _record(plane, chosen)
    sent = None
    if chosen.incident is not None:
        sent = chosen.incident.sampled(plane.samples, plane.sampling_rate)
    wanted = _frequencies(plane, frequency, record, chosen)
    notes = review_record(plane, wanted, record, chosen) + review_liner(plane, liner)
    cells = sort_into_cells(plane, getattr(liner, "cell_pitch", None))
    blocks, said = _blocks(plane, wanted, record, chosen)
    notes += said
    velocity, seen, used, said = _survey(plane, cells, wanted, record, blocks, chosen, progress)
    notes += said + review_survey(plane, seen, used)
    running = chosen.running_window or 1 / float(wanted.min())
    samples = max(1, round(running * plane.sampling_rate))
    drive = DriveSpeed(velocity, chosen.drive, chosen.mean, seen, samples)
    return Examined(plane, wanted, record, cells, used, seen, drive, sent, blocks, tuple(notes))


def _frequencies(plane: VelocityPlane, frequency: Any, record: Record, chosen: Choices) -> Tensor:
    if frequency is None and chosen.incident is not None:
        frequency = _signal_lines(plane, record, chosen)
    if frequency is None:
        frequency = plane.frequency
    if frequency is None:
        raise ValueError(f"{plane.name} states no frequency; give frequency=..., in Hz")
    return frequency_tensor(frequency, plane.sampling_rate).cpu()


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


def _review_signal(kernels: KernelTable, chosen: Choices, sent: Tensor | None) -> tuple[str, ...]:
    """Refuse a generated signal beyond the kernel's band; notes on a recorded one."""
    if sent is None:
        return ()
    wave, (low, high) = chosen.incident, kernels.band
    if wave.band is not None:
        if wave.band[0] < low or wave.band[1] > high:
            raise ValueError(
                f"incident signal {wave.label} reaches beyond the kernel's band, {low:g}-{high:g} "
                "Hz, where the kernel is not the liner; widen it with band=(low, high) or narrow "
                "the signal"
            )
        return ()
    power = torch.fft.rfft(sent).abs().square()
    lines = torch.fft.rfftfreq(len(sent), 1 / kernels.sampling_rate, dtype=torch.float64)
    inside = (lines >= low) & (lines <= high)
    share = 1 - float(power[inside].sum() / power.sum().clamp(min=1e-300))
    if share < SMALL_SHARE:
        return ()
    return (
        f"{100 * share:.2g} % of the energy of {wave.label} lies outside the kernel's band, "
        f"{low:g}-{high:g} Hz, where the reflected signal is not the liner's; filter it, or widen "
        "the band with band=(low, high)",
    )


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


def _survey(
    plane: VelocityPlane,
    cells: Cells,
    frequency: Tensor,
    record: Record,
    blocks: Blocks | None,
    chosen: Choices,
    progress: Progress | None,
) -> tuple[ProbeVelocity, Survey, Tensor, list[str]]:
    """First pass: over the probes and the cell averages; faulty probes are found and left out."""
    like = plane.velocity
    device = chosen.working_device(like.device if isinstance(like, Tensor) else torch.device("cpu"))
    dtype = chosen.working_dtype(like.dtype)
    weights = record.weights(0, plane.samples)
    said: list[str] = []
    moves = chosen.phase == "self-consistent" or chosen.drive == "rms"
    kept = blocks if moves else None
    everything = torch.ones(plane.probes, dtype=torch.bool)

    def look(used: Tensor, report: Progress | None) -> tuple[ProbeVelocity, Survey]:
        velocity = ProbeVelocity(plane, cells, dtype, device, used, chosen.slab_memory)
        rate = plane.sampling_rate
        seen, notes = with_smaller_slabs(
            velocity, lambda: survey(velocity, frequency, rate, weights, report, kept)
        )
        said.extend(notes)
        return velocity, seen

    velocity, seen = look(everything, progress)
    used = (seen.bad[: plane.probes] == 0).cpu()
    if not bool(used.all()):
        _refuse_bad_probes(plane, seen, used, chosen)
        velocity, seen = look(used, None)
    return velocity, seen, used, said


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


def _velocity_grid(examined: Sequence[Examined], liner: Liner, chosen: Choices) -> VelocityGrid:
    """Levels over the range of all planes; the top is rounded up so that the tables, and with
    them the last digits of a probe, rarely depend on which other probes are in the data."""
    top, fastest, plane = -1.0, 0, examined[0].plane
    for one in examined:
        peak = torch.maximum(one.seen.largest.abs(), one.seen.smallest.abs())
        if chosen.mean == "removed":
            peak = peak + one.seen.mean.abs()
        here = int(peak[: one.plane.probes].argmax())
        if float(peak[here]) > top:
            top, fastest, plane = float(peak[here]), here, one.plane
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


def kernel_band(liner: Liner, examined: Sequence[Examined], chosen: Choices) -> tuple[float, float]:
    """The kernel's band: as asked, or wide enough for all that is asked; within the liner's."""
    if chosen.band is not None:
        low, high = chosen.band
    else:
        asked = torch.cat([one.frequency for one in examined])
        low, high = min(BAND[0], float(asked.min())), max(BAND[1], float(asked.max()))
        if chosen.incident is not None and chosen.incident.band is not None:
            low, high = min(low, chosen.incident.band[0]), max(high, chosen.incident.band[1])
    known = getattr(liner, "frequency_range", None)
    if known is not None:
        low, high = max(low, known[0]), min(high, known[1])
    return low, high

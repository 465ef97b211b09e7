"""What is asked of a replay, what it refuses, and what it warns of: the wave, its segments, kernels and levels."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, require_positive
from torchliner.engine.drives import Drive
from torchliner.engine.intervals import FEWEST_RUNS
from torchliner.engine.kernels import BAND, HIGHEST, KernelTable
from torchliner.engine.moments import Moments
from torchliner.engine.replay import Replay, transfer
from torchliner.engine.sums import Held
from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane
from torchliner.records.educed import Educed
from torchliner.records.incident import ComplexTones, Incident
from torchliner.records.notes import Note
from torchliner.velocity.reading import Reading

LARGEST_ERROR = 1e-3  # in R, of kernels and of the interpolation between levels
LARGEST_GAIN = 10.0  # 1.3 on the default band, 5 up to 5 kHz
LARGEST_SHARE = 1e-3  # of the energy of a recorded wave
STILL_ERROR = 1e-2  # in R
SMALLEST = 1e-3  # m/s
MOST_LINES = 200  # frequencies, unless more are asked for


def segment_length(segment: float, plane: VelocityPlane) -> int:
    """An even number of samples of a segment, s."""
    require_positive("segment (s)", segment)
    length = 2 * round(segment * plane.sampling_rate / 2)
    if not 2 <= length <= plane.samples:
        raise ValueError(f"segment is {segment:g} s, and the record has {plane.duration:.4g} s; shorten the segment")
    return length


def lines_of(wave: Incident, frequency: Any, plane: VelocityPlane, length: int) -> Tensor:
    """As asked for, or what the wave has in segments of so many samples, Hz, (F,)."""
    rate, spacing = plane.sampling_rate, plane.sampling_rate / length
    if isinstance(wave, ComplexTones):
        asked = frequency_tensor(wave.frequency if frequency is None else frequency, rate).cpu()
        if wave.sampled(1, rate).is_complex() and not torch.equal(asked, wave.frequency):
            raise ValueError("incident and frequency name different tones; name them once")
        return asked
    if frequency is None and wave.band is not None:
        first, last = math.ceil(wave.band[0] / spacing - 1e-9), math.floor(wave.band[1] / spacing + 1e-9)
        return spacing * torch.arange(first, last + 1, max(1, math.ceil((last - first + 1) / MOST_LINES))).double()
    return plane.asked(frequency)


def kernel_band(wave: Incident, frequency: Tensor, liner: LinerModel, sampling_rate: float) -> tuple[float, float]:
    """Where the kernels are to be the liner, Hz: the rig's band, the wave's and the frequencies asked for, (F,).

    Raises:
        ValueError: some of that is beyond the range of the liner or of the sampling rate.
    """
    least, most = frequency.min().item(), frequency.max().item()
    if wave.band is not None:
        least, most = min(least, wave.band[0]), max(most, wave.band[1])
    known = liner.frequency_range or (0.0, math.inf)
    low, high = max(min(BAND[0], least), known[0]), min(max(BAND[1], most), known[1], HIGHEST * sampling_rate)
    if least < low or most > high:
        raise ValueError(
            f"{wave.label} is replayed, and R is asked for, from {least:g} to {most:g} Hz; the kernels hold from "
            f"{low:g} to {high:g} Hz, the range of the liner below 0.49 of the sampling rate: narrow the wave"
        )
    return low, high


def velocity_limit(stated: float | None, known: Moments, reading: Reading, still: Tensor, liner: LinerModel) -> float:
    """Top of the levels, m/s, rounded up to a power of the root of 2, so that the levels rarely depend on the data.

    Args:
        stated: by the user, if at all.
        known: the survey, which has whole periods alone.
        reading: of the same plane, for what follows the last of them.
        still: mean that is taken off, m/s, (P,).
        liner: what is replayed.
    Raises:
        ValueError: nan, or |v| beyond the levels.
    """
    plane, last = reading.plane, known.survey.blocks.borders[-1]
    (rest,) = reading.record().slabs([(min(last, plane.samples - 1), plane.samples)])
    peak = torch.maximum(known.survey.peak, rest.detach().abs().amax(0).double()) + still.abs()
    largest = torch.where(known.counted, peak, 0).cpu()
    top, table = largest.max().item(), liner.speed_max or math.inf
    place = tuple(int(i) for i in torch.unravel_index(largest.argmax(), plane.probe_shape))
    if not math.isfinite(top):
        raise ValueError(f"{plane.name} holds nan or inf at probe {place} behind its last whole period; cut it there")
    rounded = 2.0 ** (math.ceil(2 * math.log2(max(top, SMALLEST))) / 2) * (1 + 1e-9)
    limit, what = (min(rounded, table), "the liner's table") if stated is None else (stated, "velocity_max")
    if top > limit * (1 + 1e-6):
        raise ValueError(
            f"{plane.name} reaches |v| = {top:.4g} m/s at probe {place}, above {what}, {limit:.4g} m/s; extend it to "
            f"at least {top * 1.01:.3g} m/s"
        )
    return limit


@torch.no_grad()
def still_error(
    kernels: KernelTable, wave: Incident, frequency: Tensor, speed: float, samples: int, how: dict[str, Any]
) -> float:
    """Error in R of this wave, edge, window and segments where |v| never changes from about ``speed``, m/s: a segment
    misses replies to its own end and meets some to what was sent before it. ``how``: as of ``engine.transfer``."""
    level = int((kernels.grid.speeds - speed).abs().argmin())
    v = kernels.grid.speeds[level].expand(samples, 1)
    signal = Replay(Held(lambda low, high: v[low:high], samples, 1, v.device), kernels, wave, Drive())
    found = transfer(signal, wave, frequency, kernels.sampling_rate, **how).reflection[0]
    return float((found - kernels.response(frequency)[level]).abs().max())


def review_replay(kernels: KernelTable, wave: Incident, sent: Tensor, still: float, chief: Educed) -> list[Note]:
    """Warnings; ``sent`` is the wave, ``still`` the ``still_error``, ``chief`` the R to quote."""
    low, high = kernels.band
    size = float((1 + chief.impedance.detach()).abs().square().max()) / 2  # of dZ, over that of dR
    found = []
    if kernels.error > LARGEST_ERROR or kernels.gain > LARGEST_GAIN:
        remedy = "take kernel='two-sided'" if kernels.kind == "causal" else "narrow the wave and the frequencies"
        text = (
            f"the {kernels.kind} kernels are off by up to {kernels.error:.2g} in R within {low:g}-{high:g} Hz (limit "
            f"{LARGEST_ERROR:g}) and amplify up to {kernels.gain:.3g} times (limit {LARGEST_GAIN:g}); {remedy}"
        )
        found.append(("kernel", kernels.error, text))
    if kernels.level_error > LARGEST_ERROR:
        text = (
            f"between {kernels.grid.levels} levels of |v| R is off by up to {kernels.level_error:.2g} (limit "
            f"{LARGEST_ERROR:g}); take more levels, or spacing='sqrt' with interpolation='cubic'"
        )
        found.append(("levels", kernels.level_error, text))
    if still > STILL_ERROR:
        text = (
            f"where |v| never changes, R from {wave.label} is off by {still:.2g} (limit {STILL_ERROR:g}): replies last "
            f"{1e3 * kernels.taps.shape[1] / kernels.sampling_rate:.3g} ms and cross the ends of the segments; take "
            "longer ones, or lines of noise over the whole record"
        )
        found.append(("signal", still, text))
    notes = [Note(code, f"{text} (in Z up to {error * size:.2g})", error * size) for code, error, text in found]
    if wave.band is None:
        power = torch.fft.rfft(sent).abs().square()
        lines = torch.fft.rfftfreq(len(sent), 1 / kernels.sampling_rate, dtype=torch.float64)
        share = float(power[(lines < low) | (lines > high)].sum() / power.sum())
        if share > LARGEST_SHARE:
            text = (
                f"{100 * share:.2g} % of the energy of {wave.label} lies outside {low:g}-{high:g} Hz, the band of the "
                "kernels, where the reflected signal is not the liner's; filter it"
            )
            notes.append(Note("signal-band", text))
    return notes


def review_segments(count: int, duration: float, chief: Educed) -> list[Note]:
    """Too few segments, of so many s, for the error bars of ``chief``."""
    runs = 0.0 if chief.interval is None else float(chief.interval.runs.min())
    if runs >= FEWEST_RUNS:
        return []
    text = f"error bars rest on {runs:.2g} independent runs of segments, fewer than {FEWEST_RUNS}, and are rough"
    return [Note("few-segments", f"{text}: there are {count} segments of {duration:.3g} s; shorten them")]

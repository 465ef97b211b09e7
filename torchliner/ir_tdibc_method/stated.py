"""What an IR-TDIBC run is asked, checked once."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, real_tensor, require_positive, tell
from torchliner.conversions import REFERENCE_PRESSURE
from torchliner.engine.kernels import BAND
from torchliner.engine.levels import VelocityGrid
from torchliner.ir_tdibc_method.fixed_point import spectrum_of
from torchliner.ir_tdibc_method.ways import WAYS
from torchliner.liners.model import LinerModel
from torchliner.records.incident import Tones

FASTEST = 20.0  # m/s, top of the table; of 164 dB at a wall that lets all through
UNHEARD = 0.01  # of a wave's energy, that may be sent where no kernel is fitted
LOUDEST = 200.0  # dB; above, a pressure is meant


def checked_levels(level: Any) -> Tensor:
    """Levels, dB, (L,)."""
    levels = real_tensor(level).reshape(-1).detach()
    if not len(levels):
        raise ValueError("no level is given; name at least one, in dB re 20 uPa rms")
    for value in levels.tolist():
        if not math.isfinite(value):
            raise ValueError(f"level is {value:g}; it is a finite number of dB re 20 uPa rms")
        if value > LOUDEST:
            raise ValueError(
                f"level is {value:g} dB, above {LOUDEST:g} dB; if a pressure is meant, {value:g} "
                f"Pa rms is {20 * math.log10(value / REFERENCE_PRESSURE):.1f} dB re 20 uPa"
            )
    return levels


def read_at(signal: Any, frequency: Any, rate: float) -> Tensor:
    """Where Z is read, Hz, (F,)."""
    known = signal.frequency[signal.amplitude != 0] if isinstance(signal, Tones) else None
    if frequency is None and known is not None and len(known):
        return frequency_tensor(known, rate)
    if frequency is None:
        if signal.band is None:
            raise ValueError(f"{signal.label} states no frequencies; give frequency=, in Hz")
        frequency = torch.linspace(signal.band[0], signal.band[1], 10, dtype=torch.float64)[1:-1]
    read = frequency_tensor(frequency, rate)
    low, high = signal.band or (0.0, math.inf)
    for f in read.tolist():
        absent = known is not None and not bool(((known - f).abs() < 1e-6 * f).any())
        if absent or not low * (1 - 1e-6) <= f <= high * (1 + 1e-6):
            raise ValueError(f"frequency {f:g} Hz is not in {signal.label}; R is not known there")
    return read


def grid_of(model: LinerModel, velocity_max: float | None) -> VelocityGrid:
    """Levels of the kernel table: never of a batch, so that a level's result is its own."""
    top = FASTEST if model.speed_max is None else min(FASTEST, model.speed_max)
    grid = VelocityGrid(top if velocity_max is None else velocity_max)
    if model.speed_max is not None and grid.maximum > model.speed_max:
        raise ValueError(f"velocity_max is {grid.maximum:g} m/s; the liner is known up to {model.speed_max:g} m/s")
    return grid


def driving_window(drive: str, signal: Any, seconds: float | None, rate: float, n: int) -> int:
    """Samples of the rms that drives; 1 for |v| itself."""
    if drive == "instantaneous":
        if seconds is not None:
            raise ValueError("running_window is of the drive 'running-rms'; choose it, or leave "
                             "the window out")  # fmt: skip
        return 1
    if seconds is None:
        if signal.band is None:
            raise ValueError(f"{signal.label} states no period; give running_window=, in s")
        seconds = 1 / signal.band[0]
    require_positive("running_window (s)", seconds)
    samples = round(seconds * rate)
    if not 1 <= samples <= n:
        raise ValueError(f"running_window is {seconds:g} s, {samples} samples; the record has {n}")
    return samples


def band_of(
    model: LinerModel, kernel: str, band: tuple[float, float] | None, read: Tensor, signal: Any,
    rate: float,
) -> tuple[float, float]:  # fmt: skip
    """Where the kernel stands for the liner, Hz: by default all over the signal's band, since what
    is sent there moves |v| whether it is read or not.

    Raises:
        ValueError: it does not hold what is read; the liner is not known where the kernel needs it.
    """
    lowest, highest = signal.band or (float(read.min()), float(read.max()))
    low, high = band or (min(BAND[0], 0.9 * lowest), max(BAND[1], 1.1 * highest))
    high = min(high, 0.49 * rate)
    for f in read.tolist():
        if not low <= f <= high:
            raise ValueError(
                f"frequency {f:g} Hz is outside the kernel's band, {low:g}-{high:g} Hz; widen "
                "band= or raise sampling_rate"
            )
    known, needed = model.frequency_range, WAYS[kernel].needed((low, high), rate)
    if known is not None and not known[0] <= needed[0] < needed[1] <= known[1]:
        raise ValueError(
            f"the liner is known from {known[0]:g} to {known[1]:g} Hz; kernel {kernel!r} needs "
            f"{needed[0]:g}-{needed[1]:g} Hz: take 'least-squares' with band= within the table"
        )
    return low, high


def review_band(kernel: str, band: tuple[float, float], signal: Any, wave: Tensor, rate: float) -> None:
    """Say how much of the wave (n,) is sent where the kernel does not stand for the liner.

    Warns:
        DataWarning: more than 1 % of its energy.
    """
    low, high = WAYS[kernel].needed(band, rate)
    frequency, power = spectrum_of(wave, rate)
    outside = (frequency < low * (1 - 1e-6)) | (frequency > high * (1 + 1e-6))
    share = float(power[outside].sum() / power.sum())
    if share > UNHEARD:
        most = float(frequency[outside][power[outside].argmax()])
        tell(
            f"{100 * share:.3g} % of the energy of {signal.label}, most of it near {most:.4g} Hz, "
            f"is sent outside {low:g}-{high:g} Hz, where kernel {kernel!r} is not the liner's "
            "response; it moves |v| and so Z everywhere: widen band=, or filter the wave",
            depth=3,
        )

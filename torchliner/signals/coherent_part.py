"""Tones of a signal reconstructed from random samples, put back to their amplitudes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from torchliner.signals.arrivals import GridSignal, checked_stations, interpolate
from torchliner.signals.attenuation import ToneAttenuation
from torchliner.signals.tones import tone_amplitudes
from torchliner.signals.windows import make_window

LEAST_FACTOR = 0.3  # below, a correction would raise noise by more than a factor 3


@dataclass(frozen=True)
class CorrectedSignal:
    """A gridded signal whose tones have their amplitudes back.

    Args:
        signal: values (..., T), the rest as it was.
        amplitude: A, half the complex peak amplitude, phase at the grid's start, (..., F).
        line: the same as it stood in the gridded signal.
    """

    signal: GridSignal
    amplitude: Tensor
    line: Tensor


def corrected_coherent_part(
    signal: GridSignal, attenuation: ToneAttenuation, arrival_times: Any = None
) -> CorrectedSignal:
    """The signal with each tone's own part put back to its amplitude, all else untouched.

    The line of the tone is read off by an exact fit over the whole record, A follows from G and H,
    and replaces it. Noise at the line is raised by 1/G with it. What the reconstruction took from
    the turbulence stays lost. Noise that it made of the tone stays in the signal, unless the
    arrivals are given: then the whole reconstruction of the tone, line and noise, is taken out.
    Several tones are treated one by one.

    Args:
        signal: from ``onto_grid``.
        attenuation: from ``tone_attenuation`` with one segment, for the same arrivals and grid.
        arrival_times: s, those of the signal, (N,), or a list of such.
    Raises:
        ValueError: grids, methods or bands differ, several segments, a factor below 0.3 (the
            correction would raise noise by more than 3).
    """
    made_by, meant_for = ((each.method, each.band, each.grid) for each in (signal, attenuation))
    if made_by != meant_for:
        raise ValueError(
            "the signal is {} (band {}) on {}, ".format(*made_by)
            + "the attenuation {} (band {}) on {}; ".format(*meant_for)
            + "give tone_attenuation the signal's grid, method and band"
        )
    segments, smallest = attenuation.factor.shape[-2], float(attenuation.factor.abs().min())
    if segments != 1:
        raise ValueError(
            f"the attenuation is that of {segments} segments; the correction takes that of the "
            "whole record, segment=None"
        )
    if smallest < LEAST_FACTOR:
        raise ValueError(
            f"the factor is {smallest:.3g}; a correction would raise noise {1 / smallest:.3g} "
            f"times (limit: factor {LEAST_FACTOR:g}); more arrivals are needed"
        )
    grid, frequency = signal.grid, attenuation.frequency
    weights = make_window(attenuation.window, grid.samples).weights
    line = tone_amplitudes(signal.values, frequency, grid.rate, weights)
    amplitude = attenuation.true_amplitude(line[..., None, :])[..., 0, :]
    if arrival_times is None:
        made = _tones(line, frequency, grid.times - grid.start)
    else:
        made = _made_of_tones(arrival_times, amplitude, attenuation)
    true = _tones(amplitude, frequency, grid.times - grid.start)
    values = signal.values + (true - made).to(signal.values.device)
    return CorrectedSignal(replace(signal, values=values), amplitude, line)


def _tones(amplitude: Tensor, frequency: Tensor, seconds: Tensor) -> Tensor:
    """Sum over f of A e^{j omega t} + A* e^{-j omega t}: (..., F) to (..., t)."""
    turns = 2 * torch.pi * torch.outer(frequency.cpu(), seconds)
    return 2 * (amplitude.real @ turns.cos() - amplitude.imag @ turns.sin())


def _made_of_tones(arrival_times: Any, amplitude: Tensor, attenuation: ToneAttenuation) -> Tensor:
    """What the reconstruction makes of tones known at the arrivals alone."""
    stations, _ = checked_stations(arrival_times)
    each = amplitude.reshape(-1, amplitude.shape[-1])
    if len(stations) != len(each):
        raise ValueError(f"{len(stations)} stations of arrivals for {len(each)} of signals")
    grid, parts = attenuation.grid, []
    for (times, _), found in zip(stations, each, strict=True):
        tone = _tones(found, attenuation.frequency, times - grid.start)
        parts.append(interpolate(times, tone, grid, attenuation.method, attenuation.band))
    return torch.stack(parts).reshape(*amplitude.shape[:-1], grid.samples)

"""From waves along a wall to an impedance with error bars: what all methods of waves share.

A method says what waves pressures hold. The dispersion relation makes an impedance of one of them; error bars come from
what the waves leave, to first order, and from draws of the microphones' errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import torch
from torch import Tensor

from torchliner.checks import require_choice, tell
from torchliner.duct.dispersion import impedance_from_wavenumber
from torchliner.names import CONDITIONS
from torchliner.pressure.from_source import FromSource
from torchliner.pressure.microphone_errors import CONTRADICTED, MicrophoneErrors, largest_misfit
from torchliner.pressure.wave_notes import Notes, misfit_notes, wave_notes
from torchliner.records import WallEduction
from torchliner.version import __version__

STEP = 1e-4  # of the errors' unit; the slope of Z errs by its square


class Waves(NamedTuple):
    """What a method finds in pressures (..., N, F), along s.

    Args:
        wavenumber: alpha' of the wave whose impedance is wanted, (..., F); nan for none.
        modes: alpha' of all waves, (..., K, F).
        amplitudes: theirs at s = 0, Pa, (..., K, F).
        residual: rms of what they leave over that of the pressures, (..., F).
        singular_values: of the prediction matrix, (..., L, F); None for fits.
        settled: whether the fit ended, (..., F); None without a search.
    """

    wavenumber: Tensor
    modes: Tensor
    amplitudes: Tensor
    residual: Tensor
    singular_values: Tensor | None = None
    settled: Tensor | None = None


def educe_waves(
    seen: FromSource,
    waves_of: Callable[[Tensor], Waves],
    *,
    method: str,
    unknowns: int,
    condition: str,
    errors: MicrophoneErrors,
    choices: dict[str, Any],
    notes: Callable[[WallEduction], Notes] = lambda _: (),
    unit: Tensor | None = None,
    rank: int | None = None,
    order: int | None = None,
) -> WallEduction:
    """The impedance of a line's waves, its error bars and its warnings, which are told.

    Args:
        seen: the line along s.
        waves_of: the method, of pressures along s, (..., N, F), with any leading axes.
        method: for tables and legends.
        unknowns: U, complex ones of the waves.
        condition: at the liner.
        errors: of the microphones.
        choices: the method's own.
        notes: the method's own warnings.
        unit: in whose shares the errors behind the covariance are equal, (..., N, F); default the rms of the line.
        rank, order: K and L of a prediction.
    """
    require_choice("condition", condition, CONDITIONS)
    line, pressure = seen.line, seen.pressure
    about = {
        **choices,
        "condition": condition,
        "source_side": seen.source_side,
        "source": line.name,
        "microphones": line.microphones,
        "mach": line.stated_mach,
        "sound_speed": float(line.fluid.sound_speed),
        "version": __version__,
    }

    def impedance_of(wave: Tensor) -> Tensor:
        there = ~torch.isnan(wave)
        found = impedance_from_wavenumber(
            torch.where(there, wave, 1 + 0j),
            line.frequency.to(wave.device),
            height=line.duct_height,
            mach=seen.mach,
            sound_speed=line.fluid.sound_speed,
            condition=condition,
        )
        return torch.where(there, found, complex(math.nan, math.nan))

    def record_of(waves: Waves) -> WallEduction:
        settled = {} if waves.settled is None else {"unsettled": int((~waves.settled).sum())}
        return WallEduction(
            method=method,
            frequency=line.frequency,
            x=line.x,
            wavenumber=seen.sign * waves.wavenumber,
            impedance=impedance_of(waves.wavenumber),
            modes=seen.sign * waves.modes,
            amplitudes=waves.amplitudes,
            origin=seen.origin,
            residual=waves.residual,
            source_side=seen.source_side,
            singular_values=waves.singular_values,
            rank=rank,
            order=order,
            choices={**about, **settled},
            line=line,
        )

    result, spare = record_of(waves_of(pressure)), line.microphones - unknowns
    freedom = errors.freedom(spare)
    covariance = None
    if spare > 0 and pressure.ndim == 2:
        rms = pressure.abs().square().mean(0).sqrt().expand(pressure.shape)
        slope = _slopes(lambda p: impedance_of(waves_of(p).wavenumber), pressure, rms if unit is None else unit)
        # Half of the complex variance belongs to each part.
        variance = result.residual.square() * line.microphones / (2 * spare)
        covariance = variance[:, None, None] * torch.einsum("dfi,dfj->fij", slope, slope)
    result = replace(
        result,
        misfit=errors.misfit(result.residual, line.microphones, unknowns),
        covariance=covariance,
        freedom=2 * spare,
        choices={**result.choices, **errors.choices, "largest_misfit": largest_misfit(freedom, CONTRADICTED)},
    )
    if errors.draws:
        drawn, said = errors.drawn(pressure, result.error_scale, freedom)
        result = replace(result, draws=record_of(waves_of(drawn)), choices={**result.choices, **said})
    found = (*notes(result), *wave_notes(result), *misfit_notes(result, freedom))
    tell([str(note) for note in found], depth=2)
    return replace(result, notes=found)


def _slopes(impedance: Callable[[Tensor], Tensor], pressure: Tensor, unit: Tensor) -> Tensor:
    """Of R and X with each microphone's real, then imaginary part, (2 N, F, 2): differences of two eductions, of all
    microphones as one batch."""
    count = len(pressure)
    steps = torch.eye(count, dtype=torch.complex128, device=pressure.device) * STEP
    steps = torch.cat([steps, 1j * steps])[..., None] * unit  # (2 N, N, F)
    ahead, behind = impedance(torch.cat([pressure + steps, pressure - steps])).split(2 * count)
    return torch.view_as_real((ahead - behind) / (2 * STEP))

r"""From waves along a wall to an impedance with error bars: what all methods of waves share.

Microphones are seen from the source: with s the distance from its side the wave above the liner is
:math:`e^{-j\alpha' s}`, for a source upstream s = x, alpha' = alpha; for one downstream the array is read backwards,
s = -x, alpha' = -alpha, and the flow runs at -M along s. Error bars come from what the waves leave, to first order, and
from draws of the microphones' errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import torch
from torch import Tensor

from torchliner.checks import require_choice, tell
from torchliner.duct.dispersion import impedance_from_wavenumber
from torchliner.names import CONDITIONS, SOURCES, __version__
from torchliner.pressure.microphone_errors import CONTRADICTED, MicrophoneErrors, largest_misfit, wave_notes
from torchliner.records import MicrophoneLine, WallEduction

STEP = 1e-4  # of the errors' unit; the slope of Z errs by its square


class FromSource(NamedTuple):
    """A line seen from its source."""

    line: MicrophoneLine  # as recorded
    sign: int  # 1 for a source upstream, -1 downstream
    distance: Tensor  # s of the microphones from the first, m, (N,)
    pressure: Tensor  # Pa, (..., N, F), in the order of s
    mach: float  # of the flow along s

    @property
    def source_side(self) -> str:
        """``upstream`` or ``downstream``."""
        return SOURCES[self.sign == -1]


def seen_from_source(line: MicrophoneLine, source_side: str | None) -> FromSource:
    """The line along s; ``source_side`` None is what the line says; ValueError where that or the Mach number is not
    known."""
    side = line.source_side if source_side is None else source_side
    if side not in SOURCES:
        raise ValueError(f"{line.name}: source_side is {side!r}; give 'upstream' or 'downstream'")
    if side == "downstream":
        return FromSource(line, -1, (line.x[-1] - line.x).flip(0), line.pressure.flip(-2), -line.stated_mach)
    return FromSource(line, 1, line.x - line.x[0], line.pressure, line.stated_mach)


class Waves(NamedTuple):
    """What a method finds in pressures (..., N, F), along s."""

    wavenumber: Tensor  # alpha' of the wave whose impedance is wanted, (..., F); nan for none
    modes: Tensor  # alpha' of all waves, (..., K, F)
    amplitudes: Tensor  # theirs at s = 0, Pa, (..., K, F)
    residual: Tensor  # rms of what they leave over that of the pressures, (..., F)
    singular_values: Tensor | None = None  # of the prediction matrix, (..., L, F); None for fits
    settled: Tensor | None = None  # whether the fit ended, (..., F); None without a search


def educe_waves(
    seen: FromSource,
    waves_of: Callable[[Tensor], Waves],
    *,
    method: str,
    unknowns: int,
    condition: str,
    errors: MicrophoneErrors,
    choices: dict[str, Any],
    **about: Any,
) -> WallEduction:
    """The impedance of a line's waves, its error bars and its warnings, which are told.

    Args:
        seen: the line along s.  waves_of: the method, of pressures along s, (..., N, F), with any leading axes.
        method: for tables and legends.  unknowns: U, complex ones of the waves.  condition: at the liner.
        errors: of the microphones.  choices: the method's own.  about: further fields of the record.
    Raises:
        RuntimeError: no wave runs with the source at any frequency.
    """
    require_choice("condition", condition, CONDITIONS)
    line, pressure, count, spare = seen.line, seen.pressure, seen.line.microphones, seen.line.microphones - unknowns
    freedom = errors.freedom(spare)
    duct = {"height": line.duct_height, "mach": seen.mach, "sound_speed": line.fluid.sound_speed}
    choices = choices | {"condition": condition, "source_side": seen.source_side, "source": line.name}
    choices |= {"microphones": count, "mach": line.stated_mach, "sound_speed": float(line.fluid.sound_speed)}
    choices |= {"version": __version__, **errors.choices, "largest_misfit": largest_misfit(freedom, CONTRADICTED)}

    def impedance_of(waves: Waves) -> Tensor:
        frequency = line.frequency.to(waves.wavenumber.device)
        return impedance_from_wavenumber(waves.wavenumber, frequency, **duct, condition=condition)

    def record_of(pressure: Tensor) -> WallEduction:
        waves = waves_of(pressure)
        settled = {} if waves.settled is None else {"unsettled": int((~waves.settled).sum())}
        return WallEduction(
            method=method,
            frequency=line.frequency,
            x=line.x,
            wavenumber=seen.sign * waves.wavenumber,
            impedance=impedance_of(waves),
            modes=seen.sign * waves.modes,
            amplitudes=waves.amplitudes,
            origin=float(line.x[0 if seen.sign == 1 else -1]),
            residual=waves.residual,
            misfit=errors.misfit(waves.residual, count, unknowns),
            source_side=seen.source_side,
            singular_values=waves.singular_values,
            choices={**choices, **settled},
            line=line,
            freedom=2 * spare,
            **about,
        )

    result = record_of(pressure)
    if not bool(torch.isfinite(result.wavenumber).any()):
        text = f"none of the waves found runs away from a source {seen.source_side}; it may be on the other side"
        raise RuntimeError(f"{line.name}: {text}, or the phases of the other sign (exp(+j omega t) is needed)")
    if spare > 0 and pressure.ndim == 2:
        # Slopes of R and X with each microphone's real, then imaginary part, (2 N, F, 2): differences of two eductions,
        # of all microphones as one batch.
        steps = torch.eye(count, dtype=torch.complex128, device=pressure.device) * STEP
        steps = torch.cat([steps, 1j * steps])[..., None]
        steps = steps * pressure.abs().square().mean(0).sqrt()
        ahead, behind = impedance_of(waves_of(torch.cat([pressure + steps, pressure - steps]))).split(2 * count)
        slope = torch.view_as_real((ahead - behind) / (2 * STEP))
        # Half of the complex variance belongs to each part.
        variance = result.residual.square() * count / (2 * spare)
        covariance = variance[:, None, None] * torch.einsum("dfi,dfj->fij", slope, slope)
        result = replace(result, covariance=covariance)
    result = errors.with_draws(result, pressure, freedom, record_of)
    notes = wave_notes(result, freedom)
    tell([str(note) for note in notes], depth=2)
    return replace(result, notes=notes)

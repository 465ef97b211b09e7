"""Error bars of waves along a wall: by what the waves leave, and by draws of the microphones' errors."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from torchliner.checks import tell
from torchliner.pressure.from_source import wave_warnings, where_of
from torchliner.pressure.microphone_errors import (
    CONTRADICTED,
    POOR,
    draw_pressures,
    error_freedom,
    largest_misfit,
    misfit_of,
)
from torchliner.records import WallEduction
from torchliner.records.notes import Note

ROUNDING = 1e-10  # of the pressures: what waves without any error leave is below it
STEP = 1e-4  # of the errors' unit; the slope of Z errs by its square


def with_errors(
    result: WallEduction,
    notes: tuple[Note | str, ...],
    educe: Callable[[Tensor], WallEduction],
    pressure: Tensor,
    *,
    unknowns: int,
    draws: int,
    generator: torch.Generator | None,
    level_error: float,
    phase_error: float,
    unit: Tensor | None = None,
) -> WallEduction:
    """The result with the misfit of the assumed errors, the covariance that its residual stands for, the same eduction
    over draws of the errors, as one batch, and its notes, which are warned of.

    Args:
        result: without errors.
        notes: on the result, before those that every result of waves may have.
        educe: from pressures (D, ..., N, F).
        pressure: (..., N, F).
        unknowns: complex ones of the waves.
        draws: D; 0 for none.
        generator: default one with seed 0.
        level_error, phase_error: assumed, dB and degrees.
        unit: size of pressure, of the shape of ``pressure``, in whose shares the errors behind the covariance are
            equal; default one for all, the rms.
    """
    count, errors = pressure.shape[-2], {"level_error": level_error, "phase_error": phase_error}
    spare = count - unknowns
    misfit = misfit_of(result.residual, count, unknowns, **errors)
    if unit is None:
        unit = pressure.abs().square().mean(-2, keepdim=True).sqrt().expand(pressure.shape)
    freedom = error_freedom(spare, **errors) if spare > 0 and level_error + phase_error > 0 else math.inf
    result = replace(
        result,
        misfit=misfit,
        covariance=_residual_covariance(result, educe, pressure, spare, unit),
        freedom=2 * spare,
        choices={**result.choices, **errors, "largest_misfit": largest_misfit(freedom, CONTRADICTED)},
    )
    lost: tuple[str, ...] = ()
    if draws:
        source = generator or torch.Generator().manual_seed(0)
        drawn = educe(draw_pressures(pressure, draws, source, **errors, scale=result.error_scale, freedom=freedom))
        result = replace(result, draws=drawn, choices={**result.choices, "draws": draws, "seed": source.initial_seed()})
        without = int((~torch.isfinite(drawn.impedance)).sum())
        if without:
            lost = (
                f"{result.method}: {without} of {drawn.impedance.numel()} draws have no impedance and are left out of "
                "mean, deviation and interval",
            )
    notes = (*notes, *wave_warnings(result), *_misfit_notes(result, freedom))
    tell([str(note) for note in notes], depth=2)
    return result.with_notes(*notes, *lost)


def _misfit_notes(result: WallEduction, freedom: float) -> tuple[Note, ...]:
    """The waves leave more than the assumed errors do."""
    misfit, choices = result.misfit, result.choices
    assert misfit is not None
    limit = max(largest_misfit(freedom, POOR / misfit.numel()), choices["largest_misfit"])
    poor = (misfit > limit) & (result.residual > ROUNDING)
    if not bool(poor.any()):
        return ()
    level, phase = (float(used[poor].max()) for used in result.used_errors)
    size = None
    if result.draws is not None or result.covariance is not None:
        spread = result.standard_error if result.draws is None else result.standard_deviation
        size = float(spread[poor].abs().max())
    text = (
        f"{choices['source']}: {where_of(poor, result.frequency)} the waves leave up to "
        f"{100 * float(result.residual[poor].max()):.2g} % of the pressures, {float(misfit[poor].max()) ** 0.5:.3g} "
        f"times what errors of {choices['level_error']:g} dB and {choices['phase_error']:g} degrees leave (once in 100 "
        f"times it is above {limit**0.5:.3g}): these waves are not all there is, or the microphones err by up to "
        f"{level:.2g} dB and {phase:.2g} degrees, which the error bars of draws take; compare other ranks, margins and "
        "methods, or state the errors (level_error, phase_error)"
    )
    return (Note("model-misfit", text, size),)


def _residual_covariance(
    result: WallEduction, educe: Callable[[Tensor], WallEduction], pressure: Tensor,
    freedom: int, unit: Tensor,
) -> Tensor | None:  # fmt: skip
    """(F, 2, 2) of (R, X) for errors as large as what the waves leave; None without a degree of
    freedom, N microphones less the complex unknowns, or for lines with leading axes.

    Errors are taken as independent and normal, of one size in Pa (or in shares of ``unit``, (N, F),
    where a fit weights so). The slope of Z with each microphone's real and imaginary part is a
    difference of two eductions, of all microphones as one batch.
    """
    if freedom < 1 or pressure.ndim > 2:
        return None
    count = len(pressure)
    steps = torch.eye(count, dtype=torch.complex128, device=pressure.device) * STEP
    steps = torch.cat([steps, 1j * steps])[..., None] * unit  # (2 N, N, F)
    both = educe(torch.cat([pressure + steps, pressure - steps])).impedance.reshape(2, 2 * count, -1)
    slope = torch.view_as_real((both[0] - both[1]) / (2 * STEP))  # (2 N, F, 2)
    # Half of the complex variance belongs to each part.
    variance = result.residual.square() * count / (2 * freedom)
    return variance[:, None, None] * torch.einsum("dfi,dfj->fij", slope, slope)

r"""Impedance from evenly spaced microphones: Kumaresan and Tufts' wavenumber, then the dispersion
relation.

Of the K exponentials found, those that run with the source are kept, and of these the one with most
energy over the array is the wave whose impedance is returned. That the others play no part in it is
the method's assumption; a short liner's reflected and higher waves fold into it
(``docs/wall_pressure.md``).
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchliner.records import MicrophoneLine, WallEduction
from torchliner.signals.exponentials import find_exponentials
from torchliner.signals.microphone_errors import LEVEL_ERROR, PHASE_ERROR
from torchliner.wall_waves.from_source import (
    FromSource,
    duct_notes,
    over_liner,
    runs_with_source,
    wall_eduction,
    with_notes_and_draws,
)

RANK = 2


def kumaresan_tufts(
    line: MicrophoneLine,
    *,
    rank: int = RANK,
    order: int | None = None,
    source_side: str | None = None,
    condition: str = "ingard-myers",
    margin: float = 0.0,
    draws: int = 0,
    level_error: float = LEVEL_ERROR,
    phase_error: float = PHASE_ERROR,
    generator: torch.Generator | None = None,
) -> WallEduction:
    """Impedance by Kumaresan and Tufts' prediction of evenly spaced microphones.

    Args:
        line: microphones; those over the liner are used, all of them if it names no liner.
        rank: K, waves and singular values that are kept.
        order: L of the prediction, at most half the microphones; default half of them.
        source_side: ``upstream`` or ``downstream``; default what the line says.
        condition: at the liner, ``ingard-myers`` or ``continuous-velocity``.
        margin: m that the microphones keep from the liner's ends.
        draws: of the microphones' errors, 0 for none, else at least 2; 500 in the paper.
        level_error, phase_error: their standard deviations, dB and degrees.
        generator: of random numbers; default one with seed 0.
    Returns:
        Wavenumbers, impedance, singular values; with draws the same for each of them.
    Raises:
        ValueError: unequal spacing, fewer microphones than twice the order, rank above the order
            or above half the microphones, no known side of the source or
            Mach number.
        RuntimeError: no wave runs with the source at any frequency.
    Warns:
        DataWarning: higher modes are cut on, the spacing is above half a wavelength, no wave runs
            with the source somewhere or it is not the strongest, phases look conjugated, the wall
            looks rigid, or the resistance is negative; the same text is in ``notes``.
    Source: Roncen et al. (2026), sections 5.5.5 and 6.4.2; rank and order are not stated there.
    """
    seen = over_liner(line, source_side, margin=margin, condition=condition, draws=draws)
    line = seen.line
    spacing = line.require_equal_spacing("Kumaresan and Tufts' method")
    length = line.microphones // 2 if order is None else order
    if order is None and rank > length > 0:
        raise ValueError(
            f"{line.name}: {line.microphones} microphones allow an order of {length}, half of "
            f"them, which is below the rank, {rank}; use at least {2 * rank} microphones, or keep "
            "fewer waves (rank)"
        )

    def educe(pressure: Tensor) -> WallEduction:
        return _educe(pressure, seen, spacing, rank, length, condition)

    result = educe(seen.pressure)
    notes = (*duct_notes(line), *_aliasing_notes(seen, spacing), *_lost_notes(result, line.name))
    return with_notes_and_draws(
        result, notes, educe, seen.pressure, draws, generator, unknowns=2 * rank,
        level_error=level_error, phase_error=phase_error,
    )  # fmt: skip


def _educe(
    pressure: Tensor, seen: FromSource, spacing: float, rank: int, order: int, condition: str
) -> WallEduction:
    """From pressures along s, (..., N, F), with any leading axes."""
    found = find_exponentials(pressure.movedim(-2, -1), rank, order)
    along = 1j * torch.log(found.ratio) / spacing  # (..., F, K)
    with_source = runs_with_source(along)
    best = torch.where(with_source, found.energy, -1.0).argmax(-1, keepdim=True)
    wave = torch.where(with_source.any(-1), along.gather(-1, best)[..., 0], math.nan + 0j)
    return wall_eduction(
        seen, wave, along, found.amplitude, found.residual,
        method="Kumaresan-Tufts",
        condition=condition,
        choices={"method": "kumaresan-tufts", "rank": rank, "order": order},
        found={"spacing": spacing},
        singular_values=found.singular_values.movedim(-1, -2),
        rank=rank,
        order=order,
    )  # fmt: skip


def _aliasing_notes(seen: FromSource, spacing: float) -> tuple[str, ...]:
    """Re alpha is known up to 2 pi/spacing; a rigid wall's wave must lie within half of that."""
    line = seen.line
    speed = float(line.fluid.sound_speed) * (1 + seen.mach)
    limit = speed / (2 * spacing)
    above = line.frequency[line.frequency >= limit]
    if not len(above):
        return ()
    return (
        f"{line.name}: above {limit:.4g} Hz the spacing, {1e3 * spacing:.4g} mm, is more than half "
        f"the wavelength of a rigid duct's wave, and wavenumbers differ by 2 pi/spacing from the "
        f"true ones: {len(above)} frequencies from {float(above.min()):g} Hz on",
    )


def _lost_notes(result: WallEduction, name: str) -> tuple[str, ...]:
    """Frequencies without a wave; RuntimeError if there is none at all."""
    lost = ~torch.isfinite(result.wavenumber)
    if bool(lost.all()):
        raise RuntimeError(
            f"{name}: none of the waves found runs away from a source {result.source_side}; the "
            "source may be on the other side, or the phases of the other sign (exp(+j omega t) is "
            "needed)"
        )
    if not bool(lost.any()):
        return ()
    where = result.frequency[lost.reshape(-1, lost.shape[-1]).any(0).cpu()].tolist()
    return (
        f"{name}: at {int(lost.sum())} of {lost.numel()} values no wave runs away from a source "
        f"{result.source_side}, first at {where[0]:g} Hz; they are nan",
    )

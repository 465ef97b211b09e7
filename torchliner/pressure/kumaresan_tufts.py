r"""Impedance from evenly spaced microphones: Kumaresan and Tufts' wavenumber, then the dispersion
relation.

A signal of damped exponentials :math:`p_n = \sum_k a_k\lambda_k^n` obeys, conjugated and read
backwards, the prediction :math:`p^*_n = -\sum_{l=1}^{L} b_l\,p^*_{n+l}`, and each
:math:`1/\lambda_k^*` is a root of :math:`z^L + b_1 z^{L-1} + \dots + b_L`. The equations are solved
through the K largest singular values alone, which leaves noise out. Damped signals,
\|lambda\| < 1, then have their roots outside the unit circle, and the L - K roots that stand for
nothing lie inside it: so the K largest \|z\| are taken.

Of the K exponentials found, those that run with the source are kept, and of these the one with most
energy over the array is the wave whose impedance is returned. That the others play no part in it is
the method's assumption; a short liner's reflected and higher waves fold into it
(``docs/wall_pressure.md``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.checks import whole_number
from torchliner.pressure.from_source import (
    FromSource,
    duct_notes,
    over_liner,
    runs_with_source,
    wall_eduction,
)
from torchliner.pressure.microphone_errors import LEVEL_ERROR, PHASE_ERROR
from torchliner.pressure.wave_errors import with_errors
from torchliner.records import MicrophoneLine, WallEduction

RANK = 2
ROUNDING = 1e-14  # of the first singular value: what a signal without noise leaves
SIGNALS = 1 << 14  # solved at once, 4 kB each: draws of many frequencies are not held whole


def kumaresan_tufts(
    line: MicrophoneLine, *, rank: int = RANK, order: int | None = None,
    source_side: str | None = None, condition: str = "ingard-myers", margin: float = 0.0,
    draws: int = 0, level_error: float = LEVEL_ERROR, phase_error: float = PHASE_ERROR,
    generator: torch.Generator | None = None,
) -> WallEduction:  # fmt: skip
    """Impedance by Kumaresan and Tufts' prediction of evenly spaced microphones.

    Args:
        line: microphones; those over the liner are used, all of them if it names no liner.
        rank: K, waves and singular values that are kept.
        order: L of the prediction, at most half the microphones; default half of them.
        source_side: ``upstream`` or ``downstream``; default what the line says.
        condition: at the liner, ``ingard-myers`` or ``continuous-velocity``.
        margin: m that the microphones keep from the liner's ends.
        draws: of the microphones' errors, 0 for none, else at least 2; 500 in the paper.
        level_error, phase_error: standard deviations that are assumed, dB and degrees; the draws' are larger by the
            root of the misfit where the waves leave more than these errors would.
        generator: of random numbers; default one with seed 0.
    Returns:
        Wavenumbers, impedance, singular values; with draws the same for each of them.
    Raises:
        TypeError: rank, order or draws is no whole number.
        ValueError: unequal spacing, fewer microphones than twice the order, rank above the order
            or above half the microphones, no known side of the source or
            Mach number.
        RuntimeError: no wave runs with the source at any frequency.
    Warns:
        DataWarning: higher modes are cut on, the spacing is above half a wavelength, no wave runs
            with the source somewhere or it is not the strongest, phases look conjugated, the wall
            looks rigid, the resistance is negative, or the waves leave more than the assumed errors
            do ("model-misfit"); the same text is in ``notes``.
    Source: Roncen et al. (2026), sections 5.5.5 and 6.4.2; rank and order are not stated there.
    """
    seen = over_liner(line, source_side, margin=margin, condition=condition, draws=draws)
    line = seen.line
    spacing = line.require_equal_spacing("Kumaresan and Tufts' method")
    rank = whole_number("rank", rank)
    length = line.microphones // 2 if order is None else whole_number("order", order)
    if order is None and rank > length > 0:
        raise ValueError(
            f"{line.name}: {line.microphones} microphones allow an order of {length}, half of "
            f"them, which is below the rank, {rank}; use at least {2 * rank} microphones, or keep "
            "fewer waves (rank)"
        )

    def educe(pressure: Tensor) -> WallEduction:
        """From pressures along s, (..., N, F), with any leading axes."""
        found = find_exponentials(pressure.movedim(-2, -1), rank, length)
        along = 1j * torch.log(found.ratio) / spacing  # (..., F, K)
        with_source = runs_with_source(along)
        best = torch.where(with_source, found.energy, -1.0).argmax(-1, keepdim=True)
        wave = torch.where(with_source.any(-1), along.gather(-1, best)[..., 0], math.nan + 0j)
        return wall_eduction(
            seen, wave, along, found.amplitude, found.residual, method="Kumaresan-Tufts",
            condition=condition, found={"spacing": spacing},
            choices={"method": "kumaresan-tufts", "rank": rank, "order": length},
            singular_values=found.singular_values.movedim(-1, -2), rank=rank, order=length,
        )  # fmt: skip

    result = educe(seen.pressure)
    notes = (*duct_notes(line), *_aliasing_notes(seen, spacing), *_lost_notes(result, line.name))
    return with_errors(
        result, notes, educe, seen.pressure, unknowns=2 * rank, draws=draws, generator=generator,
        level_error=level_error, phase_error=phase_error,
    )  # fmt: skip


@dataclass(frozen=True)
class Exponentials:
    """What a signal is made of.

    Args:
        ratio: lambda, (..., K), largest \\|z\\| first.
        amplitude: a, at the first sample, (..., K).
        energy: sum of \\|a lambda^n\\|^2 over that of \\|p\\|^2, (..., K).
        singular_values: of the prediction matrix, all of them, (..., L).
        residual: rms of what the K exponentials leave over that of the signal, (...).
    """

    ratio: Tensor
    amplitude: Tensor
    energy: Tensor
    singular_values: Tensor
    residual: Tensor


def find_exponentials(signal: Tensor, rank: int, order: int) -> Exponentials:
    r"""Ratios and amplitudes of K exponentials by backward linear prediction.

    Args:
        signal: complex, (..., N).  rank: K, 1 to L.  order: L, at most N/2.
    Raises:
        ValueError: rank or order out of range.
    Source: Kumaresan & Tufts (1982), IEEE Trans. ASSP 30, 833, the method that Watson et al. (2015)
        and section 5.5.5 of Roncen et al. (2026) use; neither rank nor order is stated there.
    """
    samples = signal.shape[-1]
    if order < 1 or samples < 2 * order:
        raise ValueError(
            f"{samples} microphones are fewer than twice the order, {order}; lower the order to {samples // 2} or below"
        )
    if not 1 <= rank <= order:
        raise ValueError(f"rank is {rank}; it must be 1 to the order, {order}")
    values = signal.to(torch.complex128)
    parts = [_exponentials(each, rank, order) for each in values.reshape(-1, samples).split(SIGNALS)]
    return Exponentials(*(
        torch.cat(each).reshape((*values.shape[:-1], *each[0].shape[1:]))
        for each in zip(*(tuple(vars(part).values()) for part in parts), strict=True)
    ))  # fmt: skip


def _exponentials(values: Tensor, rank: int, order: int) -> Exponentials:
    """Of some signals, (S, N)."""
    windows = values.conj().unfold(-1, order + 1, 1)  # (..., N - L, L + 1)
    u, s, vh = torch.linalg.svd(windows[..., 1:], full_matrices=False)
    floor = ROUNDING * s[..., :1]
    inverse = torch.where(s > floor, 1 / s.clamp(min=1e-300), 0.0)[..., :rank, None]
    aside = inverse * (u[..., :rank].mH @ windows[..., :1])
    weights = -(vh[..., :rank, :].mH @ aside)[..., 0]
    roots = _polynomial_roots(weights)
    chosen = roots.abs().argsort(-1, descending=True)[..., :rank]
    kept = roots.gather(-1, chosen)
    # A root at 0, of a rank above what the signal holds, is no exponential; it gets no amplitude.
    ratio = 1 / torch.where(kept.abs() > ROUNDING, kept, ROUNDING).conj()
    amplitude, energy, residual = _fit_amplitudes(values, ratio)
    return Exponentials(ratio, amplitude, energy, s, residual)


def _polynomial_roots(weights: Tensor) -> Tensor:
    """Roots of z^L + b_1 z^(L-1) + ... + b_L, (..., L), as eigenvalues of the companion matrix."""
    order = weights.shape[-1]
    companion = torch.zeros(*weights.shape, order, dtype=weights.dtype, device=weights.device)
    companion[..., 0, :] = -weights
    if order > 1:
        companion[..., range(1, order), range(order - 1)] = 1
    return torch.linalg.eigvals(companion)


def _fit_amplitudes(signal: Tensor, ratio: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Amplitudes at the first sample (..., K), energies (..., K) and relative residual (...).

    Args:
        signal: complex, (..., N).  ratio: lambda, (..., K).
    """
    steps = torch.arange(signal.shape[-1], dtype=torch.float64, device=signal.device)
    # Growing waves are referred to the last sample, so that no power overflows.
    grows = ratio.abs() > 1
    shift = torch.where(grows, steps[-1], 0.0)
    columns = (ratio[..., None, :] + 0j) ** (steps[:, None] - shift[..., None, :])
    amplitude = (torch.linalg.pinv(columns) @ signal[..., None])[..., 0]
    left = signal - (columns @ amplitude[..., None])[..., 0]
    whole = signal.abs().square().sum(-1)
    energy = amplitude.abs().square() * columns.abs().square().sum(-2) / whole[..., None]
    at_first = amplitude * ratio ** (-shift)
    return at_first, energy, (left.abs().square().sum(-1) / whole).sqrt()


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

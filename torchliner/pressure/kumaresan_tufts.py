r"""Impedance from evenly spaced microphones: Kumaresan and Tufts' wavenumber, then the dispersion relation.

Damped exponentials :math:`p_n = \sum_k a_k\lambda_k^n`, conjugated and read backwards, obey
:math:`p^*_n = -\sum_{l=1}^{L} b_l\,p^*_{n+l}`, solved through the K largest singular values, and each
:math:`1/\lambda_k^*` is a root of :math:`z^L + b_1 z^{L-1} + \dots + b_L` outside the unit circle. Of the exponentials
that run with the source the one with most energy is the wave whose impedance is returned; a short liner's reflected and
higher waves fold into it (``docs/wall_pressure.md``).
"""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import whole_number
from torchliner.pressure.microphone_errors import MicrophoneErrors
from torchliner.pressure.waves import Waves, educe_waves, seen_from_source
from torchliner.records import MicrophoneLine, WallEduction

RANK = 2
ROUNDING = 1e-14  # of the first singular value: what a signal without noise leaves
SIGNALS = 1 << 14  # solved at once, 4 kB each: draws of many frequencies are not held whole


def kumaresan_tufts(
    line: MicrophoneLine,
    *,
    rank: int = RANK,
    order: int | None = None,
    source_side: str | None = None,
    condition: str = "ingard-myers",
    margin: float = 0.0,
    **errors: Any,
) -> WallEduction:
    """Impedance by Kumaresan and Tufts' prediction of evenly spaced microphones.

    Args:
        line: microphones; those over the liner are used, all of them if it names no liner.
        rank: K, waves and singular values that are kept.
        order: L of the prediction, at most half the microphones; default half of them.
        source_side: ``upstream`` or ``downstream``; default what the line says.
        condition: at the liner, ``ingard-myers`` or ``continuous-velocity``.
        margin: m that the microphones keep from the liner's ends.
        errors: ``draws``, ``level_error``, ``phase_error`` and ``generator``, as of
            ``pressure.microphone_errors.MicrophoneErrors``.
    Returns:
        Wavenumbers, impedance, singular values; with draws the same for each of them.
    Raises:
        TypeError: rank, order or draws is no whole number.
        ValueError: unequal spacing, fewer microphones than twice the order, rank above the order, no known side of the
            source or Mach number.
        RuntimeError: no wave runs with the source at any frequency.
    Warns:
        DataWarning: the answer is doubtful; the same text is in ``notes``, with a code.
    Source: Roncen et al. (2026), sections 5.5.5 and 6.4.2; rank and order are not stated there.
    """
    seen = seen_from_source(line.over_liner(margin), source_side)
    spacing = seen.line.require_equal_spacing("Kumaresan and Tufts' method")
    rank = whole_number("rank", rank)
    length = seen.line.microphones // 2 if order is None else whole_number("order", order)
    if order is None and rank > length > 0:
        count = f"{seen.line.microphones} microphones allow an order of {length}, half of them, below the rank, {rank}"
        raise ValueError(f"{line.name}: {count}; use {2 * rank} microphones, or keep fewer waves (rank)")

    def waves_of(pressure: Tensor) -> Waves:
        ratio, amplitude, energy, singular, residual = find_exponentials(pressure.movedim(-2, -1), rank, length)
        along = 1j * torch.log(ratio) / spacing  # (..., F, K)
        # A wave runs along s if its phase does and it does not grow faster than it turns, or if it decays faster than
        # its phase turns against s, which then tells nothing.
        with_source = along.real > along.imag
        best = torch.where(with_source, energy, -1.0).argmax(-1, keepdim=True)
        wave = torch.where(with_source.any(-1), along.gather(-1, best)[..., 0], math.nan + 0j)
        modes, amplitudes, singular = (each.movedim(-1, -2) for each in (along, amplitude, singular))
        return Waves(wave, modes, amplitudes, residual, singular)

    return educe_waves(
        seen,
        waves_of,
        method="Kumaresan-Tufts",
        unknowns=2 * rank,
        condition=condition,
        errors=MicrophoneErrors(**errors),
        rank=rank,
        order=length,
        choices={"method": "kumaresan-tufts", "rank": rank, "order": length, "margin": margin, "spacing": spacing},
    )


def find_exponentials(signal: Tensor, rank: int, order: int) -> tuple[Tensor, ...]:
    """K exponentials a lambda^n of signals p (..., N) by backward linear prediction.

    Returns:
        lambda, (..., K), largest |z| first; a at the first sample, (..., K); energies, sums of |a lambda^n|^2 over that
        of |p|^2, (..., K); all singular values of the prediction matrix, (..., L); rms of what the exponentials leave
        over that of p, (...).
    Raises:
        ValueError: ``rank``, K, is not 1 to L; ``order``, L, is above N/2.
    Source: Kumaresan & Tufts (1982), IEEE Trans. ASSP 30, 833.
    """
    samples = signal.shape[-1]
    if order < 1 or samples < 2 * order:
        raise ValueError(f"{samples} microphones are fewer than twice the order, {order}; the most is {samples // 2}")
    if not 1 <= rank <= order:
        raise ValueError(f"rank is {rank}; it must be 1 to the order, {order}")
    signal = signal.to(torch.complex128)
    lead = signal.shape[:-1]
    if lead.numel() > SIGNALS:
        parts = [find_exponentials(each, rank, order) for each in signal.reshape(-1, samples).split(SIGNALS)]
        whole = (torch.cat(each) for each in zip(*parts, strict=True))
        return tuple(each.reshape(lead + each.shape[1:]) for each in whole)
    windows = signal.conj().unfold(-1, order + 1, 1)  # (..., N - L, L + 1)
    u, s, vh = torch.linalg.svd(windows[..., 1:], full_matrices=False)
    inverse = torch.where(s > ROUNDING * s[..., :1], 1 / s.clamp(min=1e-300), 0.0)[..., :rank, None]
    weights = -(vh[..., :rank, :].mH @ (inverse * (u[..., :rank].mH @ windows[..., :1])))
    # Roots of z^L + b_1 z^(L-1) + ... + b_L are the eigenvalues of the companion matrix.
    below = torch.eye(order, dtype=signal.dtype, device=signal.device)[:-1].expand(*lead, -1, -1)
    roots = torch.linalg.eigvals(torch.cat([-weights.mT, below], -2))
    kept = roots.gather(-1, roots.abs().argsort(-1, descending=True)[..., :rank])
    # A root at 0, of a rank above what the signal holds, is no exponential; it gets no amplitude.
    ratio = 1 / torch.where(kept.abs() > ROUNDING, kept, ROUNDING).conj()
    steps = torch.arange(samples, dtype=torch.float64, device=signal.device)
    # Growing waves are referred to the last sample, so that no power overflows.
    shift = torch.where(ratio.abs() > 1, steps[-1], 0.0)
    columns = ratio[..., None, :] ** (steps[:, None] - shift[..., None, :])
    amplitude = (torch.linalg.pinv(columns) @ signal[..., None])[..., 0]
    left = signal - (columns @ amplitude[..., None])[..., 0]
    power = signal.abs().square().sum(-1)
    energy = amplitude.abs().square() * columns.abs().square().sum(-2) / power[..., None]
    return ratio, amplitude * ratio ** (-shift), energy, s, (left.abs().square().sum(-1) / power).sqrt()

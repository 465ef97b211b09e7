r"""Damped exponentials in an evenly sampled signal, after Kumaresan and Tufts; many at once.

A signal :math:`p_n = \sum_k a_k\lambda_k^n` obeys, conjugated and read backwards, the prediction
:math:`p^*_n = -\sum_{l=1}^{L} b_l\,p^*_{n+l}`, and each :math:`1/\lambda_k^*` is a root of
:math:`z^L + b_1 z^{L-1} + \dots + b_L`. The equations are solved through the K largest singular
values alone, which leaves noise out. Damped signals, \|lambda\| < 1, then have their roots outside
the unit circle, and the L - K roots that stand for nothing lie inside it: so the K largest \|z\|
are taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

ROUNDING = 1e-14  # of the first singular value: what a signal without noise leaves


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
            f"{samples} microphones are fewer than twice the order, {order}; lower the order to "
            f"{samples // 2} or below"
        )
    if not 1 <= rank <= order:
        raise ValueError(f"rank is {rank}; it must be 1 to the order, {order}")
    values = signal.to(torch.complex128)
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
    amplitude, energy, residual = fit_amplitudes(values, ratio)
    return Exponentials(ratio, amplitude, energy, s, residual)


def _polynomial_roots(weights: Tensor) -> Tensor:
    """Roots of z^L + b_1 z^(L-1) + ... + b_L, (..., L), as eigenvalues of the companion matrix."""
    order = weights.shape[-1]
    companion = torch.zeros(*weights.shape, order, dtype=weights.dtype, device=weights.device)
    companion[..., 0, :] = -weights
    if order > 1:
        companion[..., range(1, order), range(order - 1)] = 1
    return torch.linalg.eigvals(companion)


def fit_amplitudes(signal: Tensor, ratio: Tensor) -> tuple[Tensor, Tensor, Tensor]:
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

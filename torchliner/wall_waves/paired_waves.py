r"""Least squares for two waves between the ends of a lined section, many lines at once.

.. math:: p(s) = A e^{-j\alpha_+ s} + B e^{-j\alpha_- (s - S)}, \quad 0 \le s \le S.

Amplitudes are solved for at every step (variable projection): with Q an orthonormal basis of the
two columns and P = 1 - QQ^H, the residual P p changes by :math:`-P\,\Phi'c` to the order that
Kaufman keeps, analytic in the wavenumbers, so Gauss-Newton has one complex unknown or two:

- free: alpha+ and alpha- each by itself;
- tied: alpha+ alone. Both belong to one wall, F(alpha+, Z) = F(alpha-, Z) = 0, so alpha- follows it
  (``carry_wavenumber``), and with (r, s) the two parts of the relation at alpha+, (R, S) those at
  alpha-, S r = R s gives :math:`d\alpha_-/d\alpha_+ = -(s'R - r'S)/(sR' - rS')`.

alpha+ is a better unknown than Z: the model is smooth in it at a rigid wall too.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from torchliner.duct.dispersion import carry_wavenumber
from torchliner.duct.relation import Duct, relation

MOST_STEPS = 60
SMALLEST_STEP = 1e-10  # of k + |alpha|, where the search ends
SETTLED_STEP = 1e-6  # ... and below which a search that ended otherwise counts as settled
ROUNDING = 1e-13  # of a cost: steps are taken while they cost no more than this
LARGEST_STEP = 0.3  # of k + |alpha|
EXACT = 1e-26  # of |p|^2
DAMPING, MOST_DAMPING = 1e-3, 1e10


class Pairs(NamedTuple):
    """Wavenumbers and amplitudes of both waves, (P, 2); relative residual, (P,); settled, (P,)."""

    wavenumber: Tensor
    amplitude: Tensor
    residual: Tensor
    settled: Tensor


class _Fit(NamedTuple):
    columns: Tensor  # (P, N, 2)
    basis: Tensor  # Q
    amplitude: Tensor
    left: Tensor  # (P, N)
    cost: Tensor


def fit_pairs(
    pressure: Tensor, distance: Tensor, weight: Tensor, duct: Duct, start: Tensor, tied: bool
) -> Pairs:
    """Best wavenumbers from a start.

    Args:
        pressure: complex, (P, N).
        distance: s, m, (N,), from 0 to S.
        weight: of each microphone, (P, N).
        duct: of each line, (P,), the flow along s.
        start: alpha+ and alpha-, (P, 2); of one wall if ``tied``.
        tied: one wall for both.
    """
    wave = start.clone()
    damping = torch.full_like(duct.wavenumber, DAMPING)
    settled = torch.zeros_like(damping, dtype=torch.bool)
    target = weight * pressure
    whole = target.abs().square().sum(-1)
    todo = torch.arange(len(wave), device=wave.device)
    for _ in range(MOST_STEPS):
        if not len(todo):
            break
        part, begin, scale = duct.at(todo), wave[todo], whole[todo]
        fit = _project(target[todo], distance, weight[todo], begin)
        step, plain = _step(fit, distance, weight[todo], begin, part, damping[todo], tied)
        size = duct.wavenumber[todo] + begin.abs().amax(-1)
        longest = step.abs().amax(-1) / (LARGEST_STEP * size)
        ahead, there = _moved(begin, step / longest.clamp(min=1)[:, None], part, tied)
        cost = _project(target[todo], distance, weight[todo], ahead).cost
        better = there & (cost <= (1 + ROUNDING) * fit.cost)
        wave[todo] = torch.where(better[:, None], ahead, begin)
        damping[todo] *= torch.where(better, 0.1, 10.0)
        still = plain.abs().amax(-1) <= SMALLEST_STEP * size
        still |= torch.minimum(cost, fit.cost) <= EXACT * scale
        settled[todo] = still | (plain.abs().amax(-1) <= SETTLED_STEP * size)
        todo = todo[~still & (damping[todo] < MOST_DAMPING)]
    last = _project(target, distance, weight, wave)
    return Pairs(wave, last.amplitude, (last.cost / whole).sqrt(), settled)


def pair_residuals(pressure: Tensor, distance: Tensor, weight: Tensor, wave: Tensor) -> Tensor:
    """Relative residuals with amplitudes solved for; arguments as of ``fit_pairs``."""
    target = weight * pressure
    return (_project(target, distance, weight, wave).cost / target.abs().square().sum(-1)).sqrt()


def _project(target: Tensor, distance: Tensor, weight: Tensor, wave: Tensor) -> _Fit:
    far = torch.stack([torch.zeros_like(distance[-1]), distance[-1]])
    columns = torch.exp(-1j * wave[..., None, :] * (distance[:, None] - far))
    columns = weight[..., None] * columns
    basis, triangle = torch.linalg.qr(columns)
    inside = basis.mH @ target[..., None]
    amplitude = torch.linalg.solve_triangular(triangle, inside, upper=True)[..., 0]
    left = target - (basis @ inside)[..., 0]
    return _Fit(columns, basis, amplitude, left, left.abs().square().sum(-1))


def _step(
    fit: _Fit, distance: Tensor, weight: Tensor, wave: Tensor, duct: Duct, damping: Tensor,
    tied: bool,
) -> tuple[Tensor, Tensor]:  # fmt: skip
    """Damped Gauss-Newton step and the undamped one, (P, 1) if tied, else (P, 2)."""
    far = torch.stack([torch.zeros_like(distance[-1]), distance[-1]])
    change = -1j * (distance[:, None] - far) * fit.columns * fit.amplitude[:, None, :]
    if tied:
        change = change[..., :1] + change[..., 1:] * _slope(wave, duct)[:, None, None]
    change = change - fit.basis @ (fit.basis.mH @ change)
    normal = change.mH @ change
    aim = change.mH @ fit.left[..., None]
    diagonal = torch.diag_embed(normal.diagonal(dim1=-2, dim2=-1))
    tiny = torch.diag_embed(torch.full_like(normal.diagonal(dim1=-2, dim2=-1), 1e-300))
    damped = torch.linalg.solve(normal + damping[:, None, None] * diagonal + tiny, aim)[..., 0]
    plain = torch.linalg.solve(normal + 1e-14 * diagonal + tiny, aim)[..., 0]
    return damped, plain


def _slope(wave: Tensor, duct: Duct) -> Tensor:
    """d alpha-/d alpha+ at one wall."""
    (r, r1, _), (s, s1, _) = relation(wave[:, 0], duct)
    (far_r, far_r1, _), (far_s, far_s1, _) = relation(wave[:, 1], duct)
    return -(s1 * far_r - r1 * far_s) / (s * far_r1 - r * far_s1)


def _moved(wave: Tensor, step: Tensor, duct: Duct, tied: bool) -> tuple[Tensor, Tensor]:
    """Both wavenumbers after a step, and whether alpha- could follow."""
    if not tied:
        return wave + step, torch.ones_like(duct.wavenumber, dtype=torch.bool)
    ahead = wave[:, 0] + step[:, 0]
    begin, end = wall_of(wave[:, 0], duct), wall_of(ahead, duct)
    # Both pairs are known up to a factor; the straight way between them is to be the short one.
    inner = begin[0].conj() * end[0] + begin[1].conj() * end[1]
    turn = torch.where(inner.abs() > 0, inner.conj() / inner.abs().clamp(min=1e-300), 1 + 0j)
    end = (end[0] * turn, end[1] * turn)
    behind, there = carry_wavenumber(duct, wave[:, 1], begin, end, first_step=1.0)
    return torch.stack([ahead, behind], -1), there & torch.isfinite(behind)


def wall_of(wavenumber: Tensor, duct: Duct) -> tuple[Tensor, Tensor]:
    """The wall (a, b), a : b = Z : 1 and |a|^2 + |b|^2 = 1, at which alpha is a root."""
    rigid, soft = relation(wavenumber, duct)
    size = (rigid[0].abs().square() + soft[0].abs().square()).sqrt().clamp(min=1e-300)
    return soft[0] / size, rigid[0] / size

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

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from torchliner.duct.dispersion import carry_wavenumber
from torchliner.duct.relation import Duct, relation
from torchliner.least_squares import Problem, System, least_squares

EXACT = 1e-26  # of |p|^2


class Pairs(NamedTuple):
    """Wavenumbers and amplitudes of both waves, (P, 2); relative residual, (P,); settled, (P,)."""

    wavenumber: Tensor
    amplitude: Tensor
    residual: Tensor
    settled: Tensor


@dataclass(frozen=True, eq=False)
class WavePairs(Problem):
    """Lines of microphones, each to be fitted by two waves.

    Args:
        pressure: complex, (P, N).  distance: s, m, (N,), from 0 to S.
        weight: of each microphone, (P, N).  duct: of each line, (P,), the flow along s.
        tied: one wall for both waves.
    """

    pressure: Tensor
    distance: Tensor
    weight: Tensor
    duct: Duct
    tied: bool

    # Sizes are relative to k + |alpha|.
    longest, tolerance, most_damping, rounding = 0.3, 1e-10, 1e10, 1e-13

    @property
    def whole(self) -> Tensor:
        """Sum of squares of the weighted pressures, (P,)."""
        return (self.weight * self.pressure).abs().square().sum(-1)

    @property
    def exact(self) -> Tensor:  # type: ignore[override]
        """Cost of rounding."""
        return EXACT * self.whole

    def at(self, index: Tensor) -> WavePairs:
        """Some lines."""
        return WavePairs(self.pressure[index], self.distance, self.weight[index],
                         self.duct.at(index), self.tied)  # fmt: skip

    def fit(self, start: Tensor) -> Pairs:
        """Best wavenumbers from alpha+ and alpha-, (P, 2), which are of one wall if tied."""
        found = least_squares(self, start)
        residual = (found.system.cost / self.whole).sqrt()
        return Pairs(found.place, found.system.amplitude, residual, found.converged)

    def residuals(self, wave: Tensor) -> Tensor:
        """Relative residuals of pairs (P, G, 2), amplitudes solved for, (P, G)."""
        left = project(self.pressure[:, None], self.distance, self.weight[:, None], wave)[-1]
        return (left.abs().square().sum(-1) / self.whole[:, None]).sqrt()

    def system(self, place: Tensor, index: Tensor) -> System:
        """Residuals and their change with alpha+, and with alpha- if it is free."""
        part = self.at(index)
        columns, basis, amplitude, left = project(part.pressure, part.distance, part.weight, place)
        change = -1j * from_ends(self.distance) * columns * amplitude[:, None, :]
        if self.tied:
            change = change[..., :1] + change[..., 1:] * _slope(place, part.duct)[:, None, None]
        change = change - basis @ (basis.mH @ change)
        return System(left, -change, amplitude)

    def size(self, place: Tensor, step: Tensor, index: Tensor) -> Tensor:
        """Of k + |alpha|."""
        return step.abs().amax(-1) / (self.duct.wavenumber[index] + place.abs().amax(-1))

    def move(self, place: Tensor, step: Tensor, index: Tensor) -> tuple[Tensor, Tensor | bool]:
        """Both wavenumbers after a step, and whether alpha- could follow."""
        if not self.tied:
            return place + step, True
        duct, ahead = self.duct.at(index), place[:, 0] + step[:, 0]
        begin, end = wall_of(place[:, 0], duct), wall_of(ahead, duct)
        # Both pairs are known up to a factor; the straight way between them is to be the short one.
        inner = begin[0].conj() * end[0] + begin[1].conj() * end[1]
        turn = torch.where(inner.abs() > 0, inner.conj() / inner.abs().clamp(min=1e-300), 1 + 0j)
        end = (end[0] * turn, end[1] * turn)
        behind, there = carry_wavenumber(duct, place[:, 1], begin, end, first_step=1.0)
        return torch.stack([ahead, behind], -1), there & torch.isfinite(behind)


def from_ends(distance: Tensor) -> Tensor:
    """s and s - S, m, (N, 2)."""
    return distance[:, None] - torch.stack([torch.zeros_like(distance[-1]), distance[-1]])


def project(pressure: Tensor, distance: Tensor, weight: Tensor, wave: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Weighted columns (..., N, 2), their orthonormal basis, the best amplitudes (..., 2) and what
    they leave of the weighted pressures, (..., N)."""
    columns = weight[..., None] * torch.exp(-1j * wave[..., None, :] * from_ends(distance))
    basis, triangle = torch.linalg.qr(columns)
    target = weight * pressure
    inside = basis.mH @ target[..., None]
    amplitude = torch.linalg.solve_triangular(triangle, inside, upper=True)[..., 0]
    return columns, basis, amplitude, target - (basis @ inside)[..., 0]


def _slope(wave: Tensor, duct: Duct) -> Tensor:
    """d alpha-/d alpha+ at one wall."""
    (r, r1), (s, s1) = relation(wave[:, 0], duct)
    (far_r, far_r1), (far_s, far_s1) = relation(wave[:, 1], duct)
    return -(s1 * far_r - r1 * far_s) / (s * far_r1 - r * far_s1)


def wall_of(wavenumber: Tensor, duct: Duct) -> tuple[Tensor, Tensor]:
    """The wall (a, b), a : b = Z : 1 and |a|^2 + |b|^2 = 1, at which alpha is a root."""
    rigid, soft = relation(wavenumber, duct)
    size = (rigid[0].abs().square() + soft[0].abs().square()).sqrt().clamp(min=1e-300)
    return soft[0] / size, rigid[0] / size

r"""The Pridmore-Brown equation from the rigid wall to the other one, by collocation in panels.

With lengths in duct heights, eta = y/H, kappa = k H, a = alpha H, sigma = kappa - a M and waves
exp(j omega t - j alpha x), the linearised Euler equations are, with zeta = v/sigma,

.. math:: p' = -j \sigma^2 \zeta, \quad \zeta' = -j (1 - a^2/\sigma^2)\, p, \quad
    u = a p/\sigma + j M' \zeta.

From p = 1, zeta = 0 on the rigid wall eta = 1 they have one solution for every a; a is a wavenumber
when that solution meets the condition on the wall eta = 0:

.. math:: F(a) = (1 - R)(1 - a M_w/\kappa) p + (1 + R) v = 0,

R = (Z - 1)/(Z + 1). With the factor (1 - a M_w/kappa), M_w the Mach number at the wall, this is
Ingard's and Myers' condition, without it continuity of velocity.

The height is cut into panels that grow from the walls to the middle; in each both equations are
integrated on Chebyshev points, which makes them one linear system for p. Neither M' nor a second
derivative enters, whose rounding grows with the fourth power of the number of points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchliner.duct.flow_profiles import MeanFlow
from torchliner.duct.polynomials import chebyshev_points, integral_matrix

WIDEST, THIN, THINNEST = 1 / 8, 1e-2, 1e-5  # panels, of the height


@dataclass(frozen=True, eq=False)
class PridmoreBrown:
    """The equations of waves at M frequencies in one flow.

    Args:
        kappa: k H, (M,).
        mach, mach_slope: M and dM/deta at the nodes, (K, N).  nodes: eta, (K, N) in K panels, falling.
        integral: from the first node of each panel, along falling eta, complex128, (K, N, N).
        myers: condition with the factor of slip.
    """

    kappa: Tensor
    mach: Tensor
    mach_slope: Tensor
    nodes: Tensor
    integral: Tensor
    myers: bool

    def at(self, index: Tensor) -> PridmoreBrown:
        """The equations of some waves."""
        return replace(self, kappa=self.kappa[index])

    def solve(self, a: Tensor) -> tuple[Tensor, Tensor]:
        """p and zeta over the nodes for each a, complex, (M,): (M, K N) each; differentiable."""
        wave = a[:, None, None]
        local = self.kappa[:, None, None] - wave * self.mach
        # p = p0 - j W A zeta, zeta = zeta0 - j W B p, A and B diagonal: (1 + W A W B) p = ...
        by_stiff = -1j * self.integral * (local**2)[..., None, :]
        by_mass = -1j * self.integral * (1 - (wave / local) ** 2)[..., None, :]
        starts = torch.stack([torch.ones_like(local), by_stiff.sum(-1)], -1)  # from (p0, zeta0)
        one = torch.eye(local.shape[-1], dtype=a.dtype, device=a.device)
        p = torch.linalg.solve_ex(one - by_stiff @ by_mass, starts)[0]  # (M, K, N, 2)
        zeta = by_mass @ p + torch.tensor([0.0, 1.0], device=a.device)
        # Panel after panel: each starts from the (p, zeta) that the one above ends with.
        state = torch.tensor([[1.0], [0.0]], dtype=a.dtype, device=a.device).expand(len(a), 2, 1)
        found = []
        for panel in torch.stack([p, zeta], 2).unbind(1):  # (M, 2, N, 2)
            found.append((panel @ state[:, None])[..., 0])
            state = found[-1][..., -1:]
        pressure, flux = torch.stack(found, 2).flatten(2).unbind(1)
        return pressure, flux

    def residual(self, a: Tensor, reflection: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """F, dF/dR and p at the wall, (M,), for walls of the reflection R, (M,)."""
        pressure, flux = (part[:, -1] for part in self.solve(a))
        mach = self.mach[-1, -1]
        wall = (1 - a * mach / self.kappa if self.myers else 1) * pressure
        velocity = (self.kappa - a * mach) * flux
        return (1 - reflection) * wall + (1 + reflection) * velocity, velocity - wall, pressure

    def velocities(self, a: Tensor, pressure: Tensor, flux: Tensor) -> tuple[Tensor, Tensor]:
        """u and v over the nodes, (M, K N)."""
        local = self.kappa[:, None] - a[:, None] * self.mach.flatten()
        return a[:, None] * pressure / local + 1j * self.mach_slope.flatten() * flux, local * flux


def equations_of(profile: MeanFlow, points: int, myers: bool, kappa: Tensor, split: int = 1) -> PridmoreBrown:
    """The equations of waves of kappa = k H, (M,), with ``points`` Chebyshev points in each panel.

    ``myers``: condition with the factor of slip.  ``split``: parts that each panel is cut into.
    """
    edges = _panel_edges(profile, split)
    # From the rigid wall down: the first panel ends at eta = 1.
    widths = (edges[1:] - edges[:-1]).flip(0)
    inner = chebyshev_points(points)
    nodes = (edges[1:].flip(0)[:, None] - widths[:, None] * torch.as_tensor(inner)).clamp(0, 1)
    height = profile.duct_height
    y = (height * nodes.numpy()).clip(0, height)
    mach, slope = torch.as_tensor(profile.mach(y)), height * torch.as_tensor(profile.mach_slope(y))
    integral = (-widths[:, None, None] * torch.as_tensor(integral_matrix(inner))).to(torch.complex128)
    mach, slope, nodes, integral = (part.to(kappa.device) for part in (mach, slope, nodes, integral))
    return PridmoreBrown(kappa, mach, slope, nodes, integral, myers)


def _panel_edges(profile: MeanFlow, split: int) -> Tensor:
    """Panels over 0..1, doubling from the walls, the first half of where M' would reach M_b.

    A wave with |a| > kappa/M has M = kappa/a near a wall at a complex y, where sigma is 0 and the
    solution singular: hence thin panels there in every sheared flow, not only in thin layers.
    """
    slope = abs(float(profile.mach_slope(0.0))) * profile.duct_height
    width = min(THIN, max(THINNEST, profile.bulk_mach / slope / 2)) if slope else WIDEST
    edges = [0.0]
    while edges[-1] < 0.5:
        edges.append(edges[-1] + width)
        width = min(2 * width, WIDEST)
    half = torch.tensor(edges, dtype=torch.float64) * (0.5 / edges[-1])
    whole = torch.cat([half, 1 - half[:-1].flip(0)])
    parts = torch.arange(split, dtype=torch.float64) / split
    inner = whole[:-1, None] + (whole[1:] - whole[:-1])[:, None] * parts
    return torch.cat([inner.flatten(), whole[-1:]])

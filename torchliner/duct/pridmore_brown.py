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

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchliner.duct.flow_profiles import MeanFlow
from torchliner.duct.polynomials import chebyshev_points, integral_matrix

WIDEST, THIN, THINNEST = 1 / 8, 1e-2, 1e-5  # panels, of the height


@dataclass(frozen=True, eq=False)
class Solution:
    """What the equation gives for each a, and its derivative by a.

    Args:
        pressure, pressure_slope: p and dp/da over the nodes, (..., N).
        flux, flux_slope: zeta and its derivative, (..., N).
        wall, wall_slope: f p at eta = 0, f the factor of slip, and its derivative, (...).
        velocity, velocity_slope: v and dv/da at eta = 0, (...).
    """

    pressure: Tensor
    pressure_slope: Tensor
    flux: Tensor
    flux_slope: Tensor
    wall: Tensor
    wall_slope: Tensor
    velocity: Tensor
    velocity_slope: Tensor

    def residual(self, reflection: Tensor) -> Tensor:
        """F of the module's text, (...)."""
        return (1 - reflection) * self.wall + (1 + reflection) * self.velocity

    def residual_slope(self, reflection: Tensor) -> Tensor:
        """dF/da, (...)."""
        return (1 - reflection) * self.wall_slope + (1 + reflection) * self.velocity_slope

    @property
    def residual_by_reflection(self) -> Tensor:
        """dF/dR, (...)."""
        return self.velocity - self.wall


@dataclass(frozen=True, eq=False)
class PridmoreBrown:
    """The equations of M waves, each with its own frequency and flow.

    Args:
        kappa: k H, real, (M,).
        mach, mach_slope: M and dM/deta at the nodes, (M, K, N), or (1, K, N) of one flow for all.
        nodes: eta, (K, N) in K panels, falling.
        integral: from the first node of each panel, along falling eta, complex128, (K, N, N).
        myers: condition with the factor of slip.
    """

    kappa: Tensor
    mach: Tensor
    mach_slope: Tensor
    nodes: Tensor
    integral: Tensor
    myers: bool

    def select(self, at: Tensor) -> PridmoreBrown:
        """The equations of some waves, by index."""
        flows = (self.mach, self.mach_slope)
        mach, slope = flows if len(self.mach) == 1 else (flow[at] for flow in flows)
        return replace(self, kappa=self.kappa[at], mach=mach, mach_slope=slope)

    def split(self, count: int) -> Iterator[PridmoreBrown]:
        """Some waves at a time."""
        for at in torch.arange(len(self.kappa), device=self.kappa.device).split(count):
            yield self.select(at)

    def solve(self, a: Tensor) -> Solution:
        """The solutions from the rigid wall; a complex, (M,)."""
        wave = a[:, None, None]
        local = self.kappa[:, None, None] - wave * self.mach
        stiff, stiff_slope = local**2, -2 * self.mach * local
        mass = 1 - (wave / local) ** 2
        mass_slope = -2 * wave / local**2 * (1 + wave * self.mach / local)
        # p = p0 - j W A zeta, zeta = zeta0 - j W B p, A and B diagonal: (1 + W A W B) p = ...
        by_stiff = -1j * self.integral * stiff[..., None, :]
        by_mass = -1j * self.integral * mass[..., None, :]
        starts = torch.stack([torch.ones_like(stiff), by_stiff.sum(-1)], -1)
        one = torch.eye(stiff.shape[-1], dtype=a.dtype, device=a.device)
        factors, pivots, _ = torch.linalg.lu_factor_ex(one - by_stiff @ by_mass)
        p = torch.linalg.lu_solve(factors, pivots, starts)  # from (p0, zeta0): (M, K, N, 2)
        zeta = by_mass @ p
        zeta[..., 1] += 1
        varied_stiff = -1j * self.integral * stiff_slope[..., None, :]
        varied_mass = -1j * self.integral * mass_slope[..., None, :] @ p
        right = varied_stiff @ zeta + by_stiff @ varied_mass
        p_slope = torch.linalg.lu_solve(factors, pivots, right)
        zeta_slope = varied_mass + by_mass @ p_slope
        return self._march(a, torch.cat([p, zeta], -2), torch.cat([p_slope, zeta_slope], -2))

    def _march(self, a: Tensor, values: Tensor, slopes: Tensor) -> Solution:
        """Panel after panel: each starts from the (p, zeta) that the one above ends with."""
        points = self.nodes.shape[1]
        ends = [points - 1, 2 * points - 1]
        state = torch.zeros(len(a), 2, 1, dtype=a.dtype, device=a.device)
        state[:, 0] = 1
        varied = torch.zeros_like(state)
        found, found_slopes = [], []
        for panel, panel_slope in zip(values.unbind(1), slopes.unbind(1), strict=True):
            found.append(panel @ state)
            found_slopes.append(panel_slope @ state + panel @ varied)
            state, varied = found[-1][:, ends], found_slopes[-1][:, ends]
        whole, whole_slope = (torch.stack(f, 1)[..., 0] for f in (found, found_slopes))
        pressure, flux = (part.flatten(1) for part in whole.split(points, -1))
        pressure_slope, flux_slope = (part.flatten(1) for part in whole_slope.split(points, -1))
        mach, kappa = self.mach[:, -1, -1], self.kappa
        factor = 1 - a * mach / kappa if self.myers else torch.ones_like(a)
        factor_slope = -mach / kappa if self.myers else torch.zeros_like(kappa)
        at_wall, at_wall_slope = pressure[:, -1], pressure_slope[:, -1]
        local = kappa - a * mach
        return Solution(
            pressure, pressure_slope, flux, flux_slope,
            wall=factor * at_wall,
            wall_slope=factor * at_wall_slope + factor_slope * at_wall,
            velocity=local * flux[:, -1],
            velocity_slope=local * flux_slope[:, -1] - mach * flux[:, -1],
        )  # fmt: skip

    def velocities(self, a: Tensor, pressure: Tensor, flux: Tensor) -> tuple[Tensor, Tensor]:
        """u and v over the nodes, (M, K N)."""
        local = self.kappa[:, None] - a[:, None] * self.mach.flatten(1)
        u = a[:, None] * pressure / local + 1j * self.mach_slope.flatten(1) * flux
        return u, local * flux


def equations_of(
    profiles: Sequence[MeanFlow], points: int, myers: bool, kappa: Tensor, flow: Tensor,
    split: int = 1,
) -> PridmoreBrown:  # fmt: skip
    """The equations of waves in one duct or several of the same height.

    Args:
        profiles: mean flows; their panels are those of the thinnest of them.
        points: Chebyshev points in each panel.  myers: condition with the factor of slip.
        kappa: k H, (M,).  flow: index of the profile of each wave, (M,).
        split: parts that each panel is cut into.
    """
    edges = panel_edges(profiles, split)
    # From the rigid wall down: the first panel ends at eta = 1.
    widths = (edges[1:] - edges[:-1]).flip(0)
    nodes = edges[1:].flip(0)[:, None] - widths[:, None] * torch.as_tensor(chebyshev_points(points))
    nodes = nodes.clamp(0, 1)  # (K, N), falling
    height = profiles[0].duct_height
    inside = (height * nodes.numpy()).clip(0, height)
    mach = torch.stack([torch.as_tensor(p.mach(inside)) for p in profiles]).to(kappa.device)
    slope = torch.stack([torch.as_tensor(p.mach_slope(inside)) for p in profiles]).to(kappa.device)
    if len(profiles) > 1:
        mach, slope = mach[flow], slope[flow]
    integral = -widths[:, None, None] * torch.as_tensor(integral_matrix(chebyshev_points(points)))
    return PridmoreBrown(
        kappa, mach, height * slope, nodes.to(kappa.device),
        integral.to(kappa.device, torch.complex128), myers,
    )  # fmt: skip


def panel_edges(profiles: Sequence[MeanFlow], split: int = 1) -> Tensor:
    """Panels over 0..1, doubling from the walls, the first half of where M' would reach M_b in the
    flow of the thinnest layer.

    A wave with |a| > kappa/M has M = kappa/a near a wall at a complex y, where sigma is 0 and the
    solution singular: hence thin panels there in every sheared flow, not only in thin layers.
    """
    width = WIDEST
    for profile in profiles:
        slope = abs(float(profile.mach_slope(0.0))) * profile.duct_height
        if slope:
            width = min(width, THIN, max(THINNEST, profile.bulk_mach / slope / 2))
    edges = [0.0]
    while edges[-1] < 0.5:
        edges.append(edges[-1] + width)
        width = min(2 * width, WIDEST)
    half = torch.tensor(edges, dtype=torch.float64) * (0.5 / edges[-1])
    whole = torch.cat([half, 1 - half[:-1].flip(0)])
    parts = torch.arange(split, dtype=torch.float64) / split
    inner = whole[:-1, None] + (whole[1:] - whole[:-1])[:, None] * parts
    return torch.cat([inner.flatten(), whole[-1:]])

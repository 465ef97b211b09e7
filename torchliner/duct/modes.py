r"""Modes of a lined duct with a sheared flow: axial wavenumbers and shapes, over frequency and Z.

With lengths in duct heights, kappa = k H, a = alpha H, sigma = kappa - a M, waves exp(j omega t - j alpha x) and
zeta = v/sigma the linearised Euler equations are

.. math:: p' = -j \sigma^2 \zeta, \quad \zeta' = -j (1 - a^2/\sigma^2)\, p, \quad
    u = a p/\sigma + j M' \zeta.

From p = 1, zeta = 0 on the rigid wall they have one solution for every a, a wavenumber where it meets the wall's law
F(a) = (1 - R)(1 - a M_w/kappa) p + (1 + R) v = 0, R = (Z - 1)/(Z + 1): with the factor in M_w, the Mach number at the
wall, Ingard's and Myers' condition, without it continuity of velocity. The height is cut into panels that grow from
the walls; in each both equations are integrated on Chebyshev points, which makes them one linear system without M'.

Mode n is the rigid mode n of the bulk flow, in closed form, followed twice: while the flow takes its shape, and while
the wall's reflection goes straight from 1 to R. So the continuous spectrum Re alpha > k/M_max is never touched.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, require_choice, whole_number
from torchliner.duct.case import require_slip_condition, wall_reflection
from torchliner.duct.dispersion import rigid_wavenumber
from torchliner.duct.flow_profiles import MeanFlow
from torchliner.duct.numerics import chebyshev_points, follow_roots, integral_matrix, interpolation_matrix, with_slopes
from torchliner.names import DIRECTIONS

WIDEST, THIN, THINNEST = 1 / 8, 1e-2, 1e-5  # panels, of the height
POINTS = 12  # Chebyshev points of a panel
MOST_MODES = 2 * POINTS  # that the points resolve
DAMPED = 0.3  # -Im over Re of kappa at first: the source grows, which sends every mode to its side, past its cut-on
CHUNK = 256  # modes followed at once: some 40 MB of matrices


class PridmoreBrown:
    """The equations in one flow, on ``POINTS`` nodes in each of K panels; ``myers``: with the factor of slip.

    Attributes:
        mach, mach_slope: M and dM/deta at the nodes, (K, N).  nodes: eta, (K, N), falling.
        integral: from the first node of each panel, along falling eta, complex128, (K, N, N).
    """

    def __init__(self, profile: MeanFlow, myers: bool = False, device: torch.device | None = None) -> None:
        self.bulk, self.myers, height = profile.bulk_mach, myers, profile.duct_height
        edges, inner = _panel_edges(profile), chebyshev_points(POINTS)
        widths = np.diff(edges)[::-1, None]  # from the rigid wall down: the first panel ends at eta = 1
        nodes = (edges[:0:-1, None] - widths * inner).clip(0, 1)
        y = (height * nodes).clip(0, height)
        integral = (-1 + 0j) * widths[..., None] * integral_matrix(inner)
        found = profile.mach(y), height * profile.mach_slope(y), nodes, integral
        self.mach, self.mach_slope, self.nodes, self.integral = (torch.as_tensor(part, device=device) for part in found)

    def solve(self, a: Tensor, kappa: Tensor, share: Any = 1.0) -> tuple[Tensor, Tensor]:
        """p and zeta over the nodes for each a and kappa, (M,): (M, K N) each; differentiable.

        ``share``, (M,): how much of its shape the flow has, from 0, the bulk flow, on.
        """
        share = torch.as_tensor(share, device=a.device)[..., None, None]
        wave = a[:, None, None]
        local = kappa[:, None, None] - wave * (self.bulk + share * (self.mach - self.bulk))
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

    def residual(self, a: Tensor, kappa: Tensor, reflection: Any, share: Any = 1.0) -> Tensor:
        """F, (M,), for walls of the reflection R, (M,)."""
        pressure, flux = (part[:, -1] for part in self.solve(a, kappa, share))
        mach = self.bulk + share * (self.mach[-1, -1] - self.bulk)
        wall = (1 - a * mach / kappa if self.myers else 1) * pressure
        return (1 - reflection) * wall + (1 + reflection) * (kappa - a * mach) * flux


def _panel_edges(profile: MeanFlow) -> np.ndarray:
    """Panels over 0..1, doubling from the walls, the first half of where M' would reach M_b."""
    # A wave with |a| > kappa/M has sigma = 0 at a complex y near a wall, where the solution is singular.
    slope = abs(float(profile.mach_slope(0.0))) * profile.duct_height
    width = min(THIN, max(THINNEST, profile.bulk_mach / slope / 2)) if slope else WIDEST
    edges = [0.0]
    while edges[-1] < 0.5:
        edges.append(edges[-1] + width)
        width = min(2 * width, WIDEST)
    half = np.array(edges) * (0.5 / edges[-1])
    return np.concatenate([half, 1 - half[-2::-1]])


@dataclass(frozen=True, eq=False)
class DuctModes:
    """Waves q(y) exp(j omega t - j alpha x); p in units of rho c^2, u and v of c; complex128.

    Args:
        frequency: Hz, (F,).  direction: ``downstream`` or ``upstream``.
        wavenumber: alpha, 1/m, (..., F, N); mode n grew out of rigid mode n.
        height: y of the nodes, m, (P,), from the rigid wall at H down to the lined one at 0, in panels of ``POINTS``,
            whose ends are there twice.
        pressure: p, 1 on the rigid wall, (..., F, N, P).
        axial, normal: u along the flow, v along +y, (..., F, N, P).
    """

    frequency: Tensor
    direction: str
    wavenumber: Tensor
    height: Tensor
    pressure: Tensor
    axial: Tensor
    normal: Tensor

    def at(self, y: Any) -> tuple[Tensor, Tensor, Tensor]:
        """p, u and v at heights y (m, (Q,)), each (..., F, N, Q).

        Raises:
            ValueError: a height outside the duct.
        """
        places = torch.as_tensor(y, dtype=torch.float64, device=self.height.device).reshape(-1)
        panels = self.height.reshape(-1, POINTS)
        top = float(panels[0, 0])
        if not bool(((places >= 0) & (places <= top)).all()):
            raise ValueError(f"heights of modes run from 0 to {top:g} m")
        panel = (places < panels[:-1, -1, None]).sum(0)
        start, end = panels[panel, 0], panels[panel, -1]
        inside = ((start - places) / (start - end)).cpu().numpy()
        matrix = torch.as_tensor(interpolation_matrix(chebyshev_points(POINTS), inside)).to(self.pressure)
        columns = panel[:, None] * POINTS + torch.arange(POINTS, device=places.device)
        p, u, v = ((field[..., columns] * matrix).sum(-1) for field in (self.pressure, self.axial, self.normal))
        return p, u, v


def duct_modes(
    profile: MeanFlow,
    frequency: Any,
    impedance: Any = torch.inf,
    *,
    count: int = 6,
    direction: str = "downstream",
    slip_condition: str | None = None,
) -> DuctModes:
    r"""Pridmore-Brown modes of a plane duct, lined at y = 0 and rigid at y = H.

    A wave that grows out of no rigid mode is not among them.

    Args:
        profile: mean flow M(y).  frequency: Hz, (F,).
        impedance: Z, normalised, v into the wall; complex, broadcast against (F,), leading axes free; infinite is
            rigid. First derivatives by Z exist.
        count: modes 0 to count - 1, at most 24.  direction: ``downstream`` or ``upstream``.
        slip_condition: as for ``DuctCase``.
    Raises:
        ValueError: a Z of nan or -1, a missing slip condition, a count below 1 or beyond what the points resolve.
        RuntimeError: modes that meet on the way.
    Warns:
        DataWarning: negative resistance.
    """
    require_choice("direction", direction, DIRECTIONS)
    if not 1 <= whole_number("count", count) <= MOST_MODES:
        raise ValueError(f"count is {count}; from one mode to {MOST_MODES} can be had")
    wanted = frequency_tensor(frequency)
    wall = wall_reflection(impedance, wanted.device)
    wanted = wanted.to(wall.device)
    slips = bool((wall != 1).any()) and require_slip_condition(profile, slip_condition)
    height = profile.duct_height
    kappa = 2 * math.pi * height / profile.sound_speed * wanted
    wall = wall.expand(np.broadcast_shapes(wall.shape, kappa.shape))
    shape = (*wall.shape, count)
    equation = PridmoreBrown(profile, slips, wall.device)
    rigid = rigid_modes(profile, kappa, count, direction)
    items = rigid.expand(shape), kappa[:, None].expand(shape), wall[..., None].expand(shape)
    parts = [_lined(equation, *part) for part in zip(*(item.reshape(-1).split(CHUNK) for item in items), strict=True)]
    a, *fields = (torch.cat(part) for part in zip(*parts, strict=True))
    waves = (part.reshape(*shape, -1) for part in fields)
    return DuctModes(wanted, direction, a.reshape(shape) / height, height * equation.nodes.flatten(), *waves)


def rigid_modes(profile: MeanFlow, kappa: Tensor, count: int, direction: str) -> Tensor:
    """alpha H of modes 0 to count - 1 between rigid walls, (F, count), at kappa = k H, (F,)."""
    number = math.pi * torch.arange(count).to(kappa)
    sign = 1 if direction == "downstream" else -1
    start = rigid_wavenumber((1 - 1j * DAMPED) * kappa[:, None], profile.bulk_mach, number, sign)
    equation, each = PridmoreBrown(profile, device=kappa.device), kappa.repeat_interleave(count)

    def value(a: Tensor, t: Tensor, k: Tensor) -> Tensor:
        return equation.residual(a, k * (1 - 1j * DAMPED * (1 - t)), 1.0, t)

    return _followed(value, start.reshape(-1), each, each).reshape(-1, count)


def _lined(equation: PridmoreBrown, rigid: Tensor, kappa: Tensor, wall: Tensor) -> tuple[Tensor, ...]:
    """alpha H, (M,), and p, u, v over the nodes, (M, P), of modes followed from rigid ones to the wall's R."""

    def value(a: Tensor, t: Tensor, k: Tensor, r: Tensor) -> Tensor:
        return equation.residual(a, k, 1 + t * (r - 1))

    a = _followed(value, rigid, kappa, kappa, wall.detach())
    if wall.requires_grad:
        # One more step of Newton's, from a root: it moves nothing, but hands derivatives by R on.
        _, slope = with_slopes(lambda z: value(z, torch.ones_like(kappa), kappa, wall.detach()), a)
        a = a - equation.residual(a, kappa, wall) / slope
    pressure, flux = equation.solve(a, kappa)
    local = kappa[:, None] - a[:, None] * equation.mach.flatten()
    axial = a[:, None] * pressure / local + 1j * equation.mach_slope.flatten() * flux
    return a, pressure, axial, local * flux


def _followed(value: Any, start: Tensor, kappa: Tensor, *more: Tensor) -> Tensor:
    """Roots a of value(a, t, *more) followed from t = 0 to 1, items of (M,); RuntimeError where one stalls."""

    def condition(a: Tensor, t: Tensor, index: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        found, slope, rate = with_slopes(lambda z, s: value(z, s, *(part[index] for part in more)), a, t)
        return found, slope, rate

    a, place = follow_roots(condition, start)
    if bool((place < 1).any()):
        i = int(place.argmin())
        raise RuntimeError(
            f"the mode at alpha H = {complex(a[i]):.5g}, k H = {float(kappa[i]):.4g} cannot be followed beyond "
            f"{float(place[i]):.4g} of its way from the rigid duct: another mode meets it there; a slightly different "
            "impedance or frequency goes round"
        )
    return a


def cut_on_frequency(profile: MeanFlow, mode: int = 1) -> float:
    r"""Cut-on frequency of mode n between rigid walls in the bulk flow, n c sqrt(1 - M^2)/(2 H), Hz; shear lowers it by
    less than 1 %."""
    return mode * profile.sound_speed * math.sqrt(1 - profile.bulk_mach**2) / (2 * profile.duct_height)

"""Modes of a lined duct with a sheared flow: axial wavenumbers and shapes, over frequency and Z."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, require_choice, whole_number
from torchliner.duct.flow_profiles import MeanFlow
from torchliner.duct.polynomials import chebyshev_points, interpolation_matrix
from torchliner.duct.pridmore_brown import PridmoreBrown, equations_of
from torchliner.duct.rigid_spectrum import rigid_wavenumbers
from torchliner.duct.roots import follow_roots, newton, with_slope
from torchliner.duct.wall_impedance import require_slip_condition, result_type, wall_reflection
from torchliner.names import DIRECTIONS

CHUNK = 256  # modes solved at once: some 40 MB of matrices
SETTLED = 1e-8  # of alpha H: the last correction of a mode that was found
TWINS = 1e-6  # of alpha H: modes that are one


@dataclass(frozen=True, eq=False)
class DuctModes:
    """Waves q(y) exp(j omega t - j alpha x); p in units of rho c^2, u and v of c.

    Args:
        frequency: Hz, (F,).  direction: ``downstream`` or ``upstream``, that of the group velocity.
        wavenumber: alpha, 1/m, (..., F, N); mode n grew out of rigid mode n.
        height: y of the nodes, m, (P,), from the rigid wall at H down to the lined one at 0, in
            panels of ``points`` each, whose ends are there twice.
        pressure: p, 1 on the rigid wall, (..., F, N, P).
        axial, normal: u along the flow, v along +y, (..., F, N, P).  points: nodes in each panel.
    """

    frequency: Tensor
    direction: str
    wavenumber: Tensor
    height: Tensor
    pressure: Tensor
    axial: Tensor
    normal: Tensor
    points: int

    def at(self, y: Any) -> tuple[Tensor, Tensor, Tensor]:
        """p, u and v at heights y (m, (Q,)), each (..., F, N, Q).

        Raises:
            ValueError: a height outside the duct.
        """
        places = torch.as_tensor(y, dtype=torch.float64, device=self.height.device).reshape(-1)
        panels = self.height.reshape(-1, self.points)
        top = float(panels[0, 0])
        if not bool(((places >= 0) & (places <= top)).all()):
            raise ValueError(f"heights of modes run from 0 to {top:g} m")
        panel = (places < panels[:-1, -1, None]).sum(0)
        start, end = panels[panel, 0], panels[panel, -1]
        inside = ((start - places) / (start - end)).cpu().numpy()
        matrix = torch.as_tensor(interpolation_matrix(chebyshev_points(self.points), inside)).to(self.pressure)
        columns = panel[:, None] * self.points + torch.arange(self.points, device=places.device)
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
    points: int = 12,
) -> DuctModes:
    r"""Pridmore-Brown modes of a plane duct, lined at y = 0 and rigid at y = H.

    The rigid duct's wavenumbers come from the eigenvalues of the linearised Euler equations at
    Chebyshev points; each is then followed as the wall's reflection runs from 1 to R, Newton's
    method on the Pridmore-Brown equation at every step, so that mode n is the one that grew out of
    rigid mode n and the continuous spectrum Re alpha > k/M_max is never touched. The way decides
    the number where modes come close: ``wavenumber_from_impedance`` follows 1/Z, and its mode n may
    be another. A wave that grows out of no rigid mode is not among them: see ``growing_wave``.

    Args:
        profile: mean flow M(y).  frequency: Hz, (F,).
        impedance: Z, normalised, v into the wall; complex, broadcast against (F,), leading axes
            free; infinite is rigid. First derivatives of every output by Z exist.
        count: modes 0 to count - 1.  direction: ``downstream`` or ``upstream``.
        slip_condition: ``ingard-myers`` (displacement is continuous) or ``continuous-velocity``;
            needed for a lined wall along which the flow slips.
        points: Chebyshev points in each panel of the height, see ``pridmore_brown``.
    Returns:
        Modes on the device of ``impedance`` if it is a tensor, else of ``frequency``; complex64 if
        ``impedance`` is, else complex128.
    Raises:
        ValueError: see ``wall_reflection``, ``frequency_tensor``; a slip condition is missing or
            unknown; a count below 1.
        RuntimeError: modes that the points do not resolve, or that meet on the way.
    Warns:
        DataWarning: negative resistance.
    """
    require_choice("direction", direction, DIRECTIONS)
    if whole_number("count", count) < 1:
        raise ValueError(f"count is {count}; at least one mode is needed")
    wanted = frequency_tensor(frequency)
    wall = wall_reflection(impedance, wanted.device)
    wanted = wanted.to(wall.device)
    slips = bool((wall != 1).any()) and require_slip_condition(profile, slip_condition)
    kappa = 2 * math.pi * profile.duct_height / profile.sound_speed * wanted
    try:
        wall = torch.broadcast_to(wall, np.broadcast_shapes(wall.shape, kappa.shape))
    except ValueError:
        raise ValueError(
            f"impedance has shape {tuple(wall.shape)}, which does not broadcast against (F,) = {tuple(kappa.shape)}"
        ) from None
    shape = (*wall.shape, count)
    equation = equations_of(profile, points, slips, kappa[:, None].expand(shape).reshape(-1))
    with torch.no_grad():
        rigid = _rigid(
            equations_of(profile, points, False, kappa.repeat_interleave(count)), profile, kappa, count, direction
        )
    starts, walls = rigid.expand(shape).reshape(-1), wall[..., None].expand(shape).reshape(-1)
    parts = [
        _lined(equation.at(at), starts[at], walls[at])
        for at in torch.arange(len(starts), device=wall.device).split(CHUNK)
    ]
    a, pressure, u, v = (torch.cat(part).to(result_type(impedance)) for part in zip(*parts, strict=True))
    pressure, u, v = (part.reshape(*shape, -1) for part in (pressure, u, v))
    height = profile.duct_height
    return DuctModes(
        wanted, direction, a.reshape(shape) / height, height * equation.nodes.flatten(), pressure, u, v, points
    )


def _rigid(equation: PridmoreBrown, profile: MeanFlow, kappa: Tensor, count: int, direction: str) -> Tensor:
    """Rigid wavenumbers alpha H, (F, count): those of the eigenvalues, polished."""
    rough = rigid_wavenumbers(profile, kappa, count, direction).reshape(-1)
    one, each = torch.ones_like(rough), equation.kappa
    found, last = newton(lambda a: with_slope(lambda z: equation.residual(z, one)[0], a), rough)
    failed = (~(last < SETTLED)).nonzero()[:, 0]
    if len(failed):
        i = int(failed[0])
        raise RuntimeError(
            f"the wavenumber near alpha H = {complex(rough[i]):.4g} at k H = {float(each[i]):.4g} does not settle "
            f"(last correction {float(last[i]):.2g}): a mode exactly at cut-on has no single wavenumber, and too few "
            "points resolve none"
        )
    found = found.reshape(-1, count)
    twins = torch.triu((found[:, :, None] - found[:, None]).abs() < TWINS, diagonal=1).nonzero()
    if len(twins):
        at, one_of, other = twins[0].tolist()
        raise RuntimeError(
            f"rigid modes {one_of} and {other} at k H = {float(kappa[at]):.4g} come out the same: they are not "
            "resolved; take fewer modes"
        )
    return found


def _lined(equation: PridmoreBrown, rigid: Tensor, wall: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """alpha H, (M,), and p, u, v over the nodes, (M, P), of modes followed from rigid ones to the wall's R.

    On the way Z(t) + 1 = (Z + 1)/t: every wall is passive if the last one is, and Z = 0 is a point like others.
    """
    change = wall.detach() - 1

    def condition(a: Tensor, t: Tensor, index: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        part, rates = equation.at(index), []

        def value(z: Tensor) -> Tensor:
            found, rate, _ = part.residual(z, 1 + t * change[index])
            rates.append(rate.detach() * change[index])
            return found

        return (*with_slope(value, a), rates[0])

    a, place = follow_roots(condition, rigid)
    stuck = (place < 1).nonzero()[:, 0]
    if len(stuck):
        i = int(stuck[0])
        raise RuntimeError(
            f"the mode at alpha H = {complex(a[i]):.5g}, k H = {float(equation.kappa[i]):.4g} cannot be followed "
            f"beyond {float(place[i]):.4g} of the way to R = {complex(wall[i]):.4g}: another mode meets it there; a "
            "slightly different impedance or frequency goes round"
        )
    if wall.requires_grad:
        # One more step of Newton's, from a root: it moves nothing, but hands derivatives by R on.
        _, slope, _ = condition(a, place, torch.arange(len(a), device=a.device))
        a = a - equation.residual(a, wall)[0] / slope
    pressure, flux = equation.solve(a)
    return a, pressure, *equation.velocities(a, pressure, flux)

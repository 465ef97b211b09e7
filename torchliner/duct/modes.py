"""Modes of a lined duct with a sheared flow: axial wavenumbers and shapes, over frequency and Z."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, require_choice, whole_number
from torchliner.duct.flow_profiles import MeanFlow
from torchliner.duct.homotopy import follow, polish
from torchliner.duct.polynomials import chebyshev_points, interpolation_matrix
from torchliner.duct.pridmore_brown import PridmoreBrown, equations_of
from torchliner.duct.relation import DIRECTIONS
from torchliner.duct.rigid_spectrum import rigid_wavenumbers
from torchliner.duct.wall_impedance import require_slip_condition, result_type, wall_reflection

CHUNK = 256  # modes solved at once: some 40 MB of matrices


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
        matrix = torch.as_tensor(interpolation_matrix(chebyshev_points(self.points), inside))
        columns = panel[:, None] * self.points + torch.arange(self.points, device=places.device)
        matrix = matrix.to(self.pressure)
        fields = (self.pressure, self.axial, self.normal)
        p, u, v = ((field[..., columns] * matrix).sum(-1) for field in fields)
        return p, u, v


def duct_modes(
    profile: MeanFlow | Sequence[MeanFlow], frequency: Any, impedance: Any = torch.inf, *,
    count: int = 6, direction: str = "downstream", slip_condition: str | None = None,
    points: int = 12,
) -> DuctModes:  # fmt: skip
    r"""Pridmore-Brown modes of a plane duct, lined at y = 0 and rigid at y = H.

    The rigid duct's wavenumbers come from the eigenvalues of the linearised Euler equations at
    Chebyshev points; each is then followed as the wall's reflection runs from 1 to R, Newton's
    method on the Pridmore-Brown equation at every step, so that mode n is the one that grew out of
    rigid mode n and the continuous spectrum Re alpha > k/M_max is never touched. The way decides
    the number where modes come close: ``wavenumber_from_impedance`` follows 1/Z, and its mode n may
    be another. A wave that grows out of no rigid mode is not among them: see ``growing_wave``.

    Args:
        profile: mean flow M(y); or several of one duct height and sound speed, which are an axis P
            in front of the frequencies. They share the panels of the thinnest layer among them.
        frequency: Hz, (F,).
        impedance: Z, normalised, v into the wall; complex, broadcast against (F,) or (P, F),
            leading axes free; infinite is rigid. First derivatives of every output by Z exist.
        count: modes 0 to count - 1.  direction: ``downstream`` or ``upstream``.
        slip_condition: ``ingard-myers`` (displacement is continuous) or ``continuous-velocity``;
            needed for a lined wall along which the flow slips.
        points: Chebyshev points in each panel of the height, see ``pridmore_brown``.
    Returns:
        Modes on the device of ``impedance`` if it is a tensor, else of ``frequency``; complex64 if
        ``impedance`` is, else complex128.
    Raises:
        ValueError: see ``wall_reflection``, ``frequency_tensor``; a slip condition is missing or
            unknown; a count below 1; profiles of ducts that differ.
        RuntimeError: modes that the points do not resolve, or that meet on the way.
    Warns:
        DataWarning: negative resistance.
    """
    require_choice("direction", direction, DIRECTIONS)
    if whole_number("count", count) < 1:
        raise ValueError(f"count is {count}; at least one mode is needed")
    profiles, lead = _profiles(profile)
    wanted = frequency_tensor(frequency)
    wall = wall_reflection(impedance, wanted.device)
    wanted = wanted.to(wall.device)
    lined = bool((wall != 1).any())
    slips = [lined and require_slip_condition(flow, slip_condition) for flow in profiles]
    height = profiles[0].duct_height
    kappa = (2 * math.pi * height / profiles[0].sound_speed * wanted).expand(*lead, -1)
    try:
        wall = torch.broadcast_to(wall, np.broadcast_shapes(wall.shape, kappa.shape))
    except ValueError:
        axes = "(P, F)" if lead else "(F,)"
        raise ValueError(
            f"impedance has shape {tuple(wall.shape)}, which does not broadcast against {axes} = {tuple(kappa.shape)}"
        ) from None
    shape = (*wall.shape, count)
    number = torch.arange(len(profiles), device=kappa.device)[:, None]
    number = number.expand(-1, len(wanted)).reshape(kappa.shape)
    flat_kappa, flow, flat_wall = (item[..., None].expand(shape).reshape(-1) for item in (kappa, number, wall))
    equation = equations_of(profiles, points, any(slips), flat_kappa, flow)
    with torch.no_grad():
        rigid = torch.stack([_rigid(one, points, wanted, count, direction) for one in profiles])
    rigid = rigid.reshape(*kappa.shape, count).expand(shape).reshape(-1)
    items = zip(equation.split(CHUNK), rigid.split(CHUNK), flat_wall.split(CHUNK), strict=True)
    a, pressure, u, v = (
        torch.cat(part).to(result_type(impedance)) for part in zip(*(_solve(*item) for item in items), strict=True)
    )
    whole = (*shape, -1)
    return DuctModes(
        wanted, direction, a.reshape(shape) / height, height * equation.nodes.flatten(),
        pressure.reshape(whole), u.reshape(whole), v.reshape(whole), points,
    )  # fmt: skip


def _profiles(profile: MeanFlow | Sequence[MeanFlow]) -> tuple[list[MeanFlow], tuple[int, ...]]:
    """The flows, and the axis that they make."""
    if not isinstance(profile, Sequence):
        return [profile], ()
    flows = list(profile)
    for flow in flows:
        if not hasattr(flow, "mach_slope"):
            raise TypeError(f"profile holds {flow!r}, which is no mean flow")
    if not flows:
        raise ValueError("profile is an empty list; at least one mean flow is needed")
    for name in ("duct_height", "sound_speed"):
        values = sorted({float(getattr(flow, name)) for flow in flows})
        if len(values) > 1:
            raise ValueError(
                f"the profiles have {name} {', '.join(f'{value:g}' for value in values)}; those of "
                "one duct are solved together"
            )
    return flows, (len(flows),)


def _rigid(profile: MeanFlow, points: int, frequency: Tensor, count: int, direction: str) -> Tensor:
    """Rigid wavenumbers alpha H, (F, count), polished."""
    kappa = 2 * math.pi * profile.duct_height / profile.sound_speed * frequency
    rough = rigid_wavenumbers(profile, kappa, count, direction)
    each = kappa[:, None].expand_as(rough).reshape(-1)
    alone = torch.zeros_like(each, dtype=torch.int64)
    equation = equations_of([profile], points, False, each, alone)
    found = polish(equation, rough.reshape(-1), torch.ones_like(rough.reshape(-1)))
    found = found.reshape(rough.shape)
    twins = torch.triu((found[:, :, None] - found[:, None]).abs() < 1e-6, diagonal=1)
    if bool(twins.any()):
        which = [int(i) for i in torch.nonzero(twins)[0]]
        raise RuntimeError(
            f"rigid modes {which[1]} and {which[2]} at k H = {float(kappa[which[0]]):.4g} come out "
            "the same: they are not resolved; take fewer modes"
        )
    return found


def _solve(equation: PridmoreBrown, rigid: Tensor, wall: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    with torch.no_grad():
        found = follow(equation, rigid, wall)
        solution = equation.solve(found)
    # One more step of Newton's, from a root: it moves nothing, but hands derivatives by R on.
    change = -solution.residual(wall) / solution.residual_slope(wall).detach()
    a = found + change
    pressure = solution.pressure + solution.pressure_slope * change[:, None]
    flux = solution.flux + solution.flux_slope * change[:, None]
    return a, pressure, *equation.velocities(a, flux=flux, pressure=pressure)

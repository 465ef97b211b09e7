"""Wavenumbers of a sheared flow between rigid walls, from the eigenvalues of the whole system."""

from __future__ import annotations

import torch
from torch import Tensor

from torchliner.duct.chebyshev import chebyshev_points, derivative_matrix
from torchliner.flow_profiles import MeanFlow

CAUSAL = 1e-5  # imaginary part lent to the frequency, which sends every mode to its side
CONVECTED = 0.98  # of k/M_max: the continuous spectrum and what discretisation makes of it
INFINITE = 1e5  # of alpha H: rounding of the infinite eigenvalues, which the singular A_x has
SHIFT = 0.1 + 0.37j  # of kappa: near the plane waves, on none of them


def rigid_wavenumbers(
    profile: MeanFlow, kappa: Tensor, count: int, direction: str, points: int = 32
) -> Tensor:
    r"""The ``count`` lowest modes in one direction, a = alpha H, to a few digits.

    The linearised Euler equations (kappa - j(A_y d/deta + B)) q = a A_x q in q = (p, u, v) at
    Chebyshev points, with v = 0 in place of the continuity equation at both walls (in place of the
    v equation it would leave a spurious mode). A_x is singular where M = 0, and torch knows no
    generalised eigenproblem: the shifted inverse (A - s A_x)^{-1} A_x has the eigenvalues
    1/(a - s), those near s first, and 0 for the infinite ones.

    A mode runs downstream if it decays there once the frequency has a small negative imaginary part
    (the source is switched on slowly). Number n is its place in the order of
    Re[(kappa - a M_b)^2 - a^2], which for a uniform flow is (n pi)^2.

    Args:
        profile: mean flow.
        kappa: k H, real, (F,).
        count: modes wanted.
        direction: of the group velocity.
        points: Chebyshev nodes.
    Returns:
        (F, count), complex128.
    Raises:
        RuntimeError: fewer acoustic modes than wanted are resolved.
    """
    device, kappa = kappa.device, kappa.cpu()  # small, and no faster elsewhere
    height, n = profile.duct_height, points
    heights = (height * chebyshev_points(n).numpy()).clip(0, height)
    mach = torch.as_tensor(profile.mach(heights)).to(torch.complex128)
    slope = height * torch.as_tensor(profile.mach_slope(heights)).to(mach)
    derivative = derivative_matrix(n).to(mach)
    still = torch.zeros(n, n, dtype=mach.dtype)
    one, flow = torch.eye(n, dtype=mach.dtype), torch.diag(mach)
    along = _blocks([[flow, one, still], [one, flow, still], [still, still, flow]])
    across = _blocks(
        [[still, still, derivative], [still, still, torch.diag(slope)], [derivative, still, still]]
    )
    damped = (kappa * (1 - 1j * CAUSAL)).to(mach)[:, None, None]
    system = damped * torch.eye(3 * n, dtype=mach.dtype) - 1j * across
    for wall in (0, n - 1):
        along[wall] = 0
        system[:, wall] = 0
        system[:, wall, 2 * n + wall] = 1
    shift = SHIFT * damped
    inverted = torch.linalg.eigvals(torch.linalg.solve(system - shift * along, along))
    infinite = inverted.abs() < 1 / INFINITE
    found = shift[..., 0] + 1 / torch.where(infinite, torch.ones_like(inverted), inverted)
    found = torch.where(infinite, torch.full_like(found, complex(torch.nan, torch.nan)), found)
    fastest = float(mach.real.max())
    return _lowest(found, kappa, profile, fastest, count, direction).to(device)


def _lowest(
    found: Tensor, kappa: Tensor, profile: MeanFlow, fastest: float, count: int, direction: str
) -> Tensor:
    wanted = found.imag < 0 if direction == "downstream" else found.imag > 0
    if fastest > 0:
        wanted = wanted & (found.real < CONVECTED * kappa[:, None] / fastest)
    number = ((kappa[:, None] - found * profile.bulk_mach) ** 2 - found**2).real
    number = torch.where(wanted, number, torch.full_like(number, torch.inf))
    ranked, order = torch.sort(number, dim=-1)
    if not bool(torch.isfinite(ranked[:, :count]).all()):
        raise RuntimeError(
            f"fewer than {count} {direction} modes are resolved; take more points or fewer modes"
        )
    return torch.gather(found, -1, order[:, :count])


def _blocks(rows: list[list[Tensor]]) -> Tensor:
    return torch.cat([torch.cat(row, -1) for row in rows], -2)

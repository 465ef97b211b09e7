"""Wavenumbers and cut-on of a flow between rigid walls, from the eigenvalues of the whole system."""

from __future__ import annotations

import math

import torch
from scipy.optimize import brentq
from torch import Tensor

from torchliner.duct.columns import blocks_of
from torchliner.duct.flow_profiles import MeanFlow, UniformProfile
from torchliner.duct.polynomials import chebyshev_points, derivative_matrix
from torchliner.names import DIRECTIONS

POINTS = 32  # Chebyshev nodes
CAUSAL = 1e-5  # imaginary part lent to the frequency, which sends every mode to its side
CONVECTED = 0.98  # of k/M_max: the continuous spectrum and what discretisation makes of it
INFINITE = 1e5  # of alpha H: rounding of the infinite eigenvalues, which the singular A_x has
SHIFT = 0.1 + 0.37j  # of kappa: near the plane waves, on none of them


def rigid_wavenumbers(profile: MeanFlow, kappa: Tensor, count: int, direction: str) -> Tensor:
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
        profile: mean flow.  kappa: k H, real, (F,).  count: modes wanted.  direction: of the group velocity.
    Returns:
        (F, count), complex128.
    Raises:
        RuntimeError: fewer acoustic modes than wanted are resolved.
    """
    device, kappa = kappa.device, kappa.cpu()  # small, and no faster elsewhere
    height, n, nodes = profile.duct_height, POINTS, chebyshev_points(POINTS)
    heights = (height * nodes).clip(0, height)
    mach, slope = (
        torch.as_tensor(part).to(torch.complex128)
        for part in (profile.mach(heights), height * profile.mach_slope(heights))
    )
    derivative = torch.as_tensor(derivative_matrix(nodes)).to(mach)
    one, flow = torch.eye(n, dtype=mach.dtype), torch.diag(mach)
    still = torch.zeros_like(one)
    along = blocks_of([[flow, one, still], [one, flow, still], [still, still, flow]])
    across = blocks_of([[still, still, derivative], [still, still, torch.diag(slope)], [derivative, still, still]])
    damped = (kappa * (1 - 1j * CAUSAL)).to(mach)[:, None, None]
    system = damped * torch.eye(3 * n, dtype=mach.dtype) - 1j * across
    for wall in (0, n - 1):
        along[wall] = system[:, wall] = 0
        system[:, wall, 2 * n + wall] = 1
    shift = SHIFT * damped
    inverted = torch.linalg.eigvals(torch.linalg.solve(system - shift * along, along))
    found = shift[..., 0] + 1 / inverted
    wanted = inverted.abs() >= 1 / INFINITE
    wanted &= found.imag < 0 if direction == "downstream" else found.imag > 0
    fastest = float(mach.real.max())
    if fastest > 0:
        wanted &= found.real < CONVECTED * kappa[:, None] / fastest
    number = ((kappa[:, None] - found * profile.bulk_mach) ** 2 - found**2).real
    ranked, order = torch.sort(torch.where(wanted, number, torch.inf), dim=-1)
    if not bool(torch.isfinite(ranked[:, :count]).all()):
        raise RuntimeError(f"fewer than {count} {direction} modes are resolved; take fewer modes")
    return torch.gather(found, -1, order[:, :count]).to(device)


def cut_on_frequency(profile: MeanFlow, mode: int = 1) -> float:
    r"""Cut-on frequency of a mode between rigid walls, Hz.

    Without shear it is n c sqrt(1 - M^2)/(2 H). With shear it is the zero of the squared half
    difference of the two wavenumbers of the mode, downstream and upstream, which is real and
    crosses zero straight where they meet.

    Args:
        profile: mean flow.  mode: n, 1 or above.
    Raises:
        ValueError: a mode below 1: the plane wave runs at every frequency; none within 0.5 to 1.5 of the uniform
            flow's.
    """
    if mode < 1:
        raise ValueError(f"mode is {mode}; the plane wave, 0, runs at every frequency")
    uniform = mode * math.pi * math.sqrt(1 - profile.bulk_mach**2)
    to_hertz = profile.sound_speed / (2 * math.pi * profile.duct_height)
    if isinstance(profile, UniformProfile):
        return to_hertz * uniform

    def difference(kappa: float) -> float:
        at = torch.tensor([kappa], dtype=torch.float64)
        down, up = (rigid_wavenumbers(profile, at, mode + 1, d)[0, mode] for d in DIRECTIONS)
        return float(((down - up) / 2).square().real)

    low, high = 0.5 * uniform, 1.5 * uniform
    if difference(low) > 0 or difference(high) < 0:
        raise RuntimeError(
            f"mode {mode} has no cut-on within 0.5 to 1.5 of that of the uniform flow, {uniform * to_hertz:.4g} Hz"
        )
    return to_hertz * float(brentq(difference, low, high, xtol=1e-9))

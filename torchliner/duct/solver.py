r"""The linearised Euler equations in a lined duct, swept once for many impedances.

Every boundary has amplitudes eta of its own: a wall half the sum of p* and w, p in units of rho c^2 and w, the velocity
of its face, of c; an end the plane-like mode that goes out. Linear in eta and finite for every wall are

.. math:: \text{wall: } x = E \eta, \quad a(X) = T \eta, \qquad
    \text{end: } s = s_0 + r c, \quad m(X) = 0, \quad \eta = c,

with X = (s_L, c_L, x, s_R, c_R) the unit waves of ``sweep.py``, a the waves (p - v)/2 that arrive at the wall and m
what goes out at an end besides its modes: one system for eta, some hundred unknowns.

Of a wall p* = (1 + R) eta and w = (1 - R) eta, R = (Z - 1)/(Z + 1), projected on the column's polynomials. Without slip
v* = w: T = 1, E = R. With slip at Mach M v* = w + (M/j k) dw/dx (Ingard, Myers): T = 1 + S, E = R - S,
S = M/(2 j k) D (1 - R), where D takes its values at element edges from downstream and is 0 beyond the last: transported
from upstream, the hydrodynamic wave grows without bound.

An end lets the plane-like mode of the rigid duct out, whose outgoing and incoming parts are a_m and b_m: of what goes
out, a, the amplitude c = (w.a)/(w.a_m), w the mean of p +- u, comes back as b = c b_m, which reflects none of that mode
(nothing coming in would reflect 1e-3 of it in a sheared flow), and r times as much of the mode the other way.
"""

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, require_choice, tell
from torchliner.duct.case import DuctCase, complex_tensor, require_slip_condition, wall_reflection
from torchliner.duct.columns import Basis
from torchliner.duct.field import DuctField, EnergyBalance
from torchliner.duct.mesh import DuctMesh, build_mesh
from torchliner.duct.modes import DuctModes, cut_on_frequency, rigid_modes
from torchliner.duct.sweep import SweptDuct
from torchliner.engine.sums import one_thread
from torchliner.names import DIRECTIONS, SOURCES

SINGULAR = 1e-6  # residual over right-hand side
CHUNK = 64 * 2**20  # bytes of matrices solved at once
GONE = 2 * math.pi  # |Im alpha| times distance: 2e-3 is left, as without sound after 2 H
RUNS = 0.03  # |Im alpha| H below which a mode is cut on, within 1e-4 of its cut-on frequency


class DuctSolver:
    """A duct and its frequencies, swept once; every impedance and source side then costs little.

    The columns of the mesh are condensed and joined by two sweeps, with the lined wall and both ends left open; the
    rest is a system of the wall's own points. The solution is that of the whole discrete system, to rounding.

    Args:
        case: the duct.  frequency: Hz, (F,).  mesh: default ``build_mesh`` for the highest frequency.
        modes: downstream and upstream, those that the ends let out; default the plane-like ones of the rigid duct.
    Raises:
        ValueError: a mesh of another duct, frequencies that are none, a missing slip condition.
    Warns:
        DataWarning: a coarse mesh, mode 1 cut on, a liner so near an end that mode 1 of its edges gets there.
    """

    def __init__(
        self,
        case: DuctCase,
        frequency: Any,
        mesh: DuctMesh | None = None,
        *,
        modes: tuple[DuctModes, DuctModes] | None = None,
    ) -> None:
        self.case, self.frequency = case, frequency_tensor(frequency)
        highest = float(self.frequency.max())
        self.mesh = mesh or build_mesh(case, highest)
        if self.mesh.case is not case:
            raise ValueError("the mesh was built for another DuctCase; build one for this")
        slips = bool(case.liner) and require_slip_condition(case.profile, case.slip_condition)
        self.mesh.warn_if_coarse(highest)
        _warn_of_mode_1(case, self.frequency)
        self.swept, self._slip = SweptDuct(self.mesh, self.frequency, modes), None
        reading = self.swept.reading
        lined, own = reading[..., 2:-2], torch.eye(reading.shape[-2], reading.shape[-1] - 4).to(reading)
        back = lined
        if slips:
            share = float(case.profile.mach(0.0)) / (2j * case.wavenumber(self.frequency))
            self._slip = share[:, None, None] * downwind_derivative(self.mesh, self.swept.basis).to(share)  # (M/2jk) D
            back, own = lined + (lined + own) @ self._slip, own + (lined + own) @ self._slip
        # The wall's part of the system is reading E - T = back R - own. Contiguous, since a number with a derivative
        # beside it may share no memory with another.
        self._back, self._own = back, own.expand_as(lined).contiguous()
        self._coming, self._going = reading[..., [0, -2]], reading[..., [1, -1]]

    def solve(self, impedance: Any = math.inf, source: str | None = None) -> DuctField:
        """The field of one or many impedances.

        Args:
            impedance: Z, normalised, v into the wall, broadcast against (F, S) for F frequencies and S lined patches,
                leading axes free; or a function of x (m, (P,)) and frequency (Hz, (F,)) that returns (..., F, P).
                0 and inf are walls like others. Gradients pass.
            source: instead of that of the case.
        Returns:
            DuctField of shape (..., F).
        Raises:
            ValueError: shapes that do not fit (of Z or of the ends' reflections), Z nan or -1.
            RuntimeError: a singular system.
        Warns:
            DataWarning: negative resistance; more energy out than in past a wall that gives none.
        """
        side, basis = require_choice("source", source or self.case.source, SOURCES), self.swept.basis
        wall = wall_matrices(impedance, self.mesh, basis, self.frequency)
        # torch 2.13 has given wrong complex LU factors of 150 rows in two threads, in a process that had drawn figures
        # and used threads before; in one thread they were right.
        with one_thread():
            waves, eta = self._closed(wall, *self._ends(side))
        mach, back = self.case.profile.bulk_mach, reflected(wall, eta)
        along, against, size = (1 + mach) ** 2, (1 - mach) ** 2, waves[..., [0, 1, -2, -1]].abs().square()
        coming = along * size[..., 0] + against * size[..., 2]
        weights = torch.outer(torch.as_tensor(self.mesh.lined_widths).to(basis.weights), basis.weights).flatten()
        absorbed = ((eta + back) * (eta - back).conj()).real @ weights / self.case.height
        energy = EnergyBalance((against * size[..., 1] + along * size[..., 3]) / coming, absorbed / coming)
        _warn_of_gain(energy, self.frequency)
        return DuctField(self.swept, side, waves, energy, impedance)

    def _ends(self, side: str) -> tuple[Tensor, Tensor]:
        """Amplitudes sent in and reflections of the left and right end, (..., F, 2)."""
        case, down = self.case, side == "upstream"
        alpha = self.swept.wavenumber[:, 0 if down else 1].real
        distance = case.place_of_incidence(side) - (case.start if down else case.end)
        amplitude = case.incident * torch.exp(1j * alpha * distance)
        sent = torch.stack([amplitude, torch.zeros_like(amplitude)], -1)
        both = [complex_tensor(r, self.frequency.device) for r in (case.source_reflection, case.end_reflection)]
        returns = torch.stack(torch.broadcast_tensors(*both, alpha)[:2], -1)
        return (sent, returns) if down else (sent.flip(-1), returns.flip(-1))

    def _closed(self, wall: Tensor, starts: Tensor, returns: Tensor) -> tuple[Tensor, Tensor]:
        """X, (..., F, D), and eta of the wall, (..., F, W), for walls R, (..., F, C, n, n), and s0 and r of both ends,
        (..., F, 2): some items at a time, so that their matrices do not pile up."""
        parts = (wall, 4), (starts, 2), (returns, 2)
        lead = torch.Size(np.broadcast_shapes(*(part.shape[:-inner] for part, inner in parts)))
        step = max(1, CHUNK // (16 * self._back.shape[-2] ** 2 * len(self._back)))
        flat = (part.expand(*lead, *part.shape[-n:]).reshape(lead.numel(), *part.shape[-n:]) for part, n in parts)
        found = [self._solved(*some) for some in zip(*(part.contiguous().split(step) for part in flat), strict=True)]
        waves, eta = (torch.cat(part) for part in zip(*found, strict=True))
        return waves.reshape(*lead, *waves.shape[1:]), eta.reshape(*lead, *eta.shape[1:])

    def _solved(self, wall: Tensor, starts: Tensor, returns: Tensor) -> tuple[Tensor, Tensor]:
        """The same of one row of items."""
        lined = self._back.unflatten(-1, wall.shape[-3:-1]).transpose(-2, -3) @ wall
        ends = self._going + returns[..., None, :] * self._coming
        system = torch.cat([lined.transpose(-2, -3).flatten(-2) - self._own, ends], -1)
        right = -(self._coming * starts[..., None, :]).sum(-1)
        found = torch.linalg.solve_ex(system, right[..., None])[0][..., 0]
        matrix, solution = system.detach(), found.detach()
        left = ((matrix @ solution[..., None])[..., 0] - right).abs().amax(-1)
        # Of a singular system the residual may be small by luck; rounding of a solution so large is not.
        rounding = torch.finfo(torch.float64).eps * matrix.abs().amax((-2, -1)) * solution.abs().amax(-1)
        share = torch.maximum(left, rounding) / right.abs().amax(-1).clamp(min=1e-300)
        worst = float(torch.nan_to_num(share, nan=torch.inf).max())
        if worst > SINGULAR:
            raise RuntimeError(
                f"the duct's equations are singular: their solution leaves a residual of {worst:.2g} of the incident "
                "wave (a resonance without losses); change the impedance, the end reflections or the frequency"
            )
        eta, out = found[..., :-2], found[..., -2:]
        into, waves = starts + returns * out, reflected(wall, eta)
        if self._slip is not None:
            waves = waves - (self._slip @ (eta - waves)[..., None])[..., 0]
        return torch.cat([into[..., :1], out[..., :1], waves, into[..., 1:], out[..., 1:]], -1), eta


def solve_duct(case: DuctCase, frequency: Any, impedance: Any = math.inf, mesh: DuctMesh | None = None) -> DuctField:
    """The sound field of a lined duct with flow: ``DuctSolver`` of these and its ``solve``."""
    return DuctSolver(case, frequency, mesh).solve(impedance)


def _warn_of_mode_1(case: DuctCase, frequency: Tensor) -> None:
    """Ends let one mode out; the next, which the liner's edges make, must have died away there."""
    kappa = case.height * case.wavenumber(frequency)
    down, up = (rigid_modes(case.profile, kappa, 2, d)[:, 1].imag.abs() for d in DIRECTIONS)
    runs = down < RUNS
    if case.liner:
        ways = (up, case.liner[0][0] - case.start), (down, case.end - case.liner[-1][1])
        decay = min(float(torch.where(runs, math.inf, rate).min()) / case.height * length for rate, length in ways)
        if decay < GONE:
            tell(
                f"the liner lies so near an end that {100 * math.exp(-decay):.2g} % of mode 1, which its edges make, "
                f"reaches it and is reflected in part (limit {100 * math.exp(-GONE):.2g} %); lengthen the duct there",
                depth=2,
            )
    if bool(runs.any()):
        tell(
            f"at {float(frequency[runs].max()):g} Hz mode 1 runs too: its cut-on is about "
            f"{cut_on_frequency(case.profile):.4g} Hz; it is not sent in, and the ends reflect some of it",
            depth=2,
        )


def _warn_of_gain(balance: EnergyBalance, frequency: Tensor) -> None:
    """Where more energy goes out than comes in though the wall takes some, a wave grew."""
    fed = balance.fed
    if bool((fed > 0).any()):
        item = int(fed.argmax())
        out, absorbed = (float(part.flatten()[item]) for part in balance)
        tell(
            f"at {float(frequency[item % len(frequency)]):g} Hz ({int((fed > 0).sum())} of {fed.numel()} cases) "
            f"{out:.3g} times the energy that comes in goes out and {absorbed:.3g} times is absorbed, though the wall "
            "is passive: a wave of the shear layer grows along the liner, or the mesh does not resolve it; do not rely "
            "on this field",
            depth=2,
        )


def wall_matrices(impedance: Any, mesh: DuctMesh, basis: Basis, frequency: Tensor) -> Tensor:
    """R of the C lined columns, n points each, (..., F, C, n, n), of an impedance as ``DuctSolver.solve`` takes it;
    ValueError for shapes that do not fit."""
    wall, wanted, words = impedance, (len(frequency), len(mesh.case.liner)), "lined patches"
    if along := callable(impedance):
        inside, values, weights = basis.quadrature()
        x = torch.as_tensor(mesh.x[:-1, None][mesh.lined] + mesh.lined_widths[:, None] * inside)
        wall, wanted, words = impedance(x.flatten().to(frequency), frequency), (len(frequency), x.numel()), "places"
    reflection = wall_reflection(wall, frequency.device).to(frequency.device)
    try:
        each = reflection.expand(*reflection.shape[:-2], *wanted)
    except RuntimeError:
        raise ValueError(
            f"impedance has shape {tuple(reflection.shape)}; its last two axes must fit {wanted}: frequencies and "
            f"{words} (one value of each for all: 1)"
        ) from None
    if not along:
        each = each[..., torch.as_tensor(mesh.patch_numbers[mesh.lined])]
        return each[..., None, None] * torch.eye(basis.count, dtype=each.dtype, device=each.device)
    values, weights = values.to(each), weights.to(each)
    return values.mT @ ((each.unflatten(-1, x.shape) * weights)[..., None] * values) / basis.weights[:, None]


def downwind_derivative(mesh: DuctMesh, basis: Basis) -> Tensor:
    """d/dx over the lined columns, edge values from the right neighbour, (W, W)."""
    n, widths, columns = basis.count, mesh.lined_widths, np.flatnonzero(mesh.lined)
    whole = torch.zeros(len(widths), n, len(widths), n, dtype=torch.float64)
    first, last = basis.first.cpu(), basis.last.cpu()
    inner, weights = -basis.convection.cpu() - torch.outer(first, first), basis.weights.cpu()[:, None]
    for i, width in enumerate(widths):
        whole[i, :, i] = inner / (width * weights)
        if columns[i] + 1 in columns:
            whole[i, :, i + 1] = torch.outer(last, first) / (width * weights)
    return whole.reshape(len(widths) * n, len(widths) * n)


def reflected(wall: Tensor, eta: Tensor) -> Tensor:
    """R eta, (..., F, W)."""
    return (wall @ eta.unflatten(-1, wall.shape[-3:-1])[..., None])[..., 0].flatten(-2)

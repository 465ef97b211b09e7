"""The linearised Euler equations in a lined duct, swept once for many impedances."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, require_choice, tell
from torchliner.duct.boundaries import Boundaries, EnergyBalance, downwind_derivative, energy_balance, wall_matrices
from torchliner.duct.case import DuctCase, complex_tensor, require_slip_condition
from torchliner.duct.field import DuctField
from torchliner.duct.mesh import DuctMesh, build_mesh
from torchliner.duct.modes import DuctModes, cut_on_frequency, rigid_modes
from torchliner.duct.sweep import SweptDuct
from torchliner.engine.sums import one_thread
from torchliner.names import DIRECTIONS, SOURCES

GONE = 2 * math.pi  # |Im alpha| times distance: 2e-3 is left, as without sound after 2 H
RUNS = 0.03  # |Im alpha| H below which a mode is cut on, within 1e-4 of its cut-on frequency


class DuctSolver:
    """A duct and its frequencies, swept once; every impedance and source side then costs little.

    The columns of the mesh are condensed and joined by two sweeps, with the lined wall and both ends left open. An
    impedance, an end reflection or the side of the source then changes a system of the wall's own points, some hundred.
    The discrete solution is the whole system's, to rounding.

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
        self.swept, slip = SweptDuct(self.mesh, self.frequency, modes), None
        if slips:
            share = float(case.profile.mach(0.0)) / (2j * case.wavenumber(self.frequency))
            slip = share[:, None, None] * downwind_derivative(self.mesh, self.swept.basis).to(share)
        self._boundaries = Boundaries(self.swept.reading, slip)

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
            waves, eta = self._boundaries.solve(wall, *self._ends(side))
        energy = energy_balance(self.mesh, basis, waves, eta, wall)
        _warn_of_gain(energy, self.frequency)
        return DuctField(self.swept, side, waves, energy, impedance)

    def _ends(self, side: str) -> tuple[Tensor, Tensor]:
        """Amplitudes sent in and reflections of the left and right end, (..., F, 2)."""
        case, down, count = self.case, side == "upstream", len(self.frequency)
        alpha = self.swept.wavenumber[:, 0 if down else 1].real
        distance = case.place_of_incidence(side) - (case.start if down else case.end)
        amplitude = case.incident * torch.exp(1j * alpha * distance)
        sent = torch.stack([amplitude, torch.zeros_like(amplitude)], -1)
        both = [complex_tensor(r, self.frequency.device) for r in (case.source_reflection, case.end_reflection)]
        for name, each in zip(("source_reflection", "end_reflection"), both, strict=True):
            if each.ndim and each.shape[-1] not in (1, count):
                raise ValueError(f"{name} has shape {tuple(each.shape)}; its last axis must be 1 or {count}")
        returns = torch.stack(torch.broadcast_tensors(*both, alpha)[:2], -1)
        return (sent, returns) if down else (sent.flip(-1), returns.flip(-1))


def solve_duct(case: DuctCase, frequency: Any, impedance: Any = math.inf, mesh: DuctMesh | None = None) -> DuctField:
    """The sound field of a lined duct with flow: ``DuctSolver`` of these and its ``solve``."""
    return DuctSolver(case, frequency, mesh).solve(impedance)


def _warn_of_mode_1(case: DuctCase, frequency: Tensor) -> None:
    """Ends let one mode out; the next, which the liner's edges make, must have died away there."""
    profile, kappa = case.profile, case.height * case.wavenumber(frequency)
    down, up = (rigid_modes(profile, kappa, 2, d)[:, 1].imag.abs() for d in DIRECTIONS)
    runs = down < RUNS
    if case.liner and not bool(runs.all()):
        # At the highest frequency below cut-on mode 1 decays least.
        nearest = torch.where(runs, 0, frequency).argmax()
        ends = (
            (float(up[nearest]) / case.height, case.liner[0][0] - case.start, "upstream"),
            (float(down[nearest]) / case.height, case.end - case.liner[-1][1], "downstream"),
        )
        rate, length, end = min(ends, key=lambda each: each[0] * each[1])
        if rate * length < GONE:
            tell(
                f"the liner lies {1e3 * length:.3g} mm from the {end} end: at {float(frequency[nearest]):g} Hz "
                f"{100 * math.exp(-rate * length):.2g} % of mode 1, which its edges make, reaches the end, which "
                f"reflects some of it (limit {100 * math.exp(-GONE):.2g} %); lengthen the duct there to at least "
                f"{1e3 * GONE / rate:.3g} mm beyond the liner",
                depth=2,
            )
    if bool(runs.any()):
        tell(
            f"at {float(frequency[runs].max()):g} Hz mode 1 runs too: its cut-on is about "
            f"{cut_on_frequency(profile):.4g} Hz. Only the plane-like mode is sent in, and the ends let only that out: "
            "they reflect some of mode 1",
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

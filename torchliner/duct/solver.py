"""The linearised Euler equations in a lined duct, one frequency or many, one impedance or many."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, require_choice
from torchliner.duct.boundaries import (
    Boundaries,
    EndModes,
    downwind_derivative,
    energy_balance,
    plane_modes,
    wall_matrices,
)
from torchliner.duct.case import DuctCase
from torchliner.duct.doubts import doubt_ends, doubt_gain
from torchliner.duct.field import DuctField
from torchliner.duct.mesh import DuctMesh, build_mesh
from torchliner.duct.sweep import MEMORY, SweptDuct
from torchliner.duct.wall_impedance import require_slip_condition, result_type
from torchliner.engine.threads import one_thread
from torchliner.names import SOURCES


class DuctSolver:
    """A duct and its frequencies, swept once; every impedance and source side then costs little.

    The columns of the mesh are condensed, one for each width, with or without a lined wall, and
    joined by two sweeps, with the lined wall and both ends left open. What an impedance, an end
    reflection or the side of the source changes is a system of the wall's own points, some hundred,
    which is solved for each of them. The discrete solution is the whole system's, to rounding.

    Args:
        case: the duct.  frequency: Hz, (F,).  mesh: default ``build_mesh`` for the highest frequency.
        memory: bytes that the waves may take, those kept and those of the sweep in hand.
        modes: those that the ends let out, as ``plane_modes``.
    Raises:
        ValueError: a mesh of another duct, frequencies that are none, waves beyond ``memory``, a missing slip
            condition.
    Warns:
        DataWarning: a coarse mesh, mode 1 cut on, a liner so near an end that mode 1 of its edges gets there.
    """

    def __init__(
        self,
        case: DuctCase,
        frequency: Any,
        mesh: DuctMesh | None = None,
        *,
        memory: float = MEMORY,
        modes: Callable[..., EndModes] = plane_modes,
    ) -> None:
        self.case = case
        self.frequency = frequency_tensor(frequency)
        self.mesh = mesh or build_mesh(case, float(self.frequency.max()))
        if self.mesh.case is not case:
            raise ValueError("the mesh was built for another DuctCase; build one for this")
        slips = bool(case.liner) and require_slip_condition(case.profile, case.slip_condition)
        self.mesh.warn_if_coarse(float(self.frequency.max()))
        doubt_ends(case, self.frequency)
        self.swept = SweptDuct(self.mesh, self.frequency, modes, memory)
        slip = None
        if slips:
            share = float(case.profile.mach(0.0)) / (2j * case.wavenumber(self.frequency))
            slip = share[:, None, None] * downwind_derivative(self.mesh, self.swept.basis).to(share)
        self._boundaries = Boundaries(self.swept.reading, slip)

    def solve(self, impedance: Any = math.inf, source: str | None = None) -> DuctField:
        """The field of one or many impedances.

        Args:
            impedance: Z, normalised, v into the wall: numbers or a tensor, broadcast against (F, S)
                for F frequencies and S lined patches, leading axes free; or a function of x (m,
                (P,)) and frequency (Hz, (F,)) that returns (..., F, P). 0 and inf are walls like
                others. Gradients by a tensor, or through a function, pass.
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
        doubt_gain(energy, self.frequency)
        kind = torch.complex128 if callable(impedance) else result_type(impedance)
        return DuctField(self.swept, side, waves, energy, kind, impedance)

    def _ends(self, side: str) -> tuple[Tensor, Tensor]:
        """Amplitudes sent in and reflections of the left and right end, (..., F, 2)."""
        case, down, shape = self.case, side == "upstream", self.frequency.shape
        alpha = self.swept.modes.wavenumber[:, 0 if down else 1].real
        distance = case.place_of_incidence(side) - (case.start if down else case.end)
        amplitude = case.incident * torch.exp(1j * alpha * distance)
        sent = torch.stack([amplitude, torch.zeros_like(amplitude)], -1)
        both = []
        for name in ("source_reflection", "end_reflection"):
            value = getattr(case, name)
            # A plain complex number would become complex64.
            exact = value if isinstance(value, Tensor) else np.asarray(value, np.complex128)
            tensor = torch.as_tensor(exact).to(self.frequency.device, torch.complex128)
            if tensor.ndim and tensor.shape[-1] not in (1, *shape):
                raise ValueError(
                    f"{name} has shape {tuple(tensor.shape)}; its last axis must be one value for all frequencies or "
                    f"{shape[0]}, one of each"
                )
            both.append(tensor.expand(np.broadcast_shapes(tensor.shape, shape)))
        returns = torch.stack(torch.broadcast_tensors(*both), -1)
        return (sent, returns) if down else (sent.flip(-1), returns.flip(-1))


def solve_duct(case: DuctCase, frequency: Any, impedance: Any = math.inf, mesh: DuctMesh | None = None) -> DuctField:
    """The sound field of a lined duct with flow: ``DuctSolver`` of these and its ``solve``."""
    if isinstance(impedance, Tensor) and not isinstance(frequency, Tensor):
        frequency = frequency_tensor(frequency).to(impedance.device)
    return DuctSolver(case, frequency, mesh).solve(impedance)

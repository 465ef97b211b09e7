"""The linearised Euler equations in a lined duct, one frequency or many, one impedance or many."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, require_choice
from torchliner.duct.boundaries import energy_balance, solve_boundaries, wall_of
from torchliner.duct.case import DuctCase
from torchliner.duct.doubts import doubt_ends, doubt_gain
from torchliner.duct.field import DuctField
from torchliner.duct.mesh import DuctMesh, build_mesh
from torchliner.duct.sweep import MEMORY, SweptDuct, sweep_duct
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
        keep: ``all`` keeps the waves of all columns, for fields anywhere; ``walls`` only what pressures and velocities
            along both walls need.
        memory: bytes that the waves may take, those kept and those of the sweep in hand.
    Raises:
        ValueError: a mesh of another duct, frequencies that are none, waves beyond ``memory``, a missing slip
            condition.
    Warns:
        DataWarning: a coarse mesh, mode 1 cut on, a liner so near an end that mode 1 of its edges gets there.
    """

    def __init__(
        self, case: DuctCase, frequency: Any, mesh: DuctMesh | None = None, *, keep: str = "all", memory: float = MEMORY
    ) -> None:
        self.case = case
        self.frequency = frequency_tensor(frequency)
        self.mesh = mesh or build_mesh(case, float(self.frequency.max()))
        if self.mesh.case is not case:
            raise ValueError("the mesh was built for another DuctCase; build one for this")
        require_choice("keep", keep, ("all", "walls"))
        slips = bool(case.liner) and require_slip_condition(case.profile, case.slip_condition)
        self.slip_mach = float(case.profile.mach(0.0)) if slips else 0.0
        self.mesh.warn_if_coarse(float(self.frequency.max()))
        doubt_ends(case, self.frequency)
        with one_thread():  # see ``solve``
            self._swept: SweptDuct = sweep_duct(case, self.mesh, self.frequency, keep == "all", memory=memory)

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
        case, swept = self.case, self._swept
        side = require_choice("source", source or case.source, SOURCES)
        wall = None
        if case.liner:
            k = case.wavenumber(self.frequency)
            wall = wall_of(impedance, self.mesh, swept.basis, k, self.frequency, self.slip_mach)
        # torch 2.13 has given wrong complex LU factors of 150 rows in two threads, in a process that had drawn figures
        # and used threads before; in one thread they were right.
        with one_thread():
            waves, eta = solve_boundaries(swept.reading, wall, *self._ends(side))
        energy = energy_balance(self.mesh, swept.basis, waves, eta, wall)
        doubt_gain(energy, self.frequency)
        kind = torch.complex128 if callable(impedance) else result_type(impedance)
        return DuctField(case, self.frequency, side, waves, swept, energy, kind, impedance)

    def _ends(self, side: str) -> tuple[Tensor, Tensor]:
        """Amplitudes sent in and reflections of the left and right end, (..., F, 2)."""
        case, down, shape = self.case, side == "upstream", self.frequency.shape
        alpha = self._swept.modes.wavenumber[:, 0 if down else 1].real
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


def solve_duct(
    case: DuctCase, frequency: Any, impedance: Any = math.inf, mesh: DuctMesh | None = None, *, keep: str = "all"
) -> DuctField:
    """The sound field of a lined duct with flow: ``DuctSolver`` of these and its ``solve``."""
    if isinstance(impedance, Tensor) and not isinstance(frequency, Tensor):
        frequency = frequency_tensor(frequency).to(impedance.device)
    return DuctSolver(case, frequency, mesh, keep=keep).solve(impedance)

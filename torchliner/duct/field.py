"""The sound field of a solved duct: read on walls, inside and at the ends."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchliner.checks import require_choice
from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.duct.case import DuctCase, other_side
from torchliner.duct.flow_profiles import Array
from torchliner.duct.mesh import DuctMesh
from torchliner.duct.sweep import SweptDuct
from torchliner.engine.sums import one_thread
from torchliner.names import SOURCES, WALLS

GAIN, FED = 1.01, 2.0  # energy out, and out or absorbed, over that in
PASSIVE = -1e-6  # of the energy in: what a wall takes; below, it gives


class EnergyBalance(NamedTuple):
    """Shares of the energy that comes in, (..., F)."""

    out: Tensor  # plane-like modes out of both ends, with (1 +- M)^2, M the bulk Mach number
    absorbed: Tensor  # by the liner, from p and w on its face

    @property
    def missing(self) -> Tensor:
        """1 - out - absorbed: to the mean flow, if negative from it; errors of the mesh; mode 1."""
        return 1 - self.out - self.absorbed

    @property
    def fed(self) -> Tensor:
        """out + absorbed where more goes out than comes in past a wall that gives none: a wave grew; else 0."""
        out, absorbed = self.out.detach(), self.absorbed.detach()
        grown = ((out > GAIN) | (out + absorbed > FED)) & (absorbed > PASSIVE)
        return torch.where(grown, out + absorbed, 0.0)


@dataclass(frozen=True, eq=False)
class DuctField:
    """Complex amplitudes (peak) of exp(j omega t), complex128, for (..., F) impedances and frequencies.

    Args:
        swept: the duct's answers to unit waves.  source: side of the sound.
        waves: X of ``sweep.py``, Pa, (..., F, D).
        energy: out and absorbed over that which comes in, (..., F).
        impedance: Z of the wall as it was asked for.
        difference: of ``solve_settled``: by which a finer mesh moves transmission and levels, dB, (F,).
        finer_unknowns: of that mesh.  notes: warnings, with numbers.
    """

    swept: SweptDuct
    source: str
    waves: Tensor
    energy: EnergyBalance
    impedance: Any = None
    difference: Tensor | None = None
    finer_unknowns: int | None = None
    notes: tuple[str, ...] = ()

    @property
    def mesh(self) -> DuctMesh:
        """On which it was solved."""
        return self.swept.mesh

    @property
    def case(self) -> DuctCase:
        """The duct."""
        return self.mesh.case

    @property
    def frequency(self) -> Tensor:
        """Hz, (F,)."""
        return self.swept.frequency

    def at(self, x: Any, y: Any) -> tuple[Tensor, Tensor, Tensor]:
        """p (Pa), u and v (m/s, along x and y) at points, each (..., F, P); the duct is swept once more for them.

        Args:
            x, y: m, (P,) or numbers.
        Raises:
            ValueError: a point outside the duct.
        """
        swept, mesh, waves = self.swept, self.mesh, self.waves
        places, heights = np.broadcast_arrays(_places(x), _places(y))
        (column, inside), (element, above) = _cells("x", places, mesh.x), _cells("y", heights, mesh.y)
        along, across = (swept.basis.values(part).to(waves) for part in (inside, above))
        found = waves.new_zeros(3, *waves.shape[:-1], len(places))
        with one_thread():
            for at, columns, sweep in swept.sweeps():
                for number, (one, units) in enumerate(zip(columns, sweep, strict=True)):
                    here = torch.as_tensor(np.flatnonzero(column == number)).to(waves.device)
                    incoming = torch.einsum("fid,...fd->...fi", units, waves[..., at, :])
                    nodes = one.nodal(incoming)[..., torch.as_tensor(element).to(here.device)[here], :, :, :]
                    found[..., at, here] = torch.einsum("...pqyx,py,px->q...p", nodes, across[here], along[here])
        speed = self.case.density * self.case.profile.sound_speed
        return found[0], found[1] / speed, found[2] / speed

    def wall_pressure(self, x: Any, wall: str = "opposite") -> Tensor:
        """p on a wall at x (m, (P,) or a number), Pa, (..., F, P): the numerical trace, which meets the wall's law.

        ``wall``: ``opposite`` (rigid, y = H) or ``lined`` (y = 0, with its rigid parts).
        """
        arriving, leaving = self._wall_waves(x, wall)
        return arriving + leaving

    def wall_velocity(self, x: Any) -> Tensor:
        """Velocity of the fluid into the wall y = 0, m/s, (..., F, P): w = p*/(rho c Z), with Ingard's and Myers'
        condition w + (M/j k) dw/dx; 0 where the wall is rigid."""
        arriving, leaving = self._wall_waves(x, "lined")
        return (arriving - leaving) / (self.case.density * self.case.profile.sound_speed)

    def wall_level(self, x: Any, wall: str = "opposite") -> Tensor:
        """SPL on a wall, dB re 20 uPa rms, (..., F, P)."""
        return spl_from_pressure_amplitude(self.wall_pressure(x, wall))

    def end_waves(self, end: str) -> tuple[Tensor, Tensor]:
        """The plane-like mode that comes in and that goes out at an end, ``upstream`` or ``downstream``, Pa at the
        wall, (..., F)."""
        first = 0 if require_choice("end", end, SOURCES) == "upstream" else -2
        return self.waves[..., first], self.waves[..., first + 1]

    @property
    def reflection(self) -> Tensor:
        """Plane-like mode that reaches the source's end over the one sent from it, in wall pressure, (..., F)."""
        sent, returned = self.end_waves(self.source)
        return returned / sent

    @property
    def transmission(self) -> Tensor:
        """Plane-like mode out at the far end over the one sent in at the source's, (..., F)."""
        return self.end_waves(other_side(self.source))[1] / self.end_waves(self.source)[0]

    def rows(self) -> list[dict[str, float | None]]:
        """One a frequency, of a field without leading axes: reflection, transmission, energy, checks."""
        through = self.transmission.detach().abs()
        columns: dict[str, Any] = {
            "frequency (Hz)": self.frequency,
            "reflection": self.reflection.detach().abs(),
            "transmission": through,
            "transmission loss (dB)": -20 * through.log10(),
            "energy out": self.energy.out,
            "energy absorbed": self.energy.absorbed,
            "energy missing": self.energy.missing,
        }
        if self.difference is not None:
            columns["mesh difference (dB)"] = self.difference
        lists = {name: [v if math.isfinite(v) else None for v in part.tolist()] for name, part in columns.items()}
        return [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)]

    def _wall_waves(self, x: Any, wall: str) -> tuple[Tensor, Tensor]:
        """Waves that arrive at a wall and that leave it, Pa, (..., F, P)."""
        require_choice("wall", wall, WALLS)
        mesh, basis = self.mesh, self.swept.basis
        column, inside = _cells("x", _places(x), mesh.x)
        values = basis.values(inside).to(self.waves)
        kept = self.swept.upper if wall == "opposite" else self.swept.lower
        rows = torch.einsum("pn,fpnd->fpd", values, kept[:, torch.as_tensor(column).to(values.device)])
        arriving = torch.einsum("fpd,...fd->...fp", rows, self.waves)
        lined = torch.as_tensor(mesh.lined[column]).to(values.device)
        if wall == "opposite" or not bool(lined.any()):
            return arriving, arriving  # rigid
        first = 2 + basis.count * (np.cumsum(mesh.lined) - 1).clip(0)[column]
        own = torch.as_tensor(first[:, None] + np.arange(basis.count)).to(values.device)
        return arriving, torch.where(lined, (self.waves[..., own] * values).sum(-1), arriving)


def _places(values: Any) -> Array:
    plain = values.detach().cpu().numpy() if isinstance(values, Tensor) else values
    return np.atleast_1d(np.asarray(plain, np.float64)).ravel()


def _cells(name: str, places: Array, edges: Array) -> tuple[NDArray[np.int64], Array]:
    """The cell between edges that each place lies in, and where in it, 0 to 1."""
    outside = ~((places >= edges[0]) & (places <= edges[-1]))
    if outside.any():
        raise ValueError(f"{name} = {places[outside][0]:g} m lies outside the duct, {edges[0]:g} to {edges[-1]:g} m")
    cell = np.clip(np.searchsorted(edges, places, "right") - 1, 0, len(edges) - 2)
    return cell, (places - edges[cell]) / np.diff(edges)[cell]

"""The sound field of a solved duct, anywhere in it and along its walls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchliner.checks import require_choice
from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.duct.case import DuctCase, other_side
from torchliner.duct.columns import Column
from torchliner.duct.energy import EnergyBalance, energy_balance
from torchliner.duct.flow_profiles import Array
from torchliner.duct.sweep import Kept, SweptDuct
from torchliner.duct.walls import Wall
from torchliner.names import SOURCES, WALLS
from torchliner.records.outlets import Reported

POINTS_AT_ONCE = 512


@dataclass(frozen=True, eq=False)
class DuctField(Reported):
    """Complex amplitudes (peak) of exp(j omega t), for (..., F) impedances and frequencies.

    Args:
        case: the duct.  frequency: Hz, (F,).  source: its side.
        waves: X of ``ports.py``, Pa, (..., F, D).  swept: the duct's answers to unit waves.
        dtype: of what is read from the field; the sums are done in complex128.
        lining: the wall that it was solved with, or None where there is no liner.
        impedance: Z of it as it was asked for; None where that is not known.
    """

    case: DuctCase
    frequency: Tensor
    source: str
    waves: Tensor
    swept: SweptDuct
    dtype: torch.dtype = torch.complex128
    lining: Wall | None = None
    impedance: Any = None

    def at(self, x: Any, y: Any) -> tuple[Tensor, Tensor, Tensor]:
        """p (Pa), u and v (m/s, along x and y) at points, each (..., F, P).

        Args:
            x, y: m, (P,) or numbers.
        Raises:
            ValueError: a point outside the duct, or the solver kept the walls only.
        """
        if not self.swept.parts[0].incoming:
            raise ValueError(
                "the solver kept what the walls need (keep='walls'); build it with keep='all' to read fields inside"
            )
        places, heights = np.broadcast_arrays(_places(x), _places(y))
        _require_inside("x", places, self.case.start, self.case.end)
        _require_inside("y", heights, 0.0, self.case.height)
        blocks = []
        for first in range(0, len(places), POINTS_AT_ONCE):
            some = slice(first, first + POINTS_AT_ONCE)
            parts = []
            for part, waves in zip(self.swept.parts, self._waves_of_parts(), strict=True):
                rows = _point_rows(self.swept, part, places[some], heights[some])
                parts.append(torch.einsum("fpqd,...fd->...fpq", rows, waves))
            blocks.append(torch.cat(parts, -3))
        p, u, v = torch.cat(blocks, -2).to(self.dtype).unbind(-1)
        speed = self.case.density * self.case.profile.sound_speed
        return p, u / speed, v / speed

    def wall_pressure(self, x: Any, wall: str = "opposite") -> Tensor:
        """p on a wall, Pa, (..., F, P): the numerical trace p*, which meets the wall's law p* = Z w
        with w the velocity of the wall's own face, v* of ``wall_velocity`` where nothing slips.

        Args:
            x: m, (P,) or a number.
            wall: ``opposite`` (rigid, y = H) or ``lined`` (y = 0, with its rigid parts).
        """
        arriving, leaving = self._wall_waves(_places(x), wall)
        return (arriving + leaving).to(self.dtype)

    def wall_velocity(self, x: Any) -> Tensor:
        """Velocity of the fluid into the wall y = 0, m/s, (..., F, P): 0 where the wall is rigid.

        v* = w = p*/(rho c Z) where the flow does not slip or the velocity is continuous. With
        Ingard's and Myers' condition the wall's face moves at w = p*/(rho c Z), and the fluid that
        slips at Mach M along its wave at v* = w + (M/j k) dw/dx, which is what is returned.
        """
        arriving, leaving = self._wall_waves(_places(x), "lined")
        velocity = (arriving - leaving) / (self.case.density * self.case.profile.sound_speed)
        return velocity.to(self.dtype)

    def wall_level(self, x: Any, wall: str = "opposite") -> Tensor:
        """SPL on a wall, dB re 20 uPa rms, (..., F, P)."""
        return spl_from_pressure_amplitude(self.wall_pressure(x, wall))

    def wall_phase(self, x: Any, wall: str = "opposite") -> Tensor:
        """Phase of the pressure on a wall, degrees, -180 to 180, (..., F, P)."""
        return torch.rad2deg(torch.angle(self.wall_pressure(x, wall)))

    @property
    def reflection(self) -> Tensor:
        """Plane-like mode that reaches the source's end over the one sent from it, (..., F).

        Both at that end, as wall pressures; what the end sends back in counts as sent.
        """
        return self._end_ratio(back=True)

    @property
    def transmission(self) -> Tensor:
        """Plane-like mode out at the far end over the one sent in at the source's, (..., F)."""
        return self._end_ratio(back=False)

    @property
    def energy(self) -> EnergyBalance:
        """Energy out and absorbed over that which comes in, (..., F)."""
        return energy_balance(self.swept, self.waves, self.lining)

    def rows(self) -> list[dict[str, float | None]]:
        """One a frequency, of a field without leading axes: reflection, transmission, energy."""
        reflection, transmission = (part.detach().abs() for part in (self.reflection, self.transmission))
        return [
            {"frequency (Hz)": frequency, "reflection": float(back), "transmission": float(through),
             "transmission loss (dB)": -20 * float(through.log10()), **energy}
            for frequency, back, through, energy in zip(
                self.frequency.tolist(), reflection, transmission, self.energy.rows(), strict=True)
        ]  # fmt: skip

    def end_waves(self, end: str) -> tuple[Tensor, Tensor]:
        """The plane-like mode that comes in and that goes out at an end, Pa at the wall, (..., F).

        Args:
            end: ``upstream`` or ``downstream``.
        """
        first = 0 if require_choice("end", end, SOURCES) == "upstream" else -2
        return self.waves[..., first], self.waves[..., first + 1]

    def _end_ratio(self, back: bool) -> Tensor:
        sent, returned = self.end_waves(self.source)
        out = returned if back else self.end_waves(other_side(self.source))[1]
        return (out / sent).to(self.dtype)

    def _waves_of_parts(self) -> tuple[Tensor, ...]:
        sizes = [len(part.upper) for part in self.swept.parts]
        return self.waves.split(sizes, -2)

    def _wall_waves(self, x: Array, wall: str) -> tuple[Tensor, Tensor]:
        """Waves that arrive at a wall and that leave it, Pa, (..., F, P)."""
        require_choice("wall", wall, WALLS)
        _require_inside("x", x, self.case.start, self.case.end)
        mesh, basis = self.swept.mesh, self.swept.basis
        column, inside = _cells(mesh.x, x)
        values = basis.values(inside).to(self.waves)
        which = torch.as_tensor(column).to(values.device)
        parts = []
        for part, waves in zip(self.swept.parts, self._waves_of_parts(), strict=True):
            kept = part.upper if wall == "opposite" else part.lower
            rows = torch.einsum("pn,fpnd->fpd", values, kept[:, which])
            parts.append(torch.einsum("fpd,...fd->...fp", rows, waves))
        arriving = torch.cat(parts, -2)
        if wall == "opposite" or not mesh.lined.any():
            return arriving, arriving
        number = torch.as_tensor(np.cumsum(mesh.lined) - 1).to(which)[which].clamp(min=0)
        from_wall = self.waves[..., 2:-2].unflatten(-1, (-1, basis.count))[..., number, :]
        leaving = (from_wall * values).sum(-1)
        return arriving, torch.where(torch.as_tensor(mesh.lined).to(which.device)[which], leaving, arriving)


def _places(values: Any) -> Array:
    if isinstance(values, Tensor):
        values = values.detach().cpu().numpy()
    return np.atleast_1d(np.asarray(values, np.float64)).ravel()


def _require_inside(name: str, values: Array, low: float, high: float) -> None:
    outside = ~((values >= low) & (values <= high))
    if outside.any():
        raise ValueError(f"{name} = {values[outside][0]:g} m lies outside the duct, {low:g} to {high:g} m")


def _cells(edges: Array, places: Array) -> tuple[NDArray[np.int64], Array]:
    """The cell between edges that each place lies in, and where in it, 0 to 1."""
    cell = np.clip(np.searchsorted(edges, places, "right") - 1, 0, len(edges) - 2)
    return cell, (places - edges[cell]) / np.diff(edges)[cell]


def _point_rows(swept: SweptDuct, part: Kept, x: Array, y: Array) -> Tensor:
    """p, u and v at points for unit waves in, (F, P, 3, D), by the elements' own polynomials."""
    mesh, basis = swept.mesh, swept.basis
    column, inside = _cells(mesh.x, x)
    element, above = _cells(mesh.y, y)
    along, across = basis.values(inside), basis.values(above)
    incoming = part.incoming[0]
    found = incoming.new_zeros(len(incoming), len(x), 3, incoming.shape[-1])
    for number in np.unique(column):
        here = np.flatnonzero(column == number)
        rows = _column_rows(part.columns[number], element[here], along[here], across[here])
        found[:, torch.as_tensor(here).to(found.device)] = rows @ part.incoming[number][:, None]
    return found


def _column_rows(column: Column, element: NDArray[np.int64], along: Tensor, across: Tensor) -> Tensor:
    """p, u and v at points of one column for unit waves into it, (F, P, 3, I)."""
    elements, n = column.elements, along.shape[-1]
    which = torch.as_tensor(element).to(along.device)
    interior = elements.interior[:, which].unflatten(2, (3, n, n))
    values = torch.einsum("py,px,fpqyxi->fpqi", across.to(interior), along.to(interior), interior)
    sides = elements.along + n
    count = elements.interior.shape[1]
    vertical = column.vertical.unflatten(1, (count, 2 * n))[:, which]
    rows = values[..., sides:] @ vertical
    kinds = torch.arange(sides // n, device=which.device)[:, None] * (count * n)
    places = kinds + which[:, None, None] * n + torch.arange(n, device=which.device)
    places = places.flatten(1)[:, None].expand(-1, 3, -1)
    return rows.scatter_add(-1, places.expand(len(rows), -1, -1, -1), values[..., :sides])

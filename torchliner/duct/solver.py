"""The linearised Euler equations in a lined duct: the solver of many impedances, and the sound field it returns."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchliner.checks import frequency_tensor, require_choice, tell
from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.duct import boundaries
from torchliner.duct.case import DuctCase, other_side, require_slip_condition
from torchliner.duct.flow_profiles import Array
from torchliner.duct.mesh import DuctMesh, build_mesh
from torchliner.duct.modes import cut_on_frequency, rigid_modes
from torchliner.duct.sweep import SweptDuct
from torchliner.engine.threads import one_thread
from torchliner.names import DIRECTIONS, SOURCES, WALLS

GONE = 2 * math.pi  # |Im alpha| times distance: 2e-3 is left, as without sound after 2 H
RUNS = 0.03  # |Im alpha| H below which a mode is cut on, within 1e-4 of its cut-on frequency


class DuctSolver:
    """A duct and its frequencies, swept once; every impedance and source side then costs little.

    The columns of the mesh are condensed, one for each width, with or without a lined wall, and
    joined by two sweeps, with the lined wall and both ends left open. What an impedance, an end
    reflection or the side of the source changes is a system of the wall's own points, some hundred,
    which is solved for each of them. The discrete solution is the whole system's, to rounding.

    Args:
        case: the duct.  frequency: Hz, (F,).  mesh: default ``build_mesh`` for the highest frequency.
        modes: those that the ends let out, as ``boundaries.plane_modes``.
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
        modes: Callable[..., boundaries.EndModes] = boundaries.plane_modes,
    ) -> None:
        self.case = case
        self.frequency = frequency_tensor(frequency)
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
            derivative = boundaries.downwind_derivative(self.mesh, self.swept.basis)
            slip = share[:, None, None] * derivative.to(share)
        self._boundaries = boundaries.Boundaries(self.swept.reading, slip)

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
        wall = boundaries.wall_matrices(impedance, self.mesh, basis, self.frequency)
        # torch 2.13 has given wrong complex LU factors of 150 rows in two threads, in a process that had drawn figures
        # and used threads before; in one thread they were right.
        with one_thread():
            waves, eta = self._boundaries.solve(wall, *self._ends(side))
        energy = boundaries.energy_balance(self.mesh, basis, waves, eta, wall)
        _warn_of_gain(energy, self.frequency)
        return DuctField(self.swept, side, waves, energy, impedance)

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
                raise ValueError(f"{name} has shape {tuple(tensor.shape)}; its last axis must be 1 or {shape[0]}")
            both.append(tensor.expand(np.broadcast_shapes(tensor.shape, shape)))
        returns = torch.stack(torch.broadcast_tensors(*both), -1)
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


def _warn_of_gain(balance: boundaries.EnergyBalance, frequency: Tensor) -> None:
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


@dataclass(frozen=True, eq=False)
class DuctField:
    """Complex amplitudes (peak) of exp(j omega t), complex128, for (..., F) impedances and frequencies.

    Args:
        swept: the duct's answers to unit waves.  source: side of the sound.
        waves: X of ``sweep.py``, Pa, (..., F, D).
        energy: out and absorbed over that which comes in, (..., F).
        impedance: Z of the wall as it was asked for.
        growth, growing: of a wave that grows over the liner, dB, (F,), 0 where none was found, and its wavenumber,
            1/m, (F,), nan where there is none; these and the next two of ``solve_settled``.
        difference: by which a finer mesh moves transmission and levels, dB, (F,); nan where one mesh was stated.
        finer_unknowns: of that mesh.  notes: warnings, with numbers.
    """

    swept: SweptDuct
    source: str
    waves: Tensor
    energy: boundaries.EnergyBalance
    impedance: Any = None
    growth: Tensor | None = None
    growing: Tensor | None = None
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
        p, u, v = fields_at(self.swept, self.waves, x, y).unbind(-1)
        speed = self.case.density * self.case.profile.sound_speed
        return p, u / speed, v / speed

    def wall_pressure(self, x: Any, wall: str = "opposite") -> Tensor:
        """p on a wall, Pa, (..., F, P): the numerical trace p*, which meets the wall's law p* = Z w
        with w the velocity of the wall's own face, v* of ``wall_velocity`` where nothing slips.

        Args:
            x: m, (P,) or a number.
            wall: ``opposite`` (rigid, y = H) or ``lined`` (y = 0, with its rigid parts).
        """
        arriving, leaving = self._wall_waves(x, wall)
        return arriving + leaving

    def wall_velocity(self, x: Any) -> Tensor:
        """Velocity of the fluid into the wall y = 0, m/s, (..., F, P): 0 where the wall is rigid.

        v* = w = p*/(rho c Z) where the flow does not slip or the velocity is continuous. With
        Ingard's and Myers' condition the wall's face moves at w = p*/(rho c Z), and the fluid that
        slips at Mach M along its wave at v* = w + (M/j k) dw/dx, which is what is returned.
        """
        arriving, leaving = self._wall_waves(x, "lined")
        return (arriving - leaving) / (self.case.density * self.case.profile.sound_speed)

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
        if self.growing is not None:
            columns |= {
                "growing wave real (1/m)": self.growing.real,
                "growing wave imaginary (1/m)": self.growing.imag,
                "growth over the liner (dB)": self.growth,
                "mesh difference (dB)": self.difference,
            }
        lists = {name: [v if math.isfinite(v) else None for v in part.tolist()] for name, part in columns.items()}
        return [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)]

    def end_waves(self, end: str) -> tuple[Tensor, Tensor]:
        """The plane-like mode that comes in and that goes out at an end, ``upstream`` or ``downstream``, Pa at the
        wall, (..., F)."""
        first = 0 if require_choice("end", end, SOURCES) == "upstream" else -2
        return self.waves[..., first], self.waves[..., first + 1]

    def _wall_waves(self, x: Any, wall: str) -> tuple[Tensor, Tensor]:
        """Waves that arrive at a wall and that leave it, Pa, (..., F, P)."""
        require_choice("wall", wall, WALLS)
        mesh, basis = self.mesh, self.swept.basis
        column, inside = _cells("x", x, mesh.x)
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


def fields_at(swept: SweptDuct, waves: Tensor, x: Any, y: Any) -> Tensor:
    """p, rho c u and rho c v, Pa, at points (m, (P,) or numbers) for X (..., F, D), (..., F, P, 3)."""
    places, heights = np.broadcast_arrays(_places(x), _places(y))
    column, inside = _cells("x", places, swept.mesh.x)
    element, above = _cells("y", heights, swept.mesh.y)
    along, across = (swept.basis.values(part).to(waves) for part in (inside, above))
    found = waves.new_zeros(*waves.shape[:-1], len(places), 3)
    with one_thread():
        for at, columns, sweep in swept.sweeps():
            for number, (one, units) in enumerate(zip(columns, sweep, strict=True)):
                here = torch.as_tensor(np.flatnonzero(column == number)).to(waves.device)
                incoming = torch.einsum("fid,...fd->...fi", units, waves[..., at, :])
                nodes = one.nodal(incoming)[..., torch.as_tensor(element).to(here.device)[here], :, :, :]
                found[..., at, here, :] = torch.einsum("...pqyx,py,px->...pq", nodes, across[here], along[here])
    return found


def _places(values: Any) -> Array:
    plain = values.detach().cpu().numpy() if isinstance(values, Tensor) else values
    return np.atleast_1d(np.asarray(plain, np.float64)).ravel()


def _cells(name: str, values: Any, edges: Array) -> tuple[NDArray[np.int64], Array]:
    """The cell between edges that each place lies in, and where in it, 0 to 1."""
    places = _places(values)
    outside = ~((places >= edges[0]) & (places <= edges[-1]))
    if outside.any():
        raise ValueError(f"{name} = {places[outside][0]:g} m lies outside the duct, {edges[0]:g} to {edges[-1]:g} m")
    cell = np.clip(np.searchsorted(edges, places, "right") - 1, 0, len(edges) - 2)
    return cell, (places - edges[cell]) / np.diff(edges)[cell]

r"""Whether the field of a duct can be relied on: a second mesh, and a wave that grows along the liner.

The answer is that of the coarsest mesh which the next one confirms, so that a duct whose mesh was fine enough keeps its
numbers. Each next mesh has 1.5 times the columns and rows and half the cell at the walls.

A liner may be passive and the sound above it grow: the shear layer feeds a hydrodynamic wave, as between two streams.
It grows out of no rigid mode, so it is looked for: Newton's method on F/p from a grid of wavenumbers beyond k/M, in
panels cut fine for its critical layer. A root counts if finer panels have it too, within 1e-2, and still finer ones
within 1e-4; that of the fastest growth is kept.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, noted, tell
from torchliner.duct.case import DuctCase, require_slip_condition, wall_reflection
from torchliner.duct.field import DuctField
from torchliner.duct.flow_profiles import MeanFlow
from torchliner.duct.mesh import DuctMesh, build_mesh
from torchliner.duct.modes import PridmoreBrown
from torchliner.duct.numerics import newton, with_slopes
from torchliner.duct.solver import DuctSolver

SETTLED, REFUSED = 0.05, 1.0  # dB
MOST_GROWTH = 100.0  # dB over the liner: beyond, a field of linear sound has no meaning
FINER, THINNER = 1.5, 2.0  # columns and rows; cells at the walls
TRIES = 2  # meshes beyond the first
WEAK = 20.0  # dB below the loudest microphone: the levels of standing-wave nodes are not compared
DEGREE = 4
WAY_OUT = "take a thicker profile, or state a mesh (--mesh, mesh=) to have its answer without this check"
# Parts of a panel, last step of Newton's method and change since the parts before, of |alpha|.
STAGES = ((4, math.inf, math.inf), (4, 1e-3, math.inf), (12, 1e-8, 1e-2), (30, 1e-8, 1e-4))
ALIKE = 1e-2  # of |alpha|: roots of a stage that are one
NEAREST, FARTHEST, ALONG = 0.8, 80.0, 14  # Re alpha of the starts, in k/M_max
ASIDE = (0.15, 0.5, 1.4)  # their Im over Re
STEPS, LONGEST = 6, 0.25  # of Newton's method, of |alpha|
LEAST = 1e-3  # of alpha H; below, the wave neither grows nor decays
NEPER = 20 * math.log10(math.e)  # dB
NONE = complex(math.nan, math.nan)


def solve_settled(
    case: DuctCase,
    frequency: Any,
    impedance: Any = math.inf,
    *,
    places: Any = (),
    wall: str = "opposite",
    mesh: DuctMesh | None = None,
) -> DuctField:
    """The field of one impedance, refined until a finer mesh moves it by less than 0.05 dB.

    Args:
        case, frequency: as for ``DuctSolver``.
        impedance: as for ``DuctSolver.solve``, without leading axes.
        places: x at which levels on ``wall`` are compared, m; the transmission always is.
        mesh: to be used as it is, without a second one.
    Returns:
        The field of the coarsest mesh that the next one confirms, else of the last but one.
    Raises:
        RuntimeError: meshes that still differ by more than 1 dB, or a wave in the field that grows
            by more than 100 dB over the liner; the message says by how much.
        ValueError: see ``DuctSolver``.
    Warns:
        DataWarning: meshes that still differ by more than 0.05 dB; a growing wave; as ``DuctSolver`` and its ``solve``.
    """
    wanted = frequency_tensor(frequency)
    with noted() as notes:
        growth, growing = growth_over_liner(case, wanted, impedance)
        if float(growth.max()) > 0:
            _judge_growth(case, wanted, growth, growing, mesh is None)
        field = DuctSolver(case, wanted, mesh).solve(impedance)
        moved, unknowns = torch.full(wanted.shape, math.nan, dtype=torch.float64), None
        for step in range(1, TRIES + 1) if mesh is None else ():
            other = DuctSolver(case, wanted, _finer_mesh(case, float(wanted.max()), step)).solve(impedance)
            moved, unknowns = _difference(field, other, torch.as_tensor(places), wall), other.mesh.unknowns
            if float(moved.max()) <= SETTLED:
                break
            if step == TRIES:
                _judge(field, moved, unknowns)
            else:
                field = other
    about: dict[str, Any] = {"growth": growth, "growing": growing, "difference": moved, "finer_unknowns": unknowns}
    return replace(field, **about, notes=tuple(notes))


def _finer_mesh(case: DuctCase, highest: float, step: int) -> DuctMesh:
    """The mesh for the highest frequency, Hz, ``step`` times refined."""
    first = build_mesh(case, highest, degree=DEGREE)
    rows, column = first.y[1:] - first.y[:-1], float(first.widths.max()) / FINER**step
    row, wall = float(rows.max()) / FINER**step, float(rows[0]) / THINNER**step
    return build_mesh(case, highest, degree=DEGREE, column=column, row=row, wall_cell=wall)


def _difference(one: DuctField, other: DuctField, places: Tensor, wall: str) -> Tensor:
    """Of transmission and, where not weak, of levels, dB, (F,)."""
    moved = 20 * (one.transmission.detach() / other.transmission.detach()).abs().log10().abs()
    if not len(places):
        return moved
    first, second = (field.wall_level(places, wall).detach() for field in (one, other))
    loud = first > first.amax(-1, keepdim=True) - WEAK
    return torch.maximum(moved, torch.where(loud, (first - second).abs(), 0).amax(-1))


def _judge(field: DuctField, difference: Tensor, finer_unknowns: int) -> None:
    """Warn of meshes that differ, or refuse."""
    worst = int(torch.nan_to_num(difference, nan=math.inf).argmax())
    moved = float(difference[worst])
    text = (
        f"at {float(field.frequency[worst]):g} Hz the answer is not settled: {finer_unknowns} unknowns move that of "
        f"{field.mesh.unknowns} by {moved:.2g} dB"
    )
    if not moved <= REFUSED:
        raise RuntimeError(
            f"{text}, above {REFUSED:g} dB: the field is noise of the mesh, as of a layer too thin or a wave that "
            f"grows along the liner; {WAY_OUT}"
        )
    tell(f"{text} (limit {SETTLED:g} dB)", depth=2)


def _judge_growth(case: DuctCase, frequency: Tensor, growth: Tensor, growing: Tensor, refuse: bool) -> None:
    """Warn of the fastest growing wave, or refuse."""
    worst = int(growth.argmax())
    text = (
        f"at {float(frequency[worst]):g} Hz ({int((growth > 0).sum())} of {len(growth)} frequencies) a hydrodynamic "
        f"wave grows along the liner, alpha = {complex(growing[worst]):.4g} 1/m, by {float(growth[worst]):.3g} dB "
        "over it"
    )
    if float(case.profile.mach(0.0)) > 0:
        text += "; the field leaves it out, being integrated from the downstream edge"
    elif float(growth[worst]) > MOST_GROWTH and refuse:
        raise RuntimeError(f"{text}, above {MOST_GROWTH:g} dB: no mesh gives such a field; {WAY_OUT}")
    tell(text, depth=2)


def growth_over_liner(case: DuctCase, frequency: Tensor, impedance: Any) -> tuple[Tensor, Tensor]:
    """Growth of the fastest wave over all lined patches, dB, (F,), and its largest alpha, (F,).

    0 and nan where no wave grows. ``impedance`` is as for ``DuctSolver.solve``, without leading axes; of a function the
    value in the middle of each patch.
    """
    if callable(impedance):
        impedance = impedance(torch.tensor([sum(pair) / 2 for pair in case.liner]).to(frequency), frequency)
    walls = torch.as_tensor(impedance).detach().cpu().expand(len(frequency), len(case.liner))
    growth = torch.zeros(len(frequency), dtype=torch.float64)
    worst = torch.full(growth.shape, NONE, dtype=torch.complex128)
    for patch, (start, end) in enumerate(case.liner):
        alpha = growing_wave(case.profile, frequency, walls[:, patch], case.slip_condition)
        growth += NEPER * (end - start) * torch.nan_to_num(alpha.imag)
        worst = torch.where(torch.isnan(worst.real) | (alpha.imag > worst.imag), alpha, worst)
    return growth, worst


def growing_wave(profile: MeanFlow, frequency: Any, impedance: Any, slip_condition: str | None = None) -> Tensor:
    r"""Wavenumber of the fastest growing wave along the flow above an endless liner.

    Args:
        profile, frequency, impedance, slip_condition: as for ``duct_modes``, without leading axes.
    Returns:
        alpha, 1/m, (F,), complex128, of exp(-j alpha x): Im alpha > 0 and Re alpha > k; nan where none is found, which
        is no proof that there is none (Re alpha of 0.8 to 80 k/M, Im above some Re/50).
    Source: Briggs (1964), Electron-stream interaction with plasmas, for what runs downstream though it grows there;
        Rienstra and Darau (2011), J. Fluid Mech. 671, 559, for such waves above liners.
    """
    wanted = frequency_tensor(frequency).cpu()
    reflection = wall_reflection(impedance).detach().cpu()
    if reflection.shape not in ((), (1,), wanted.shape):
        shape, count = tuple(reflection.shape), len(wanted)
        raise ValueError(f"impedance has shape {shape}; one value is needed, or {count}, one a frequency")
    reflection, found = reflection.expand(wanted.shape), torch.full(wanted.shape, NONE, dtype=torch.complex128)
    height = profile.duct_height
    fastest = float(profile.mach(np.linspace(0, height, 201)).max())
    lined = (reflection != 1).nonzero()[:, 0].tolist() if fastest > 0 else []
    if lined:
        myers = require_slip_condition(profile, slip_condition)
        kappa = 2 * math.pi * height / profile.sound_speed * wanted
        sheared = float(profile.mach(0.0)) < fastest  # else there is no critical layer
        equations = {n: PridmoreBrown(profile, myers, split=n if sheared else 1) for n, _, _ in STAGES}
        for i in lined:
            found[i] = _fastest(equations, kappa[i], fastest, reflection[i]) / height
    return found


def _fastest(equations: dict[int, PridmoreBrown], kappa: Tensor, fastest: float, reflection: Tensor) -> Any:
    """alpha H of the fastest growing root, or nan."""
    low, high = (math.log(share * float(kappa) / fastest) for share in (NEAREST, FARTHEST))
    along = torch.linspace(low, high, ALONG, dtype=torch.float64).exp()
    a = (along[:, None] * (1 + 1j * torch.tensor(ASIDE, dtype=torch.float64))).flatten()
    for parts, close, change in STAGES:

        def relative(z: Tensor, equation: PridmoreBrown = equations[parts]) -> Tensor:
            value, pressure = equation.residual(z, kappa.expand(len(z)), reflection)
            return value / pressure  # F itself grows as exp(alpha H)

        start = a
        a, last = newton(lambda z, f=relative: with_slopes(f, z), start, STEPS, LONGEST)  # type: ignore[misc]
        held = (last < close * a.abs()) & (a.imag > LEAST) & (a.real > kappa)
        a = a[held & ((a - start).abs() < change * a.abs())]
        apart = (a[:, None] - a).abs() < ALIKE * a.abs()
        a = a[~torch.triu(apart, diagonal=1).any(0)]
        if not len(a):
            return NONE
    return a[a.imag.argmax()]

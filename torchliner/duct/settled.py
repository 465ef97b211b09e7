"""A duct solved on two meshes at least: by how much a finer one moves the answer.

The answer is that of the coarsest mesh which the next one confirms, so that a duct whose mesh was fine enough keeps its
numbers. Each next mesh has 1.5 times the columns and rows and half the cell at the walls.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, noted, tell
from torchliner.duct.case import DuctCase
from torchliner.duct.field import DuctField
from torchliner.duct.growing_wave import growth_over_liner
from torchliner.duct.mesh import DuctMesh, build_mesh
from torchliner.duct.solver import DuctSolver

SETTLED, REFUSED = 0.05, 1.0  # dB
MOST_GROWTH = 100.0  # dB over the liner: beyond, a field of linear sound has no meaning
FINER, THINNER = 1.5, 2.0  # columns and rows; cells at the walls
TRIES = 2  # meshes beyond the first
WEAK = 20.0  # dB below the loudest microphone: the levels of standing-wave nodes are not compared
DEGREE = 4
WAY_OUT = "take a thicker profile, or state a mesh (--mesh, mesh=) to have its answer without this check"


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
            other = DuctSolver(case, wanted, _finer_mesh(case, wanted, step)).solve(impedance)
            moved, unknowns = _difference(field, other, torch.as_tensor(places), wall), other.mesh.unknowns
            if float(moved.max()) <= SETTLED:
                break
            if step < TRIES:
                field = other
        else:
            if mesh is None:
                _judge(field, moved, unknowns)
    about: dict[str, Any] = {"growth": growth, "growing": growing, "difference": moved, "finer_unknowns": unknowns}
    return replace(field, **about, notes=tuple(notes))


def _finer_mesh(case: DuctCase, frequency: Tensor, step: int) -> DuctMesh:
    """The mesh ``step`` times refined."""
    highest = float(frequency.max())
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


def _judge(field: DuctField, difference: Tensor, finer_unknowns: int | None) -> None:
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

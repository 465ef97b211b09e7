"""Whether the field of a duct can be relied on: a second mesh, with 1.5 times the columns and rows and half the cell at
the walls, must give the same."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from torchliner.checks import frequency_tensor, noted, tell
from torchliner.duct.case import DuctCase
from torchliner.duct.field import DuctField
from torchliner.duct.mesh import DuctMesh, build_mesh
from torchliner.duct.solver import DuctSolver

SETTLED, REFUSED = 0.05, 1.0  # dB
FINER, THINNER = 1.5, 2.0  # columns and rows; cells at the walls
WEAK = 20.0  # dB below the loudest microphone: the levels of standing-wave nodes are not compared


def solve_settled(
    case: DuctCase,
    frequency: Any,
    impedance: Any = math.inf,
    *,
    places: Any = (),
    wall: str = "opposite",
    mesh: DuctMesh | None = None,
) -> DuctField:
    """The field of one impedance, compared with that of a finer mesh.

    Args:
        case, frequency: as for ``DuctSolver``.
        impedance: as for ``DuctSolver.solve``, without leading axes.
        places: x at which levels on ``wall`` are compared, m; the transmission always is.
        mesh: to be used as it is, without a second one.
    Raises:
        RuntimeError: meshes that differ by more than 1 dB.  ValueError: see ``DuctSolver``.
    Warns:
        DataWarning: meshes that differ by more than 0.05 dB; as ``DuctSolver`` and its ``solve``.
    """
    wanted, about = frequency_tensor(frequency), dict[str, Any]()
    with noted() as notes:
        field = DuctSolver(case, wanted, mesh).solve(impedance)
        if mesh is None:
            rows, column = np.diff(field.mesh.y), field.mesh.widths.max() / FINER
            sizes = {"column": column, "row": rows.max() / FINER, "wall_cell": rows[0] / THINNER}
            other = DuctSolver(case, wanted, build_mesh(case, float(wanted.max()), **sizes)).solve(impedance)
            moved = 20 * (field.transmission / other.transmission).detach().abs().log10().abs()
            if len(places):
                first, second = (each.wall_level(places, wall).detach() for each in (field, other))
                loud = first > first.amax(-1, keepdim=True) - WEAK
                moved = torch.maximum(moved, torch.where(loud, (first - second).abs(), 0).amax(-1))
            about = {"difference": moved, "finer_unknowns": other.mesh.unknowns}
            worst = int(torch.nan_to_num(moved, nan=math.inf).argmax())
            text = (
                f"at {float(wanted[worst]):g} Hz the answer is not settled: {other.mesh.unknowns} unknowns move that "
                f"of {field.mesh.unknowns} by {float(moved[worst]):.2g} dB"
            )
            if not float(moved[worst]) <= REFUSED:
                raise RuntimeError(
                    f"{text}, above {REFUSED:g} dB: the field is noise of the mesh, as of a layer too thin or a wave "
                    "that grows along the liner; take a thicker profile, or state a mesh (--mesh, mesh=) to have its "
                    "answer without this check"
                )
            if float(moved[worst]) > SETTLED:
                tell(f"{text} (limit {SETTLED:g} dB)")
    return replace(field, **about, notes=tuple(notes))

"""Verification of the duct solvers: measured errors and their limits; exit code 1 if one is not held.

    python scripts/verify_duct.py [--degrees 1 2 3 4]

Mode 0 of a duct of 150 x 50 mm lined throughout with Z = 2.33-0.30j, at 1500 Hz, enters at one end of the linearised
Euler equations, leaves at the other and is known there exactly, from the collocation of the Pridmore-Brown equation.
The error of p should fall with the element size to the power p + 1. Then a liner between rigid walls against 40 matched
modes.
"""

import functools
import math
import sys
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from common import options_of, parser_of
from oracles.mode_matching import match_modes
from torchliner.checks import DataWarning
from torchliner.duct.case import DuctCase
from torchliner.duct.columns import Basis
from torchliner.duct.flow_profiles import Array, MeanFlow, TanhProfile, UniformProfile
from torchliner.duct.mesh import DuctMesh
from torchliner.duct.modes import DuctModes, duct_modes
from torchliner.duct.solver import DuctSolver

CONDITION = "continuous-velocity"  # no flow slips here: either would do
HEIGHT, LENGTH, FREQUENCY, TRUE = 50e-3, 0.15, 1500.0, 2.33 - 0.30j
# The derivatives of a layer of shear 0.5 stay small enough for the order to be seen on coarse meshes.
CASES: dict[str, MeanFlow] = {"no flow": UniformProfile(0.0, HEIGHT), "sheared": TanhProfile(0.3, HEIGHT, 0.5)}
MESHES = ((4, 2), (8, 4), (16, 8), (32, 16))
LEAST = 0.5  # by which the last step may miss p + 1: with upwind fluxes p + 1/2 is sure


def order_table(
    flow: str,
    degrees: Sequence[int] = (1, 2, 3, 4),
    meshes: Sequence[tuple[int, int]] = MESHES,
    direction: str = "downstream",
) -> list[dict[str, Any]]:
    """A row a mesh: the largest error of p over the largest p, and the order, nan on the first mesh.

    Args:
        flow: one of ``CASES``.  degrees: p.  direction: of the mode.
        meshes: columns and rows; each next one twice as fine.
    """
    table = []
    for degree in degrees:
        last = math.nan
        for columns, rows in meshes:
            error, unknowns = exact_mode_error(CASES[flow], degree, columns, rows, direction)
            row = {"flow": flow, "degree": degree, "columns": columns, "rows": rows, "unknowns": unknowns}
            table.append({**row, "error": error, "order": math.log2(last / error)})
            last = error
    return table


def exact_mode_error(
    profile: MeanFlow, degree: int, columns: int, rows: int, direction: str = "downstream"
) -> tuple[float, int]:
    """Largest error of p over the elements' nodes, relative to the largest p; and the unknowns."""
    source = "upstream" if direction == "downstream" else "downstream"
    case = DuctCase(profile, 0.0, LENGTH, (0.0, LENGTH), source, slip_condition=CONDITION)
    mesh = DuctMesh(case, np.linspace(0, LENGTH, columns + 1), np.linspace(0, HEIGHT, rows + 1), degree)
    x, y = (places.ravel() for places in node_places(mesh))
    both = down, up = lined_modes(profile)  # type: ignore[arg-type]  # flows are frozen records
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DataWarning)  # the liner reaches both ends, on purpose
        found = DuctSolver(case, FREQUENCY, mesh, modes=both).solve(TRUE).at(x, y)[0][0]
    mode, start = (down, 0.0) if source == "upstream" else (up, LENGTH)
    wanted = mode.at(y)[0][0, 0] * torch.exp(-1j * mode.wavenumber[0, 0] * torch.as_tensor(x - start))
    return float((found - wanted).abs().max() / wanted.abs().max()), mesh.unknowns


@functools.lru_cache(maxsize=4)  # all meshes are compared with the same two
def lined_modes(profile: MeanFlow) -> tuple[DuctModes, DuctModes]:
    """Mode 0 of the lined duct, downstream and upstream."""
    about: dict[str, Any] = {"count": 1, "slip_condition": CONDITION}
    down, up = (duct_modes(profile, FREQUENCY, TRUE, direction=d, **about) for d in ("downstream", "upstream"))
    return down, up


def node_places(mesh: DuctMesh) -> tuple[Array, Array]:
    """x and y of the elements' nodes, m, each (columns, E, n, n) with y before x."""
    nodes = Basis(mesh.degree).nodes.numpy()
    x = mesh.x[:-1, None] + np.diff(mesh.x)[:, None] * nodes
    y = mesh.y[:-1, None] + np.diff(mesh.y)[:, None] * nodes
    shape = (*x.shape[:1], *y.shape, len(nodes))
    return np.broadcast_to(x[:, None, None, :], shape), np.broadcast_to(y[None, :, :, None], shape)


def checks(rows: Sequence[dict[str, Any]]) -> dict[str, tuple[float, float]]:
    """Measured figure and its limit, by name; ``rows`` are those of ``order_table``, the finest mesh last."""
    found: dict[str, tuple[float, float]] = {}
    for row in rows:
        flow, degree = row["flow"], row["degree"]
        found[f"order {degree + 1} with degree {degree}, {flow}: misses by"] = degree + 1 - row["order"], LEAST
        if (flow, degree) == ("no flow", 4):
            found["no flow, degree 4, 32 x 16: relative error of p"] = row["error"], 1e-9
    # Rigid-lined-rigid without flow, on the opposite wall.
    places = np.linspace(-0.05, 0.2, 26)
    case = DuctCase(UniformProfile(0.0, HEIGHT), -0.15, 0.3, (0.0, 0.15))
    field = DuctSolver(case, FREQUENCY).solve(TRUE).wall_pressure(places)
    matched = match_modes(HEIGHT, (0.0, 0.15), FREQUENCY, TRUE, modes=40).fields(places, HEIGHT)[0]
    away = float(np.abs(field[0].numpy() - matched).max() / np.abs(matched).max())
    return found | {"rigid-lined-rigid without flow against 40 matched modes": (away, 1e-4)}


def main(arguments: Sequence[str] | None = None) -> int:
    options = options_of(parser_of(__doc__, degrees=[1, 2, 3, 4]), arguments)
    rows = [row for flow in CASES for row in order_table(flow, options.degrees)]
    for row in rows:
        mesh = f"{row['columns']} x {row['rows']}"
        numbers = f"{row['unknowns']:6d} {row['error']:9.2e} {row['order']:5.2f}"
        print(f"{row['flow']:8s} p {row['degree']} {mesh:>8s} {numbers}")
    found = checks(rows)
    for name, (value, limit) in found.items():
        print(f"{'holds' if value <= limit else 'FAILS'}: {name} {value:.2e} (limit {limit:.0e})")
    return 0 if all(value <= limit for value, limit in found.values()) else 1


if __name__ == "__main__":
    sys.exit(main())

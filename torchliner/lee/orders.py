"""How the error of the Euler solver falls with the mesh, against exact modes of a lined duct."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchliner.duct.case import DuctCase
from torchliner.duct.modes import DuctModes, duct_modes
from torchliner.flow_profiles import MeanFlow, TanhProfile, UniformProfile
from torchliner.lee.basis import Basis
from torchliner.lee.ends import EndModes, end_modes
from torchliner.lee.field import DuctField
from torchliner.lee.mesh import DuctMesh
from torchliner.lee.ports import solve_ports
from torchliner.lee.sweep import sweep_duct
from torchliner.lee.walls import wall_of

CONDITION = "continuous-velocity"  # no flow slips here: either would do
HEIGHT, LENGTH, FREQUENCY, IMPEDANCE = 50e-3, 0.15, 1500.0, 2.33 - 0.30j
CASES: dict[str, MeanFlow] = {
    "no flow": UniformProfile(0.0, HEIGHT),
    "sheared": TanhProfile(0.3, HEIGHT, 0.5),
}
MESHES = ((4, 2), (8, 4), (16, 8), (32, 16))


def order_table(
    flow: str, degrees: Sequence[int] = (1, 2, 3, 4), meshes: Sequence[tuple[int, int]] = MESHES,
    direction: str = "downstream",
) -> list[dict[str, Any]]:  # fmt: skip
    """Errors of mode 0 in a duct of 150 x 50 mm lined throughout with Z = 2.33-0.30j, at 1500 Hz.

    The mode enters at one end, leaves at the other and is known there exactly: alpha and shape from
    the collocation of ``pridmore_brown``. The error of p should fall with the element size to the
    power p + 1 until the modes' own 1e-11 is reached.

    Args:
        flow: ``no flow`` or ``sheared`` (tanh profile, bulk Mach 0.3, shear 0.5, whose derivatives
            stay small enough for the order to be seen on coarse meshes).
        degrees: p.  meshes: columns and rows; each next one twice as fine.  direction: of the mode.
    Returns:
        A row a mesh: flow, degree, columns, rows, unknowns, the largest ``error`` of p over the
        largest p, and the ``order``, log2 of the last error over this one, nan on the first mesh.
    Raises:
        KeyError: another flow.
    """
    table = []
    for degree in degrees:
        last = math.nan
        for columns, rows in meshes:
            error, unknowns = exact_mode_error(CASES[flow], degree, columns, rows, direction)
            order = math.log2(last / error)
            table.append({"flow": flow, "degree": degree, "columns": columns, "rows": rows,
                          "unknowns": unknowns, "error": error, "order": order})  # fmt: skip
            last = error
    return table


def exact_mode_error(
    profile: MeanFlow, degree: int, columns: int, rows: int, direction: str = "downstream"
) -> tuple[float, int]:
    """Largest error of p over the elements' nodes, relative to the largest p; and the unknowns."""
    source = "upstream" if direction == "downstream" else "downstream"
    case = DuctCase(profile, 0.0, LENGTH, (0.0, LENGTH), source, slip_condition=CONDITION)
    mesh = DuctMesh(
        case, np.linspace(0, LENGTH, columns + 1), np.linspace(0, HEIGHT, rows + 1), degree
    )
    frequency = torch.tensor([FREQUENCY], dtype=torch.float64)
    down, up = _modes_of(profile)  # type: ignore[arg-type]  # flows are frozen records

    def lined_modes(_: MeanFlow, __: Tensor, y: Tensor, flow: bool) -> EndModes:
        return end_modes(down, up, y, flow)

    swept = sweep_duct(case, mesh, frequency, True, math.inf, lined_modes)
    k = case.wavenumber(frequency)
    wall = wall_of(IMPEDANCE, mesh, swept.basis, k, frequency, 0.0)
    sent = torch.tensor([[1.0, 0.0]] if source == "upstream" else [[0.0, 1.0]]).to(wall.send)
    waves = solve_ports(swept.response, wall, sent, torch.zeros_like(sent))
    x, y = (places.ravel() for places in node_places(mesh))
    found = DuctField(case, frequency, source, waves, swept).at(x, y)[0][0]
    mode, start = (down, 0.0) if source == "upstream" else (up, LENGTH)
    phase = torch.exp(-1j * mode.wavenumber[0, 0] * torch.as_tensor(x - start))
    wanted = mode.at(y)[0][0, 0] * phase
    return float((found - wanted).abs().max() / wanted.abs().max()), mesh.unknowns


@functools.lru_cache(maxsize=4)  # all meshes are compared with the same two
def _modes_of(profile: MeanFlow) -> tuple[DuctModes, DuctModes]:
    """Mode 0 of the lined duct, downstream and upstream."""
    down, up = (
        duct_modes(
            profile, FREQUENCY, IMPEDANCE, count=1, direction=d, slip_condition=CONDITION
        )
        for d in ("downstream", "upstream")
    )  # fmt: skip
    return down, up


def node_places(mesh: DuctMesh) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """x and y of the elements' nodes, m, each (columns, E, n, n) with y before x."""
    nodes = Basis.of_degree(mesh.degree).nodes.numpy()
    x = mesh.x[:-1, None] + np.diff(mesh.x)[:, None] * nodes
    y = mesh.y[:-1, None] + np.diff(mesh.y)[:, None] * nodes
    shape = (*x.shape[:1], *y.shape, len(nodes))
    return (
        np.broadcast_to(x[:, None, None, :], shape),
        np.broadcast_to(y[None, :, :, None], shape),
    )

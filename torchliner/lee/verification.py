"""Verification of the duct solvers: measured errors and their limits.

The error of the Euler solver falls with the mesh, against exact modes of a lined duct.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.duct.case import DuctCase
from torchliner.duct.dispersion import impedance_from_wavenumber, wavenumber_from_impedance
from torchliner.duct.modes import DuctModes, duct_modes
from torchliner.flow_profiles import MeanFlow, TanhProfile, UniformProfile
from torchliner.flow_profiles.mean_flow import Array
from torchliner.lee.basis import Basis
from torchliner.lee.ends import EndModes, end_modes
from torchliner.lee.field import DuctField
from torchliner.lee.mesh import DuctMesh
from torchliner.lee.ports import solve_ports
from torchliner.lee.solver import DuctSolver
from torchliner.lee.sweep import sweep_duct
from torchliner.lee.walls import wall_of

CONDITION = "continuous-velocity"  # no flow slips here: either would do
HEIGHT, LENGTH, FREQUENCY, TRUE = 50e-3, 0.15, 1500.0, 2.33 - 0.30j
CASES: dict[str, MeanFlow] = {
    "no flow": UniformProfile(0.0, HEIGHT),
    "sheared": TanhProfile(0.3, HEIGHT, 0.5),
}
MESHES = ((4, 2), (8, 4), (16, 8), (32, 16))
PUBLISHED = 21.45776 - 2.51104j  # c 343 m/s, M 0.3, Ingard-Myers, downstream
# p on the opposite wall at 26 places, x = -0.05 to 0.2 m, by 40 matched modes of a rigid-lined-
# rigid duct without flow (scripts/oracles/mode_matching.py; a test makes it again).
MATCHED = [
    0.2704552450943+1.0271604121750j, 0.5155037953053+0.9576063187013j,
    0.7228570904701+0.8184073163452j, 0.8776459015565+0.6213699585782j,
    0.9693617773489+0.3832519489909j, 0.9928123251979+0.1243871387856j,
    0.9485982968854-0.1332453745550j, 0.8430050078108-0.3686617515250j,
    0.6871704797449-0.5639968643637j, 0.4957601435968-0.7061651850346j,
    0.2853704083406-0.7875519369247j, 0.0729319461596-0.8060461097437j,
    -0.1257229743350-0.7646159289669j, -0.2970328397231-0.6705713721768j,
    -0.4305628577086-0.5346087251811j, -0.5195136447357-0.3697173821858j,
    -0.5608734643568-0.1900281172895j, -0.5552287505999-0.0096821325109j,
    -0.5062803559214+0.1582006036708j, -0.4201647247873+0.3023734122851j,
    -0.3047542887011+0.4140488285505j, -0.1690593979716+0.4872139981404j,
    -0.0229609531903+0.5186046992979j, 0.1231899302920+0.5076991622879j,
    0.2590041369513+0.4566242351932j, 0.3747245416864+0.3700638785677j,
]  # fmt: skip
FLOOR = 1e-11  # of p: the error of the exact modes
LEAST = 0.5  # by which the last step may miss p + 1: with upwind fluxes p + 1/2 is sure


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
    mesh = DuctMesh(case, np.linspace(0, LENGTH, columns + 1), np.linspace(0, HEIGHT, rows + 1), degree)
    frequency = torch.tensor([FREQUENCY], dtype=torch.float64)
    down, up = _modes_of(profile)  # type: ignore[arg-type]  # flows are frozen records

    def lined_modes(_: MeanFlow, __: Tensor, y: Tensor, flow: bool) -> EndModes:
        return end_modes(down, up, y, flow)

    swept = sweep_duct(case, mesh, frequency, True, math.inf, lined_modes)
    k = case.wavenumber(frequency)
    wall = wall_of(TRUE, mesh, swept.basis, k, frequency, 0.0)
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
            profile, FREQUENCY, TRUE, count=1, direction=d, slip_condition=CONDITION
        )
        for d in ("downstream", "upstream")
    )  # fmt: skip
    return down, up


def node_places(mesh: DuctMesh) -> tuple[Array, Array]:
    """x and y of the elements' nodes, m, each (columns, E, n, n) with y before x."""
    nodes = Basis.of_degree(mesh.degree).nodes.numpy()
    x = mesh.x[:-1, None] + np.diff(mesh.x)[:, None] * nodes
    y = mesh.y[:-1, None] + np.diff(mesh.y)[:, None] * nodes
    shape = (*x.shape[:1], *y.shape, len(nodes))
    return (
        np.broadcast_to(x[:, None, None, :], shape),
        np.broadcast_to(y[None, :, :, None], shape),
    )


def order_rows(degrees: Sequence[int]) -> list[dict[str, Any]]:
    """The Euler solver against exact modes of a duct lined throughout, mesh by mesh."""
    return [row for flow in CASES for row in order_table(flow, degrees)]


def checks(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Name, measured figure, limit, and whether it is held."""
    found = []
    for flow in CASES:
        for degree in sorted({row["degree"] for row in rows}):
            mine = [row for row in rows if (row["flow"], row["degree"]) == (flow, degree)]
            # The finest mesh of those above the modes' own error; the coarsest has no order.
            steps = [row["order"] for row in mine if row["error"] > FLOOR]
            order = steps[-1] if steps else math.nan
            missed = degree + 1 - order
            found.append(_check(f"order {degree + 1} with degree {degree}, {flow}: misses by",
                                missed, LEAST))  # fmt: skip
    finest = [row["error"] for row in rows if row["flow"] == "no flow" and row["degree"] == 4]
    if finest:
        found.append(_check("no flow, degree 4, 32 x 16: relative error of p", finest[-1], 1e-9))
    return [*found, *_wavenumbers(), _matched()]


def _check(name: str, value: float, limit: float) -> dict[str, Any]:
    return {"check": name, "value": value, "limit": limit, "passed": bool(value <= limit)}


def _wavenumbers() -> list[dict[str, Any]]:
    about: dict[str, Any] = {"height": HEIGHT, "mach": 0.3, "sound_speed": 343.0}
    z = torch.tensor(TRUE, dtype=torch.complex128)
    alpha = wavenumber_from_impedance(z, FREQUENCY, **about)
    back = impedance_from_wavenumber(alpha, FREQUENCY, **about)
    flow = UniformProfile(0.3, HEIGHT, sound_speed=343.0)
    solved = duct_modes(flow, FREQUENCY, TRUE, count=1, slip_condition="ingard-myers").wavenumber
    return [
        _check("dispersion relation against its published value (1/m)",
               abs(complex(alpha) - PUBLISHED), 1e-5),
        _check("impedance to wavenumber and back", abs(complex(back) - TRUE), 1e-12),
        _check("eigen-solver against the dispersion relation, relative",
               abs(complex(solved.reshape(-1)[0]) / complex(alpha) - 1), 1e-6),
    ]  # fmt: skip


def _matched() -> dict[str, Any]:
    """Rigid-lined-rigid without flow, on the opposite wall, against 40 matched modes."""
    flow = UniformProfile(0.0, HEIGHT)
    case = DuctCase(flow, -0.15, 0.3, (0.0, 0.15))
    places = np.linspace(-0.05, 0.2, 26)
    solver = DuctSolver(case, FREQUENCY, keep="walls")
    field = solver.solve(TRUE).wall_pressure(places)
    matched = torch.tensor(MATCHED, dtype=torch.complex128)
    away = float((field - matched).abs().max() / matched.abs().max())
    return _check("rigid-lined-rigid without flow against 40 matched modes", away, 1e-4)

"""A duct swept at its frequencies, and what of it is kept to read fields from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchliner.duct.case import DuctCase
from torchliner.lee.basis import Basis, Rows
from torchliner.lee.columns import Column, condense_column
from torchliner.lee.ends import EndModes, plane_modes
from torchliner.lee.mesh import DuctMesh
from torchliner.lee.ports import Response
from torchliner.lee.sweep import Station, sweep

AT_ONCE = 128 * 2**20  # bytes of one sweep's waves; beyond, fewer frequencies are swept together


@dataclass(frozen=True, eq=False)
class Kept:
    """Waves of one sweep, for unit waves in; D of them.

    Args:
        columns: of the mesh, those alike being one and the same, or nothing.
        incoming: into each column, (F, I, D), or nothing.
        upper: waves (p + v)/2 that arrive at the rigid wall, (F, C, n, D).
        lower: waves (p - v)/2 that arrive at the lower one, (F, C, n, D).
    """

    columns: list[Column]
    incoming: list[Tensor]
    upper: Tensor
    lower: Tensor


@dataclass(frozen=True, eq=False)
class SweptDuct:
    """All sweeps of a duct.

    Args:
        mesh, basis: of the duct.
        modes: at its ends.
        response: to unit waves, all frequencies.
        parts: what is kept, one after the other along the frequencies.
    """

    mesh: DuctMesh
    basis: Basis
    modes: EndModes
    response: Response
    parts: list[Kept]


def sweep_duct(
    case: DuctCase,
    mesh: DuctMesh,
    frequency: Tensor,
    keep_all: bool,
    memory: float,
    modes: Callable[..., EndModes] = plane_modes,
) -> SweptDuct:
    """Condense and sweep; see ``DuctSolver``. ``modes`` are those that the ends let out."""
    basis = Basis.of_degree(mesh.degree, frequency.device)
    rows = Rows.of_flow(basis, mesh.y, case.profile)
    flow = bool((rows.flow != 0).any())
    y = mesh.y[:-1, None] + np.diff(mesh.y)[:, None] * basis.nodes.cpu().numpy()
    at_ends = modes(case.profile, frequency, torch.as_tensor(y.ravel()).to(frequency), flow)
    each = _bytes_swept(mesh, basis.count, flow)
    at_once = max(1, int(AT_ONCE // each))
    held = len(frequency) if keep_all else min(at_once, len(frequency))
    need = held * each + len(frequency) * _bytes_of_walls(mesh, basis.count)
    if need > memory:
        fewer = "give keep='walls' if pressures along the walls are enough, or " if keep_all else ""
        raise ValueError(
            f"the waves of {mesh.unknowns} unknowns take {need / 2**30:.3g} GB for "
            f"{len(frequency)} frequencies, above the limit of {memory / 2**30:.3g} GB; {fewer}"
            "take fewer frequencies, a coarser mesh or more memory"
        )
    means = torch.as_tensor(np.diff(mesh.y)[:, None] * basis.weights.cpu().numpy() / case.height)
    k = case.wavenumber(frequency)
    parts, responses = [], []
    for start in range(0, len(frequency), at_once):
        at = slice(start, start + at_once)
        chosen = EndModes(at_ends.wavenumber[at], at_ends.along[at], at_ends.against[at])
        columns = _columns(k[at], mesh, basis, rows, flow)
        part, response = _one_sweep(columns, chosen, means.flatten().to(at_ends.along), keep_all)
        parts.append(part)
        responses.append(response)
    whole = (torch.cat([getattr(r, name) for r in responses]) for name in Response.__annotations__)
    return SweptDuct(mesh, basis, at_ends, Response(*whole), parts)


def _columns(k: Tensor, mesh: DuctMesh, basis: Basis, rows: Rows, flow: bool) -> list[Column]:
    """One column for each width, with and without lined wall, as often as the mesh has it."""
    known: dict[tuple[float, bool], Column] = {}
    columns = []
    for width, lined in zip(mesh.widths.tolist(), mesh.lined.tolist(), strict=True):
        if (width, lined) not in known:
            known[width, lined] = condense_column(k, width, basis, rows, flow, lined)
        columns.append(known[width, lined])
    return columns


def _one_sweep(
    columns: list[Column], modes: EndModes, means: Tensor, keep_all: bool
) -> tuple[Kept, Response]:
    incoming, wall, upper, lower = [], [], [], []
    points = len(means)
    for step in sweep(columns, modes.ends):
        if not isinstance(step, Station):
            left_out, right_out = step
            break
        vertical = step.column.vertical
        n = step.column.elements.interior.shape[-1] - step.column.elements.along
        n //= 3  # waves against the flow, up and down are n each
        upper.append(vertical[:, -n:] @ step.incoming)  # turned at the rigid wall: down into it
        lower.append(step.wall_out if step.column.lined else vertical[:, :n] @ step.incoming)
        if step.column.lined:
            wall.append(step.wall_out)
        if keep_all:
            incoming.append(step.incoming)
    empty = left_out.new_zeros(len(left_out), 0, left_out.shape[-1])
    response = Response(
        wall=torch.cat(wall, 1) if wall else empty,
        left=means @ left_out,
        right=means @ right_out[:, :points],
        left_modes=modes.against @ means,
        right_modes=modes.along[..., :points] @ means,
    )
    kept = columns if keep_all else []
    return Kept(kept, incoming, torch.stack(upper, 1), torch.stack(lower, 1)), response


def _bytes_swept(mesh: DuctMesh, n: int, flow: bool) -> int:
    """Of the waves into all columns, for one frequency: a sweep's own, kept for fields inside."""
    across = (len(mesh.y) - 1) * n
    waves = len(mesh.lined) * across * (3 if flow else 2) + n * int(mesh.lined.sum())
    return 16 * waves * _units(mesh, n)


def _bytes_of_walls(mesh: DuctMesh, n: int) -> int:
    """Of the waves that arrive at both walls and, for the response, at the lined one."""
    return 16 * n * (2 * len(mesh.lined) + int(mesh.lined.sum())) * _units(mesh, n)


def _units(mesh: DuctMesh, n: int) -> int:
    """D, unit waves in: two modes at either end and n points of each lined column."""
    return 4 + n * int(mesh.lined.sum())


def point_rows(
    swept: SweptDuct, part: Kept, x: NDArray[np.float64], y: NDArray[np.float64]
) -> Tensor:
    """p, u and v at points for unit waves in, (F, P, 3, D), by the elements' own polynomials."""
    mesh, basis = swept.mesh, swept.basis
    column = np.clip(np.searchsorted(mesh.x, x, "right") - 1, 0, len(mesh.x) - 2)
    element = np.clip(np.searchsorted(mesh.y, y, "right") - 1, 0, len(mesh.y) - 2)
    along = basis.values((x - mesh.x[column]) / np.diff(mesh.x)[column])
    across = basis.values((y - mesh.y[element]) / np.diff(mesh.y)[element])
    incoming = part.incoming[0]
    found = incoming.new_zeros(len(incoming), len(x), 3, incoming.shape[-1])
    for number in np.unique(column):
        here = np.flatnonzero(column == number)
        rows = _column_rows(part.columns[number], element[here], along[here], across[here])
        found[:, torch.as_tensor(here).to(found.device)] = rows @ part.incoming[number][:, None]
    return found


def _column_rows(
    column: Column, element: NDArray[np.int64], along: Tensor, across: Tensor
) -> Tensor:
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

r"""All columns of a duct, swept from the right end to the left and back.

With a the waves along the flow, b those against it and x those from the lined wall, each column
gives a' = S_aa a + S_ab b' + S_aw x and b = S_ba a + S_bb b' + S_bw x, primes on its right side.
Let b' = R' a' + s' hold there for everything on the right. Then b' = P a + t with

.. math:: P = (1 - R' S_{ab})^{-1} R' S_{aa}, \quad
    t = (1 - R' S_{ab})^{-1} (R' S_{aw} x + s'),

and R = S_ba + S_bb P, s = S_bb t + S_bw x hold on its left side. At the right end R = 0. The second
sweep runs from a at the left end through a' = S_aa a + S_ab (P a + t) + S_aw x.

All x at once: the waves are matrices with one column for each unit wave into the duct, at its left
end, through its lined wall in the order of x, and at its right end. What an impedance or an end
reflection changes comes later (``ports.py``); the sweep is done once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchliner.duct.basis import Basis, Rows
from torchliner.duct.case import DuctCase
from torchliner.duct.columns import Column, condense_column
from torchliner.duct.ends import EndModes, plane_modes
from torchliner.duct.mesh import DuctMesh
from torchliner.duct.ports import Response

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
        mesh, basis: of the duct.  modes: at its ends.  response: to unit waves, all frequencies.
        parts: what is kept, one after the other along the frequencies.
    """

    mesh: DuctMesh
    basis: Basis
    modes: EndModes
    response: Response
    parts: list[Kept]


def sweep_duct(
    case: DuctCase, mesh: DuctMesh, frequency: Tensor, keep_all: bool, memory: float,
    modes: Callable[..., EndModes] = plane_modes,
) -> SweptDuct:  # fmt: skip
    """Condense and sweep; see ``DuctSolver``. ``modes`` are those that the ends let out."""
    basis = Basis.of_degree(mesh.degree, frequency.device)
    rows = Rows.of_flow(basis, mesh.y, case.profile)
    flow = bool((rows.flow != 0).any())
    y = mesh.y[:-1, None] + np.diff(mesh.y)[:, None] * basis.nodes.cpu().numpy()
    at_ends = modes(case.profile, frequency, torch.as_tensor(y.ravel()).to(frequency), flow)
    each, walls = _bytes_of_waves(mesh, basis.count, flow)
    at_once = max(1, int(AT_ONCE // each))
    held = len(frequency) if keep_all else min(at_once, len(frequency))
    need = held * each + len(frequency) * walls
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


def _one_sweep(columns: list[Column], modes: EndModes, means: Tensor, keep_all: bool) -> tuple[Kept, Response]:
    """Both sweeps over the columns, for a unit wave into each opening of the duct."""
    left, right = modes.along.mT, modes.against.flip(1).mT  # unit waves into the ends
    first, widths = left.shape[-1], [column.open_waves for column in columns]
    wall_from = [first + sum(widths[:i]) for i in range(len(columns))]
    total = first + sum(widths) + right.shape[-1]
    passes, sources = _backward(columns, left, right)
    along = left.new_zeros(*left.shape[:2], total)
    along[..., :first] = left
    kept: list[Tensor] = []
    wall, upper, lower = [], [], []
    for i, column in enumerate(columns):
        back = passes[i] @ along
        back[..., wall_from[i] :] += sources[i]
        passes[i] = sources[i] = back[..., :0]  # done with
        wall_in = along.new_zeros(len(along), widths[i], total)
        wall_in[..., wall_from[i] : wall_from[i] + widths[i]] = torch.eye(widths[i])
        incoming = torch.cat([along, back, wall_in], -2)
        if i == 0:
            left_out = column.out["left"] @ incoming
        wall.append(column.out["wall"] @ incoming)
        n = column.points
        upper.append(column.vertical[:, -n:] @ incoming)  # turned at the rigid wall: down into it
        lower.append(wall[-1] if column.lined else column.vertical[:, :n] @ incoming)
        if keep_all:
            kept.append(incoming)
        along = column.out["right"] @ incoming
    points = len(means)
    response = Response(
        wall=torch.cat(wall, 1),
        left=means @ left_out,
        right=means @ along[:, :points],
        left_modes=modes.against @ means,
        right_modes=modes.along[..., :points] @ means,
    )
    parts = Kept(columns if keep_all else [], kept, torch.stack(upper, 1), torch.stack(lower, 1))
    return parts, response


def _backward(columns: list[Column], left: Tensor, right: Tensor) -> tuple[list[Tensor], list[Tensor]]:
    """P and t of every column; t has the columns of its own wall and of all on its right."""
    reflection = right.new_zeros(len(right), right.shape[1], left.shape[1])
    source = right
    passes: list[Tensor] = []
    sources: list[Tensor] = []
    for column in reversed(columns):
        blocks, width = column.blocks, column.open_waves
        one = torch.eye(reflection.shape[-2], dtype=reflection.dtype, device=reflection.device)
        sides = torch.cat([reflection @ blocks["right", "left"], reflection @ blocks["right", "wall"], source], -1)
        solved = torch.linalg.solve(one - reflection @ blocks["right", "right"], sides)
        passed, source = solved.tensor_split([blocks["right", "left"].shape[-1]], -1)
        passes.append(passed)
        sources.append(source)
        reflection = blocks["left", "left"] + blocks["left", "right"] @ passed
        source = blocks["left", "right"] @ source
        source[..., :width] += blocks["left", "wall"]
    return passes[::-1], sources[::-1]


def _bytes_of_waves(mesh: DuctMesh, n: int, flow: bool) -> tuple[int, int]:
    """For one frequency: of a sweep's own, into all columns, kept for fields inside; and of those
    that arrive at both walls and, for the response, at the lined one."""
    columns, lined = len(mesh.lined), int(mesh.lined.sum())
    across = (len(mesh.y) - 1) * n
    units = 4 + n * lined  # D: two modes at either end and n points of each lined column
    inside = columns * across * (3 if flow else 2) + n * lined
    return 16 * inside * units, 16 * n * (2 * columns + lined) * units

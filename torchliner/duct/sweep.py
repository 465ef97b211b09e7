r"""All columns of a duct, swept from the right end to the left and back.

With a the waves along the flow, b those against it and x those from the lined wall, each column
gives a' = S_aa a + S_ab b' + S_aw x and b = S_ba a + S_bb b' + S_bw x, primes on its right side.
Let b' = R' a' + s' hold there for everything on the right. Then b' = P a + t with

.. math:: P = (1 - R' S_{ab})^{-1} R' S_{aa}, \quad
    t = (1 - R' S_{ab})^{-1} (R' S_{aw} x + s'),

and R = S_ba + S_bb P, s = S_bb t + S_bw x hold on its left side. At the right end R = 0. The second
sweep runs from a at the left end through a' = S_aa a + S_ab (P a + t) + S_aw x.

All x at once: the waves are matrices with one column for each unit wave into the duct, in the order of
X = (s_L, c_L, x, s_R, c_R): the plane-like modes into the left end (downstream s, upstream c: its part
along the flow), the waves x from the lined wall and the modes into the right end (upstream s,
downstream c). What an impedance or an end reflection changes comes later (``boundaries.py``); the
sweep is done once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchliner.duct.boundaries import EndModes, plane_modes
from torchliner.duct.case import DuctCase
from torchliner.duct.columns import Column, Rows, condense_column
from torchliner.duct.mesh import DuctMesh
from torchliner.duct.polynomials import Basis

AT_ONCE = 128 * 2**20  # bytes of one sweep's waves; beyond, fewer frequencies are swept together
MEMORY = 2 * 2**30  # bytes that the waves may take, those kept and those of the sweep in hand


@dataclass(frozen=True, eq=False)
class SweptDuct:
    """What the duct does with D unit waves into it.

    Args:
        mesh, basis: of the duct.  modes: at its ends.
        reading: (F, W + 2, D): waves that arrive at the lined wall; then, of the left and the right end, the mean of
            the outgoing p -+ u less that of the end's modes, which is 0 where no other wave goes out.
        upper, lower: waves (p + v)/2 that arrive at the rigid wall and (p - v)/2 at the other, (F, C, n, D).
        columns, incoming: of the mesh, those alike being one and the same, and the waves into each, (F, I, D); nothing
            if only the walls are kept.
    """

    mesh: DuctMesh
    basis: Basis
    modes: EndModes
    reading: Tensor
    upper: Tensor
    lower: Tensor
    columns: list[Column]
    incoming: list[Tensor]


def sweep_duct(
    case: DuctCase,
    mesh: DuctMesh,
    frequency: Tensor,
    keep_all: bool,
    modes: Callable[..., EndModes] = plane_modes,
    memory: float = MEMORY,
) -> SweptDuct:
    """Condense and sweep; see ``DuctSolver``. ``modes`` are those that the ends let out."""
    basis = Basis.of_degree(mesh.degree, frequency.device)
    rows = Rows.of_flow(basis, mesh.y, case.profile)
    flow = bool((rows.flow != 0).any())
    sizes = np.diff(mesh.y)[:, None]
    y = torch.as_tensor((mesh.y[:-1, None] + sizes * basis.nodes.cpu().numpy()).ravel()).to(frequency)
    means = torch.as_tensor((sizes * basis.weights.cpu().numpy() / case.height).ravel()).to(y.device, torch.complex128)
    ends = modes(case.profile, frequency, y, flow)
    at_once = _frequencies_at_once(mesh, basis.count, flow, len(frequency), keep_all, memory)
    kinds = list(zip(mesh.widths.tolist(), mesh.lined.tolist(), strict=True))
    parts, columns = [], []
    for at in torch.arange(len(frequency), device=frequency.device).split(at_once):
        k = case.wavenumber(frequency[at])
        known = {kind: condense_column(k, kind[0], basis, rows, flow, kind[1]) for kind in set(kinds)}
        columns = [known[kind] for kind in kinds]
        parts.append(_one_sweep(columns, EndModes(*(part[at] for part in ends)), means, keep_all))
    reading, upper, lower = (torch.cat(part) for part in list(zip(*parts, strict=True))[:3])
    incoming = parts[0][3]  # of all frequencies, if kept
    return SweptDuct(mesh, basis, ends, reading, upper, lower, columns if keep_all else [], incoming)


def _frequencies_at_once(mesh: DuctMesh, n: int, flow: bool, wanted: int, keep_all: bool, memory: float) -> int:
    """How many frequencies to sweep together: all, where all waves are kept.

    Raises:
        ValueError: what is kept and in hand takes more than ``memory``.
    """
    columns, lined = len(mesh.lined), int(mesh.lined.sum())
    units = 4 + n * lined  # D: two modes at either end and n points of each lined column
    inside = columns * (len(mesh.y) - 1) * n * (3 if flow else 2) + n * lined  # into all columns
    each, walls = 16 * inside * units, 16 * n * (2 * columns + lined) * units
    at_once = wanted if keep_all else min(wanted, max(1, int(AT_ONCE // each)))
    need = at_once * each + wanted * walls
    if need > memory:
        fewer = "give keep='walls' if pressures along the walls are enough, or " if keep_all else ""
        raise ValueError(
            f"the waves of {mesh.unknowns} unknowns take {need / 2**30:.3g} GB for {wanted} frequencies, above the "
            f"limit of {memory / 2**30:.3g} GB; {fewer}take fewer frequencies, a coarser mesh or more memory"
        )
    return at_once


def _one_sweep(
    columns: list[Column], modes: EndModes, means: Tensor, keep_all: bool
) -> tuple[Tensor, Tensor, Tensor, list[Tensor]]:
    """Both sweeps over the columns: reading, upper, lower and incoming waves of ``SweptDuct``."""
    left, right = modes.along.mT, modes.against.flip(1).mT  # unit waves into the ends
    starts = np.cumsum([left.shape[-1], *(column.lined for column in columns)]).tolist()
    total, n = starts[-1] + right.shape[-1], modes.against.shape[-1] // columns[0].interior.shape[1]
    passes, sources = _backward(columns, left, right)
    along = left.new_zeros(*left.shape[:2], total)
    along[..., : starts[0]] = left
    kept: list[Tensor] = []
    wall, upper, lower = [], [], []
    for i, column in enumerate(columns):
        back = passes[i] @ along
        back[..., starts[i] :] += sources[i]
        passes[i] = sources[i] = back[..., :0]  # done with
        from_wall = along.new_zeros(len(along), column.lined, total)
        from_wall[..., starts[i] : starts[i + 1]] = torch.eye(column.lined)
        incoming = torch.cat([along, back, from_wall], -2)
        if i == 0:
            left_out = column.out["left"] @ incoming
        wall.append(column.out["wall"] @ incoming)
        upper.append(column.vertical[:, -n:] @ incoming)  # turned at the rigid wall: down into it
        lower.append(wall[-1] if column.lined else column.vertical[:, :n] @ incoming)
        kept += [incoming] if keep_all else []
        along = column.out["right"] @ incoming
    going = torch.stack([means @ left_out, means @ along[:, : len(means)]], 1)
    going[:, 0, :2] -= modes.against @ means
    going[:, 1, -2:] -= (modes.along[..., : len(means)] @ means).flip(1)
    return torch.cat([*wall, going], 1), torch.stack(upper, 1), torch.stack(lower, 1), kept


def _backward(columns: list[Column], left: Tensor, right: Tensor) -> tuple[list[Tensor], list[Tensor]]:
    """P and t of every column; t has the columns of its own wall and of all on its right."""
    reflection = right.new_zeros(len(right), right.shape[1], left.shape[1])
    one = torch.eye(right.shape[1], dtype=right.dtype, device=right.device)
    source = right
    passes: list[Tensor] = []
    sources: list[Tensor] = []
    for column in reversed(columns):
        block = column.block
        sides = torch.cat([reflection @ block("right", "left"), reflection @ block("right", "wall"), source], -1)
        solved = torch.linalg.solve(one - reflection @ block("right", "right"), sides)
        passed, source = solved.tensor_split([left.shape[1]], -1)
        passes.append(passed)
        sources.append(source)
        reflection = block("left", "left") + block("left", "right") @ passed
        source = block("left", "right") @ source
        source[..., : column.lined] += block("left", "wall")
    return passes[::-1], sources[::-1]

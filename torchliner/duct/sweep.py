r"""All columns of a duct, swept from the right end to the left and back, for every unit wave into the duct.

With a the waves along the flow, b those against it and x those from the lined wall, each column gives
a' = S_aa a + S_ab b' + S_aw x and b = S_ba a + S_bb b' + S_bw x, primes on its right side. Where b' = R' a' + s' holds,

.. math:: b' = P a + t, \quad P = (1 - R' S_{ab})^{-1} R' S_{aa}, \quad
    t = (1 - R' S_{ab})^{-1} (R' S_{aw} x + s'),

and R = S_ba + S_bb P, s = S_bb t + S_bw x hold on its left side; at the right end R = 0. The waves are matrices with
one column for each unit wave, in the order of X = (s_L, c_L, x, s_R, c_R): the plane-like modes into the left end
(downstream s, upstream c: its part along the flow), the waves from the lined wall, the modes into the right end.
"""

from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

from torchliner.duct.columns import Basis, Column, Rows
from torchliner.duct.mesh import DuctMesh
from torchliner.duct.modes import DuctModes, duct_modes
from torchliner.engine.sums import one_thread
from torchliner.names import DIRECTIONS


class SweptDuct:
    """What a duct does with D unit waves into it, at frequencies (Hz, (F,)).

    ``modes``: downstream and upstream, what the ends let out, mode 0 of each; default those of the rigid duct.

    Attributes:
        mesh, basis, frequency: of the duct.  wavenumber: alpha of the ends' modes, 1/m, (F, 2).
        reading: (F, W + 2, D): waves that arrive at the lined wall; then, of the left and the right end, the mean of
            the outgoing p -+ u less that of the end's modes, which is 0 where no other wave goes out.
        upper, lower: waves (p + v)/2 that arrive at the rigid wall and (p - v)/2 at the other, (F, C, n, D).
    """

    def __init__(self, mesh: DuctMesh, frequency: Tensor, modes: tuple[DuctModes, DuctModes] | None = None) -> None:
        self.mesh, self.frequency, case = mesh, frequency, mesh.case
        self.basis = basis = Basis(mesh.degree, frequency.device)
        self._rows = Rows(basis, mesh.y, case.profile)
        self._flow = bool((self._rows.flow != 0).any())
        sizes = np.diff(mesh.y)[:, None]
        y = torch.as_tensor((mesh.y[:-1, None] + sizes * basis.nodes.cpu().numpy()).ravel()).to(frequency)
        means = torch.as_tensor((sizes * basis.weights.cpu().numpy() / case.height).ravel())
        means = means.to(y.device, torch.complex128)
        pair = modes or [duct_modes(case.profile, frequency, count=1, direction=d) for d in DIRECTIONS]
        p, u, v = (torch.cat([f[:, :1] for f in each], 1) for each in zip(*(m.at(y) for m in pair), strict=True))
        self.wavenumber = torch.stack([m.wavenumber[:, 0] for m in pair], -1)
        along, against = (p + u) / 2, (p - u) / 2
        going = torch.stack([against @ means, (along @ means).flip(1)], 1)  # out of the left and the right end
        # Unit waves into the ends, (F, N or 2 N, 2).
        self._ends = torch.cat([along, v], -1).mT if self._flow else along.mT, against.flip(1).mT
        n, parts = basis.count, []
        with one_thread():  # see ``DuctSolver.solve``
            for at, found, waves in self.sweeps():
                wall, upper, lower, out = [], [], [], list[Tensor]()
                for column, incoming in zip(found, waves, strict=True):
                    wall.append(column.out["wall"] @ incoming)
                    upper.append(column.vertical[:, -n:] @ incoming)  # turned at the rigid wall: down into it
                    lower.append(wall[-1] if column.lined else column.vertical[:, :n] @ incoming)
                    out = out or [means @ (column.out["left"] @ incoming)]
                out.append(means @ (column.out["right"] @ incoming)[:, : len(means)])
                out[0][:, :2] -= going[at, 0]
                out[1][:, -2:] -= going[at, 1]
                parts.append((torch.cat([*wall, torch.stack(out, 1)], 1), torch.stack(upper, 1), torch.stack(lower, 1)))
        self.reading, self.upper, self.lower = (torch.cat(part) for part in zip(*parts, strict=True))

    def sweeps(self) -> Iterator[tuple[slice, list[Column], Iterator[Tensor]]]:
        """A frequency at a time, so that their waves do not pile up: which, the columns, and the unit waves into each,
        (1, I, D), from the left on."""
        kinds = list(zip(self.mesh.widths.tolist(), self.mesh.lined.tolist(), strict=True))
        for at in (slice(i, i + 1) for i in range(len(self.frequency))):
            k = self.mesh.case.wavenumber(self.frequency[at])
            known = {kind: Column(k, kind[0], self.basis, self._rows, self._flow, kind[1]) for kind in set(kinds)}
            columns = [known[kind] for kind in kinds]
            yield at, columns, _waves_into(columns, *(part[at] for part in self._ends))


def _waves_into(columns: list[Column], left: Tensor, right: Tensor) -> Iterator[Tensor]:
    """The unit waves into each column by both sweeps."""
    starts = np.cumsum([left.shape[-1], *(column.lined for column in columns)]).tolist()
    # Backward: P and t of every column, from the right on; t has the columns of its own wall and of all on its right.
    reflection = right.new_zeros(len(right), right.shape[1], left.shape[1])
    one = torch.eye(right.shape[1], dtype=right.dtype, device=right.device)
    source, passes, sources = right, [], []
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
    # Forward: the waves themselves.
    along = left.new_zeros(*left.shape[:2], starts[-1] + right.shape[-1])
    along[..., : starts[0]] = left
    for i, column in enumerate(columns):
        back = passes.pop() @ along
        back[..., starts[i] :] += sources.pop()
        from_wall = along.new_zeros(len(along), column.lined, along.shape[-1])
        from_wall[..., starts[i] : starts[i + 1]] = torch.eye(column.lined)
        incoming = torch.cat([along, back, from_wall], -2)
        yield incoming
        along = column.out["right"] @ incoming

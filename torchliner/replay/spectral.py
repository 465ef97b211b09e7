r"""The fast engine: the impedance at chosen frequencies in one pass over the data.

For a tone the windowed line of the reflected signal is a weighted sum over the emission times of
R(f_q, |v_k|) at one to a few frequencies f_q (see ``edges``), so no reflected signal is formed:
R is evaluated in place for liners that offer a ``speed_law``; what has no formula (other liners,
the kernels' own response, the ends of a record) is a table over (time, level), gathered and
interpolated; both are weighted and reduced. This also says what the method is: the educed R is the
window-weighted mean of R(f0, |v(t)|), plus its line at 2 f0 when a phase is stated.

Sums over slabs of time add up; a column's sum never meets its neighbours'. Slabs are cut into
blocks small enough for the cache; sums of up to 16 samples are made in the data's precision, all
others in float64.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from torchliner.liners.nonlinear import SpeedLaw
from torchliner.records.slabs import SLAB_ROWS, Bounds, bounds_of
from torchliner.replay.block_lines import BlockLine
from torchliner.replay.column_sums import ColumnSums, Task
from torchliner.replay.incident import LineSums
from torchliner.replay.levels import VelocityGrid
from torchliner.replay.lines import AnyLine
from torchliner.replay.sources import SpeedSource, block_elements, in_full_precision

FREQUENCIES_AT_ONCE = 8  # whose tables over (time, level) are held together
SMALLEST_SINGLE = 1e-15  # b d of a law between this and its inverse has squares in float32


@in_full_precision
def spectral_sums(
    source: SpeedSource,
    lines: Sequence[AnyLine],
    grid: VelocityGrid,
    *,
    block_lines: Sequence[BlockLine] = (),
    bounds: Bounds | None = None,
    elements: int | None = None,
    compile_loops: str = "auto",
    progress: Callable[[int], None] | None = None,
) -> LineSums:
    """Windowed lines of the reflected signal at each frequency, without forming the signal.

    Args:
        source: velocity, read by slabs.
        lines: of each frequency, F of them, all with the same directions.
        grid: velocity levels of the tables, but of lines that have their own.
        block_lines: of each frequency, for means over blocks of the record; no derivatives.
        bounds, elements: of slabs and blocks; they change the result by rounding only.
        compile_loops: ``auto``: fuse the inner loops where that pays; ``never``; ``always``. A
            missing compiler is warned of once and changes nothing but the time.
        progress: called with the number of samples done.
    Returns:
        Sums, complex128, (P, F), on the source's device; differentiable in the liner. With
        ``block_lines`` also ``LineSums.blocks``; without ``lines`` these alone.
    """
    bounds = source.bounds() if bounds is None else bounds
    elements = block_elements(source.device) if elements is None else elements
    longest = max(end - begin for begin, end in bounds)
    groups = [ColumnSums(lines, block_lines, source, i, elements, longest, compile_loops)
              for i in range(len(source.widths))]  # fmt: skip
    coefficients = [_coefficients(line.law, source) for line in lines]
    of_blocks = [_BlockTasks(i, line, source, grid) for i, line in enumerate(block_lines)]
    # Sum of all weights: the part of R = 1 + 2 (R - 1)/2 that is 1.
    directions = lines[0].directions if lines else 1
    constants = torch.zeros(len(lines), directions, 1, dtype=torch.complex128)
    for (begin, end), slab in zip(bounds, source.slabs(bounds), strict=True):
        # Long slabs, of files whose time runs fastest, are worked on in short ones.
        for low, high in bounds_of(end - begin, SLAB_ROWS):
            for first in range(0, max(len(lines), len(of_blocks)), FREQUENCIES_AT_ONCE):
                batch = slice(first, first + FREQUENCIES_AT_ONCE)
                tasks = [each.task(begin + low, begin + high) for each in of_blocks[batch]]
                for i in range(len(lines))[batch]:
                    samples = begin + low, begin + high
                    weights, made = _tasks(i, lines[i], coefficients[i], samples, source, grid)
                    constants[i, :, 0] += weights
                    tasks += made
                for group, columns in zip(groups, slab, strict=True):
                    group.add(columns.part(slice(low, high), slice(None)), tasks)
        if progress is not None:
            progress(end - begin)
    blocks = _block_means(groups, block_lines) if block_lines else None
    if not lines:
        nothing = torch.zeros(sum(source.widths), 0, dtype=torch.complex128, device=source.device)
        return LineSums(nothing, None, blocks)
    totals = torch.cat([group.sums() for group in groups], dim=-1)  # (F, directions, P)
    totals = totals + constants.to(totals.device)
    backward = totals[:, 1].T if totals.shape[1] == 2 else None
    return LineSums(totals[:, 0].T, backward, blocks)


def _block_means(groups: Sequence[ColumnSums], lines: Sequence[BlockLine]) -> LineSums:
    """Means over blocks, (S, P, F), in the precision of the sums."""
    found = []
    for i, line in enumerate(lines):
        sums = torch.cat([group.block_sums(i) for group in groups], dim=-1)
        found.append(line.means(sums))
    both = [torch.stack(each, dim=-1) for each in zip(*found, strict=True)]
    return LineSums(both[0], both[1] if len(both) == 2 else None)


class _BlockTasks:
    """The block means of one frequency."""

    def __init__(
        self, index: int, line: BlockLine, source: SpeedSource, grid: VelocityGrid
    ) -> None:
        self.index, self.line, self.source, self.grid = index, line, source, grid
        law = _coefficients(line.law, source)
        self.coefficients = None if law is None else law.detach()
        self.levels = None
        if line.response is not None:
            parts = torch.view_as_real(line.response.detach())
            self.levels = parts.to(source.device, source.dtype)

    def task(self, begin: int, end: int) -> Task:
        """Of samples begin .. end - 1."""
        first, weights = self.line.weights(begin, end)
        dtype = self.source.dtype
        if self.coefficients is not None:
            weights, dtype = 2 * weights, self.coefficients.dtype  # the formula gives (R - 1)/2
        data = _parts(weights.flatten(1)[:, None]).to(self.source.device, dtype)
        return Task(self.index, self.coefficients, data, self.grid, self.levels, first)


def _coefficients(law: SpeedLaw | None, source: SpeedSource) -> Tensor | None:
    """Of a law's formula, in the precision in which its squares exist; None without a law."""
    if law is None:
        return None
    size = (law.b * law.d).detach()
    single = SMALLEST_SINGLE < float(size.min()) <= float(size.max()) < 1 / SMALLEST_SINGLE
    return law.inverse_coefficients().to(source.device, source.dtype if single else torch.float64)


def _tasks(
    i: int,
    line: AnyLine,
    coefficients: Tensor | None,
    samples: tuple[int, int],
    source: SpeedSource,
    grid: VelocityGrid,
) -> tuple[Tensor | float, list[Task]]:
    """Sums that line ``i`` needs of some emissions, and the sum of its weights."""
    total: Tensor | float = 0.0
    tasks = []
    if coefficients is not None:
        weights = line.weights(*samples)
        total = weights.sum((0, 1))
        # Twice: the formula gives (R - 1)/2.
        data = _parts(2 * weights).to(source.device, coefficients.dtype)
        tasks.append(Task(i, coefficients, data, grid))
    table = line.rows(*samples)
    if table is not None:
        data = _parts(table).to(source.device, source.dtype)
        tasks.append(Task(i, None, data, line.grid or grid))
    return total, tasks


def _parts(values: Tensor) -> Tensor:
    """Complex (t, ..., directions) as real and imaginary parts, (t, ..., 2 directions)."""
    return torch.view_as_real(values).flatten(2)

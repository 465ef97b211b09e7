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

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.liners.nonlinear import SpeedLaw, inverse_parts, powers
from torchliner.records.slabs import SLAB_ROWS, Bounds, bounds_of
from torchliner.replay.compiled import GROUP, PAYS_FROM, Loop, Shape, compile_loop
from torchliner.replay.gradients import carries_gradient
from torchliner.replay.incident import LineSums
from torchliner.replay.levels import VelocityGrid, gather_rows
from torchliner.replay.lines import Line
from torchliner.replay.sources import (
    Columns,
    SpeedSource,
    block_elements,
    blocks,
    weighted_sums,
)

FREQUENCIES_AT_ONCE = 8  # whose tables over (time, level) are held together
SMALLEST_SINGLE = 1e-15  # b d of a law between this and its inverse has squares in float32


def spectral_sums(
    source: SpeedSource,
    lines: Sequence[Line],
    grid: VelocityGrid,
    *,
    bounds: Bounds | None = None,
    elements: int | None = None,
    compile_loops: str = "auto",
    progress: Callable[[int], None] | None = None,
) -> LineSums:
    """Windowed lines of the reflected signal at each frequency, without forming the signal.

    Args:
        source: velocity, read by slabs.
        lines: of each frequency, F of them, all with the same directions.
        grid: velocity levels of the tables.
        bounds, elements: of slabs and blocks; they change the result by rounding only.
        compile_loops: ``auto``: fuse the inner loops where that pays; ``never``; ``always``. A
            missing compiler is warned of once and changes nothing but the time.
        progress: called with the number of samples done.
    Returns:
        Sums, complex128, (P, F), on the source's device; differentiable in the liner.
    """
    bounds = source.bounds() if bounds is None else bounds
    elements = block_elements(source.device) if elements is None else elements
    longest = max(end - begin for begin, end in bounds)
    groups = [_Group(lines, grid, source, i, elements, longest, compile_loops)
              for i in range(len(source.widths))]  # fmt: skip
    coefficients = [_coefficients(line.law, source) for line in lines]
    # Sum of all weights: the part of R = 1 + 2 (R - 1)/2 that is 1.
    constants = torch.zeros(len(lines), lines[0].directions, 1, dtype=torch.complex128)
    for (begin, end), slab in zip(bounds, source.slabs(bounds), strict=True):
        # Long slabs, of files whose time runs fastest, are worked on in short ones.
        for low, high in bounds_of(end - begin, SLAB_ROWS):
            for first in range(0, len(lines), FREQUENCIES_AT_ONCE):
                batch = range(first, min(first + FREQUENCIES_AT_ONCE, len(lines)))
                tasks = []
                for i in batch:
                    weights, made = _tasks(
                        i, lines[i], coefficients[i], begin + low, begin + high, source
                    )
                    constants[i, :, 0] += weights
                    tasks += made
                for group, columns in zip(groups, slab, strict=True):
                    group.add(columns.part(slice(low, high), slice(None)), tasks)
        if progress is not None:
            progress(end - begin)
    totals = torch.cat([group.sums() for group in groups], dim=-1)  # (F, directions, P)
    totals = totals + constants.to(totals.device)
    backward = totals[:, 1].T if totals.shape[1] == 2 else None
    return LineSums(totals[:, 0].T, backward)


@dataclass(frozen=True)
class _Task:
    """A sum over a slab: by formula with ``data`` (t, lines, parts), or of the table ``data``."""

    index: int
    coefficients: Tensor | None
    data: Tensor


def _coefficients(law: SpeedLaw | None, source: SpeedSource) -> Tensor | None:
    """Of a law's formula, in the precision in which its squares exist; None without a law."""
    if law is None:
        return None
    size = (law.b * law.d).detach()
    single = SMALLEST_SINGLE < float(size.min()) <= float(size.max()) < 1 / SMALLEST_SINGLE
    return law.inverse_coefficients().to(source.device, source.dtype if single else torch.float64)


def _tasks(
    i: int, line: Line, coefficients: Tensor | None, begin: int, end: int, source: SpeedSource
) -> tuple[Tensor | float, list[_Task]]:
    """Sums that line ``i`` needs of emissions begin .. end - 1, and the sum of its weights."""
    total: Tensor | float = 0.0
    tasks = []
    if coefficients is not None:
        weights = line.weights(begin, end)
        total = weights.sum((0, 1))
        # Twice: the formula gives (R - 1)/2.
        data = _parts(2 * weights).to(source.device, coefficients.dtype)
        tasks.append(_Task(i, coefficients, data))
    table = line.rows(begin, end)
    if table is not None:
        tasks.append(_Task(i, None, _parts(table).to(source.device, source.dtype)))
    return total, tasks


def _parts(values: Tensor) -> Tensor:
    """Complex (t, ..., directions) as real and imaginary parts, (t, ..., 2 directions)."""
    return torch.view_as_real(values).flatten(2)


class _Group:
    """Running sums of one group of columns."""

    def __init__(
        self,
        lines: Sequence[Line],
        grid: VelocityGrid,
        source: SpeedSource,
        index: int,
        elements: int,
        rows: int,
        compile_loops: str,
    ) -> None:
        self.count, self.grid, self.elements = len(lines), grid, elements
        self.width, self.samples = source.widths[index], source.samples
        self.dtype, self.device = source.dtype, source.device
        self.compile_loops = compile_loops
        # Of a compiled loop: those of a slab, in whole groups.
        self.rows = -(-min(SLAB_ROWS, rows) // GROUP) * GROUP
        # Real and imaginary part per direction, float64, (2 directions, P_g).
        shape = (len(lines), 2 * lines[0].directions, self.width)
        self.totals = list(torch.zeros(shape, dtype=torch.float64, device=source.device))

    def sums(self) -> Tensor:
        """Complex sums of all lines, (F, directions, P_g)."""
        real, imaginary = torch.stack(self.totals).unflatten(1, (-1, 2)).unbind(2)
        return torch.complex(real, imaginary)

    def add(self, columns: Columns, tasks: Sequence[_Task]) -> None:
        """At most ``SLAB_ROWS`` samples."""
        eager = [task for task in tasks if not self._fused(task, columns)]
        if eager:
            for part in blocks(len(columns.velocity), self.width, self.elements):
                self._eager(eager, columns.part(*part), *part)

    def _fused(self, task: _Task, columns: Columns) -> bool:
        """Whether a compiled loop has done the task."""
        loop = self._loop(task, columns.offset is not None)
        if loop is None:
            return False
        # Contiguous: inductor's loops over transposed columns write beyond their output when the
        # columns are no multiple of its vectors (seen in torch 2.13).
        velocity, data = columns.velocity.contiguous(), task.data.contiguous()
        missing = self.rows - len(velocity)
        if missing:  # one shape only; what is padded has weight 0
            velocity = torch.cat([velocity, velocity.new_zeros(missing, self.width)])
            data = torch.cat([data, data.new_zeros(missing, *data.shape[1:])])
        if task.coefficients is None:
            scale = torch.tensor(1 / self.grid.maximum, dtype=self.dtype, device=self.device)
            partial = loop(velocity, columns.offset, data, scale)
        else:
            partial = loop(velocity, columns.offset, task.coefficients, data)
        self._keep(
            task, torch.stack([sums.sum(0, dtype=torch.float64) for sums in partial]), slice(None)
        )
        return True

    def _loop(self, task: _Task, has_offset: bool) -> Loop | None:
        lines = 0 if task.coefficients is None else len(task.coefficients)
        gradient = carries_gradient(task.data) or (
            task.coefficients is not None and carries_gradient(task.coefficients)
        )
        if self.compile_loops == "never" or gradient or task.data.dtype != self.dtype:
            return None
        work = self.samples * self.width * max(1, lines) * self.count
        if self.compile_loops == "auto" and work < PAYS_FROM:
            return None
        grid = dataclasses.replace(self.grid, maximum=1.0) if lines == 0 else None
        parts = task.data.shape[2]
        return compile_loop(
            Shape(self.device, self.dtype, self.rows, self.width, has_offset, parts, lines, grid)
        )

    def _eager(self, tasks: list[_Task], block: Columns, rows: slice, columns: slice) -> None:
        speed = block.speed
        shared: dict[torch.dtype, tuple[Tensor, Tensor, Tensor]] = {}
        located: tuple[Tensor, list[Tensor]] | None = None
        for task in tasks:
            data = task.data[rows]
            if task.coefficients is None:
                if located is None:
                    index, weights = self.grid.locate(speed)
                    start = torch.arange(len(index), device=index.device) * data.shape[1]
                    located = (index + start[:, None]).flatten(), [w.flatten() for w in weights]
                gathered = gather_rows(data.flatten(0, 1), *located)
                sums = gathered.reshape(*speed.shape, -1).sum(0, dtype=torch.float64).T
            else:
                if data.dtype not in shared:
                    values = speed.to(data.dtype)
                    shared[data.dtype] = (values, *powers(values))
                sums = self._law_sums(task.coefficients, shared[data.dtype], data)
            self._keep(task, sums, columns)

    @staticmethod
    def _law_sums(
        coefficients: Tensor, speeds: tuple[Tensor, Tensor, Tensor], pairs: Tensor
    ) -> Tensor:
        """Sum over time and lines, (2 directions, P_b)."""
        total = None
        for i, each in enumerate(coefficients):
            real, imaginary = inverse_parts(each, *speeds)
            weights = pairs[:, i].T  # (2 directions, t): re, im, re, im
            a, b = weighted_sums(weights, real), weighted_sums(weights, imaginary)
            part = torch.stack([a[0::2] - b[1::2], a[1::2] + b[0::2]], dim=1).flatten(0, 1)
            total = part if total is None else total + part
        assert total is not None
        return total

    def _keep(self, task: _Task, sums: Tensor, columns: slice) -> None:
        """Add to the running sums; out of place where a gradient must pass."""
        before = self.totals[task.index]
        if not (carries_gradient(sums) or carries_gradient(before)):
            before[:, columns] += sums
            return
        left, right, _ = columns.indices(self.width)
        around = (left, self.width - right)
        self.totals[task.index] = before + torch.nn.functional.pad(sums.to(torch.float64), around)

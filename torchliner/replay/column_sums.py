"""Running sums of one group of columns: eager, block by block in the cache, or by fused loops."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.liners.nonlinear import inverse_parts, powers
from torchliner.records.slabs import SLAB_ROWS
from torchliner.replay.block_lines import BlockLine
from torchliner.replay.compiled import GROUP, PAYS_FROM, Loop, Shape, compile_loop
from torchliner.replay.levels import VelocityGrid, carries_gradient, gather_rows
from torchliner.replay.lines import AnyLine
from torchliner.replay.sources import Columns, SpeedSource, blocks, weighted_sums

MOST_FUSED_PARTS = 16  # of a compiled loop: means over short blocks are summed eagerly


@dataclass(frozen=True)
class Task:
    """A sum over a slab: by formula or from ``levels`` with the weights ``data`` (t, lines, parts),
    or of the table over (time, level) ``data``.

    ``grid`` are the levels of its table. With ``first`` it belongs to block means: parts are blocks
    from ``first`` on, then directions.
    """

    index: int
    coefficients: Tensor | None
    data: Tensor
    grid: VelocityGrid
    levels: Tensor | None = None
    first: int | None = None


class ColumnSums:
    """Running sums of one group of columns."""

    def __init__(
        self,
        lines: Sequence[AnyLine],
        block_lines: Sequence[BlockLine],
        source: SpeedSource,
        index: int,
        elements: int,
        rows: int,
        compile_loops: str,
    ) -> None:
        self.count, self.elements = len(lines), elements
        self.width, self.samples = source.widths[index], source.samples
        self.dtype, self.device = source.dtype, source.device
        self.compile_loops = compile_loops
        # Of a compiled loop: those of a slab, in whole groups.
        self.rows = -(-min(SLAB_ROWS, rows) // GROUP) * GROUP
        # Real and imaginary part per direction, float64, (2 directions, P_g).
        parts = 2 * lines[0].directions if lines else 2
        shape = (len(lines), parts, self.width)
        self.totals = list(torch.zeros(shape, dtype=torch.float64, device=source.device))
        self.spreads = [line.spread for line in block_lines]
        # Of blocks, (S + spread, directions, 2, P_g): in the data's precision, they are many.
        self.blocks = [
            torch.zeros(
                line.blocks.count + line.spread, line.directions, 2, self.width,
                dtype=source.dtype, device=source.device,
            )
            for line in block_lines
        ]  # fmt: skip

    def sums(self) -> Tensor:
        """Complex sums of all lines, (F, directions, P_g)."""
        real, imaginary = torch.stack(self.totals).unflatten(1, (-1, 2)).unbind(2)
        return torch.complex(real, imaginary)

    def block_sums(self, index: int) -> Tensor:
        """Complex sums over blocks at one frequency, (S, directions, P_g)."""
        store = self.blocks[index]
        count = len(store) - self.spreads[index]
        return torch.complex(store[:count, :, 0], store[:count, :, 1])

    def add(self, columns: Columns, tasks: Sequence[Task]) -> None:
        """At most ``SLAB_ROWS`` samples."""
        eager = [task for task in tasks if not self._fused(task, columns)]
        if eager:
            for part in blocks(len(columns.velocity), self.width, self.elements):
                self._eager(eager, columns.part(*part), *part)

    def _fused(self, task: Task, columns: Columns) -> bool:
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
            scale = torch.tensor(1 / task.grid.maximum, dtype=self.dtype, device=self.device)
            partial = loop(velocity, columns.offset, data, scale)
        else:
            partial = loop(velocity, columns.offset, task.coefficients, data)
        self._keep(
            task, torch.stack([sums.sum(0, dtype=torch.float64) for sums in partial]), slice(None)
        )
        return True

    def _loop(self, task: Task, has_offset: bool) -> Loop | None:
        lines = 0 if task.coefficients is None else len(task.coefficients)
        gradient = carries_gradient(task.data) or (
            task.coefficients is not None and carries_gradient(task.coefficients)
        )
        if self.compile_loops == "never" or gradient or task.data.dtype != self.dtype:
            return None
        if task.first is not None and (lines == 0 or task.data.shape[2] > MOST_FUSED_PARTS):
            return None
        work = self.samples * self.width * max(1, lines) * max(self.count, len(self.blocks))
        if self.compile_loops == "auto" and work < PAYS_FROM:
            return None
        grid = dataclasses.replace(task.grid, maximum=1.0) if lines == 0 else None
        parts = task.data.shape[2]
        return compile_loop(
            Shape(self.device, self.dtype, self.rows, self.width, has_offset, parts, lines, grid)
        )

    def _eager(self, tasks: list[Task], block: Columns, rows: slice, columns: slice) -> None:
        speed = block.speed
        shared: dict[torch.dtype, tuple[Tensor, Tensor, Tensor]] = {}
        located: dict[VelocityGrid, tuple[Tensor, list[Tensor]]] = {}
        for task in tasks:
            data = task.data[rows]
            if task.coefficients is None and task.grid not in located:
                index, weights = task.grid.locate(speed)
                located[task.grid] = index, [w.flatten() for w in weights]
            if task.levels is not None:
                index, weights = located[task.grid]
                values = gather_rows(task.levels, index.flatten(), weights)
                real, imaginary = values.reshape(*speed.shape, 2).unbind(-1)
                sums = _product_sums(data[:, 0].T, real, imaginary)
            elif task.coefficients is None:
                index, weights = located[task.grid]
                start = torch.arange(len(speed), device=speed.device) * data.shape[1]
                place = (index + start[:, None]).flatten()
                gathered = gather_rows(data.flatten(0, 1), place, weights)
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
            part = _product_sums(pairs[:, i].T, real, imaginary)
            total = part if total is None else total + part
        assert total is not None
        return total

    def _keep(self, task: Task, sums: Tensor, columns: slice) -> None:
        """Add to the running sums; out of place where a gradient must pass."""
        if task.first is not None:
            spread = self.spreads[task.index]
            store = self.blocks[task.index][task.first : task.first + spread, ..., columns]
            store += sums.reshape(store.shape).to(store.dtype)
            return
        before = self.totals[task.index]
        if not (carries_gradient(sums) or carries_gradient(before)):
            before[:, columns] += sums
            return
        left, right, _ = columns.indices(self.width)
        around = (left, self.width - right)
        self.totals[task.index] = before + torch.nn.functional.pad(sums.to(torch.float64), around)


def _product_sums(weights: Tensor, real: Tensor, imaginary: Tensor) -> Tensor:
    """Sums over time of complex weights (parts, t), re, im, re, im, times complex values (t, P)."""
    a, b = weighted_sums(weights, real), weighted_sums(weights, imaginary)
    return torch.stack([a[0::2] - b[1::2], a[1::2] + b[0::2]], dim=1).flatten(0, 1)

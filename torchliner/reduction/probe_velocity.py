"""v of a plane's probes and of its cells, read by slabs as the memory allows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TypeVar

import torch
from torch import Tensor

from torchliner.compiled.library import available
from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells
from torchliner.records.slabs import SLAB_ROWS, Bounds, bounds_of, read_ahead, rows_per_slab
from torchliner.reduction import native
from torchliner.reduction.sources import block_elements, blocks

NARROW = 1 << 19  # velocities of a slab, at least: few columns get longer slabs
FEW_CELLS = 64  # up to here a product with the averaging matrix beats scattered additions


class ProbeVelocity:
    """v of the plane's probes, and the averages over its cells as a second group of columns.

    The averages are formed as the data stream by, so both orders of averaging cost one pass.
    """

    def __init__(
        self,
        plane: VelocityPlane,
        cells: Cells | None,
        dtype: torch.dtype,
        device: torch.device,
        used: Tensor | None = None,
        memory: int | None = None,
    ) -> None:
        """``used``: probes to keep, (P,), others read as 0; ``memory``: bytes for slabs."""
        if used is None:
            used = torch.ones(plane.probes, dtype=torch.bool)
        self.plane = plane
        self.samples = plane.samples
        self.widths: tuple[int, ...] = (plane.probes,)
        self.dtype, self.device = dtype, device
        self.used = None if bool(used.all()) else used.to(device)
        self.memory = memory
        self.most_rows: int | None = None  # set where a device turned out to be too small
        self.derived = 0  # columns that are formed of these beside them
        self.span = (0, self.samples)  # samples that are read, of a part of a record
        self.samples_read = 0  # in all readings so far
        if cells is None:
            return
        self.widths = (plane.probes, cells.count)
        # Probes of no cell, or left out, go to one more cell that is dropped.
        inside = (cells.labels >= 0) & used
        self.labels = torch.where(inside, cells.labels, cells.count).to(device)
        sizes = torch.bincount(cells.labels[inside], minlength=cells.count)
        self.weights = (1 / sizes.clamp(min=1).to(torch.float64)).to(device)
        self.runs = _runs(self.labels.cpu(), cells.count)
        self.matrix: Tensor | None = None
        if cells.count <= FEW_CELLS:
            self.matrix = cells.membership(used).to(device, dtype)

    @property
    def readings(self) -> int:
        """How often the samples were read through; neighbours that a slab needs do not count."""
        return round(self.samples_read / (self.span[1] - self.span[0]))

    def bounds(self) -> Bounds:
        """Slabs within the memory, whole tiles of the file where these fit."""
        stored = self.plane.stored
        tile = 1 if stored is None else getattr(stored, "tile_rows", 1)
        size = self.plane.velocity.dtype.itemsize
        if self.dtype.itemsize > size or self.device.type == "cuda":
            size += self.dtype.itemsize
        columns = sum(self.widths) + self.derived
        # Nothing is copied of what is in memory: long slabs, fewer calls.
        rows = SLAB_ROWS if stored is not None or self.used is not None else 4 * SLAB_ROWS
        longest = max(rows, tile, NARROW // columns)
        packed = getattr(stored, "tile_bytes", 0)
        most = rows_per_slab(columns, size, self.memory, most=longest, tile=packed)
        # Whole tiles; and multiples of the samples that are summed in single precision, so that no
        # digit depends on the slabs.
        step = next((n for n in (math.lcm(tile, SLAB_ROWS), tile, SLAB_ROWS) if n <= most), 1)
        rows = most - most % step
        rows = min(rows, self.most_rows or rows)
        begin, end = self.span
        whole = min(end, -(-begin // SLAB_ROWS) * SLAB_ROWS)
        return [*bounds_of(whole, rows, begin), *bounds_of(end, rows, whole)]

    def slabs(self, bounds: Bounds, *, averages: bool = True) -> Iterator[list[Tensor]]:
        """Probes (t, P) and, unless left out, cell averages (t, C) of each slab, m/s."""
        stored = self.plane.stored
        if stored is not None:
            source = read_ahead(stored, bounds, self.device)
        else:
            source = (self.plane.read(*each).to(self.device) for each in bounds)
        for slab in source:
            self.samples_read += len(slab)
            if self.used is not None:
                slab = torch.where(self.used, slab, torch.zeros((), dtype=slab.dtype))
            found = [slab.to(self.dtype)]
            wanted = averages and len(self.widths) > 1
            yield [*found, self._averages(slab)] if wanted else found

    def _averages(self, slab: Tensor) -> Tensor:
        if slab.device.type == "cpu" and slab.stride(1) == 1 and available():
            return native.cell_averages(slab.to(self.dtype), self.runs, self.weights)
        if self.matrix is not None:
            return slab.to(self.dtype) @ self.matrix
        count = self.widths[1]
        sums = torch.zeros(len(slab), count + 1, dtype=torch.float64, device=self.device)
        for rows, columns in blocks(slab.shape[0], slab.shape[1], block_elements(self.device)):
            sums[rows].index_add_(1, self.labels[columns], slab[rows, columns].to(torch.float64))
        return (sums[:, :count] * self.weights).to(self.dtype)


def _runs(labels: Tensor, count: int) -> Tensor:
    """Neighbouring columns of one cell: first, how many, cell; int64, (n, 3)."""
    change = torch.nn.functional.pad(labels.diff() != 0, (1, 1), value=True)
    edges = change.nonzero()[:, 0]
    runs = torch.stack([edges[:-1], edges.diff(), labels[edges[:-1]]], dim=1)
    return runs[runs[:, 2] < count].contiguous()


T = TypeVar("T")


def with_smaller_slabs(velocity: ProbeVelocity, work: Callable[[], T]) -> tuple[T, list[str]]:
    """Run ``work``; where memory runs out, again with slabs half as long.

    Returns: its result, and a note if it had to be started again.
    Raises:
        RuntimeError: the device does not even hold slabs of one sample.
    """
    first_rows = None
    while True:
        begin, end = velocity.bounds()[0]
        rows = end - begin
        try:
            found = work()
        except (RuntimeError, MemoryError) as error:
            if not _out_of_memory(error):
                raise
            if rows == 1:
                raise RuntimeError(
                    f"{velocity.device} is out of memory even with slabs of one sample of "
                    f"{sum(velocity.widths)} probes ({error}); use another device, or fewer probes"
                ) from error
            first_rows = rows if first_rows is None else first_rows
            velocity.most_rows = rows // 2
            if velocity.device.type == "cuda":
                torch.cuda.empty_cache()
            continue
        if first_rows is None:
            return found, []
        return found, [
            f"{velocity.device} ran out of memory with slabs of {first_rows} samples; slabs of {rows} were used"
        ]


def _out_of_memory(error: Exception) -> bool:
    text = str(error)
    return isinstance(error, (torch.OutOfMemoryError, MemoryError)) or (
        "out of memory" in text or "can't allocate memory" in text
    )

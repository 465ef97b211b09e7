"""The one loop over the data: whatever is known of a record is a sum, or a maximum, over its blocks.

On a CPU several threads work, each with torch in one. torch's own threads share every operation and wait for each
other by turning in a loop, on processors that others could use: with small tensors, or on a machine that is busy, they
take many times longer than one.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol, TypeVar

import torch
from torch import Tensor
from torch.autograd import forward_ad

from torchliner.engine.blocks import SLAB, Blocks, Slab, waves
from torchliner.records import VelocityPlane
from torchliner.records.slabs import read_ahead

Read = Callable[[int, int], Tensor]  # samples begin .. end - 1 of v, (t, P), m/s, positive away from the liner
Columns = Callable[[Tensor, int], Tensor]  # a slab (t, P) and its first sample, to columns (t, N), m/s
Measure = Callable[[Tensor, Tensor], Tensor]  # weights (G, R, L) and columns (G, L, N), to (G, R, K, N)

Item = TypeVar("Item")
Result = TypeVar("Result")

ON_CPU, ON_DEVICE = 1 << 21, 1 << 26  # velocities that are worked on together
FEWEST_ROWS = 64  # of a slab, but at the end of a block
FEW_COLUMNS = 1 << 10  # of which a CPU takes several slabs at once


class Record(Protocol):
    """What is read: one reading of consecutive slabs at a time, the next one ahead of need where that helps."""

    @property
    def samples(self) -> int:
        """T."""
        ...

    @property
    def columns(self) -> int:
        """P."""
        ...

    @property
    def device(self) -> torch.device:
        """Of the slabs."""
        ...

    def slabs(self, bounds: Sequence[tuple[int, int]]) -> Iterator[Tensor]:
        """Samples begin .. end - 1 of each of ``bounds``, (t, P); on a CPU a slab lives until ``alive_together`` more
        were read."""
        ...


@dataclass(frozen=True)
class Held:
    """A record in memory, or any function that gives samples, as a ``Record``."""

    read: Read
    samples: int
    columns: int
    device: torch.device

    def slabs(self, bounds: Sequence[tuple[int, int]]) -> Iterator[Tensor]:
        """One after another."""
        return (self.read(begin, end) for begin, end in bounds)


@dataclass(frozen=True, eq=False)
class PlaneRecord:
    """Velocity of a plane, in memory or in its file, as a ``Record`` in the precision and on the device of the work.

    Args:
        plane: what is read; from a file the next slab is read while this one is worked on.
        dtype, device: of the work.
        excluded: probes that are read as 0, bool, (P,), on ``device``; None for none.
        progress: called with numbers of samples read.
    """

    plane: VelocityPlane
    dtype: torch.dtype
    device: torch.device
    excluded: Tensor | None = None
    progress: Callable[[int], object] | None = None

    @property
    def samples(self) -> int:
        """T."""
        return self.plane.samples

    @property
    def columns(self) -> int:
        """P."""
        return self.plane.probes

    def slabs(self, bounds: Sequence[tuple[int, int]]) -> Iterator[Tensor]:
        """Samples begin .. end - 1 of each of ``bounds``, (t, P)."""
        stored = self.plane.stored
        if stored is None:
            return self._worked_on(self.plane.read(*each) for each in bounds)
        # Counted now: while slabs are worked on in threads torch says that it has one.
        return self._worked_on(read_ahead(stored, bounds, self.device, alive_together()))

    def _worked_on(self, read: Iterable[Tensor]) -> Iterator[Tensor]:
        for slab in read:
            here = slab.to(self.device, self.dtype)
            yield here if self.excluded is None else here.masked_fill(self.excluded, 0)
            if self.progress is not None:
                self.progress(len(slab))


@dataclass(frozen=True, eq=False)
class Job:
    """What one reading is to find out.

    Args:
        drive: columns whose |v| acts on the liner, or that are measured.
        measure: of weights and columns, K numbers for each row and column.
        lines: Hz, (L,), on the device: samples are weighed with 1, cos and sin of these; None for 1 alone.
        reach: samples before and after a slab that ``drive`` needs to see; their columns are not summed.
        largest: of how many of the last rows blocks keep the largest instead of the sum.
    """

    drive: Columns
    measure: Measure
    lines: Tensor | None = None
    reach: int = 0
    largest: int = 0

    def join(self, found: Tensor, part: Tensor) -> None:
        """Add to what was found of a block, (..., R, K, N), in place, what was found of another part of it."""
        sums = found.shape[-3] - self.largest
        found[..., :sums, :, :].add_(part[..., :sums, :, :])
        if self.largest:
            most = found[..., sums:, :, :]
            most.copy_(torch.maximum(most, part[..., sums:, :, :]))


def reduce(record: Record, blocks: Blocks, jobs: Sequence[Job], only: Iterable[int] | None = None) -> list[Tensor]:
    """Read a record once and give what each job asks for.

    Args:
        record: what is read.
        blocks: of the record.
        jobs: they share the reading.
        only: blocks that this worker has, rising; default all.
    Returns:
        For each job float64, (S, R, K, N): the rows of ``only``. Rows of several workers, in order of time, are the
        same bits as one reading of all.
    """
    taken = range(blocks.count) if only is None else list(only)
    reach, on_cpu = max(job.reach for job in jobs), record.device.type == "cpu"
    batches = list(blocks.batches(*rows_at_once(record), taken, across=not on_cpu))
    bounds = [(max(0, batch[0].begin - reach), min(record.samples, batch[-1].end + reach)) for batch in batches]
    nothing = torch.empty(0, dtype=torch.float64, device=record.device)

    def work(item: tuple[list[Slab], int, Tensor]) -> list[Tensor]:
        batch, low, samples = item
        begin, end, padding = batch[0].begin, batch[-1].end, _padding(batch, record.device)
        found = []
        for job in jobs:
            columns = job.drive(samples, low)[begin - low : end - low]
            lines = nothing if job.lines is None else job.lines
            weights = waves(lines, blocks.sampling_rate, begin, end).to(columns)
            found.append(job.measure(*_of_slabs(weights, columns, len(batch), padding)).double())
        return found

    lows = (low for low, _ in bounds)
    items = zip(batches, lows, record.slabs(bounds), strict=True)
    kept: list[Tensor] = []
    # A network's lower precision around an eduction is not the data's.
    with torch.autocast("cpu" if on_cpu else "cuda", enabled=False):
        for batch, found in zip(batches, in_order(work, items, record.device), strict=True):
            kept = kept or [each.new_zeros(len(taken), *each.shape[1:]) for each in found]
            for job, own, each in zip(jobs, kept, found, strict=True):
                for slab, part in zip(batch, each, strict=True):
                    job.join(own[slab.place], part)
    return kept


def _padding(batch: Sequence[Slab], device: torch.device) -> tuple[Tensor, Tensor] | None:
    """Rows of the batch that each slab takes and whether they are its own, (G, L); None where all are alike.

    Shorter slabs repeat their last sample with weight 0, which changes neither a sum nor a maximum.
    """
    lengths = [slab.end - slab.begin for slab in batch]
    if len({*lengths}) == 1:
        return None
    first = [slab.begin - batch[0].begin for slab in batch]
    first_and_length = torch.tensor([first, lengths]).to(device)[:, :, None]
    step = torch.arange(max(lengths), device=device)
    return first_and_length[0] + torch.minimum(step, first_and_length[1] - 1), step < first_and_length[1]


def _of_slabs(
    weights: Tensor, columns: Tensor, count: int, padding: tuple[Tensor, Tensor] | None
) -> tuple[Tensor, Tensor]:
    """Weights (R, t) and columns (t, N) of a batch slab by slab, (G, R, L) and (G, L, N)."""
    if padding is None:  # views
        return weights.unflatten(1, (count, -1)).transpose(0, 1), columns.unflatten(0, (count, -1))
    place, own = padding
    each = weights[:, place.flatten()].unflatten(1, place.shape).transpose(0, 1) * own[:, None]
    return each, columns[place.flatten()].unflatten(0, place.shape)


def rows_at_once(record: Record) -> tuple[int, int]:
    """Samples that are worked on together, and of a slab: fewer where there are very many columns."""
    on_cpu = record.device.type == "cpu"
    rows = max(FEWEST_ROWS, (ON_CPU if on_cpu else ON_DEVICE) // record.columns)
    slab = min(SLAB, rows)
    return slab if on_cpu and record.columns > FEW_COLUMNS else rows, slab


def linear(weights: Tensor, columns: Tensor) -> Tensor:
    """Measure: sums of w v, K = 1."""
    return (weights @ columns)[:, :, None]


def square(weights: Tensor, columns: Tensor) -> Tensor:
    """Measure: sums of w v^2, K = 1."""
    return (weights @ columns.square())[:, :, None]


def largest(weights: Tensor, columns: Tensor) -> Tensor:
    """Measure: largest |v|, whatever the weights, R = K = 1."""
    return columns.abs().amax(1)[:, None, None]


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """torch in one thread; several also add small tables in another order."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def is_differentiated(*values: Tensor) -> bool:
    """Whether a value requires a gradient or carries a tangent of forward differentiation."""
    return any(value.requires_grad or forward_ad.unpack_dual(value).tangent is not None for value in values)


def alive_together() -> int:
    """Items of ``in_order`` that live at once: one for each thread, and one so that no thread waits for its next."""
    threads = torch.get_num_threads()
    return threads if threads == 1 else threads + 1


def in_order(
    work: Callable[[Item], Result], items: Iterable[Item], device: torch.device, *, alone: bool = False
) -> Iterator[Result]:
    """The ``work`` of each item, in order; on a CPU as many at once as torch has threads, unless ``alone``.

    Items may be read from a file: few are asked for ahead, and ``alive_together`` must live at once.
    """
    threads = torch.get_num_threads()
    if alone or device.type != "cpu" or threads == 1:
        yield from map(work, items)
        return
    with_gradients = torch.is_grad_enabled()  # which a new thread would not know

    def in_a_thread(item: Item) -> Result:
        with torch.set_grad_enabled(with_gradients):
            return work(item)

    most = alive_together()
    with one_thread(), ThreadPoolExecutor(threads) as pool:
        waiting: deque[Future[Result]] = deque()
        for item in items:
            waiting.append(pool.submit(in_a_thread, item))
            if len(waiting) == most:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()

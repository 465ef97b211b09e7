"""The one loop over the data: whatever is known of a record is a sum, or a maximum, over its blocks.

On a CPU several threads work, each with torch in one. torch's own threads share every operation and wait for each
other by turning in a loop, on processors that others could use: with small tensors, or on a machine that is busy, they
take many times longer than one.
"""

import contextlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, TypeVar

import torch
from torch import Tensor
from torch.autograd import forward_ad

from torchliner.engine.blocks import SLAB, Blocks, Slab, waves
from torchliner.records import VelocityPlane
from torchliner.records.slabs import read_ahead

Read = Callable[[int, int], Tensor]  # samples begin .. end - 1 of v, (t, P), m/s, positive away from the liner
Columns = Callable[[Tensor, int], Tensor]  # a slab (t, P) and its first sample, to columns (t, N), m/s
# T samples of P columns on a device, such as ``Held``: ``samples``, ``columns``, ``device``, and ``slabs(bounds)`` that
# gives samples begin .. end - 1 of each pair; on a CPU a slab lives until one more were read than torch has threads.
Record = Any
Measure = Callable[[Tensor, Tensor], Tensor]  # weights (G, R, L) and columns (G, L, N), to (G, R, K, N)

Item = TypeVar("Item")
Result = TypeVar("Result")

ON_CPU, ON_DEVICE = 1 << 21, 1 << 26  # velocities that are worked on together
FEWEST_ROWS = 64  # of a slab, but at the end of a block
FEW_COLUMNS = 1 << 10  # of which a CPU takes several slabs at once


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
    """Velocity of a plane, in memory or in its file, as a ``Record`` in the precision and on the device of the work."""

    plane: VelocityPlane  # from a file the next slab is read while this one is worked on
    dtype: torch.dtype
    device: torch.device
    used: Tensor | None = None  # probes that are read, bool, (P,), on the host; others are 0
    progress: Callable[[int], object] | None = None  # called with numbers of samples read
    # Slabs that live at once, counted beforehand, since torch has one thread while several work: one for each thread,
    # and one so that no thread waits for its next.
    alive: int = field(default_factory=lambda: torch.get_num_threads() + 1)
    samples: int = field(init=False)
    columns: int = field(init=False)
    excluded: Tensor | None = field(init=False)  # on ``device``

    def __post_init__(self) -> None:
        excluded = None if self.used is None or bool(self.used.all()) else ~self.used.to(self.device)
        self.__dict__.update(samples=self.plane.samples, columns=self.plane.probes, excluded=excluded)

    def slabs(self, bounds: Sequence[tuple[int, int]]) -> Iterator[Tensor]:
        """Samples begin .. end - 1 of each of ``bounds``, (t, P)."""
        read: Iterable[Tensor] = (self.plane.read(*each) for each in bounds)
        if not isinstance(self.plane.velocity, Tensor):
            read = read_ahead(self.plane.velocity, bounds, self.device, self.alive)
        for slab in read:
            here = slab.to(self.device, self.dtype)
            yield here if self.excluded is None else here.masked_fill(self.excluded, 0)
            if self.progress is not None:
                self.progress(len(slab))


@dataclass(frozen=True, eq=False)
class Job:
    """What one reading is to find out."""

    drive: Columns  # columns whose |v| acts on the liner, or that are measured
    measure: Measure  # K numbers for each row of weights and column
    lines: Tensor | None = None  # Hz, (L,), on the device: samples are weighed with 1, cos and sin of these
    reach: int = 0  # samples before and after a slab that ``drive`` needs to see; their columns are not summed
    largest: int = 0  # of how many of the last rows blocks keep the largest instead of the sum


def reduce(record: Record, blocks: Blocks, jobs: Sequence[Job], only: Iterable[int] | None = None) -> list[Tensor]:
    """Read a record once and give what each job asks for, float64, (S, R, K, N), of the blocks ``only``, rising;
    default all. Rows of several workers, in order of time, are the same bits as one reading."""
    taken, device = range(blocks.count) if only is None else list(only), record.device
    on_cpu, reach = device.type == "cpu", max(job.reach for job in jobs)
    rows = max(FEWEST_ROWS, (ON_CPU if on_cpu else ON_DEVICE) // record.columns)
    slab = min(SLAB, rows)  # fewer samples where there are very many columns
    rows = slab if on_cpu and record.columns > FEW_COLUMNS else rows
    batches = list(blocks.batches(rows, slab, taken, across=not on_cpu))
    bounds = [(max(0, batch[0].begin - reach), min(record.samples, batch[-1].end + reach)) for batch in batches]
    nothing = torch.empty(0, dtype=torch.float64, device=device)

    def work(item: tuple[list[Slab], int, Tensor]) -> list[Tensor]:
        """What each job finds in the slabs of a batch, (G, R, K, N)."""
        batch, low, samples = item
        begin, end, lengths = batch[0].begin, batch[-1].end, [slab.end - slab.begin for slab in batch]
        place = own = torch.empty(0)
        if len(set(lengths)) > 1:  # shorter slabs repeat their last sample with weight 0
            first, length = torch.tensor([[slab.begin - begin for slab in batch], lengths]).to(device)[:, :, None]
            step = torch.arange(max(lengths), device=device)
            place, own = first + torch.minimum(step, length - 1), (step < length)[:, None]
        found = []
        for job in jobs:
            columns = job.drive(samples, low)[begin - low : end - low]
            lines = nothing if job.lines is None else job.lines
            weights = waves(lines, blocks.sampling_rate, begin, end).to(columns)
            if len(place):
                columns = columns[place.flatten()].unflatten(0, place.shape)
                weights = weights[:, place.flatten()].unflatten(1, place.shape).transpose(0, 1) * own
            else:  # views
                columns = columns.unflatten(0, (len(batch), -1))
                weights = weights.unflatten(1, (len(batch), -1)).transpose(0, 1)
            found.append(job.measure(weights, columns).double())
        return found

    items = zip(batches, (low for low, _ in bounds), record.slabs(bounds), strict=True)
    kept: list[Tensor] = []
    # A network's lower precision around an eduction is not the data's.
    with torch.autocast("cpu" if on_cpu else "cuda", enabled=False):
        for batch, found in zip(batches, in_order(work, items, device), strict=True):
            kept = kept or [each.new_zeros(len(taken), *each.shape[1:]) for each in found]
            for job, own, each in zip(jobs, kept, found, strict=True):
                sums = own.shape[1] - job.largest
                for slab, row in zip(batch, each, strict=True):
                    own[slab.place, :sums] += row[:sums]
                    if job.largest:
                        most = own[slab.place, sums:]
                        torch.maximum(most, row[sums:], out=most)
    return kept


def linear(weights: Tensor, columns: Tensor) -> Tensor:
    """Measure: sums of w v, K = 1."""
    return (weights @ columns)[:, :, None]


def square(weights: Tensor, columns: Tensor) -> Tensor:
    """Measure: sums of w v^2, K = 1."""
    return (weights @ columns.square())[:, :, None]


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


def in_order(work: Callable[[Item], Result], items: Iterable[Item], device: torch.device) -> Iterator[Result]:
    """The ``work`` of each item, in order; on a CPU as many at once as torch has threads. One item more lives."""
    threads = torch.get_num_threads()
    if device.type != "cpu" or threads == 1:
        yield from map(work, items)
        return
    gradients = torch.is_grad_enabled()  # which a new thread would not know
    with one_thread(), ThreadPoolExecutor(threads, initializer=torch.set_grad_enabled, initargs=(gradients,)) as pool:
        waiting: deque[Future[Result]] = deque()
        for item in items:
            waiting.append(pool.submit(work, item))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()

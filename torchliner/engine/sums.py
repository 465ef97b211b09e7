"""The one loop over the data: whatever is known of a record is a sum, or a maximum, over its blocks."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from torchliner.engine.blocks import SLAB, Blocks, Slab, waves
from torchliner.engine.threads import in_order

Read = Callable[[int, int], Tensor]  # samples begin .. end - 1 of v, (t, P), m/s, positive away from the liner
Drive = Callable[[Tensor, int], Tensor]  # a slab (t, P) and its first sample, to columns (t, N), m/s
Rows = Callable[[int, int], Tensor]  # weights of samples begin .. end - 1, (R, t), float64
Measure = Callable[[Tensor, Tensor], Tensor]  # weights (G, R, L) and columns (G, L, N), to (G, R, K, N)

ON_CPU, ON_DEVICE = 1 << 21, 1 << 26  # velocities that are worked on together
FEWEST_ROWS = 64  # of a slab, but at the end of a block
TILE = 1 << 11  # columns that go through all jobs while they are in the cache of a CPU
FEW_COLUMNS = 1 << 8


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
        """Samples begin .. end - 1 of each of ``bounds``, (t, P); on a CPU a slab lives until ``alive_together`` (of
        ``engine.threads``) more were read."""
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


@dataclass(frozen=True)
class Job:
    """What one reading is to find out.

    Args:
        drive: columns whose |v| acts on the liner, or that are measured.
        rows: weights of the samples.
        measure: of weights and columns, K numbers for each row and column.
        reach: samples before and after a slab that ``drive`` needs to see; their columns are not summed.
        largest: of how many of the last rows blocks keep the largest instead of the sum.
        projection: applied to the sums of each slab, (J, K); None keeps all K.
    """

    drive: Drive
    rows: Rows
    measure: Measure
    reach: int = 0
    largest: int = 0
    projection: Tensor | None = None


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
    reach = max(job.reach for job in jobs)
    batches = list(blocks.batches(*rows_at_once(record), taken, across=record.device.type != "cpu"))
    bounds = [(max(0, batch[0].begin - reach), min(record.samples, batch[-1].end + reach)) for batch in batches]

    def work(item: tuple[list[Slab], int, Tensor]) -> list[list[Tensor]]:
        batch, low, samples = item
        padding = _padding(batch, record.device)
        weights = [job.rows(batch[0].begin, batch[-1].end).to(samples) for job in jobs]
        found: list[list[Tensor]] = [[] for _ in jobs]
        for part in _tiles(samples):
            for i, job in enumerate(jobs):
                drive = job.drive if part is None else of_columns(job.drive, part)
                if drive is not None:
                    columns = drive(samples if part is None else samples[:, part], low)
                elif not found[i]:  # of all columns at once
                    columns = job.drive(samples, low)
                else:
                    continue
                found[i].append(_measured(job, weights[i], columns, batch, low, padding))
        return found

    lows = (low for low, _ in bounds)
    items = zip(batches, lows, record.slabs(bounds), strict=True)
    kept = [_Blocks(job, len(taken)) for job in jobs]
    # A network's lower precision around an eduction is not the data's.
    with torch.autocast("cuda" if record.device.type == "cuda" else "cpu", enabled=False):
        for batch, found in zip(batches, in_order(work, items, record.device), strict=True):
            for own, parts in zip(kept, found, strict=True):
                own.add(batch, parts)
    return [own.rows for own in kept]


class _Blocks:
    """What a job found in each block, put together in order of time."""

    def __init__(self, job: Job, count: int) -> None:
        self.job, self.count, self.done = job, count, 0
        self.rows = torch.empty(0)
        self.opened: list[Tensor] = []

    def add(self, batch: Sequence[Slab], tiles: Sequence[Tensor]) -> None:
        """The slabs that come next, tile by tile of the columns, (G, R, J, n)."""
        begin = 0
        for end, slab in enumerate(batch, 1):
            if not slab.last and end < len(batch):
                continue
            parts = [joined(self.job, tile[begin:end].double()) for tile in tiles]
            if not batch[begin].first:
                pairs = zip(self.opened, parts, strict=True)
                parts = [joined(self.job, torch.stack(pair)) for pair in pairs]
            self.opened, begin = parts, end
            if slab.last:
                self._close(parts)

    def _close(self, parts: Sequence[Tensor]) -> None:
        """A block is complete."""
        if not self.done:
            shape = *parts[0].shape[:2], sum(part.shape[2] for part in parts)
            self.rows = parts[0].new_empty(self.count, *shape)
        left = 0
        for part in parts:
            self.rows[self.done, ..., left : left + part.shape[2]] = part
            left += part.shape[2]
        self.done += 1


def joined(job: Job, parts: Tensor) -> Tensor:
    """What a job finds of several parts of a block together, from what it finds of each, (n, R, J, N)."""
    if len(parts) == 1:
        return parts[0]
    found, keep = parts.sum(0), job.largest
    if keep:
        found[-keep:] = parts[:, -keep:].amax(0)
    return found


def _padding(batch: Sequence[Slab], device: torch.device) -> tuple[Tensor, Tensor] | None:
    """Rows of the batch that each slab takes and whether they are its own, (G, L); None where all are alike.

    Shorter slabs repeat their last sample with weight 0, which changes neither a sum nor a maximum.
    """
    lengths = [slab.end - slab.begin for slab in batch]
    longest = max(lengths)
    if longest == min(lengths):
        return None
    first = [slab.begin - batch[0].begin for slab in batch]
    first_and_length = torch.tensor([first, lengths]).to(device)[:, :, None]
    step = torch.arange(longest, device=device)
    return first_and_length[0] + torch.minimum(step, first_and_length[1] - 1), step < first_and_length[1]


def _tiles(samples: Tensor) -> Sequence[slice | None]:
    """On a CPU so few columns at once that they stay in its cache for all jobs; the bits do not depend on that."""
    if samples.device.type != "cpu" or samples.shape[1] <= TILE:
        return [None]
    return [slice(left, left + TILE) for left in range(0, samples.shape[1], TILE)]


def of_columns(drive: Drive, part: slice) -> Drive | None:
    """A drive for some of the probes alone; None of one that joins probes."""
    make = getattr(drive, "of_columns", None)
    found: Drive | None = None if make is None else make(part)
    return found


def _measured(
    job: Job, rows: Tensor, columns: Tensor, batch: Sequence[Slab], low: int, padding: tuple[Tensor, Tensor] | None
) -> Tensor:
    """Of each slab of a batch, (G, R, J, N), from weights (R, t) and columns that begin with sample ``low``."""
    first = batch[0].begin
    columns = columns[first - low : batch[-1].end - low]
    if padding is None:  # views
        shape = (len(batch), -1)
        found = job.measure(rows.unflatten(1, shape).transpose(0, 1), columns.unflatten(0, shape))
    elif columns.device.type == "cpu" and columns.shape[1] > FEW_COLUMNS:  # no copies
        cuts = [slice(slab.begin - first, slab.end - first) for slab in batch]
        found = torch.cat([job.measure(rows[None, :, cut], columns[None, cut]) for cut in cuts])
    else:
        place, own = padding
        weights = rows[:, place.flatten()].unflatten(1, place.shape).transpose(0, 1) * own[:, None]
        found = job.measure(weights, columns[place.flatten()].unflatten(0, place.shape))
    return found if job.projection is None else job.projection @ found


def rows_at_once(record: Record) -> tuple[int, int]:
    """Samples that are worked on together, and of a slab: fewer where there are very many columns."""
    rows = max(FEWEST_ROWS, (ON_DEVICE if record.device.type != "cpu" else ON_CPU) // record.columns)
    return rows, min(SLAB, rows)


def linear(weights: Tensor, columns: Tensor) -> Tensor:
    """Measure: sums of w v, K = 1."""
    return (weights @ columns)[:, :, None]


def square(weights: Tensor, columns: Tensor) -> Tensor:
    """Measure: sums of w v^2, K = 1."""
    return (weights @ (columns * columns))[:, :, None]


def largest(weights: Tensor, columns: Tensor) -> Tensor:
    """Measure: largest |v|, whatever the weights, R = K = 1."""
    return columns.abs().amax(1)[:, None, None]


def ones(device: torch.device) -> Rows:
    """The one row that weighs every sample alike."""
    return functools.partial(waves, torch.zeros(0, dtype=torch.float64, device=device), 1.0)


def wave_rows(lines: Tensor, sampling_rate: float) -> Rows:
    """Rows 1, cos and sin of lines (Hz, (L,)), on their device: R = 1 + 2 L."""
    return functools.partial(waves, lines, sampling_rate)

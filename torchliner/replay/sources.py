"""Velocity as the engines see it: slabs of time over columns.

Columns are the probes of a plane and whatever is replayed beside them (averages over cells). They
come in groups that are never joined, so that no copy of a plane is made, and the modulus |v| is
only taken block by block, within the cache.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, ParamSpec, Protocol, TypeVar

import torch
from torch import Tensor

from torchliner.records.slabs import SLAB_ROWS, Bounds, bounds_of

BLOCK_ELEMENTS = 1 << 18  # velocities of a block: within the cache, temporaries included
ROWS_SUMMED = 16
GPU_ELEMENTS = 1 << 25
BLOCK_COLUMNS = 1 << 12  # contiguous velocities of a block


P = ParamSpec("P")
T = TypeVar("T")


def speed_of(velocity: Tensor, offset: Tensor | None) -> Tensor:
    """|v|, m/s, of (t, P) less an offset (P,)."""
    return (velocity if offset is None else velocity - offset).abs()


@dataclass(frozen=True)
class Columns:
    """Some columns of a slab.

    Args:
        velocity: m/s, signed, (t, P_g).
        offset: m/s, (P_g,), taken off before the modulus; None for 0.
    """

    velocity: Tensor
    offset: Tensor | None = None

    def part(self, rows: slice, columns: slice) -> Columns:
        """A block of it, a view."""
        offset = None if self.offset is None else self.offset[columns]
        return Columns(self.velocity[rows, columns], offset)

    @property
    def speed(self) -> Tensor:
        """|v|, m/s, (t, P_g)."""
        return speed_of(self.velocity, self.offset)


class SpeedSource(Protocol):
    """Velocity of P columns in groups, on one device."""

    samples: int
    widths: tuple[int, ...]  # columns of each group
    dtype: torch.dtype  # precision of the work
    device: torch.device

    def bounds(self) -> Bounds:
        """Slabs that suit the memory and the file."""
        ...

    def slabs(self, bounds: Bounds) -> Iterator[list[Columns]]:
        """The groups of each slab (begin, end); a slab lives until the next is asked for."""
        ...


class HeldSpeed:
    """Velocity, or |v|, in memory, (P, n), as a source of one group."""

    def __init__(self, speed: Tensor) -> None:
        self.speed = speed
        self.widths: tuple[int, ...]
        self.widths, self.samples = (speed.shape[0],), speed.shape[1]
        self.dtype, self.device = speed.dtype, speed.device

    def bounds(self) -> Bounds:
        """``SLAB_ROWS`` at once."""
        return bounds_of(self.samples, SLAB_ROWS)

    def slabs(self, bounds: Bounds) -> Iterator[list[Columns]]:
        """Views."""
        for begin, end in bounds:
            yield [Columns(self.speed[:, begin:end].T)]


def in_full_precision(function: Callable[P, T]) -> Callable[P, T]:
    """Let a pass over data, its first argument, see nothing of a ``torch.autocast`` around it,
    which would round float32 products to 3 digits."""

    @functools.wraps(function)
    def run(*args: P.args, **options: P.kwargs) -> T:
        source: Any = args[0]
        with torch.autocast(source.device.type, enabled=False):
            return function(*args, **options)

    return run


def weighted_sums(weights: Tensor, values: Tensor) -> Tensor:
    """``weights`` (m, t) times ``values`` (t, P), float64: at most ``ROWS_SUMMED`` samples are
    added in the precision of the data, so that no digit is lost over a long block."""
    if values.dtype == torch.float64:
        return weights @ values
    whole = len(values) - len(values) % ROWS_SUMMED
    parts = weights[:, :whole].unflatten(1, (-1, ROWS_SUMMED)).transpose(0, 1)
    sums = (parts @ values[:whole].unflatten(0, (-1, ROWS_SUMMED))).sum(0, dtype=torch.float64)
    rest: Tensor = sums + (weights[:, whole:] @ values[whole:])
    return rest


def block_elements(device: torch.device) -> int:
    """Velocities of a block: those that fit the cache, or that keep a GPU busy."""
    return BLOCK_ELEMENTS if device.type == "cpu" else GPU_ELEMENTS


def blocks(rows: int, columns: int, elements: int) -> Iterator[tuple[slice, slice]]:
    """Rows and columns of blocks of at most ``elements``, of up to ``BLOCK_COLUMNS`` columns."""
    wide = max(1, min(columns, elements, max(BLOCK_COLUMNS, elements // SLAB_ROWS)))
    deep = max(1, elements // wide)
    for low in range(0, rows, deep):
        for left in range(0, columns, wide):
            yield slice(low, min(low + deep, rows)), slice(left, min(left + wide, columns))

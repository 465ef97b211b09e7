"""Velocity as the engines see it: slabs of time over columns.

Columns are the probes of a plane and whatever is replayed beside them (averages over cells). They
come in groups that are never joined, so that no copy of a plane is made, and the modulus |v| is
only taken block by block, within the cache.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ParamSpec, Protocol, TypeVar

import torch
from torch import Tensor

from torchliner.records.slabs import SLAB_ROWS, Bounds, bounds_of

BLOCK_ELEMENTS = 1 << 18  # velocities of a block: within the cache, temporaries included
GPU_ELEMENTS = 1 << 25
BLOCK_COLUMNS = 1 << 12  # contiguous velocities of a block


P = ParamSpec("P")
T = TypeVar("T")


@dataclass(frozen=True)
class Taken:
    """What is taken off v before the modulus: v* = scale v - rows @ coefficients.

    Args:
        rows: (t, J).
        coefficients: m/s, (J, P).
        scale: (P,); None for 1.
    """

    rows: Tensor
    coefficients: Tensor
    scale: Tensor | None = None

    def part(self, rows: slice, columns: slice) -> Taken:
        """Of some samples and columns."""
        scale = None if self.scale is None else self.scale[columns]
        return Taken(self.rows[rows], self.coefficients[:, columns], scale)

    def off(self, velocity: Tensor) -> Tensor:
        """v*, (t, P)."""
        scaled = velocity if self.scale is None else velocity * self.scale
        return torch.addmm(scaled, self.rows, self.coefficients, alpha=-1)


@dataclass(frozen=True)
class Columns:
    """Some columns of a slab.

    Args:
        velocity: m/s, signed, (t, P_g).
        taken: off it before the modulus; None for nothing.
    """

    velocity: Tensor
    taken: Taken | None = None

    def part(self, rows: slice, columns: slice) -> Columns:
        """A block of it, a view."""
        taken = None if self.taken is None else self.taken.part(rows, columns)
        return Columns(self.velocity[rows, columns], taken)

    @property
    def speed(self) -> Tensor:
        """|v*|, m/s, (t, P_g)."""
        return (self.velocity if self.taken is None else self.taken.off(self.velocity)).abs()


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
    """Let a function see nothing of a ``torch.autocast`` around it, which would round float32
    products to 3 digits."""

    @functools.wraps(function)
    def run(*args: P.args, **options: P.kwargs) -> T:
        with contextlib.ExitStack() as stack:
            for kind in ("cpu", "cuda"):
                if torch.is_autocast_enabled(kind):
                    stack.enter_context(torch.autocast(kind, enabled=False))
            return function(*args, **options)

    return run


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

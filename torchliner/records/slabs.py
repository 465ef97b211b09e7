"""How a record is cut along time, so that no pass over it holds much at once."""

from __future__ import annotations

SLAB_ELEMENTS = 1 << 23  # velocities: 64 MB in float64
SLAB_ROWS = 1024


def rows_per_slab(probes: int, most: int = SLAB_ROWS) -> int:
    """Samples of a slab: as many as ``SLAB_ELEMENTS`` allows, 1 to ``most``."""
    return max(1, min(most, SLAB_ELEMENTS // max(1, probes)))


def slab_bounds(samples: int, probes: int, most: int = SLAB_ROWS) -> list[tuple[int, int]]:
    """(begin, end) of the slabs of a record."""
    rows = rows_per_slab(probes, most)
    return [(begin, min(begin + rows, samples)) for begin in range(0, samples, rows)]

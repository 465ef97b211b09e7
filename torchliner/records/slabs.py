"""How a record is cut along time, so that no pass over it holds much at once."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor

SLAB_BYTES = 1 << 26  # of one buffer
SLAB_ROWS = 1024

Bounds = Sequence[tuple[int, int]]


@runtime_checkable
class StoredVelocity(Protocol):
    """Velocity that stays in its file and is read by slabs."""

    shape: tuple[int, ...]  # (..., T)
    dtype: torch.dtype

    def read(self, begin: int, end: int, out: Tensor | None = None) -> Tensor:
        """Samples begin .. end - 1 of every probe, (t, P), in ``out`` if it can be used."""
        ...

    def load(self) -> Tensor:
        """All of it, (..., T)."""
        ...


def bounds_of(samples: int, rows: int) -> list[tuple[int, int]]:
    """(begin, end) of the slabs of ``rows`` samples that cover the samples."""
    return [(low, min(low + rows, samples)) for low in range(0, samples, rows)]


def slab_bounds(samples: int, probes: int) -> list[tuple[int, int]]:
    """Slabs for a plain copy of a plane."""
    return bounds_of(samples, max(1, min(SLAB_ROWS, SLAB_BYTES // (4 * max(1, probes)))))


def read_ahead(reader: StoredVelocity, bounds: Bounds, device: torch.device, held: int = 1) -> Iterator[Tensor]:
    """Slabs of a file on ``device``, the next one being read while ``held`` of them are worked on.

    One thread reads, since HDF5 knows one lock, into ``held`` + 1 buffers, pinned for a GPU. A slab lives
    until so many more are asked for: copy what must stay.
    """
    if not bounds:
        return
    rows = max(end - begin for begin, end in bounds)
    probes = torch.Size(reader.shape[:-1]).numel()
    on_gpu = device.type == "cuda"
    buffers = [torch.empty(rows, probes, dtype=reader.dtype, pin_memory=on_gpu) for _ in range(held + 1)]
    copied = [torch.cuda.Event() for _ in buffers] if on_gpu else []

    with ThreadPoolExecutor(1, thread_name_prefix="read-ahead") as pool:
        pending = pool.submit(reader.read, *bounds[0], buffers[0])
        for i in range(len(bounds)):
            slab = pending.result()
            if i + 1 < len(bounds):
                other = (i + 1) % len(buffers)
                if on_gpu:
                    copied[other].synchronize()
                pending = pool.submit(reader.read, *bounds[i + 1], buffers[other])
            if on_gpu:
                slab = slab.to(device, non_blocking=True)
                copied[i % len(buffers)].record(torch.cuda.current_stream(device))
            yield slab

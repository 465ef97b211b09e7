"""How a record is cut along time, so that no pass over it holds much at once."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Protocol

import torch
from torch import Tensor

SLAB_BYTES = 1 << 26  # of one buffer unless a memory limit says less
SLAB_ROWS = 256
WORK_BYTES = 1 << 26  # temporaries of the engines, whatever the plane's size

Bounds = Sequence[tuple[int, int]]


class Reader(Protocol):
    """Velocity that stays in its file and is read by slabs."""

    shape: tuple[int, ...]  # (..., T)
    dtype: torch.dtype

    def read(self, begin: int, end: int, out: Tensor | None = None) -> Tensor:
        """Samples begin .. end - 1 of every probe, (t, P), in ``out`` if it can be used."""
        ...


def bytes_of(size: int | str) -> int:
    """A number of bytes, or text such as "500MB" or "2GiB"; a ValueError for what is neither."""
    found = re.fullmatch(r"(\d+\.?\d*)\s*([kMGT]?)(i?)B?", str(size).strip())
    if found is None:
        raise ValueError(f"memory is {size!r}; give bytes or a size such as '500MB' or '2GB'")
    return int(float(found[1]) * (1024 if found[3] else 1000) ** " kMGT".index(found[2] or " "))


def rows_per_slab(
    probes: int, itemsize: int, memory: int | None = None, *, most: int = SLAB_ROWS, tile: int = 0
) -> int:
    """Samples of a slab, 1 to ``most``.

    Args:
        probes: P.
        itemsize: bytes per velocity, of the file and of work copies together.
        memory: bytes for two buffers and the work; default two of ``SLAB_BYTES``.
        tile: bytes of a compressed tile of the file, which is unpacked as a whole.
    Raises:
        ValueError: the limit holds neither one sample of every probe, nor a tile twice.
    """
    row = 2 * itemsize * max(1, probes)
    if memory is None:
        return max(1, min(most, 2 * SLAB_BYTES // row))
    least = max(WORK_BYTES, 2 * tile) + row
    if memory < least:
        raise ValueError(
            f"a memory limit of {memory / 1e6:.4g} MB is below {least / 1e6:.4g} MB, for one sample of {probes} probes "
            f"and the work arrays, or twice a compressed tile of the file, {tile / 1e6:.4g} MB; raise memory"
        )
    return max(1, min(most, (memory - WORK_BYTES) // row))


def bounds_of(samples: int, rows: int, begin: int = 0) -> list[tuple[int, int]]:
    """(begin, end) of the slabs of ``rows`` samples that cover begin .. samples - 1."""
    return [(low, min(low + rows, samples)) for low in range(begin, samples, rows)]


def slab_bounds(samples: int, probes: int, most: int = 4 * SLAB_ROWS) -> list[tuple[int, int]]:
    """Slabs for a plain copy of a plane."""
    return bounds_of(samples, rows_per_slab(probes, 4, most=most))


def read_ahead(reader: Reader, bounds: Bounds, device: torch.device, held: int = 1) -> Iterator[Tensor]:
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

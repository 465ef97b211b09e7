"""Planes to files, by slabs: one read, one write, and on from where a run was killed."""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch

from torchliner.checks import tell
from torchliner.io.axes import write_case, write_coordinates, write_times
from torchliner.io.cf import VELOCITY
from torchliner.io.hdf5 import attach_scales, tiles, write_variable
from torchliner.io.hdf5_velocity import numpy_kind
from torchliner.io.holes import write_holes
from torchliner.io.plane_file import AREA, KIND, NUMBERS, STREAMWISE
from torchliner.io.whole_file import HDF5, Part, part_of
from torchliner.records import VelocityPlane
from torchliner.records.slabs import SLAB_ROWS, bounds_of, bytes_of, read_ahead, rows_per_slab

COMPRESSED_ROWS = 256  # samples of a compressed tile
NARROW = 1 << 20  # values of a slab of few probes
MARKED = 1 << 26  # bytes after which a mark is set
FINEST = 9  # level of gzip


def write_plane(
    plane: VelocityPlane, path: str | Path, compress: bool | int = False, *,
    memory: int | str | None = None, source: str = "", progress: Callable[[int], Any] | None = None,
) -> None:  # fmt: skip
    """Write a plane; the old file, if any, is replaced only when the new one is whole.

    Args:
        plane: record, in memory or in its files, which are then read once.
        path: .h5 or .nc.
        compress: gzip in tiles (smaller, slower), of a level 1 to 9, True: 9; default contiguous,
            as fast as the disk.
        memory: bytes, or text as "500MB", for slabs that are read ahead; default 0.13 GB.
        source: words that differ for different data. With them FILE.part stays when the run is
            killed or the disk is full, and a run with the same words goes on there.
        progress: called with bytes as they are written.
    Raises:
        ValueError: a single sample: a file's sampling rate is that of its times; a memory limit
            below one slab.
        OSError: the disk is full, the folder cannot be written to, another run writes the file.
        KeyboardInterrupt: Ctrl-C, after the slab in hand; with ``source`` what is written stays.
    Warns:
        DataWarning: a part that was left is damaged; it is written anew.
    """
    level = FINEST if compress is True else int(compress)
    if not 0 <= level <= FINEST:
        raise ValueError(f"compress is {compress}; gzip has levels 1 to {FINEST}")
    limit = None if memory is None else bytes_of(memory)
    if not source:
        with KIND.created(path, plane) as file, interrupts_noted() as asked:
            _describe(file, plane, level)
            for _ in _filled(file, plane, limit, 0, progress):
                if asked:
                    raise KeyboardInterrupt
        return
    with part_of(path, source, *HDF5) as part:
        if part.done and not _holds(part, plane):
            tell(f"{part.path} does not hold what it says; it is written anew", depth=2)
            part.done = 0
        if not part.done:
            part.mark.unlink(missing_ok=True)
            with h5py.File(part.path, "w") as file:
                for key, text in KIND.constants:
                    file.attrs[key] = text
                KIND.write_head(file, plane)
                _describe(file, plane, level)
        size, marked = plane.velocity.dtype.itemsize * plane.probes, part.done
        if progress is not None:
            progress(size * part.done)
        with h5py.File(part.path, "r+") as file, interrupts_noted() as asked:
            for done in _filled(file, plane, limit, part.done, progress):
                if asked or size * (done - marked) >= MARKED:
                    file.flush()
                    part.reached(done)
                    marked = done
                if asked:
                    raise KeyboardInterrupt


@contextmanager
def interrupts_noted() -> Iterator[list[int]]:
    """Ctrl-C as an entry of a list, to be looked at between slabs; the second one is raised, too.

    Raised wherever it comes, it may land in a callback of h5py, where Python drops it. Handlers of
    others, and threads that get no signals, are left as they are.
    """
    asked: list[int] = []

    def note(number: int, frame: Any) -> None:
        asked.append(number)
        if asked[1:]:
            signal.default_int_handler(number, frame)

    usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if not usual or threading.current_thread() is not threading.main_thread():
        yield asked
        return
    signal.signal(signal.SIGINT, note)
    try:
        yield asked
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _describe(file: h5py.File, plane: VelocityPlane, level: int) -> None:
    """All but the values of the velocities."""
    write_times(file, plane)
    dims = write_coordinates(file, plane.probe_shape, plane.x, plane.z)
    shape = (plane.samples, *(len(file[dim]) for dim in dims))
    storage = tiles(shape, COMPRESSED_ROWS, level=level) if level else {}
    for name, _ in _fields(plane):
        kind = numpy_kind(plane.velocity.dtype)
        dataset = file.create_dataset(name, shape, kind, **storage)
        dataset.attrs["units"] = "m/s"
        attach_scales(dataset, file, ("time", *dims))
    if plane.area is not None:
        shares = plane.area.reshape(shape[1:]).cpu().numpy()
        write_variable(file, AREA, shares, "m2", dims).attrs["long_name"] = "area of each probe"
    file[VELOCITY].attrs["positive"] = "away from the liner"
    write_case(file, plane, NUMBERS)
    write_holes(file, plane.holes)


def _fields(plane: VelocityPlane) -> list[tuple[str, Any]]:
    found = [(VELOCITY, plane.velocity), (STREAMWISE, plane.streamwise)]
    return [(name, value) for name, value in found if value is not None]


def _filled(
    file: h5py.File, plane: VelocityPlane, memory: int | None, done: int,
    progress: Callable[[int], Any] | None,
) -> Iterator[int]:  # fmt: skip
    """Values from sample ``done`` of all fields, one field after the other, written by slabs."""
    for number, (name, value) in enumerate(_fields(plane)):
        before = number * plane.samples
        bounds = _bounds(plane, value, memory, max(0, done - before))
        if isinstance(value, torch.Tensor):
            whole = value.detach().movedim(-1, 0)
            slabs: Iterator[torch.Tensor] = (whole[low:high].cpu() for low, high in bounds)
        else:
            slabs = read_ahead(value, bounds, torch.device("cpu"))
        dataset = file[name]
        for (low, high), slab in zip(bounds, slabs, strict=True):
            dataset[low:high] = slab.numpy().reshape(high - low, *dataset.shape[1:])
            if progress is not None:
                progress(slab.nbytes)
            yield before + high


def _bounds(plane: VelocityPlane, value: Any, memory: int | None, begin: int) -> list[tuple[int, int]]:
    """Slabs within the memory, of whole tiles of the file that is read and of that written."""
    tile = getattr(value, "tile_rows", 1)
    longest = max(4 * SLAB_ROWS, tile, NARROW // plane.probes)
    most = rows_per_slab(
        plane.probes, value.dtype.itemsize, memory, most=longest,
        tile=getattr(value, "tile_bytes", 0),
    )  # fmt: skip
    step = next((n for n in (math.lcm(tile, COMPRESSED_ROWS), tile, COMPRESSED_ROWS) if n <= most), 1)
    return bounds_of(plane.samples, most - most % step, begin)


def _holds(part: Part, plane: VelocityPlane) -> bool:
    """Whether a part that was left can be opened and ends with the samples that it should."""
    with suppress(OSError, RuntimeError, KeyError, ValueError), h5py.File(part.path, "r") as file:
        number, last = divmod(part.done - 1, plane.samples)
        name, value = _fields(plane)[number]
        dataset, low, done = file[name], max(0, last - COMPRESSED_ROWS), last + 1
        if dataset.shape[0] != plane.samples:
            return False
        own = value.movedim(-1, 0) if isinstance(value, torch.Tensor) else None
        wanted = value.read(low, done) if own is None else own[low:done]
        there = dataset[low:done]
        return bool(np.array_equal(there.reshape(wanted.shape), wanted.numpy(), equal_nan=True))
    return False

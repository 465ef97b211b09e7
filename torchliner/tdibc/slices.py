"""Moments of a plane by slices of time, which workers read on their own, or one machine in turn.

How a record is cut depends on its size alone, and slices are added in the order of time: so the
sum has the same bits whoever does the work, and whoever is lost on the way.
"""

from __future__ import annotations

import dataclasses
import io
import os
import pickle
import socket
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice, pairwise
from typing import Any, Protocol

import numpy as np
import torch

from torchliner.checks import DataWarning, tell
from torchliner.records import VelocityPlane
from torchliner.records.slabs import SLAB_ROWS
from torchliner.reduction.moments import SETTINGS, Moments
from torchliner.reduction.parts import MomentsPart, joined
from torchliner.tdibc.parts import first_part, second_part, sum_parts
from torchliner.tdibc.prepared import Progress
from torchliner.tdibc.reading import read_plane
from torchliner.tdibc.reduced import with_window
from torchliner.tdibc.requested import Request, requested, without_velocity
from torchliner.version import __version__

SLICE_VALUES = 1 << 27  # velocities: about a second of work, and 0.5 GB in float32
FEW = 8  # slices; of more of them each is longer, so that what it leaves is 1 % of it:
LONG = 20_000  # samples, for some 200 samples' worth of moments
JOINED = 8  # slices added at once: all that is held

Span = tuple[int, int]  # first sample, and how many


class Kept(Protocol):
    """Where what is known of an unfinished record stays."""

    def load(self, reading: int) -> MomentsPart | None:
        """The slices that are summed so far, from the first one on, of reading 1 or 2."""
        ...

    def save(self, reading: int, part: MomentsPart) -> None:
        """Keep them, if that is due: in the place of what was kept of this reading."""
        ...


def reduce_whole(plane: VelocityPlane, request: Request, progress: Progress | None = None) -> Moments:
    """As ``moments``, undivided."""
    asked, model, chosen, basis = requested(plane, request)
    if chosen.drive == "running-rms":
        chosen = with_window(chosen, asked.frequency)
    drive, sums, notes = read_plane(asked, model, chosen, basis, progress=progress)
    tell(tuple(notes))
    return Moments(
        without_velocity(plane), sums,
        {name: getattr(chosen, name) for name in SETTINGS}, model.cell_pitch, tuple(notes),
        0 if drive is None else drive.velocity.readings,
    )  # fmt: skip


def moments_in_slices(
    plane: VelocityPlane, request: Request, *, client: Any = None, kept: Kept | None = None,
    progress: Progress | None = None, ahead: int | None = None,
) -> Moments:  # fmt: skip
    """As ``moments``, in the bits that any number of workers gives.

    Args:
        plane: still in its file, under a path that every worker can open.
        request: as for ``moments``.
        client: of dask.distributed; None: slices one after another, here.
        kept: what is known already, and is from time to time.
        progress: called with numbers of samples done, 2 T in all.
        ahead: slices under way at once; default two for each thread of the workers.
    Raises:
        ValueError: as ``moments``; the plane is in memory.
        OSError, ImportError: a worker cannot read; it says which, and which path.
        RuntimeError: workers are of another version, or end one after another.
    """
    if plane.stored is None:
        raise ValueError(
            f"{plane.name} is in memory, and workers read for themselves; write it to a file, and "
            "read that with lazy=True"
        )
    asked, _, chosen, _ = requested(plane, request)
    spans = spans_of(plane, asked.blocks.borders)
    # Neighbouring samples, and faults that some slices alone have, are seen by the whole alone.
    if len(spans) == 1 or chosen.drive == "running-rms" or chosen.missing == "exclude":
        (found,) = in_order(client, reduce_whole, (plane, request), [()], ahead)
        tell(() if client is None else found.notes)
        if progress is not None:
            progress(2 * plane.samples)
        return found
    whole = dataclasses.replace(plane, streamwise=None)

    def read(number: int, work: Callable[..., MomentsPart], known: Any) -> MomentsPart:
        found = None if kept is None else kept.load(number)
        done = 0 if found is None else found.end
        if progress is not None:
            progress(done)
        tasks = [(span,) for span in spans if span[0] >= done]
        parts = in_order(client, _slice, (work, whole, known), tasks, ahead)
        # From the left, as the last bits of blocks that slices share ask for.
        while more := list(islice(_told(parts, progress), JOINED)):
            found = joined(more if found is None else [found, *more])
            if kept is not None and found.end < plane.samples:
                kept.save(number, found)
        assert found is not None
        return found

    first = sum_parts([read(1, first_part, request)])
    if len(first.sums.groups) == 2 + (first.sums.periodic is not None):
        if progress is not None:
            progress(plane.samples)
        return first
    # The second reading asks how many groups there are, not for what is in them.
    names: Any = (None,) * len(first.sums.groups)
    known = dataclasses.replace(first, sums=dataclasses.replace(first.sums, groups=names))
    return sum_parts([read(2, second_part, known)], given=first)


def spans_of(plane: VelocityPlane, borders: Sequence[int]) -> list[Span]:
    """Slices of about ``SLICE_VALUES``: whole blocks if these are shorter, else multiples of the
    samples that are summed at once; whole tiles of the file at least."""
    samples = plane.samples
    longest = max(1, samples // getattr(plane.stored, "tile_rows", 1))
    count = min(longest, -(-samples * plane.probes // SLICE_VALUES), max(FEW, samples // LONG))
    if count < len(borders):
        places = {min(borders, key=lambda b: abs(b * count - i * samples)) for i in range(1, count)}
    else:
        places = {SLAB_ROWS * round(i * samples / count / SLAB_ROWS) for i in range(1, count)}
    return [(low, high - low) for low, high in pairwise(sorted(places | {0, samples}))]


def _told(parts: Iterator[MomentsPart], progress: Progress | None) -> Iterator[MomentsPart]:
    for part in parts:
        if progress is not None:
            progress(part.end - part.first)
        yield part


def _slice(work: Callable[..., MomentsPart], plane: VelocityPlane, known: Any, span: Span) -> MomentsPart:
    return work(plane, span, known)


def in_order(
    client: Any,
    work: Callable[..., Any],
    shared: tuple[Any, ...],
    tasks: Iterable[tuple[Any, ...]],
    ahead: int | None = None,
) -> Iterator[Any]:
    """``work(*shared, *task)`` of each task, in their order, with some under way ahead of it.

    Args:
        client: of dask.distributed; None: one after another, here, as they are asked for.
        work: a function that workers can import.
        shared: arguments of all tasks, sent once.
        tasks: the other arguments.
        ahead: tasks under way at once; default two for each thread of the workers.
    """
    if client is None:
        yield from (work(*shared, *task) for task in tasks)
        return
    # As results of tasks: sent once, and made again where the workers that held them are lost.
    held = [client.submit(_same, each, pure=False) for each in shared]
    ahead = ahead or 2 * max(1, sum(client.nthreads().values()))
    left, waiting = iter(tasks), deque[Any]()
    try:
        while True:
            for task in islice(left, ahead - len(waiting)):
                waiting.append(client.submit(on_worker, __version__, work, *held, *task, pure=False))
            if not waiting:
                return
            yield unpacked(_result(waiting.popleft()))
    finally:
        client.cancel([*waiting, *held])


def _same(value: Any) -> Any:
    return value


def _result(future: Any) -> Any:
    try:
        return future.result()
    except Exception as error:
        if type(error).__name__ != "KilledWorker":
            raise
        raise RuntimeError(
            f"workers ended one after another on the same slice: {error}; give them more memory, "
            "or look into their logs"
        ) from error


class _Pickler(pickle.Pickler):
    """Tensors as arrays, which travel without a copy."""

    def reducer_override(self, value: Any) -> Any:
        """See ``pickle``."""
        if isinstance(value, torch.Tensor):
            return _tensor, (value.detach().cpu().numpy(),)
        return NotImplemented


def _tensor(values: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(values if values.flags.writeable else values.copy())


def packed(value: Any) -> tuple[bytes, list[np.ndarray]]:
    """Anything, its large arrays apart."""
    buffers: list[pickle.PickleBuffer] = []
    with io.BytesIO() as file:
        _Pickler(file, protocol=5, buffer_callback=buffers.append).dump(value)  # type: ignore[arg-type]
        return file.getvalue(), [np.frombuffer(each.raw(), np.uint8) for each in buffers]


def unpacked(parcel: tuple[bytes, list[np.ndarray]]) -> Any:
    """What was ``packed``."""
    head, arrays = parcel
    return pickle.loads(head, buffers=arrays)


def on_worker(version: str, work: Callable[..., Any], *arguments: Any) -> Any:
    """A task on a worker: in one thread, in silence; what it cannot read is said with its name.

    Raises:
        RuntimeError: it has another version of this package.
    """
    place = f"worker on {socket.gethostname()} (folder {os.getcwd()})"
    if version != __version__:
        raise RuntimeError(f"{place} has torchliner {__version__}, and {version} asks; install the same")
    torch.set_num_threads(1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)  # they are among the notes
            return packed(work(*arguments))
    except (OSError, ImportError) as error:
        raise type(error)(f"{place}: {error}") from error

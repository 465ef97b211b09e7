"""The one loop on workers of dask, or in steps that are kept: each task reads some blocks of the plane for itself.

How blocks are shared out depends on the size of the record alone, a block has one owner, and rows are laid one after
another in order of time: the same bits whoever does the work, and whoever is lost on the way.
"""

from __future__ import annotations

import dataclasses
import importlib
import os
import socket
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import DataWarning
from torchliner.engine.blocks import Blocks
from torchliner.engine.sums import Job, PlaneRecord, Record, reduce
from torchliner.names import __version__

SHARE = 1 << 27  # velocities that a task reads: about a second of work, and 0.5 GB in float32
WAIT = 30.0  # s, for the first worker
MOST_AHEAD = 16  # tasks that are under way, at least, so that a cluster that adapts sees work for so many workers
Reduce = Callable[[Record, Blocks, Sequence[Job], Iterable[int] | None], list[Tensor]]
Rows = list[np.ndarray]


class Kept(Protocol):
    """Where finished shares of a record stay, by all that they depend on but the samples themselves."""

    def load(self, asked: Any) -> Rows | None:
        """What was saved; None if nothing was."""
        ...

    def save(self, asked: Any, rows: Rows) -> None:
        """Keep it."""
        ...


def reduce_on(client: Any = None, kept: Kept | None = None) -> Reduce:
    """``engine.sums.reduce`` of a ``PlaneRecord`` of a plane in its file, shared out; no data travel.

    Args:
        client: of dask.distributed; a worker that is lost is replaced by another. None: here, one share after another.
        kept: what is there is not read again.
    Raises:
        ValueError: the plane is in memory.
        OSError, ImportError: a worker cannot read; it says which, and which path.
        RuntimeError: workers of another version, or workers that end one after another.
    """

    def run(record: Record, blocks: Blocks, jobs: Sequence[Job], only: Iterable[int] | None = None) -> list[Tensor]:
        assert isinstance(record, PlaneRecord)
        plane, progress, taken = record.plane, record.progress, list(range(blocks.count) if only is None else only)
        if plane.stored is None:
            raise ValueError(
                f"{plane.name} is in memory, and workers read for themselves; write it to a file, and read that with "
                "lazy=True"
            )
        count = min(len(taken), -(-record.columns * int(blocks.lengths[taken].sum()) // SHARE))
        shares = [taken[len(taken) * i // count : len(taken) * (i + 1) // count] for i in range(count)]
        sent = (dataclasses.replace(record, progress=None), blocks, list(jobs))
        about = (plane.name, tuple(plane.velocity.shape), plane.sampling_rate, record.dtype, record.excluded)
        asked = [(about, blocks, sent[2], share) for share in shares]
        known = [None if kept is None else kept.load(each) for each in asked]
        left = [(share,) for share, rows in zip(shares, known, strict=True) if rows is None]
        read, found = tasks_in_order(client, _rows, (sent,), left), []
        for share, each, rows in zip(shares, asked, known, strict=True):
            found.append(next(read) if rows is None else rows)
            if rows is None and kept is not None:
                kept.save(each, found[-1])
            if progress is not None:
                progress(blocks.borders[share[-1] + 1] - blocks.borders[share[0]])
        return [torch.cat([*map(torch.from_numpy, each)]).to(record.device) for each in zip(*found, strict=True)]

    return run


def _rows(sent: tuple[Any, ...], share: Sequence[int]) -> Rows:
    record, blocks, jobs = sent
    return [rows.cpu().numpy() for rows in reduce(record, blocks, jobs, share)]


def tasks_in_order(
    client: Any, work: Callable[..., Any], shared: tuple[Any, ...], tasks: Iterable[tuple[Any, ...]]
) -> Iterator[Any]:
    """``work(*shared, *task)`` of each task, in their order, with some under way ahead of it.

    Args:
        client: of dask.distributed; None: one after another, here, as they are asked for.
        work: a function that workers can import, of ``shared`` arguments, sent once, and those of each task.
    Raises:
        OSError: no worker comes, or the scheduler is gone.
        RuntimeError: workers end one after another.
    """
    if client is None:
        yield from (work(*shared, *task) for task in tasks)
        return
    # As results of tasks: sent once, and made again where the workers that held them are lost.
    held = [client.submit(_same, each, pure=False) for each in shared]
    left, waiting = iter(tasks), deque[Any]()
    try:
        while True:
            threads = sum(client.nthreads().values())
            for task in islice(left, max(MOST_AHEAD, 2 * threads) - len(waiting)):
                waiting.append(client.submit(on_worker, __version__, work, *held, *task, pure=False))
            if not waiting:
                return
            if not threads:  # the work waits already, so that a cluster that adapts starts its first worker
                seconds = importlib.import_module("dask").config.get("torchliner.wait", WAIT)
                where = client.scheduler.address
                try:
                    client.wait_for_workers(1, timeout=seconds)
                except TimeoutError as error:
                    text = f"start some (dask worker {where} --nthreads 1), or wait longer (--wait)"
                    raise OSError(f"the scheduler at {where} has no worker within {seconds:g} s; {text}") from error
            yield waiting[0].result()
            waiting.popleft()  # the worker may forget it
    except Exception as error:
        name = type(error).__name__
        if name == "KilledWorker":
            text = "workers ended one after another on the same task"
            raise RuntimeError(f"{text}: {error}; give them more memory, or read their logs") from error
        if client.status != "running" or name in ("FutureCancelledError", "CommClosedError"):
            text = "the scheduler of dask is gone; start it again and repeat the command: a campaign keeps what it has"
            raise OSError(text) from error
        raise
    finally:
        if client.status == "running":
            client.cancel([*held, *waiting])


def _same(value: Any) -> Any:
    return value


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
            return work(*arguments)
    except (OSError, ImportError) as error:
        raise type(error)(f"{place}: {error}") from error

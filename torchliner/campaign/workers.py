"""The one loop shared out: to workers of dask, or in steps whose sums are kept on disk.

How blocks are shared out depends on the size of the record alone, each block has one owner, and the rows are laid one
after another in order of time. So the bits are the same whoever does the work, and whoever is lost on the way.
"""

import dataclasses
import functools
import hashlib
import os
import socket
import warnings
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import DataWarning
from torchliner.engine.blocks import Blocks
from torchliner.engine.sums import Job, Record, reduce
from torchliner.io.whole_file import written_whole
from torchliner.names import __version__
from torchliner.velocity.reading import Reduce

SHARE = 1 << 27  # velocities that a task reads: about a second of work, and 0.5 GB in float32
WAIT = 30.0  # s, for the scheduler and the first worker
Rows = list[np.ndarray]


def share_out(client: Any = None, kept: Path | None = None) -> Reduce:
    """The loop that ``torchliner.moments`` runs over a plane in its file, in shares; no data travel.

    ``client``: of dask.distributed, whose workers do them; a worker that is lost is replaced by another. ``kept``:
    folder for finished shares, which are not done again: of this plane, what is asked of it and this version alone.
    """

    def run(record: Record, blocks: Blocks, jobs: Sequence[Job]) -> list[Tensor]:
        if isinstance(record.plane.velocity, Tensor):
            raise ValueError(f"{record.plane.name} is in memory; write it, and read its file with lazy=True")
        count = min(blocks.count, -(-record.columns * int(blocks.lengths.sum()) // SHARE))
        shares = [range(blocks.count * i // count, blocks.count * (i + 1) // count) for i in range(count)]
        sent = (dataclasses.replace(record, progress=None), blocks, list(jobs))
        reading = "" if kept is None else _name_of(record, jobs)
        paths = [None if kept is None else kept / f"{reading}_{share[0]}-{share[-1]}.npz" for share in shares]
        known = [None if path is None else _load(path) for path in paths]
        left = [share for share, rows in zip(shares, known, strict=True) if rows is None]
        read = map(functools.partial(_rows, sent), left) if client is None else _on_workers(client, sent, left)
        found = []
        for share, path, rows in zip(shares, paths, known, strict=True):
            found.append(next(read) if rows is None else rows)
            if rows is None and path is not None:
                _save(path, found[-1])
            if record.progress is not None:
                record.progress(blocks.borders[share[-1] + 1] - blocks.borders[share[0]])
        return [torch.cat([*map(torch.from_numpy, rows)]).to(record.device) for rows in zip(*found, strict=True)]

    return run


def _name_of(record: Record, jobs: Sequence[Job]) -> str:
    """Tells a reading from others of its plane: by probes that are left out, and by what drives take from before."""
    held = [record.excluded, *(value for job in jobs for value in vars(job.drive).values())]
    held = [each.cpu().numpy().tobytes() for each in held if isinstance(each, Tensor)]
    return hashlib.sha256(b"".join(held)).hexdigest()[:16]


def _load(path: Path) -> Rows | None:
    """What was saved; None if nothing was, or if the file is damaged: the share is read again."""
    with suppress(OSError, ValueError, BadZipFile, EOFError), np.load(path) as file:
        return [file[name] for name in file.files]
    return None


def _save(path: Path, rows: Rows) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_whole(path) as temporary, temporary.open("wb") as file:
        np.savez(file, *rows)


def _rows(sent: tuple[Any, ...], share: Sequence[int]) -> Rows:
    """What each job finds in a share of the blocks."""
    record, blocks, jobs = sent
    return [rows.cpu().numpy() for rows in reduce(record, blocks, jobs, share)]


def on_worker(version: str, sent: tuple[Any, ...], share: Sequence[int]) -> Rows:
    """A share on a worker: in one thread, in silence; what it cannot read is said with its name."""
    place = f"worker on {socket.gethostname()} (folder {os.getcwd()})"
    if version != __version__:
        raise RuntimeError(f"{place} has torchliner {__version__}, and {version} asks; install the same")
    torch.set_num_threads(1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)  # they are among the notes
            return _rows(sent, share)
    except (OSError, ImportError) as error:
        raise type(error)(f"{place}: {error}") from error


def _on_workers(client: Any, sent: tuple[Any, ...], shares: Sequence[Sequence[int]]) -> Iterator[Rows]:
    """The rows of each share, in their order; ``sent`` travels once."""
    import dask

    # A task: made again where the worker that held it is lost.
    held = client.submit(lambda value: value, sent, pure=False)
    waiting = deque(client.submit(on_worker, __version__, held, share, pure=False) for share in shares)
    wait, where = dask.config.get("torchliner.wait", WAIT), client.scheduler.address
    try:
        while waiting:
            if not client.nthreads():  # the work waits, so that a cluster that adapts starts its first worker
                client.wait_for_workers(1, timeout=wait)
            with suppress(TimeoutError):  # long work; or who does it is lost, which the next round finds
                rows = waiting[0].result(timeout=wait)
                waiting.popleft()  # the worker may forget it
                yield rows
    except TimeoutError as error:
        text = f"start some (dask worker {where} --nthreads 1), or wait longer (--wait)"
        raise OSError(f"the scheduler at {where} has no worker within {wait:g} s; {text}") from error
    except Exception as error:
        if client.status != "running" or type(error).__name__ in ("FutureCancelledError", "CommClosedError"):
            text = "the scheduler of dask is gone; start it again and repeat the command: a campaign keeps what it has"
            raise OSError(text) from error
        raise
    finally:
        if client.status == "running":
            client.cancel([held, *waiting])


@contextmanager
def open_cluster(where: str, wait: float | None = None) -> Iterator[Any]:
    """A client of dask.distributed.

    ``where``: ``local:N``, N processes of one thread on this machine; ``tcp://HOST:PORT`` (or tls://) of a scheduler;
    or its file, .json. ``wait``: s, for the scheduler and, once there is work for it, for the first worker; default 30.
    """
    kind, _, count = where.partition(":")
    local, by_file = kind == "local" and count.isdecimal() and 0 < int(count) <= 1024, where.endswith(".json")
    if not (local or by_file or kind in ("tcp", "tls")):
        raise ValueError(f"cluster is {where!r}; write local:4, tcp://host:8786, or the .json file of a scheduler")
    try:
        import dask
        import distributed
    except ImportError as error:
        raise ImportError(f"a cluster needs dask.distributed ({error}); pip install 'torchliner[cluster]'") from error
    wait = WAIT if wait is None else wait
    # What dask does to its workers makes small tensor operations 15 times dearer; stated where they are started, as
    # they take it over before anything of theirs runs.
    malloc = ("MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_")
    settings: dict[str, Any] = {f"distributed.nanny.pre-spawn-environ.{name}": 1 << 30 for name in malloc}
    settings |= {"distributed.comm.timeouts.connect": f"{wait}s", "torchliner.wait": wait}
    # What a second reading must know of the first takes some MB, sent once.
    settings["distributed.admin.large-graph-warning-threshold"] = "1GB"
    with dask.config.set(settings), ExitStack() as stack:
        place: Any = where
        if local:  # any port, so that several can be; a limit of memory would count the page cache
            about = {"threads_per_worker": 1, "dashboard_address": "127.0.0.1:0", "memory_limit": 0}
            place = distributed.LocalCluster(n_workers=int(count), silence_logs="ERROR", **about)
            stack.enter_context(place)
        try:
            if by_file:
                os.stat(where)  # for which dask would wait without end
            client = distributed.Client(**{"scheduler_file" if by_file else "address": place}, timeout=f"{wait}s")
        except (OSError, TimeoutError, ValueError, KeyError) as error:
            raise OSError(f"no scheduler of dask answers at {where} within {wait:g} s ({error})") from error
        yield stack.enter_context(client)

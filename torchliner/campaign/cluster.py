"""Workers by name: of this machine, of a scheduler that runs, or of its file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

PATIENCE = 30  # s, for scheduler and first worker
# What dask does to its workers makes small tensor operations 15 times dearer; stated where they
# are started, as they take it over before anything of theirs runs.
MALLOC = {"MALLOC_TRIM_THRESHOLD_": 1 << 30, "MALLOC_MMAP_THRESHOLD_": 1 << 30}


@contextmanager
def open_cluster(where: str | None) -> Iterator[Any]:
    """A client of dask.distributed; None for None.

    Args:
        where: ``local:N``, N processes of one thread on this machine; ``tcp://HOST:PORT`` (or
            tls://) of a scheduler; or its file, .json.
    Raises:
        ImportError: dask.distributed is not there.
        ValueError: none of these.
        OSError: no scheduler answers, or it has no worker.
    """
    if where is None:
        yield None
        return
    kind, _, count = where.partition(":")
    local = kind == "local" and count.isdecimal() and 0 < int(count) <= 1024
    if not (local or kind in ("tcp", "tls") or where.endswith(".json")):
        raise ValueError(
            f"cluster {where!r} cannot be read; write local:4, tcp://host:8786, or the .json file of a scheduler"
        )
    try:
        import dask
        import distributed
    except ImportError as error:
        raise ImportError(f"a cluster needs dask.distributed ({error}); pip install 'torchliner[cluster]'") from error
    settings: dict[str, Any] = {f"distributed.nanny.pre-spawn-environ.{k}": v for k, v in MALLOC.items()}
    # What a second reading must know of the first takes some MB, sent once.
    settings["distributed.admin.large-graph-warning-threshold"] = "1GB"
    settings["distributed.comm.timeouts.connect"] = f"{PATIENCE}s"
    with dask.config.set(settings), ExitStack() as stack:
        place: Any = where
        if local:
            # Any port, so that several can be; a limit of memory would count the page cache.
            place = stack.enter_context(distributed.LocalCluster(
                n_workers=int(count), threads_per_worker=1, dashboard_address="127.0.0.1:0",
                memory_limit=0, silence_logs="ERROR",
            ))  # fmt: skip
        yield stack.enter_context(_client(place, where))


@contextmanager
def _client(place: Any, where: str) -> Iterator[Any]:
    """A client that has a worker.

    Raises:
        OSError: as ``open_cluster``.
    """
    import distributed

    by_file = isinstance(place, str) and place.endswith(".json")
    if by_file and not Path(place).exists():
        raise FileNotFoundError(f"{place}: no such file; the scheduler writes it when it starts")
    address = {"scheduler_file": os.fspath(place)} if by_file else {"address": place}
    try:
        client = distributed.Client(**address, timeout=f"{PATIENCE}s")
    except (OSError, TimeoutError, ValueError, KeyError) as error:
        raise OSError(
            f"no scheduler of dask answers at {where} within {PATIENCE} s ({error}); is it "
            "running, and can this machine reach it?"
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError as error:
            raise OSError(
                f"the scheduler at {where} has no worker within {PATIENCE} s; start some: dask "
                "worker ADDRESS --nthreads 1"
            ) from error
        yield client

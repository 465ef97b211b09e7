"""Workers by name: of this machine, of a scheduler that runs, or of its file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from torchliner.engine.workers import WAIT

# What dask does to its workers makes small tensor operations 15 times dearer; stated where they are started, as they
# take it over before anything of theirs runs.
MALLOC = {"MALLOC_TRIM_THRESHOLD_": 1 << 30, "MALLOC_MMAP_THRESHOLD_": 1 << 30}


@contextmanager
def open_cluster(where: str | None, wait: float | None = None) -> Iterator[Any]:
    """A client of dask.distributed; None for None.

    Args:
        where: ``local:N``, N processes of one thread on this machine; ``tcp://HOST:PORT`` (or tls://) of a scheduler;
            or its file, .json.
        wait: s, for the scheduler and, once there is work for it, for the first worker; default 30.
    Raises:
        ImportError: dask.distributed is not there.
        ValueError: none of these.
        OSError: no scheduler answers.
    """
    if where is None:
        yield None
        return
    kind, _, count = where.partition(":")
    local, by_file = kind == "local" and count.isdecimal() and 0 < int(count) <= 1024, where.endswith(".json")
    if not (local or by_file or kind in ("tcp", "tls")):
        raise ValueError(f"cluster is {where!r}; write local:4, tcp://host:8786, or the .json file of a scheduler")
    if by_file and not Path(where).exists():
        raise FileNotFoundError(f"{where}: no such file; the scheduler writes it when it starts")
    try:
        import dask
        import distributed
    except ImportError as error:
        raise ImportError(f"a cluster needs dask.distributed ({error}); pip install 'torchliner[cluster]'") from error
    wait = WAIT if wait is None else wait
    settings: dict[str, Any] = {f"distributed.nanny.pre-spawn-environ.{name}": value for name, value in MALLOC.items()}
    # What a second reading must know of the first takes some MB, sent once.
    settings |= {"distributed.admin.large-graph-warning-threshold": "1GB", "torchliner.wait": wait}
    settings["distributed.comm.timeouts.connect"] = f"{wait}s"
    with dask.config.set(settings), ExitStack() as stack:
        address: dict[str, Any] = {"scheduler_file": where} if by_file else {"address": where}
        if local:  # any port, so that several can be; a limit of memory would count the page cache
            about = {"threads_per_worker": 1, "dashboard_address": "127.0.0.1:0", "memory_limit": 0}
            own = distributed.LocalCluster(n_workers=int(count), silence_logs="ERROR", **about)
            address = {"address": stack.enter_context(own)}
        try:
            client = distributed.Client(**address, timeout=f"{wait}s")
        except (OSError, TimeoutError, ValueError, KeyError) as error:
            raise OSError(
                f"no scheduler of dask answers at {where} within {wait:g} s ({error}); is it running, and can this "
                "machine reach it?"
            ) from error
        yield stack.enter_context(client)

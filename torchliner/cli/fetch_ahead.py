"""Inputs are looked at and asked for before they are read, while Python imports."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

CHUNK = 1 << 20  # bytes that a system takes on at once; of a longer range it fetches the first part
SMALLEST = 1 << 24  # bytes of a file that is worth it
MOST = 1 << 30  # bytes altogether: what a disk gives in the second that the imports take
WAITING = 1 << 24  # bytes asked for at once: whoever reads another part of a file waits behind them


def fetch_ahead(names: Sequence[str]) -> None:
    """Ask the system for the beginnings of large files, in the background; never fails."""
    threading.Thread(target=_ahead, args=(list(names),), daemon=True).start()


def _ahead(names: Sequence[str]) -> None:
    with contextlib.suppress(Exception):  # the reader says what is wrong
        if hasattr(os, "posix_fadvise"):
            _fetch(names)


def _fetch(names: Sequence[str]) -> None:
    left = min(MOST, os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 4)
    for path in map(Path, names):
        size = path.stat().st_size if path.is_file() else 0
        if size < SMALLEST:
            continue
        with path.open("rb", buffering=0) as file:
            for begin in range(0, min(size, left), CHUNK):
                if not _torch_is_to_come():  # now the command reads, here and there at first
                    return
                os.posix_fadvise(file.fileno(), begin, CHUNK, os.POSIX_FADV_WILLNEED)
                if begin >= WAITING:
                    os.pread(file.fileno(), 1, begin - WAITING)  # until that part is there
        left -= size


def _torch_is_to_come() -> bool:
    """Whether the longest import is still to end."""
    torch = sys.modules.get("torch")
    return torch is None or getattr(torch.__spec__, "_initializing", False)

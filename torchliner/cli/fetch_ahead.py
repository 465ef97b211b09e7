"""The disk works while Python imports: inputs are asked for before they are read."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Sequence
from pathlib import Path

CHUNK = 1 << 20  # bytes that a system takes on at once; of a longer range it fetches the first part
SMALLEST = 1 << 24  # bytes of a file that is worth it
MOST = 1 << 30  # bytes altogether: what a disk gives in the second that the imports take


def fetch_ahead(names: Sequence[str]) -> None:
    """Ask the system for the beginnings of large files, in the background; never fails."""
    if hasattr(os, "posix_fadvise"):
        threading.Thread(target=_fetch, args=(names,), daemon=True).start()


def _fetch(names: Sequence[str]) -> None:
    with contextlib.suppress(OSError, ValueError):
        left = min(MOST, os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 4)
        for path in map(Path, names):
            size = path.stat().st_size if path.is_file() else 0
            if size < SMALLEST:
                continue
            with path.open("rb", buffering=0) as file:
                for begin in range(0, min(size, left), CHUNK):
                    os.posix_fadvise(file.fileno(), begin, CHUNK, os.POSIX_FADV_WILLNEED)
            left -= size

"""One run at a time in a folder of results."""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

NO_LOCKS = (errno.ENOSYS, errno.ENOTSUP, errno.ENOLCK)  # of a file system that has none


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """A folder for one run at a time; the lock ends with the process, however that ends.

    Raises:
        OSError: another run holds it, and which.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("ab+", buffering=0) as file:
        try:
            _lock(file)
        except OSError as error:
            if error.errno not in NO_LOCKS:
                file.seek(0)
                holder = file.read().decode(errors="replace").strip() or "unknown"
                raise OSError(
                    f"{folder} is in use by another run ({holder}); wait for its end, or name another --output"
                ) from None
        with suppress(OSError):  # the disk is full; the words are for the message alone
            file.truncate(0)
            file.write(f"process {os.getpid()} on {socket.gethostname()}\n".encode())
        yield


def _lock(file: Any) -> None:
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
        return
    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)

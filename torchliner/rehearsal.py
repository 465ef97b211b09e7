"""HDF5 and MATLAB files read first by another process.

On damaged files the libraries may end the process that reads, or never return. So it is tried where
that does no harm: in a child, started with the first file, that is given up after a while. Of HDF5
it reads all attributes and what is small, which costs some milliseconds; MATLAB files before v7.3
it reads whole, up to ``LARGEST_MATLAB``.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import math
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import h5py

try:
    import resource
except ImportError:  # not POSIX: nothing is tried there
    resource = None  # type: ignore[assignment]

LIMIT = 4  # s of a core
PATIENCE = 60.0  # s, on a machine or a disk that is busy
SMALL = 1 << 16  # values of a dataset that is read as well
OBJECTS = 1000  # that are looked at
LARGEST_MATLAB = 1 << 26  # bytes
_lock = threading.Lock()
_children: dict[int, subprocess.Popen[bytes]] = {}  # by process, as forks do not share a child


def _unlock() -> None:
    global _lock
    _lock = threading.Lock()


if hasattr(os, "register_at_fork"):  # no thread goes on in the child that would give it back
    os.register_at_fork(after_in_child=_unlock)


def rehearse(path: str | Path) -> None:
    """Refuse a file on which the library that reads it breaks down.

    Nothing is tried where no further Python can be started, or its time cannot be limited.

    Raises:
        ValueError: it crashed, or did not come to an end within ``LIMIT``.
    """
    with contextlib.suppress(OSError):
        path = Path(path).resolve()
        status = path.stat()
        _rehearse(path, status.st_size, status.st_mtime_ns)


@functools.lru_cache(maxsize=1024)
def _rehearse(path: Path, size: int, changed: int) -> None:
    """Once for a file as it is at present."""
    python = sys.executable or ""
    if resource is None or getattr(sys, "frozen", False) or not Path(python).name.lower().startswith("py"):
        return
    with _lock:
        child = _children.get(os.getpid())
        if child is None or child.poll() is not None:
            child = _children[os.getpid()] = subprocess.Popen(
                [python, "-P", __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )  # fmt: skip
            if not _answer(child):
                _end(child)
                return  # this Python cannot do it
        try:
            answer = _answer(child, os.fsencode(path).hex().encode() + b"\n")
        except BaseException:  # an interrupt, after which questions and answers would not agree
            _end(child)
            raise
        if not answer:
            _end(child)
            ended = child.returncode in (-signal.SIGKILL, -signal.SIGXCPU)
            how = f"does not come to an end within {LIMIT} s" if ended else "crashes"
            raise ValueError(
                f"{path}: the library that reads it {how} on its structure, which is damaged; copy "
                "it again from where it comes from, or repair it (HDF5: h5clear, h5repack)"
            )


def _answer(child: subprocess.Popen[bytes], question: bytes = b"") -> bytes:
    """A line; b"" if the child ended."""
    assert child.stdin is not None
    assert child.stdout is not None
    timer = threading.Timer(PATIENCE, child.kill)
    timer.start()
    try:
        child.stdin.write(question)
        child.stdin.flush()
        return child.stdout.readline()
    finally:
        timer.cancel()


def _end(child: subprocess.Popen[bytes]) -> None:
    child.kill()
    for pipe in (child.stdin, child.stdout):
        with contextlib.suppress(OSError):  # nobody reads any more
            if pipe is not None:
                pipe.close()
    child.wait()


@atexit.register
def _end_all() -> None:
    for process, child in _children.items():
        if process == os.getpid():
            _end(child)


def walk(path: str) -> None:
    """Read what a reader may read of a file's structure."""
    import h5py

    if path.lower().endswith(".mat") and not h5py.is_hdf5(path):
        if os.path.getsize(path) <= LARGEST_MATLAB:
            from scipy.io import loadmat, whosmat

            whosmat(path)
            loadmat(path)
        return
    with h5py.File(path, "r", locking=False) as file:
        groups, seen = [file], 0
        while groups and seen < OBJECTS:
            group = groups.pop()
            list(group.attrs.items())
            for key in group:
                seen += 1
                found = group.get(key)
                if isinstance(found, h5py.Group) and group.name == "/":
                    groups.append(found)
                if isinstance(found, h5py.Dataset):
                    _look_at(found)


def _look_at(dataset: h5py.Dataset) -> None:
    with contextlib.suppress(Exception):  # the reader says what is wrong
        list(dataset.attrs.items())
        for dim in dataset.dims:
            _ = dim[0].name if len(dim) else dim.label
        _ = dataset.chunks and dataset.id.get_num_chunks(), dataset.fillvalue
        if dataset.size <= SMALL:
            _ = dataset[()]


def serve() -> None:
    """Look at each file whose name comes in, in hexadecimal, and answer with a line; one first."""
    import h5py  # noqa: F401  # before its time is limited

    print(flush=True)
    for line in sys.stdin:
        used = math.ceil(time.process_time())
        _, most = resource.getrlimit(resource.RLIMIT_CPU)
        wanted = used + LIMIT if most == resource.RLIM_INFINITY else min(most, used + LIMIT)
        resource.setrlimit(resource.RLIMIT_CPU, (wanted, most))
        with contextlib.suppress(Exception):
            walk(os.fsdecode(bytes.fromhex(line)))
        print(flush=True)


if __name__ == "__main__":
    serve()

"""The C++ files of this room, built into one library on first use, where there is a compiler.

``TORCHLINER_SUMS`` in the environment: ``torch`` never uses it, ``native`` insists on it.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import shlex
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.compiled.threads import threads

SOURCES = sorted(Path(__file__).parent.glob("*.cpp"))
# Not -ffast-math: a library built with it makes the whole process flush denormal numbers to zero.
FLAGS = ["-std=c++17", "-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-fPIC"]
FUNCTIONS = (
    "add_float32", "add_float64", "cells_float32", "cells_float64",
    "neighbours", "forms", "extremes",
)  # fmt: skip
SECONDS = 120.0  # that a compiler may take

reason: str | None = None  # why it could not be had, after `available()`


def available() -> bool:
    """Whether the compiled sums can be used here; builds them the first time.

    Raises:
        ValueError: if ``TORCHLINER_SUMS`` is neither empty, ``torch`` nor ``native``.
        RuntimeError: with the reason, if it is ``native`` and they cannot be had.
    """
    wanted = os.environ.get("TORCHLINER_SUMS", "")
    if wanted not in ("", "torch", "native"):
        raise ValueError(f"TORCHLINER_SUMS is {wanted!r}; use 'torch', 'native' or leave it unset")
    if wanted == "torch":
        return False
    there = _library() is not None
    if wanted == "native" and not there:
        raise RuntimeError(f"TORCHLINER_SUMS=native, but the compiled sums failed: {reason}")
    return there


def address(tensor: Tensor | None, shape: Sequence[int], dtype: torch.dtype = torch.float64) -> int | None:
    """Where a tensor lies, once it is what C++ takes it for; -1 in the shape: any length."""
    if tensor is None:
        return None
    fits = len(tensor.shape) == len(shape) and all(
        want in (-1, have) for have, want in zip(tensor.shape, shape, strict=True)
    )
    if not (fits and tensor.dtype == dtype and tensor.is_contiguous() and tensor.is_cpu):
        have = f"{tuple(tensor.shape)} {tensor.dtype} on {tensor.device}"
        raise ValueError(f"{have}, but a contiguous {tuple(shape)} {dtype} on a CPU is needed")
    return tensor.data_ptr()


@functools.cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(os.cpu_count(), "torchliner-sums")


if hasattr(os, "register_at_fork"):  # the child has none of its parent's threads
    os.register_at_fork(after_in_child=_pool.cache_clear)


def in_threads(name: str, share: int, count: int, given: Sequence[Any]) -> None:
    """Call a function of the library with ranges of ``share`` of ``count`` columns or rows.

    Raises:
        ValueError: there is no such function.
    """
    library = _library()
    if library is None or name not in FUNCTIONS:
        raise ValueError(f"no compiled function {name}: {reason}")
    function = library[name]

    lefts = iter(range(0, count, max(share, 1)))  # of all threads: who is done takes the next

    def work() -> None:
        for left in lefts:
            function(*given, ctypes.c_int64(left), ctypes.c_int64(min(left + share, count)))

    workers = min(threads(), -(-count // max(share, 1)))
    others = [_pool().submit(work) for _ in range(1, workers)]
    work()
    for other in others:
        other.result()


@functools.cache
def _library() -> ctypes.CDLL | None:
    """The compiled file, from the cache or built; None where that fails, and ``reason``."""
    global reason
    try:
        library = ctypes.CDLL(str(_built()))
        for name in FUNCTIONS:
            library[name].restype = None
    except (OSError, AttributeError, subprocess.TimeoutExpired, RuntimeError) as problem:
        reason = str(problem)
        return None
    reason = None
    return library


def _built() -> Path:
    """The compiled file's path; its name holds all that it depends on.

    Home directories are shared in clusters of unlike machines: the macros that the compiler
    defines say its version and the instructions of this machine.
    """
    found = [path for name in ("g++", "clang++") if (path := shutil.which(name))]
    compiler = shlex.split(os.environ.get("CXX", "")) or found[:1]
    if not compiler:
        raise RuntimeError("no C++ compiler: neither g++ nor clang++ is on the path, CXX is unset")
    command = [*compiler, *FLAGS]
    macros = _output([*command, "-dM", "-E", "-x", "c++", os.devnull])
    content = [*(path.read_bytes() for path in SOURCES), shlex.join(command).encode(), macros]
    key = hashlib.sha256(b"\0".join(content)).hexdigest()[:16]
    home = os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
    folder = Path(home) / "torchliner"
    target = folder / f"sums-{key}.so"
    if not target.exists():
        folder.mkdir(parents=True, exist_ok=True)
        # Several workers may build at once: each into a name of its own, the last one stays.
        with tempfile.TemporaryDirectory(dir=folder, prefix=".sums-") as own:
            part = Path(own) / target.name
            _output([*command, "-shared", "-o", str(part), *map(str, SOURCES)])
            part.replace(target)
    return target


def _output(command: Sequence[str]) -> bytes:
    """What a compiler prints.

    Raises:
        RuntimeError: with its message, where it fails; subprocess.TimeoutExpired after SECONDS.
    """
    # A file, not a pipe, and a session of its own: a compiler's children, which outlive it when it
    # is stopped, would hold a pipe open.
    with tempfile.TemporaryFile() as printed:
        with subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=printed,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        ) as process:
            try:
                failed = process.wait(SECONDS)
            except BaseException:
                os.killpg(process.pid, signal.SIGKILL)
                raise
        printed.seek(0)
        text = printed.read()
    if failed:
        last = text.decode(errors="replace").strip()[-500:]
        raise RuntimeError(f"{shlex.join(command)} failed with code {failed}: {last}")
    return text

"""The sums of a reading on CPUs in C++: built at first use where a compiler is, or brought by the wheel.

The library lies in a folder that only the user can write, beside its own checksum; what does not match is built anew
and never loaded. ``TORCHLINER_SUMS`` in the environment: ``torch`` never uses it, ``native`` insists on it.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import logging
import os
import shlex
import shutil
import signal
import stat
import subprocess
import tempfile
import threading
from collections.abc import Sequence
from ctypes import CDLL, c_double, c_int64, c_void_p
from pathlib import Path

import torch
from torch import Tensor

SOURCE = Path(__file__).with_suffix(".cpp")
# Not -ffast-math: a library built with it makes the whole process flush denormal numbers to zero.
FLAGS = ("-std=c++17", "-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-fPIC")
SECONDS = 120.0  # that a compiler may take
PRECISIONS = {torch.float32: "float32", torch.float64: "float64"}

reason = ""  # why there is no library, after ``available()``
_looking = threading.Lock()  # threads that ask at the same time build it once
if hasattr(os, "register_at_fork"):  # no child begins with a lock that nobody will release
    os.register_at_fork(before=_looking.acquire, after_in_parent=_looking.release, after_in_child=_looking.release)


def available() -> bool:
    """Whether the library can be used here; builds it the first time.

    Raises:
        RuntimeError: with the reason, if ``TORCHLINER_SUMS`` is ``native`` and there is none.
    """
    wanted = os.environ.get("TORCHLINER_SUMS")
    there = wanted != "torch" and _library() is not None
    if not there and wanted == "native":
        raise RuntimeError(f"TORCHLINER_SUMS=native, but the compiled sums failed: {reason}")
    return there


def sums(weights: Tensor, columns: Tensor, count: int, centre: float) -> Tensor:
    """See ``chebyshev_sums.sums``; columns with any strides; other threads work on meanwhile.

    Raises:
        TypeError: neither float32 nor float64. ValueError: shapes that do not fit, or not on a CPU.
        RuntimeError: there is no library.
    """
    return _call("sums", weights, columns, (weights.shape[1], count), count, c_double(centre))


def survey(weights: Tensor, columns: Tensor) -> Tensor:
    """See ``survey.survey_sums``; the rest as for ``sums``."""
    return _call("survey", weights, columns, (weights.shape[1] + 2, 1), 1)


def _call(name: str, weights: Tensor, columns: Tensor, numbers: tuple[int, int], count: int, *more: c_double) -> Tensor:
    if columns.dtype not in PRECISIONS:
        raise TypeError(f"columns are {columns.dtype}; the compiled sums take float32 or float64")
    slabs, rows, length = weights.shape
    if columns.shape[:-1] != (slabs, length) or not columns.is_cpu:
        have = f"columns are {tuple(columns.shape)} on {columns.device}"
        raise ValueError(f"{have}; weights {tuple(weights.shape)} need ({slabs}, {length}, N) on a CPU")
    library = _library()
    if library is None:
        raise RuntimeError(f"there are no compiled sums: {reason}")
    held, width = weights.to(columns).contiguous(), columns.shape[2]
    found = torch.empty(slabs, *numbers, width, dtype=torch.float64)
    layout = (c_int64 * 8)(*columns.stride(), slabs, rows, length, count, width)
    data = map(c_void_p, (columns.data_ptr(), held.data_ptr(), found.data_ptr()))
    library[f"{name}_{PRECISIONS[columns.dtype]}"](*data, layout, *more, c_int64(0), c_int64(width))
    return found


def _library() -> CDLL | None:
    with _looking:
        return _found()


@functools.cache
def _found() -> CDLL | None:
    """Loaded from the cache, built, or the one of the wheel; None where none can be had, with the ``reason``."""
    global reason
    problems = []
    for get in (_built, _brought):
        try:
            return get()
        except (OSError, AttributeError, RuntimeError, ValueError, subprocess.TimeoutExpired) as problem:
            problems.append(str(problem))
    reason = "; ".join(problems)
    logging.getLogger("torchliner").info("moments are summed by torch alone, which is slower: %s", reason)
    return None


def _loaded(path: Path) -> CDLL:
    library = CDLL(str(path))
    for name in ("sums", "survey"):
        for precision in PRECISIONS.values():
            library[f"{name}_{precision}"].restype = None
    return library


def _brought() -> CDLL:
    """The library of the wheel, made for processors that know AVX2, or any of another kind."""
    found = next(iter(sorted(SOURCE.parent.glob("native-*.so"))), None)
    if found is None:
        raise RuntimeError("the package brings no compiled sums")
    if found.name.endswith("-v3.so") and torch.backends.cpu.get_cpu_capability() not in ("AVX2", "AVX512"):
        raise RuntimeError(f"{found.name} needs a processor with AVX2")
    return _loaded(found)


def _built() -> CDLL:
    """The library for this source, compiler and processor, built unless it is there and whole."""
    found = [path for name in ("g++", "clang++") if (path := shutil.which(name))]
    compiler = shlex.split(os.environ.get("CXX", "")) or found[:1]
    if not compiler:
        raise RuntimeError("no C++ compiler: neither g++ nor clang++ is on the path, CXX is unset")
    command = [*compiler, *FLAGS]
    # Unlike machines share home folders: the macros say the compiler's version and the processor's instructions.
    macros = _output([*command, "-dM", "-E", "-x", "c++", os.devnull])
    key = hashlib.sha256(b"\0".join([SOURCE.read_bytes(), shlex.join(command).encode(), macros])).hexdigest()[:16]
    names = f"native-{key}.so", f"native-{key}.sha256"
    folder = _folder()
    if folder is not None:
        with contextlib.suppress(OSError):
            if (folder / names[1]).read_bytes() == _digest(folder / names[0]):
                return _loaded(folder / names[0])
        if not os.access(folder, os.W_OK):
            folder = None
    # Several processes may build at once: each into a folder of its own, the last one stays. Where no folder is the
    # user's alone, the library lives on in memory.
    with tempfile.TemporaryDirectory(dir=folder, prefix=".native-") as own:
        part, checksum = (Path(own) / name for name in names)
        _output([*command, "-shared", "-o", str(part), str(SOURCE)])
        library = _loaded(part)
        checksum.write_bytes(_digest(part))
        for file in (part, checksum) if folder is not None else ():
            file.chmod(0o600)
            os.replace(file, Path(own).parent / file.name)
    return library


def _folder() -> Path | None:
    """Of the user's cache, if only the user can write it."""
    with contextlib.suppress(OSError, RuntimeError):  # RuntimeError: no home
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "torchliner"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        state = folder.lstat()
        if stat.S_ISDIR(state.st_mode) and state.st_uid == os.getuid() and not state.st_mode & 0o022:
            return folder
    return None


def _digest(path: Path) -> bytes:
    return hashlib.sha256(path.read_bytes()).hexdigest().encode()


def _output(command: Sequence[str]) -> bytes:
    """What a compiler prints.

    Raises:
        RuntimeError: with its message, where it fails; subprocess.TimeoutExpired after SECONDS.
    """
    # A file, not a pipe, and a session of its own: a compiler's children, which outlive it when it is stopped, would
    # hold a pipe open.
    with tempfile.TemporaryFile() as printed:
        about = {"stdin": subprocess.DEVNULL, "stdout": printed, "stderr": subprocess.STDOUT}
        with subprocess.Popen(command, start_new_session=True, **about) as process:  # type: ignore[call-overload]
            try:
                failed = process.wait(SECONDS)
            except BaseException:
                os.killpg(process.pid, signal.SIGKILL)
                raise
        printed.seek(0)
        text: bytes = printed.read()
    if failed:
        raise RuntimeError(f"{shlex.join(command)} failed with code {failed}: {text.decode(errors='replace')[-500:]}")
    return text

"""The moments on CPUs in C++: built at first use where a compiler is, or brought by the wheel.

The library lies in a folder that only the user can write, beside its own checksum; what does not match is built anew
and never loaded. ``TORCHLINER_SUMS`` in the environment: ``torch`` never uses it, ``native`` insists on it.
"""

from __future__ import annotations

import contextlib
import ctypes
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
from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor

SOURCE = Path(__file__).with_suffix(".cpp")
# Not -ffast-math: a library built with it makes the whole process flush denormal numbers to zero.
FLAGS = ("-std=c++17", "-O3", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared")
SECONDS = 120.0  # that a compiler may take
FUNCTIONS = {torch.float32: "sums_float32", torch.float64: "sums_float64"}

reason = ""  # why there is no library, after ``available()``


class _Slabs(ctypes.Structure):
    """``Slabs`` of native.cpp."""

    _fields_ = (
        ("v", ctypes.c_void_p),
        ("strides", ctypes.c_int64 * 3),
        ("weights", ctypes.c_void_p),
        ("sizes", ctypes.c_int64 * 5),
        ("centre", ctypes.c_double),
        ("sums", ctypes.c_void_p),
    )


def available() -> bool:
    """Whether the library can be used here; builds it the first time.

    Raises:
        RuntimeError: with the reason, if ``TORCHLINER_SUMS`` is ``native`` and there is none.
    """
    there = _library() is not None
    if not there and os.environ.get("TORCHLINER_SUMS") == "native":
        raise RuntimeError(f"TORCHLINER_SUMS=native, but the compiled sums failed: {reason}")
    return there


def sums(weights: Tensor, columns: Tensor, count: int, centre: float) -> Tensor:
    """See ``chebyshev_sums.sums``; columns with any strides; other threads work on meanwhile.

    Raises:
        TypeError: neither float32 nor float64.
    """
    library = _library()
    if columns.dtype not in FUNCTIONS or library is None:
        raise TypeError(f"columns are {columns.dtype}; float32 or float64 is needed {reason}")
    held = weights.to(columns.dtype).contiguous()
    slabs, rows, length = held.shape
    width = columns.shape[2]
    found = torch.empty(slabs, rows, count, width, dtype=torch.float64)
    about = _Slabs(
        columns.data_ptr(),
        (ctypes.c_int64 * 3)(*columns.stride()),
        held.data_ptr(),
        (ctypes.c_int64 * 5)(slabs, rows, length, count, width),
        centre,
        found.data_ptr(),
    )
    library[FUNCTIONS[columns.dtype]](ctypes.byref(about), ctypes.c_int64(0), ctypes.c_int64(width))
    return found


@functools.cache
def _library() -> ctypes.CDLL | None:
    """Loaded from the cache, built, or the one of the wheel; None where none can be had, with the ``reason``."""
    global reason
    for get in (_built, _brought):
        try:
            library = ctypes.CDLL(str(get()))
            for name in FUNCTIONS.values():
                library[name].restype = None
            return library
        except (OSError, AttributeError, RuntimeError, subprocess.TimeoutExpired) as problem:
            reason = f"{reason}; {problem}".lstrip("; ")
    logging.getLogger("torchliner").info("moments are summed by torch alone, which is slower: %s", reason)
    return None


def _brought() -> Path:
    """The library of the wheel, made for processors that know AVX2, or any of another kind."""
    found = next(iter(sorted(SOURCE.parent.glob("native-*.so"))), None)
    if found is None:
        raise RuntimeError("the package brings no compiled sums")
    if found.name.endswith("-v3.so") and torch.backends.cpu.get_cpu_capability() not in ("AVX2", "AVX512"):
        raise RuntimeError(f"{found.name} needs a processor with AVX2")
    return found


def _built() -> Path:
    """The library for this source, compiler and processor, built unless it is there and whole."""
    found = [path for name in ("g++", "clang++") if (path := shutil.which(name))]
    compiler = shlex.split(os.environ.get("CXX", "")) or found[:1]
    if not compiler:
        raise RuntimeError("no C++ compiler: neither g++ nor clang++ is on the path, CXX is unset")
    command = [*compiler, *FLAGS, "-march=native"]
    # Unlike machines share home folders: the macros say the compiler's version and the processor's instructions.
    macros = _output([*compiler, "-march=native", "-dM", "-E", "-x", "c++", os.devnull])
    key = hashlib.sha256(b"\0".join([SOURCE.read_bytes(), shlex.join(command).encode(), macros])).hexdigest()[:16]
    target = _folder() / f"native-{key}.so"
    checksum = target.with_suffix(".sha256")
    if not (target.is_file() and checksum.is_file() and checksum.read_text() == _digest(target)):
        # Several processes may build at once: each into a folder of its own, the last one stays.
        with tempfile.TemporaryDirectory(dir=target.parent, prefix=".native-") as own:
            part = Path(own) / target.name
            _output([*command, "-o", str(part), str(SOURCE)])
            summed = Path(own) / checksum.name
            summed.write_text(_digest(part))
            os.replace(part, target)
            os.replace(summed, checksum)
    return target


def _folder() -> Path:
    """That only the user can write: in the cache of the user, else one of this process alone."""
    home = os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
    folder = Path(home) / "torchliner"
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        state = folder.lstat()
        if stat.S_ISDIR(state.st_mode) and state.st_uid == os.getuid() and not state.st_mode & 0o022:
            return folder
    return _own_folder()


@functools.cache
def _own_folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="torchliner-"))


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


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

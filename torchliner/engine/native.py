"""The sums of a reading on CPUs in C++: built at first use where a compiler is, or brought by the wheel.

The library lies in a folder that only the user can write, beside its checksum; what does not match is built anew and
never loaded. ``TORCHLINER_SUMS`` in the environment: ``torch`` never uses it, ``native`` insists on it.
"""

import atexit
import contextlib
import functools
import hashlib
import logging
import os
import shlex
import shutil
import subprocess
import tempfile
from ctypes import CDLL, c_double, c_int64, c_void_p
from pathlib import Path

import torch
from torch import Tensor

SOURCE = Path(__file__).with_suffix(".cpp")
# Not -ffast-math: a library built with it makes the whole process flush denormal numbers to zero.
FLAGS = ("-std=c++17", "-O3", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared")
PROCESSORS = {"AVX2": ("-march=haswell",), "AVX512": ("-march=skylake-avx512",)}
SECONDS = 120.0  # that a compiler may take
PRECISIONS = {torch.float32: "float32", torch.float64: "float64"}

reason = ""  # why there is no library, after ``available()``


def available() -> bool:
    """Whether the library can be used here; builds it the first time."""
    return library() is not None


def sums(weights: Tensor, columns: Tensor, count: int, centre: float) -> Tensor:
    """See ``nodes.torch_sums``; columns with any strides; other threads work on meanwhile.

    Raises:
        ValueError: neither float32 nor float64, shapes that do not fit, or not on a CPU.
    """
    slabs, rows, length = weights.shape
    if columns.shape[:-1] != (slabs, length) or not columns.is_cpu or columns.dtype not in PRECISIONS:
        have = f"columns are {columns.dtype}, {tuple(columns.shape)} on {columns.device}"
        raise ValueError(f"{have}; weights {tuple(weights.shape)} need float32 or 64, ({slabs}, {length}, N) on a CPU")
    compiled, held, width = library(), weights.to(columns).contiguous(), columns.shape[2]
    assert compiled is not None
    found = torch.empty(slabs, rows, count, width, dtype=torch.float64)
    layout = (c_int64 * 8)(*columns.stride(), slabs, rows, length, count, width)
    data = map(c_void_p, (columns.data_ptr(), held.data_ptr(), found.data_ptr()))
    compiled[f"sums_{PRECISIONS[columns.dtype]}"](*data, layout, c_double(centre))
    return found


@functools.cache
def library() -> CDLL | None:
    """Loaded from the cache, built, or the one of the wheel; None where none can be had, with the ``reason``, or a
    RuntimeError if ``TORCHLINER_SUMS`` is ``native``."""
    global reason
    problems = []
    for get in (_built, _brought):
        try:
            found = CDLL(str(get()))
            for precision in PRECISIONS.values():
                found[f"sums_{precision}"].restype = None
            return found
        except (OSError, AttributeError, RuntimeError, ValueError, subprocess.SubprocessError) as problem:
            problems.append(str(problem))
    reason = "; ".join(problems)
    if os.environ.get("TORCHLINER_SUMS") == "native":
        raise RuntimeError(f"TORCHLINER_SUMS=native, but the compiled sums failed: {reason}")
    logging.getLogger("torchliner").info("moments are summed by torch alone, which is slower: %s", reason)
    return None


def _brought() -> Path:
    """The library of the wheel, made for processors that know AVX2, or any of another kind."""
    found = next(iter(sorted(SOURCE.parent.glob("native-*.so"))), None)
    if found is None or (found.name.endswith("-v3.so") and torch.backends.cpu.get_cpu_capability() not in PROCESSORS):
        raise RuntimeError("the package brings no compiled sums for this processor")
    return found


def _built() -> Path:
    """The library for this source, compiler and kind of processor, built unless it is there and whole."""
    compiler = shlex.split(os.environ.get("CXX", "")) or [each for each in ("g++", "clang++") if shutil.which(each)][:1]
    if not compiler:
        raise RuntimeError("no C++ compiler: neither g++ nor clang++ is on the path, CXX is unset")
    command = [*compiler, *FLAGS, *PROCESSORS.get(torch.backends.cpu.get_cpu_capability(), ())]
    key, folder = hashlib.sha256(SOURCE.read_bytes() + shlex.join(command).encode()).hexdigest()[:16], _folder()
    if folder is None:  # none is the user's alone: for this process
        folder = Path(tempfile.mkdtemp(prefix="torchliner-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    library = folder / f"native-{key}.so"
    checksum = library.with_suffix(".sha256")  # a library that is not the one that was built would end the process
    with contextlib.suppress(OSError):
        if checksum.read_bytes() == hashlib.sha256(library.read_bytes()).hexdigest().encode():
            return library
    # Several processes may build at once: each into files of its own, the last one stays.
    part = library.with_suffix(f".{os.getpid()}")
    done = subprocess.run([*command, "-o", part, SOURCE], capture_output=True, text=True, timeout=SECONDS)
    if done.returncode:
        raise RuntimeError(f"{shlex.join(command)} failed with code {done.returncode}: {done.stderr[-500:]}")
    part.replace(library)
    part.write_text(hashlib.sha256(library.read_bytes()).hexdigest())
    part.replace(checksum)
    return library


def _folder() -> Path | None:
    """Of the user's cache, if the user alone can write it."""
    with contextlib.suppress(OSError, RuntimeError):  # RuntimeError: no home
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "torchliner"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        state = folder.lstat()
        mine = state.st_uid == os.getuid() and not folder.is_symlink() and not state.st_mode & 0o022
        return folder if mine and os.access(folder, os.W_OK) else None
    return None

"""The sums of a reading on CPUs in C++: built at first use where a compiler is, or brought by the wheel.

The library lies in a folder that only the user can write, beside its own checksum; what does not match is built anew
and never loaded. ``TORCHLINER_SUMS`` in the environment: ``torch`` never uses it, ``native`` insists on it.
"""

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
FLAGS = ("-std=c++17", "-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-fPIC")
SECONDS = 120.0  # that a compiler may take
PRECISIONS = {torch.float32: "float32", torch.float64: "float64"}

reason = ""  # why there is no library, after ``available()``


def available() -> bool:
    """Whether the library can be used here; builds it the first time.

    Raises:
        RuntimeError: with the reason, if ``TORCHLINER_SUMS`` is ``native`` and there is none.
    """
    wanted = os.environ.get("TORCHLINER_SUMS")
    there = wanted != "torch" and library() is not None
    if not there and wanted == "native":
        raise RuntimeError(f"TORCHLINER_SUMS=native, but the compiled sums failed: {reason}")
    return there


def sums(weights: Tensor, columns: Tensor, count: int, centre: float) -> Tensor:
    """See ``nodes.torch_sums``; columns with any strides; other threads work on meanwhile.

    Raises:
        TypeError: neither float32 nor float64. ValueError: shapes that do not fit, or not on a CPU.
    """
    if columns.dtype not in PRECISIONS:
        raise TypeError(f"columns are {columns.dtype}; the compiled sums take float32 or float64")
    slabs, rows, length = weights.shape
    if columns.shape[:-1] != (slabs, length) or not columns.is_cpu:
        have = f"columns are {tuple(columns.shape)} on {columns.device}"
        raise ValueError(f"{have}; weights {tuple(weights.shape)} need ({slabs}, {length}, N) on a CPU")
    compiled, held, width = library(), weights.to(columns).contiguous(), columns.shape[2]
    assert compiled is not None
    found = torch.empty(slabs, rows, count, width, dtype=torch.float64)
    layout = (c_int64 * 8)(*columns.stride(), slabs, rows, length, count, width)
    data = map(c_void_p, (columns.data_ptr(), held.data_ptr(), found.data_ptr()))
    compiled[f"sums_{PRECISIONS[columns.dtype]}"](*data, layout, c_double(centre))
    return found


@functools.cache
def library() -> CDLL | None:
    """Loaded from the cache, built, or the one of the wheel; None where none can be had, with the ``reason``."""
    global reason
    problems = []
    for get in (_built, _brought):
        try:
            return get()
        except (OSError, AttributeError, RuntimeError, ValueError, subprocess.SubprocessError) as problem:
            problems.append(str(problem))
    reason = "; ".join(problems)
    logging.getLogger("torchliner").info("moments are summed by torch alone, which is slower: %s", reason)
    return None


def _loaded(path: Path) -> CDLL:
    found = CDLL(str(path))
    for precision in PRECISIONS.values():
        found[f"sums_{precision}"].restype = None
    return found


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
    folder, name = _folder(), f"native-{key}.so"
    if folder is not None:
        with contextlib.suppress(OSError):
            if (folder / name).with_suffix(".sha256").read_bytes() == _digest(folder / name):
                return _loaded(folder / name)
    # Several processes may build at once: each into a folder of its own, the last one stays. Where no folder is the
    # user's alone, the library lives on in memory.
    with tempfile.TemporaryDirectory(dir=folder, prefix=".native-") as own:
        part = Path(own) / name
        _output([*command, "-shared", "-o", str(part), str(SOURCE)])
        made = _loaded(part)
        part.with_suffix(".sha256").write_bytes(_digest(part))
        for file in (part, part.with_suffix(".sha256")) if folder is not None else ():
            file.chmod(0o600)
            os.replace(file, Path(own).parent / file.name)
    return made


def _folder() -> Path | None:
    """Of the user's cache, if the user alone can write it."""
    with contextlib.suppress(OSError, RuntimeError):  # RuntimeError: no home
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "torchliner"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        state = folder.lstat()
        mine = state.st_uid == os.getuid() and not folder.is_symlink() and not state.st_mode & 0o022
        return folder if mine and os.access(folder, os.W_OK) else None
    return None


def _digest(path: Path) -> bytes:
    return hashlib.sha256(path.read_bytes()).hexdigest().encode()


def _output(command: list[str]) -> bytes:
    """What a compiler prints; RuntimeError with its message where it fails."""
    done = subprocess.run(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=SECONDS
    )
    if done.returncode:
        text = done.stdout.decode(errors="replace")[-500:]
        raise RuntimeError(f"{shlex.join(command)} failed with code {done.returncode}: {text}")
    return done.stdout

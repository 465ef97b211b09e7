"""The sums of ``eager`` by a C++ file that is built on first use, where there is a compiler.

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

import numpy as np
import torch
from torch import Tensor

from torchliner.reduction.eager import Lines, Pieces, Speeds, weight_sums
from torchliner.reduction.sources import Taken
from torchliner.reduction.threads import threads

SOURCE = Path(__file__).with_name("sums.cpp")
# Not -ffast-math: a library built with it makes the whole process flush denormal numbers to zero.
FLAGS = ["-std=c++17", "-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-fPIC"]
SECONDS = 120.0  # that a compiler may take
TILE = 64  # columns; the ranges of threads begin at multiples of it

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


def add(
    slab: Tensor, lines: Sequence[Lines] = (), speeds: Speeds | None = None,
    taken: Taken | None = None,
) -> None:  # fmt: skip
    """``eager.add`` on a CPU, to the same bits for any threads and any order of columns.

    Raises:
        ValueError, IndexError: where a tensor or a block does not fit; nothing is added then.
    """
    kept: list[Any] = []  # till the end: what the addresses point to
    slab_of = _slab(slab, taken, kept)
    asked = (_Lines * len(lines))(*(_lines(slab, each, kept) for each in lines))
    moments = None if speeds is None else ctypes.byref(_moments(slab, speeds, kept))
    columns = slab.shape[1]
    share = -(-columns // (TILE * threads())) * TILE
    given = ctypes.byref(slab_of), asked, ctypes.c_int64(len(lines)), moments
    _in_threads("add", slab, share, columns, given)
    del kept


def _moments(slab: Tensor, speeds: Speeds, kept: list[Any]) -> _Moments:
    known = weight_sums(slab, speeds.pieces, speeds.rows)
    rows = None if speeds.rows is None else speeds.rows.contiguous()
    kept += [known, rows]
    further, dtype, (length, columns) = known.shape[1], slab.dtype, slab.shape
    return _Moments(
        _pieces(speeds.pieces, speeds.of_blocks, kept),
        _address(rows, (further - 1, length), dtype),
        length,
        further,
        speeds.count,
        speeds.centre,
        _address(known, known.shape),
        _address(speeds.totals, (further, speeds.count, columns)),
        _address(speeds.of_blocks, (-1, further, speeds.count, columns), dtype),
    )


def _lines(slab: Tensor, lines: Lines, kept: list[Any]) -> _Lines:
    weight_sums(slab, lines.pieces, None)
    (length, columns), count = slab.shape, len(lines.rows)
    rows = lines.rows.contiguous()
    kept.append(rows)
    return _Lines(
        _pieces(lines.pieces, lines.sums, kept),
        _address(rows, (count, length), slab.dtype),
        length,
        count,
        _address(lines.sums, (-1, count, columns)),
        _address(lines.squares, (len(lines.sums), columns)),
        _address(lines.smallest, (columns,)),
        _address(lines.largest, (columns,)),
    )


def cell_sums(slab: Tensor, runs: Tensor, count: int) -> Tensor:
    """Sums of v over cells, (t, C), float64.

    Args:
        slab: v, m/s, (t, P), columns side by side in memory.
        runs: of neighbouring columns of one cell: first column, how many, cell; int64, (n, 3).
        count: C.
    """
    found = torch.zeros(len(slab), count, dtype=torch.float64)
    slab_of = _slab(slab, None, [])
    given = (
        ctypes.c_void_p(_address(runs, (-1, 3), torch.int64)), ctypes.c_int64(len(runs)),
        ctypes.c_int64(count), ctypes.c_void_p(found.data_ptr()),
    )  # fmt: skip
    share = max(1, -(-len(slab) // threads()))
    _in_threads("cells", slab, share, len(slab), (ctypes.byref(slab_of), *given))
    return found


def _members(text: str) -> list[tuple[str, Any]]:
    """Of a structure of the C++ file: pointers with a star, else int64."""
    return [
        (name.lstrip("*"), ctypes.c_void_p if name[0] == "*" else ctypes.c_int64)
        for name in text.split()
    ]


class _Slab(ctypes.Structure):
    _fields_ = _members(
        "*v row_stride column_stride columns *taken_rows *taken_coefficients *scale taken_count"
    )


class _Pieces(ctypes.Structure):
    _fields_ = _members("*at count")


class _Moments(ctypes.Structure):
    _fields_ = [
        ("pieces", _Pieces), *_members("*weights weight_stride rows count"),
        ("centre", ctypes.c_double), *_members("*known *totals *of_blocks"),
    ]  # fmt: skip


class _Lines(ctypes.Structure):
    _fields_ = [
        ("pieces", _Pieces),
        *_members("*weights weight_stride rows *sums *squares *smallest *largest"),
    ]


def _slab(slab: Tensor, taken: Taken | None, kept: list[Any]) -> _Slab:
    """What the C++ file knows of a slab; what must live as long is put into ``kept``."""
    length, columns = slab.shape
    rows = coefficients = scale = None
    if taken is not None:
        rows, coefficients = taken.rows.contiguous(), taken.coefficients.contiguous()
        scale = None if taken.scale is None else taken.scale.contiguous()
        kept += [rows, coefficients, scale]
    of = 0 if rows is None else rows.shape[1]
    return _Slab(
        slab.data_ptr(),
        slab.stride(0),
        slab.stride(1),
        columns,
        _address(rows, (length, of), slab.dtype),
        _address(coefficients, (of, columns), slab.dtype),
        _address(scale, (columns,), slab.dtype),
        of,
    )


def _pieces(pieces: Pieces, of_blocks: Tensor | None, kept: list[Any]) -> _Pieces:
    blocks = [block for *_, block in pieces]
    if of_blocks is not None and blocks and not 0 <= min(blocks) <= max(blocks) < len(of_blocks):
        raise IndexError(f"blocks {min(blocks)} to {max(blocks)}, but room for {len(of_blocks)}")
    table = np.array(pieces, dtype=np.int64)
    kept.append(table)
    return _Pieces(table.ctypes.data, len(pieces))


def _address(
    tensor: Tensor | None, shape: Sequence[int], dtype: torch.dtype = torch.float64
) -> int | None:
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


def _in_threads(name: str, slab: Tensor, share: int, count: int, given: Sequence[Any]) -> None:
    """Call a function of the library with ranges of ``share`` of ``count`` columns or rows."""
    library = _library()
    kind = str(slab.dtype).removeprefix("torch.")
    if library is None or kind not in ("float32", "float64") or not slab.is_cpu:
        raise ValueError(f"no compiled sums of {slab.dtype} on {slab.device}: {reason}")
    function = library[f"{name}_{kind}"]

    def over(left: int) -> None:
        function(*given, ctypes.c_int64(left), ctypes.c_int64(min(left + share, count)))

    lefts = range(0, count, max(share, 1))
    others = [_pool().submit(over, left) for left in lefts[1:]]
    for left in lefts[:1]:
        over(left)
    for other in others:
        other.result()


@functools.cache
def _library() -> ctypes.CDLL | None:
    """The compiled file, from the cache or built; None where that fails, and ``reason``."""
    global reason
    try:
        library = ctypes.CDLL(str(_built()))
        for name in ("add", "cells"):
            for kind in ("float32", "float64"):
                library[f"{name}_{kind}"].restype = None
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
    content = [SOURCE.read_bytes(), shlex.join(command).encode(), macros]
    key = hashlib.sha256(b"\0".join(content)).hexdigest()[:16]
    home = os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
    folder = Path(home) / "torchliner"
    target = folder / f"sums-{key}.so"
    if not target.exists():
        folder.mkdir(parents=True, exist_ok=True)
        # Several workers may build at once: each into a name of its own, the last one stays.
        with tempfile.TemporaryDirectory(dir=folder, prefix=".sums-") as own:
            part = Path(own) / target.name
            _output([*command, "-shared", "-o", str(part), str(SOURCE)])
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

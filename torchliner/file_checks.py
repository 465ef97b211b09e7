"""What holds of every file that is read: regular, no larger than memory, its errors by its name."""

from __future__ import annotations

import csv
import functools
import math
import os
import stat
import struct
import tokenize
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

LONGEST_LINE = 1 << 20  # bytes
CELLS = 16  # bytes of memory that a byte of text takes as cells and numbers
# What libraries raise on damaged files, beside ValueError, TypeError and OSError.
DAMAGE = (
    *(LookupError, AttributeError, ArithmeticError, NameError, EOFError, RuntimeError, AssertionError, SystemError),
    *(SyntaxError, struct.error, zlib.error, csv.Error, tokenize.TokenError),
)


class Unwritten(ValueError):
    """A file lacks samples, which may be written yet."""


@contextmanager
def naming(path: str | Path) -> Iterator[None]:
    """A block that reads a file: whatever fails there is an OSError or a ValueError that names the file."""
    try:
        yield
    except (OSError, ValueError, TypeError) as error:
        if Path(path).name in str(error):
            raise
        kind = OSError if isinstance(error, OSError) else ValueError
        raise kind(f"{path}: {error}") from error
    except MemoryError as error:
        raise ValueError(f"{path} does not fit into memory ({error})") from error
    except DAMAGE as error:
        raise ValueError(
            f"{path} is damaged, or of another layout than it says: {type(error).__name__}: {error}"
        ) from error


def require_regular(path: str | Path) -> None:
    """Refuse what is no file of bytes.

    Raises:
        FileNotFoundError: no such file.
        OSError: a folder, a device, a pipe; a link that leads round in a circle.
    """
    path = Path(path)
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        raise FileNotFoundError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise OSError(f"{path} cannot be read: {error}") from error
    if stat.S_ISDIR(mode):
        raise OSError(f"{path} is a folder, not a file")
    if not stat.S_ISREG(mode):
        raise OSError(f"{path} is a device or a pipe; a regular file is needed")


@functools.cache
def machine_memory() -> float:
    """Bytes of memory that this process may use at most; inf where nothing tells."""
    found = [math.inf]
    with suppress(ValueError, OSError, AttributeError):
        found.append(float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")))
    for name in ("memory.max", "memory/memory.limit_in_bytes"):  # of a container
        with suppress(ValueError, OSError):
            found.append(float(Path("/sys/fs/cgroup", name).read_text()))
    return min(found)


def require_memory(size: float, label: str, remedy: str = "cut it, or use a larger machine") -> None:
    """Refuse before it is read what cannot fit into this machine: ``size`` bytes of what ``label`` names."""
    if size > machine_memory():
        raise ValueError(
            f"{label} takes {size / 1e9:.4g} GB; this machine has {machine_memory() / 1e9:.4g} GB: {remedy}"
        )


def read_bytes(path: str | Path, head: int | None = None) -> bytes:
    """A text file as it is stored, or its first ``head`` bytes.

    Raises:
        FileNotFoundError, OSError: as ``require_regular``; it cannot be read.
        ValueError: a line above ``LONGEST_LINE``; zero bytes; more than fits into memory as cells.
    """
    path = Path(path)
    require_regular(path)
    require_memory(CELLS * min(path.stat().st_size, head or math.inf), f"{path} as cells of text")
    with path.open("rb") as file:
        raw = file.read(-1 if head is None else head)
    if b"\0" in raw:
        raise ValueError(f"{path} holds zero bytes: it is no text file (UTF-8 or latin-1)")
    for begin in range(0, len(raw) - LONGEST_LINE, LONGEST_LINE):
        part = raw[begin : begin + LONGEST_LINE]
        if b"\n" not in part and b"\r" not in part:
            raise ValueError(f"{path} has a line of more than {LONGEST_LINE} bytes; it is no table of text")
    return raw

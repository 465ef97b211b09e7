"""Files that are whole or not there, folders for one run at a time, and what is refused as an output."""

import errno
import os
import re
import socket
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

HDF5 = (".h5", ".hdf5", ".nc")
PICTURES = (".png", ".pdf", ".svg", ".jpg", ".jpeg", ".eps", ".ps", ".tif", ".tiff", ".webp")
PART = ".torchliner-"  # begins the names of files that are not whole yet
STEERING = r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)

_inputs: ContextVar[frozenset[Any]] = ContextVar("inputs", default=frozenset())


def printable(text: str) -> str:
    """Text from a file for a terminal or a table: control characters, marks that turn the direction of writing and
    halves of characters become ``\\x1b`` and the like; ends of lines and tabs stay."""
    return re.sub(STEERING, lambda found: ascii(found[0])[1:-1], text)


@contextmanager
def inputs_kept(paths: Iterable[str | Path]) -> Iterator[None]:
    """Within the block nothing is written over one of these files, whatever its name there."""
    token = _inputs.set(frozenset(map(identity, paths)))
    try:
        yield
    finally:
        _inputs.reset(token)


def identity(path: str | Path) -> Any:
    """What a name leads to: the file, by any of its names, or the place where one would be."""
    try:
        found = os.stat(path)
    except OSError:
        return os.path.realpath(path)
    return found.st_dev, found.st_ino


def require_ending(path: str | Path, endings: Sequence[str]) -> None:
    """Refuse a file name whose ending says something else than what is written, by a ValueError."""
    suffix = Path(path).suffix
    if suffix.lower() not in endings:
        raise ValueError(f"{path} ends in {suffix or 'nothing'!r}; it must be one of {', '.join(endings)}")


def writable(path: str | Path, *endings: str) -> Path:
    """The file that an output of one of some endings (default: any) would replace or make, with links followed. A
    ValueError for another ending and an input of the command, an OSError for what is no file that can be written."""
    if endings:
        require_ending(path, endings)
    path, target = Path(path), Path(os.path.realpath(path))
    folder = target.parent if path.is_symlink() else path.parent  # as the user knows it
    if identity(target) in _inputs.get():
        raise ValueError(f"the output {path} is an input; name another file")
    there = target.exists()
    # The mode as well: root may write to what is marked read-only.
    kept = there and not (target.stat().st_mode & 0o222 and os.access(target, os.W_OK))
    wrong = {
        "it is a link that leads to itself; name a file": target.is_symlink(),
        f"the folder {folder} does not exist": not folder.is_dir(),
        "it is a folder; name a file": target.is_dir(),
        "it is a device or a pipe, which is not written to; name a file": there and not target.is_file(),
        "it is write-protected; name another file": kept,
        f"the folder {folder} is write-protected": not os.access(folder, os.W_OK | os.X_OK),
    }
    if why := next((text for text, found in wrong.items() if found), ""):
        raise OSError(f"{path} cannot be written: {why}")
    return target


def writable_folder(path: str | Path) -> None:
    """Refuse, by an OSError, a folder that could neither be made nor written to."""
    whole = Path(path).absolute()
    there = next(each for each in (whole, *whole.parents) if each.exists() or each.is_symlink())
    if not there.is_dir():
        raise OSError(f"{path}: {there} is there and no folder; name a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise OSError(f"{path} cannot be made or filled: the folder {there} is write-protected")


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """A folder for one run at a time; the lock ends with the process, however that ends. What a killed run has left of
    unfinished files is deleted. An OSError says which other run holds it."""
    from filelock import FileLock, Timeout

    folder.mkdir(parents=True, exist_ok=True)
    lock, holder = FileLock(folder / ".lock"), folder / ".lock.held"
    try:
        lock.acquire(blocking=False)
    except NotImplementedError:  # of a file system that has none
        yield
        return
    except Timeout:
        said = holder.read_text("utf-8").strip() if holder.exists() else "unknown"
        raise OSError(
            f"{folder} is in use by another run ({said}); wait for its end, or name another --output"
        ) from None
    with lock:
        holder.write_text(f"process {os.getpid()} on {socket.gethostname()}\n", "utf-8")
        for left in folder.rglob(f"{PART}*"):
            left.unlink(missing_ok=True)
        yield


@contextmanager
def written_whole(path: str | Path, *endings: str) -> Iterator[Path]:
    """A temporary path beside the file, renamed onto it when the block ends well.

    A crash or an interrupt leaves the old file as it was. A link is followed, and a file that is replaced keeps its
    mode. ValueError, OSError as ``writable``; OSError where the disk is full.
    """
    target = writable(path, *endings)
    try:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=PART, suffix=".part")
    except OSError as error:
        raise OSError(f"{path} cannot be written: {error.strerror}") from error
    os.close(handle)
    temporary = Path(name)
    os.umask(umask := os.umask(0))
    try:
        yield temporary
        os.chmod(temporary, target.stat().st_mode & 0o7777 if target.exists() else 0o666 & ~umask)
        os.replace(temporary, target)
    except (OSError, RuntimeError) as error:
        full = isinstance(error, OSError) and (error.errno in FULL or name in str(error))
        if full or ("errno" in str(error) and "read" not in str(error)):  # HDF5 writes or closes
            said = re.search(r"error message = '([^']+)'", str(error))  # in HDF5's page of words
            text = said[1] if said else str(error).replace(name, str(path))
            raise OSError(f"{path} cannot be written: {text}") from error
        raise
    finally:
        temporary.unlink(missing_ok=True)  # gone already where all went well

"""Files that are whole or not there, and the one place where anything is refused as an output."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import socket
import stat
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torchliner.io.lock import locked_by

HDF5 = (".h5", ".hdf5", ".nc")
PICTURES = (".png", ".pdf", ".svg", ".jpg", ".jpeg", ".eps", ".ps", ".tif", ".tiff", ".webp")
LONGEST_NAME = 255  # bytes, on all file systems in use
PART = f".torchliner-{re.sub(r'[^A-Za-z0-9]', '', socket.gethostname())[:40]}-"  # and who writes it
STEERING = r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)

_inputs: ContextVar[frozenset[Any]] = ContextVar("inputs", default=frozenset())


def printable(text: str) -> str:
    """Text from a file for a terminal or a table: what would steer either is written out.

    Control characters, marks that turn the direction of writing, and halves of characters become
    ``\\x1b`` and the like; ends of lines and tabs stay.
    """
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


def require_ending(path: str | Path, endings: Sequence[str], option: str = "") -> None:
    """Refuse a file name whose ending says something else than what is written.

    Raises:
        ValueError: it does.
    """
    suffix = Path(path).suffix
    if suffix.lower() not in endings:
        raise ValueError(
            f"{option}{' ' if option else ''}{path} ends in {suffix or 'nothing'!r}; it must be "
            f"one of {', '.join(endings)}"
        )


def writable(path: str | Path, *endings: str) -> Path:
    """The file that an output would replace or make, with links followed.

    Args:
        path: as the user named it.
        endings: that it may have; any if none is named.
    Raises:
        ValueError: another ending; an input of the command.
        OSError: no folder, a folder, a device, a link that leads to itself, write-protected, a name
            longer than 255 bytes.
    """
    if endings:
        require_ending(path, endings)
    path = Path(path)
    target = Path(os.path.realpath(path))
    if len(os.fsencode(target.name)) > LONGEST_NAME:
        raise OSError(f"{path}: the name has more than {LONGEST_NAME} bytes; shorten it")
    if target.is_symlink():
        raise OSError(f"{path} is a link that leads to itself; name a file")
    folder = target.parent if path.is_symlink() else path.parent  # as the user knows it
    if not folder.is_dir():
        raise OSError(f"{path}: the folder {folder} does not exist")
    if target.is_dir():
        raise OSError(f"{path} is a folder; name a file")
    if target.exists() and not target.is_file():
        raise OSError(f"{path} is a device or a pipe, which is not written to; name a file")
    if identity(target) in _inputs.get():
        raise ValueError(f"the output {path} is an input; name another file")
    # The mode as well: root may write to what is marked read-only.
    if target.exists() and not (target.stat().st_mode & 0o222 and os.access(target, os.W_OK)):
        raise OSError(f"{path} is write-protected; name another file, or allow writing to it")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OSError(f"{path} cannot be written: the folder {folder} is write-protected")
    return target


def writable_folder(path: str | Path) -> None:
    """Refuse a folder that could neither be made nor written to.

    Raises:
        OSError: it, or what it would be made in, is no folder or is write-protected.
    """
    there = Path(path).absolute()
    while not there.exists() and not there.is_symlink() and there != there.parent:
        there = there.parent
    if not there.is_dir():
        raise OSError(f"{path}: {there} is there and no folder; name a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise OSError(f"{path} cannot be made or filled: the folder {there} is write-protected")


@contextmanager
def written_whole(path: str | Path, *endings: str) -> Iterator[Path]:
    """A temporary path beside the file, renamed onto it when the block ends well.

    A crash or an interrupt leaves the old file as it was; what killed runs have left beside it is
    deleted. A link is followed, and a file that is replaced keeps its mode.

    Args:
        path, endings: as for ``writable``.
    Raises:
        ValueError, OSError: as ``writable``; the disk is full.
    """
    target = writable(path, *endings)
    _clean(target.parent)
    try:
        handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=f"{PART}{os.getpid()}-", suffix=".part")
    except OSError as error:
        raise OSError(f"{path} cannot be written: {error.strerror}") from error
    os.close(handle)
    try:
        with _told(path, temporary):
            yield Path(temporary)
            _dress(temporary, target)
            os.replace(temporary, target)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


@contextmanager
def _told(path: str | Path, temporary: str | Path, part: Part | None = None) -> Iterator[None]:
    """Failures to write, of a full disk above all, by the name that the user gave.

    ``part``: it stays if any of it was marked.
    """
    try:
        yield
    except (OSError, RuntimeError) as error:
        full = isinstance(error, OSError) and error.errno in FULL
        at_end = "errno" in str(error) and "read" not in str(error)  # HDF5 writes or closes
        if full or at_end or (isinstance(error, OSError) and str(temporary) in str(error)):
            text = str(error).replace(str(temporary), str(path))
            if said := re.search(r"error message = '([^']+)'", text):  # HDF5's page of words
                text = said[1]
            remedy = ""
            if part is not None and part.done:
                remedy = f"; what is written stays in {part.path}: free space and run this again"
            raise OSError(f"{path} cannot be written: {text}{remedy}") from error
        raise


@dataclass
class Part:
    """A file that is being written, and how far it is.

    Args:
        path: of what is written so far.
        source: words for what is written.
        done: units of it that are there.
    """

    path: Path
    source: str
    done: int = 0

    @property
    def mark(self) -> Path:
        """The file that says how far it is."""
        return self.path.with_name(f"{self.path.name}-mark")

    def reached(self, done: int) -> None:
        """Say so in the mark, which is whole or the old one."""
        new = self.mark.with_name(f"{self.mark.name}-new")
        try:
            new.write_text(json.dumps({"source": self.source, "done": done}), encoding="utf-8")
            os.replace(new, self.mark)
        finally:
            new.unlink(missing_ok=True)
        self.done = done


@contextmanager
def part_of(path: str | Path, source: str, *endings: str) -> Iterator[Part]:
    """A file that is written beside, as FILE.part, and renamed when the block ends well.

    If the block does not, what was marked as written stays, and the next block with the same
    ``source`` goes on there. One block at a time writes a file, as FILE.part-lock has it.

    Args:
        path, endings: as for ``writable``.
        source: words that differ for different contents.
    Raises:
        ValueError, OSError: as ``writable``; the disk is full; another run writes the file.
    """
    target = writable(path, *endings)
    part = Part(target.with_name(f"{target.name}.part"), source)
    lock = target.with_name(f"{target.name}.part-lock")
    with locked_by(lock, path):
        try:
            yield from _part_written(part, path, target)
        finally:
            with contextlib.suppress(OSError):  # open files stay on Windows
                lock.unlink()


def _part_written(part: Part, path: str | Path, target: Path) -> Iterator[Part]:
    """Of ``part_of`` what the lock guards."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        found = json.loads(part.mark.read_text(encoding="utf-8"))
        if found["source"] == part.source and part.path.is_file():
            part.done = int(found["done"])
    try:
        with _told(path, part.path, part):
            yield part
            _dress(str(part.path), target)
            os.replace(part.path, target)
    except BaseException:
        if not part.mark.exists():
            part.path.unlink(missing_ok=True)
        raise
    part.mark.unlink(missing_ok=True)


def _dress(temporary: str, target: Path) -> None:
    """Mode and owner of the file that is replaced; a new one has the usual mode."""
    if not target.exists():
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)
        return
    old = target.stat()
    if hasattr(os, "chown"):
        with contextlib.suppress(OSError):  # another's file, in a folder of ours
            os.chown(temporary, old.st_uid, old.st_gid)
    os.chmod(temporary, stat.S_IMODE(old.st_mode))


def _clean(folder: Path) -> None:
    """Delete parts of runs on this machine that are no more."""
    if os.name == "nt":  # where asking after a process would end it
        return
    for part in folder.glob(f"{PART}*.part"):
        number = part.name.removeprefix(PART).partition("-")[0]
        try:
            os.kill(int(number), 0)
        except ProcessLookupError:
            part.unlink(missing_ok=True)
        except (OSError, ValueError, OverflowError):  # alive and another's; no part of ours
            continue

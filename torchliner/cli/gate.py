"""The gate: what a command reads and writes, as its options declare, is tested before the work.

What is written later is held against the inputs once more, by ``io.whole_file``.
"""

import argparse
import glob
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from torchliner.cli.options import Kind, Option
from torchliner.io.whole_file import HDF5, identity, inputs_kept, require_ending, writable, writable_folder
from torchliner.names import did_you_mean

OWN_FILES = (".toml", ".csv", ".py", ".txt", ".wav", ".npy", ".mat", *HDF5)  # by which a name is a file


@contextmanager
def passed(command: str, declared: Sequence[Option], options: argparse.Namespace) -> Iterator[list[str]]:
    """Test all files that the options name; within the block none of the inputs can be lost.

    An output without an ending is a folder: it is made, and the output is a file in it.

    Yields:
        The inputs, as the user named them.
    Raises:
        ValueError: an output is an input or another output, or has a wrong ending; a list names one file twice.
        OSError: an input is missing or a device; an output cannot be written.
        ImportError: a figure is asked for, and matplotlib is not there.
    """
    given: list[tuple[Option, Kind, Any]] = []
    for each in declared:
        value = getattr(options, each.dest, None)
        if isinstance(each.kind, Kind) and each.kind.part and value is not None:
            given += [(each, each.kind, one) for one in (value if isinstance(value, list) else [value])]
    named: dict[Any, str] = {}
    for each, kind, value in given:
        name = str(value).partition(":")[0] if each.dest in ("x", "z") else str(value)  # FILE:VARIABLE
        if kind.part == "read":
            if (each.dest, identity(value)) in named:
                raise ValueError(f"{value} is named twice; name it once")
            named[each.dest, identity(value)] = name
        if kind.part == "named" and Path(name).suffix.lower() in OWN_FILES:
            named[each.dest, name] = name
    files = [Path(found) for name in named.values() for found in _matching(name)]
    for path in files:
        require_input(path)
    inside = [each for path in files if path.is_dir() for each in path.iterdir()]
    with inputs_kept([*files, *inside]):
        outputs: dict[Any, str] = {}
        for each, kind, path in given:
            if kind.part == "written":
                setattr(
                    options, each.dest, path := _output(path, kind, command if each.dest == "output" else each.dest)
                )
            elif kind.part == "folder":
                writable_folder(path)
            else:
                continue
            if each.flag in ("--figure", "--field"):
                from torchliner.report.figure import require_matplotlib

                require_matplotlib()
            if (other := outputs.setdefault(identity(path), each.flag)) != each.flag:
                raise ValueError(f"{each.flag} {path} is another output, that of {other}; name another file")
        yield [*named.values()]


def _output(path: Path, kind: Kind, name: str) -> Path:
    """A file that can be written: the path, or a file of that name in the folder that it is."""
    if not path.suffix:
        writable_folder(path)
        path.mkdir(parents=True, exist_ok=True)
        path /= f"{name.split()[0]}{kind.endings[0]}"
    writable(path)
    require_ending(path, kind.endings)
    return path


def _matching(name: str) -> list[str]:
    """The file of that name, or those that a pattern stands for; the name itself if none does."""
    return [name] if os.path.lexists(name) else sorted(glob.glob(name, recursive=True)) or [name]


def require_input(path: Path) -> None:
    """Refuse what is not there, with the nearest name, and what is neither a file nor a folder."""
    try:
        path.stat()
    except FileNotFoundError:
        there = os.listdir(path.parent) if os.access(path.parent, os.R_OK) else []
        raise FileNotFoundError(f"{path}: no such file{did_you_mean(path.name, there, 0.7)}") from None
    except (OSError, ValueError) as error:  # ValueError: a name with a null byte
        raise OSError(f"{path} cannot be read: {getattr(error, 'strerror', error)}") from error
    if not (path.is_file() or path.is_dir()):
        raise OSError(f"{path} is a device or a pipe; a file is needed")

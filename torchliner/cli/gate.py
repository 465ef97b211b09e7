"""The gate: what a command reads and writes, as its options declare, is tested before the work.

What is written later is held against the inputs once more, by ``io.whole_file``.
"""

from __future__ import annotations

import argparse
import contextlib
import glob
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from torchliner.cli.parser import Parser
from torchliner.io.whole_file import HDF5, PICTURES, identity, inputs_kept, require_ending, writable, writable_folder
from torchliner.names import did_you_mean

OWN_FILES = (".toml", ".csv", ".py", ".txt", ".wav", ".npy", ".mat", *HDF5)  # by which a name is a file
LARGEST_TOML = 1 << 20  # characters, in which names of files are looked for


@contextmanager
def passed(parser: Parser, options: argparse.Namespace) -> Iterator[list[str]]:
    """Test all files that the options name; within the block none of the inputs can be lost.

    An output without an ending is a folder: it is made, and the output is a file in it.

    Yields:
        The inputs, as the user named them.
    Raises:
        ValueError: an output is an input or another output, or has a wrong ending; a list names one file twice.
        OSError: an input is missing or a device; an output cannot be written.
        ImportError: a figure is asked for, and matplotlib is not there.
    """
    given: dict[str, list[tuple[argparse.Action, Any]]] = {}
    for action in parser._actions:
        value = getattr(options, action.dest, None)
        values = value if isinstance(value, list) else [] if value is None else [value]
        part = getattr(action.type, "part", "")
        given.setdefault(part, []).extend((action, each) for each in values)
    seen: dict[Any, Any] = {}
    for action, path in given.get("read", []):
        if seen.setdefault((action.dest, identity(path)), path) is not path:
            raise ValueError(f"{path} is named twice; name it once")
    named = [str(path) for path in seen.values()]
    # An array is FILE:VARIABLE.
    maybe = [text.partition(":")[0] if a.metavar == "ARRAY" else text for a, text in given.get("named", [])]
    named += [name for name in maybe if Path(name).suffix.lower() in OWN_FILES]
    files = [Path(each) for name in named for each in _matching(name)]
    for path in files:
        require_input(path)
    with inputs_kept([*files, *(each for path in files for each in _inside(path))]):
        outputs: dict[Any, str] = {}
        for action, path in given.get("folder", []) + given.get("written", []):
            flag, endings = action.option_strings[-1], getattr(action.type, "endings", ())
            if endings and not path.suffix:
                writable_folder(path)
                path.mkdir(parents=True, exist_ok=True)
                path /= f"{options.command if action.dest == 'output' else action.dest}{endings[0]}"
                setattr(options, action.dest, path)
            if endings:
                writable(path)
                require_ending(path, endings, flag)
            else:
                writable_folder(path)
            if endings == PICTURES or flag == "--figure":
                from torchliner.report.figure import require_matplotlib

                require_matplotlib()
            if (other := outputs.setdefault(identity(path), flag)) != flag:
                raise ValueError(f"{flag} {path} is another output, that of {other}; name another file")
        yield named


def _matching(name: str) -> list[str]:
    """The file of that name, or those that a pattern stands for; the name itself if none does."""
    return [name] if os.path.lexists(name) else sorted(glob.glob(name, recursive=True)) or [name]


def _inside(path: Path) -> list[Path]:
    """Files in a folder, or those that a TOML names: what is wrong with it is for its reader to say."""
    if path.is_dir():
        return list(path.iterdir())
    if path.suffix.lower() != ".toml":
        return []
    with path.open(encoding="utf-8", errors="replace") as file:
        texts = {found[2] for found in re.finditer(r"""(["'])([^\0\n]+?)\1""", file.read(LARGEST_TOML))}
    return [Path(each) for text in texts if "." in text for each in _matching(str(path.parent / text))]


def require_input(path: Path) -> None:
    """Refuse what is not there, and what is neither a file nor a folder.

    Raises:
        FileNotFoundError: the nearest name in its folder is told.
        OSError: a device, a pipe, a link that leads to itself.
    """
    try:
        path.stat()
    except FileNotFoundError:
        there: list[str] = []
        with contextlib.suppress(OSError):
            there = os.listdir(path.parent)
        raise FileNotFoundError(f"{path}: no such file{did_you_mean(path.name, there, 0.7)}") from None
    except (OSError, ValueError) as error:  # ValueError: a name with a null byte
        text = error.strerror if isinstance(error, OSError) else error
        raise OSError(f"{path} cannot be read: {text}") from error
    if not (path.is_file() or path.is_dir()):
        raise OSError(f"{path} is a device or a pipe; a file is needed")

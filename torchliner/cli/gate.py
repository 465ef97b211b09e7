"""The gate: what a command reads and writes, told from its options, is tested before the work.

An option is an input or an output by the word that stands for its value in the help, so a new
command passes through here without a line of its own. What is written later is held against the
inputs once more, by ``io.whole_file``.
"""

from __future__ import annotations

import argparse
import contextlib
import glob
import os
import re
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from torchliner.cli.parser import Parser
from torchliner.io.whole_file import (
    HDF5,
    PICTURES,
    identity,
    inputs_kept,
    require_ending,
    writable,
    writable_folder,
)
from torchliner.names import did_you_mean

READ = ("PLANE", "LINE", "SOURCE", "RECORD", "PATH")  # files and folders that must be there
MAYBE = ("LINER", "DUCT", "SIGNAL", "ARRAY")  # a name or a file, ARRAY with :VARIABLE
WRITTEN = ("FILE", "PICTURE", "FOLDER")
# By which MAYBE is a file.
OWN_FILES = (".toml", ".csv", ".py", ".txt", ".wav", ".npy", ".mat", *HDF5)
LARGEST_TOML = 1 << 20  # bytes, in which files are looked for; no liner has as many
MOST_NAMES = 10_000  # in a folder, among which a name is looked for


@contextmanager
def passed(parser: Parser, options: argparse.Namespace) -> Iterator[list[str]]:
    """Test all files that the options name; within the block none of the inputs can be lost.

    Args:
        parser: of the command or its task.
        options: as parsed.
    Yields:
        The inputs, as the user named them.
    Raises:
        ValueError: an output is an input or another output, or ends in something else than its
            help names; an option or argument names one file twice.
        OSError: an input is missing or a device; an output cannot be written.
        ImportError: a figure is asked for, and matplotlib is not there.
    """
    given = [(a, v) for a in parser._actions for v in _values(options, a)]
    inputs = [(a, v) for a, v in given if reads(a, parser.text_of(a))]
    named = [str(v) for _, v in inputs]
    named += [found for a, v in given if a.metavar in MAYBE and (found := _own_file(a, str(v)))]
    files = [path for name in named for path in _matching(name)]
    for path in files:
        require_input(path)
    _require_once(inputs)
    with inputs_kept(_with_those_inside(files)):
        outputs: dict[Any, str] = {}
        for action, value in given:
            text = parser.text_of(action)
            if not writes(action, text):
                continue
            flag = action.option_strings[-1]
            _require_output(value, flag, () if action.metavar == "FOLDER" else endings_of(text))
            if text.startswith("draw"):
                _require_matplotlib()
            if outputs.setdefault(identity(value), flag) != flag:
                raise ValueError(
                    f"{flag} {value} is another output, that of {outputs[identity(value)]}; name another file"
                )
        yield named


def reads(action: argparse.Action, text: str) -> bool:
    """Whether an option names an input that must be there."""
    return action.metavar in READ or (action.metavar == "FILE" and not writes(action, text))


def writes(action: argparse.Action, text: str) -> bool:
    """Whether an option names an output: its help says so."""
    return action.metavar in WRITTEN and text.startswith(("write ", "draw "))


def endings_of(text: str) -> tuple[str, ...]:
    """The endings that the help of an output names; all of HDF5 for one of them."""
    if text.startswith("draw "):
        return PICTURES
    found = re.findall(r"(?<!\w)\.\w+", text)
    return tuple(dict.fromkeys(e for each in found for e in (HDF5 if each in HDF5 else (each,))))


def _values(options: argparse.Namespace, action: argparse.Action) -> list[Any]:
    value = getattr(options, action.dest, None)
    return value if isinstance(value, list) else [] if value is None else [value]


def _own_file(action: argparse.Action, text: str) -> str | None:
    """The file that a name stands for; None for a preset or a generated signal."""
    path = text.partition(":")[0] if action.metavar == "ARRAY" else text
    return path if Path(path).suffix.lower() in OWN_FILES else None


def _matching(name: str) -> list[Path]:
    """The file of that name, or those that a pattern stands for; the name itself if none does."""
    found = [] if os.path.lexists(name) else sorted(glob.glob(name, recursive=True))
    return [Path(each) for each in found or [name]]


def require_input(path: Path) -> None:
    """Refuse what is not there, and what is neither a file nor a folder.

    Raises:
        FileNotFoundError: the nearest name in its folder is told.
        OSError: a device, a pipe, a link that leads to itself.
    """
    try:
        os.stat(path)
    except FileNotFoundError:
        if path.is_symlink():
            raise FileNotFoundError(f"{path}: no such file; it is a link to {os.readlink(path)}") from None
        there: list[str] = []
        with contextlib.suppress(OSError), os.scandir(path.parent) as entries:
            there = [entry.name for entry, _ in zip(entries, range(MOST_NAMES), strict=False)]
        near = did_you_mean(path.name, there, 0.7)
        raise FileNotFoundError(f"{path}: no such file{near}") from None
    except (OSError, ValueError) as error:  # ValueError: a name with a null byte
        text = error.strerror if isinstance(error, OSError) else error
        raise OSError(f"{path} cannot be read: {text}") from error
    if not (path.is_file() or path.is_dir()):
        raise OSError(f"{path} is a device or a pipe; a file is needed")


def _require_once(inputs: Iterable[tuple[argparse.Action, Any]]) -> None:
    """Refuse a file that a list names twice: it would count as two measurements."""
    seen: dict[Any, Any] = {}
    for action, path in inputs:
        if (first := seen.setdefault((action.dest, identity(path)), path)) is not path:
            as_first = "" if str(first) == str(path) else f", as {first} before"
            raise ValueError(f"{path} is named twice{as_first}; name it once")


def _with_those_inside(paths: Iterable[Path]) -> Iterator[Path]:
    """The inputs, the files of those that are folders, and the files that a TOML names."""
    for path in paths:
        yield path
        if path.is_dir():
            yield from path.iterdir()
        elif path.suffix.lower() == ".toml" and path.stat().st_size < LARGEST_TOML:
            # What is wrong with it is for its reader to say.
            with contextlib.suppress(OSError, ValueError, RecursionError):
                for text in _texts(tomllib.loads(path.read_text(encoding="utf-8-sig"))):
                    named = path.parent / text
                    if Path(text).suffix and "\0" not in text and named.exists():
                        yield named


def _texts(value: Any) -> Iterator[str]:
    """Every text in a TOML."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, (dict, list)):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _texts(each)


def _require_output(path: Path, flag: str, endings: tuple[str, ...]) -> None:
    """Refuse a file, or without endings a folder, that cannot be written."""
    if not endings:
        writable_folder(path)
        return
    writable(path)
    require_ending(path, endings, flag)


def _require_matplotlib() -> None:
    from torchliner.report.figure import require_matplotlib

    require_matplotlib()


@contextmanager
def figures_as_asked(options: argparse.Namespace) -> Iterator[None]:
    """Within the block figures are as wide as ``--figure-width`` says."""
    if (width := getattr(options, "figure_width", None)) is None:
        yield
        return
    from torchliner.report.figure import figure_style

    with figure_style(width):
        yield

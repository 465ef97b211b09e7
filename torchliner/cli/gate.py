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

from torchliner.cli.kinds import Kind
from torchliner.cli.options import Option
from torchliner.io.whole_file import HDF5, identity, inputs_kept, require_ending, writable, writable_folder
from torchliner.names import did_you_mean

OWN_FILES = (".toml", ".csv", ".py", ".txt", ".wav", ".npy", ".mat", *HDF5)  # by which a name is a file


@contextmanager
def passed(command: str, declared: Sequence[Option], options: argparse.Namespace) -> Iterator[list[str]]:
    """Test all files that the options name; within the block none of the inputs can be lost. Yields the inputs, as the
    user named them. An output without an ending is a folder: it is made, and the output is a file in it."""
    given = [
        (each, each.kind, one)
        for each in declared
        if isinstance(each.kind, Kind) and each.kind.part and (value := getattr(options, each.dest, None)) is not None
        for one in (value if isinstance(value, list) else [value])
    ]
    named: dict[Any, str] = {}
    for each, kind, value in given:
        name = str(value).partition(":")[0] if each.dest in ("x", "z") else str(value)  # FILE:VARIABLE
        if kind.part == "read" and (each.dest, identity(value)) in named:
            raise ValueError(f"{value} is named twice; name it once")
        if kind.part == "read" or (kind.part == "named" and Path(name).suffix.lower() in OWN_FILES):
            named[each.dest, identity(name)] = name
    files = [found for name in named.values() for found in _inputs(name)]
    with inputs_kept([*files, *(each for path in files if path.is_dir() for each in path.iterdir())]):
        outputs: dict[Any, str] = {}
        for each, kind, path in given:
            if kind.part in ("read", "named"):
                continue
            if kind.part == "drawn":
                from torchliner.report.figure import require_matplotlib

                require_matplotlib()
            if kind.part == "folder" or not path.suffix:
                writable_folder(path)
            if kind.part == "written" and not path.suffix:
                path.mkdir(parents=True, exist_ok=True)
                path /= f"{command.split()[0] if each.dest == 'output' else each.dest}{kind.endings[0]}"
                setattr(options, each.dest, path)
            if kind.part != "folder" and path.suffix:
                writable(path)
                require_ending(path, kind.endings)
            if (other := outputs.setdefault(identity(path), each.flag)) != each.flag:
                raise ValueError(f"{each.flag} {path} is another output, that of {other}; name another file")
        yield [*named.values()]


def _inputs(name: str) -> list[Path]:
    """The file or folder of that name, or the files that a pattern stands for; an OSError where there is none."""
    from torchliner.file_checks import require_regular

    found = [name] if os.path.lexists(name) else sorted(glob.glob(name, recursive=True)) or [name]
    for path in map(Path, found):
        try:
            if not path.is_dir():
                require_regular(path)
        except FileNotFoundError as error:
            there = os.listdir(path.parent) if os.access(path.parent, os.R_OK) else []
            raise FileNotFoundError(f"{error}{did_you_mean(path.name, there, 0.7)}") from None
    return [*map(Path, found)]

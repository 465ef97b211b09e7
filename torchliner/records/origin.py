"""Where a result comes from: its input files with sizes and fingerprints, and what computed it.

The fingerprint is the SHA-256 of a file up to 32 MiB. Of a larger one, of a folder and of a series of files it is that
of names, sizes and 32 blocks of 1 MiB: another simulation changes every block, an edit between them goes unseen.
"""

import hashlib
import os
import platform
import re
from collections.abc import Collection, Iterable
from dataclasses import replace
from decimal import Decimal
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch

from torchliner.names import __version__

BLOCK, BLOCKS = 1 << 20, 32
NAMED = re.compile(rb"""\bfile\s*=\s*["']([^"']+)["']|"name"\s*:\s*"([^"]+)\"""")
SERIES = (".pvd", ".series", ".vtp", ".vtu", ".vti", ".vts", ".vtr", ".vtm", ".vtk")
NUMBER = re.compile(r"(.*?)(\d+(?:\.\d+)?(?:[eE][-+]\d{1,3})?)")  # plane_0.0012, plane_1.2e-03
State = tuple[tuple[str, int, int, int], ...]  # of files: name, bytes, time of change, inode
Result = TypeVar("Result", bound=Any)


def numbered_series(folder: Path, endings: Collection[str]) -> dict[str, dict[Path, Decimal]]:
    """Files with a number at the end of their names, by the name before it, in its order. A decimal is one number, as
    where names tell times: t_0.9 and t_1.0 are of one series."""
    files = [each for each in folder.iterdir() if each.suffix in endings]
    rows = [(part[1], Decimal(part[2]), each) for each in files if (part := NUMBER.fullmatch(each.stem))]
    return {name: {each: n for _, n, each in own} for name, own in groupby(sorted(rows), key=itemgetter(0))}


def series_of(path: Path) -> list[Path]:
    """Files that one file of a series stands for, sorted, itself among them: those that a collection names, or those
    of its name with other numbers; none where it stands for itself."""
    if path.suffix.lower() not in SERIES or not path.is_file():
        return []
    if path.suffix.lower() in (".pvd", ".series"):
        found = {path.parent / (a or b).decode() for a, b in NAMED.findall(path.read_bytes())}
    else:
        series = numbered_series(path.parent, (path.suffix,)).values()
        found = {each for files in series if path in files for each in files}
    return sorted({path} | {each for each in found if each.is_file()})


def state_of(path: Path) -> State:
    """What tells whether any of the files that a path stands for is another now."""
    files = [each for each in path.rglob("*") if each.is_file()] if path.is_dir() else series_of(path) or [path]
    status = [(str(each), each.stat()) for each in sorted(files)]
    return tuple((name, each.st_size, each.st_mtime_ns, each.st_ino) for name, each in status)


def input_file(what: str, path: str | Path) -> dict[str, Any]:
    """What is stored of an input, a file, a folder or a file that stands for a series: what it is (velocity, liner
    ...), its name as given, bytes, fingerprint. An OSError where it cannot be read."""
    files = [(name, size) for name, size, *_ in state_of(Path(path))]
    total = sum(size for _, size in files)
    if len(files) == 1 and total <= BLOCKS * BLOCK:
        found = hashlib.sha256(Path(files[0][0]).read_bytes())
    else:
        names = [(os.path.basename(name) if len(files) > 1 else "", size) for name, size in files]
        found = hashlib.sha256(repr(names).encode())
        each = max(2, BLOCKS // max(1, len(files)))  # blocks of a file, first and last among them
        for name, size in files[:: 1 + 2 * len(files) // BLOCKS]:
            with open(name, "rb") as file:
                for place in range(each):
                    file.seek(max(0, size - BLOCK) * place // (each - 1))
                    found.update(file.read(BLOCK))
    return {"what": what, "name": str(path), "bytes": total, "hash": found.hexdigest()}


def origin_of(named: Iterable[tuple[str, str | Path]], **more: Any) -> dict[str, Any]:
    """For the ``choices`` of a result: ``inputs``, ``versions`` and what else is given and not None. ``named``: what an
    input is and its name, FILE or FILE:/dataset; names that are no files are of data in memory."""
    files: dict[tuple[str, str], None] = {}
    for what, name in named:
        text, inside, _ = str(name).partition(":/")
        # A folder holds a record only where something in it is named: "velocity" is a name of others.
        if os.path.isfile(text) or (inside and os.path.isdir(text)):
            files[what, text] = None
    versions = {"torch": torch.__version__, "numpy": np.__version__, "python": platform.python_version()}
    return {
        "inputs": [input_file(what, path) for what, path in files],
        "versions": {"torchliner": __version__, **versions},
        **{key: value for key, value in more.items() if value is not None},
    }


def with_choices(result: Result, **more: Any) -> Result:
    """The same with further facts of where it comes from."""
    return replace(result, choices={**result.choices, **more})

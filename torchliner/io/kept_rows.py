"""What is summed of a record that is not whole yet, so that it is not summed again."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from torch import Tensor

from torchliner.io.whole_file import written_whole
from torchliner.version import __version__


@dataclasses.dataclass(frozen=True)
class KeptRows:
    """Finished shares of one record, a file for each, whole or not there; see ``engine.workers.Kept``.

    Args:
        folder: of this record alone: its samples are not looked at.
    """

    folder: Path

    def load(self, asked: Any) -> list[np.ndarray] | None:
        """What was saved; None if nothing was, or if the file is damaged: it is read again."""
        with (
            suppress(OSError, ValueError, BadZipFile, EOFError),
            np.load(self._path(asked), allow_pickle=False) as file,
        ):
            return [file[name] for name in file.files]
        return None

    def save(self, asked: Any, rows: list[np.ndarray]) -> None:
        """Keep them.

        Raises:
            OSError: the disk is full, the folder is write-protected.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        with written_whole(self._path(asked)) as temporary, temporary.open("wb") as file:
            np.savez(file, *rows)

    def clear(self) -> None:
        """Delete what is not needed any more."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _path(self, asked: Any) -> Path:
        found = hashlib.sha256(__version__.encode())
        _add(found, asked)
        return self.folder / f"{found.hexdigest()[:32]}.npz"


def _add(found: Any, value: Any) -> None:
    """All that a value is made of: dataclasses, lists, tensors, functions with what they hold."""
    if isinstance(value, Tensor):
        found.update(f"{value.dtype} {tuple(value.shape)}".encode())
        found.update(value.detach().cpu().contiguous().numpy().tobytes())
    elif isinstance(value, functools.partial):
        _add(found, (value.func, value.args))
    elif dataclasses.is_dataclass(value):
        _add(found, (type(value).__qualname__, [getattr(value, each.name) for each in dataclasses.fields(value)]))
    elif isinstance(value, list | tuple):
        found.update(f"{len(value)} of ".encode())
        for each in value:
            _add(found, each)
    elif hasattr(value, "__self__"):  # a method, such as the sums of nodes
        _add(found, (value.__self__, value.__name__))
    else:
        found.update(f"{getattr(value, '__qualname__', repr(value))};".encode())

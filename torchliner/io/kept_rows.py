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
from torchliner.names import __version__


@dataclasses.dataclass(frozen=True)
class KeptRows:
    """Finished shares of one record, a file for each, whole or not there; see ``engine.workers.Kept``.

    Args:
        folder: of this record alone: its samples are not looked at.
    """

    folder: Path

    def load(self, asked: Any) -> list[np.ndarray] | None:
        """What was saved; None if nothing was, or if the file is damaged: it is read again."""
        with suppress(OSError, ValueError, BadZipFile, EOFError), np.load(self._path(asked)) as file:
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
        name = hashlib.sha256(repr((__version__, _said(asked))).encode()).hexdigest()
        return self.folder / f"{name[:32]}.npz"


def _said(value: Any) -> Any:
    """All that a value is made of, in plain words: dataclasses, lists, tensors, functions with what they hold."""
    if isinstance(value, Tensor):
        data = value.detach().cpu().contiguous().numpy().tobytes()
        return str(value.dtype), tuple(value.shape), hashlib.sha256(data).hexdigest()
    if isinstance(value, functools.partial):
        return _said((value.func, value.args))
    if dataclasses.is_dataclass(value):
        fields = [_said(getattr(value, each.name)) for each in dataclasses.fields(value)]
        return type(value).__qualname__, fields
    if isinstance(value, list | tuple):
        return [_said(each) for each in value]
    if hasattr(value, "__self__"):  # a method, such as the sums of nodes
        return _said((value.__self__, value.__name__))
    return getattr(value, "__qualname__", repr(value))

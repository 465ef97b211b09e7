"""Finished stations of a line on disk, so that a run that was broken off can go on."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from pathlib import Path

from torchliner.io.own_file import read_line
from torchliner.io.own_writer import write_record
from torchliner.records import ImpedanceLine


class LineParts:
    """A folder of lines of one station each, named by what each follows from.

    Args:
        folder: made when the first part is written.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.mine: list[Path] = []

    @property
    def there(self) -> int:
        """Parts on disk, of this run or another."""
        return len(list(self.folder.glob("*.h5"))) if self.folder.is_dir() else 0

    def load(self, key: str) -> ImpedanceLine | None:
        """The station of a key; None where it is not there, or a file is damaged or not the part that its name says."""
        with contextlib.suppress(ValueError, OSError):
            line = read_line(self._path(key))
            if line.stations == 1 and line.choices.get("part") == key:
                return line
        return None

    def keep(self, key: str, line: ImpedanceLine) -> ImpedanceLine:
        """Write a finished station."""
        self.folder.mkdir(exist_ok=True)
        line = replace(line, choices={**line.choices, "part": key})
        write_record(line, self._path(key))
        return line

    def clear(self) -> None:
        """Delete the parts of this run, and the folder if nothing else is in it."""
        for path in self.mine:
            path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # not empty, not there, a link
            self.folder.rmdir()

    def _path(self, key: str) -> Path:
        path = self.folder / f"{key}.h5"
        self.mine.append(path)
        return path

"""Finished stations of a line on disk, so that a run that was broken off can go on."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from torchliner.io.line_file import read_line, write_line
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

    def holds(self, key: str) -> bool:
        """Whether the station of a key is on disk."""
        return (self.folder / f"{key}.h5").exists()

    def take_up(self, key: str, work: Callable[[], ImpedanceLine]) -> ImpedanceLine:
        """The station of a key from its file, else made and kept.

        Raises:
            ValueError, OSError: a part that cannot be read or holds no single station.
        """
        path = self.folder / f"{key}.h5"
        self.mine.append(path)
        if path.exists():
            try:
                line = read_line(path)
            except (ValueError, OSError) as error:
                raise ValueError(f"a finished station cannot be taken up: {error}; delete it, and "
                                 "it is made anew") from error  # fmt: skip
            if line.stations != 1 or line.choices.get("part") != key:
                raise ValueError(f"{path} is not the part that its name says; delete it, and it is "
                                 "made anew")  # fmt: skip
            return line
        line = work()
        self.folder.mkdir(exist_ok=True)
        line = replace(line, choices={**line.choices, "part": key})
        write_line(line, path)
        return line

    def clear(self) -> None:
        """Delete the parts of this run, and the folder if nothing else is in it."""
        for path in self.mine:
            path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # not empty, not there, a link
            self.folder.rmdir()

"""What a format beside netCDF-4 and CSV needs of a result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torchliner.names import RESULT_WRITERS, resolve


@dataclass(frozen=True)
class ResultWriter:
    """One format beside netCDF-4 and CSV, and what a result needs to be written in it.

    Args:
        write: an ``OwnFile``, a record of it and a path.
        frequencies: at least so many.
        places: x or z of its probes.
    """

    write: Callable[[Any, Any, str | Path], None]
    frequencies: int = 1
    places: bool = False

    def require(self, path: str | Path, frequencies: float, places: bool = True) -> None:
        """Refuse what the format cannot hold.

        Raises:
            ValueError: fewer frequencies than it needs; no places.
        """
        ending = Path(path).suffix
        if frequencies < self.frequencies:
            raise ValueError(
                f"{path}: a {ending} needs {self.frequencies} frequencies at least and the result "
                f"has {frequencies:g}; educe with several, or write .txt"
            )
        if self.places and not places:
            raise ValueError(
                f"{path}: a {ending} needs places and the result has no x or z; state them in the data, or write .csv"
            )


def require_result(path: str | Path, frequencies: float, places: bool = True) -> None:
    """Before the work: refuse a name in whose format the result could not be written.

    Args:
        path: whose ending names the format.
        frequencies, places: of the result, as for ``ResultWriter.require``.
    """
    home = RESULT_WRITERS.get(Path(path).suffix.lower())
    if home is not None:
        resolve(home).require(path, frequencies, places)

"""What a format beside netCDF-4 and CSV needs of a result."""

from __future__ import annotations

from pathlib import Path

FEWEST = {".bdf": 2, ".dat": 2}  # frequencies: a table of one cannot be interpolated
AT_PLACES = (".vtp", ".vtkhdf")


def require_result(path: str | Path, frequencies: float, places: bool = True) -> None:
    """Refuse a name in whose format a result could not be written, also before the work.

    Args:
        path: whose ending names the format.
        frequencies: how many the result has.
        places: whether its probes have x or z.
    Raises:
        ValueError: fewer frequencies than the format needs; no places.
    """
    ending = Path(path).suffix.lower()
    if frequencies < FEWEST.get(ending, 1):
        raise ValueError(
            f"{path}: a {ending} needs {FEWEST[ending]} frequencies at least and the result has {frequencies:g}; educe "
            "with several, or write .txt"
        )
    if ending in AT_PLACES and not places:
        raise ValueError(
            f"{path}: a {ending} needs places and the result has no x or z; state them in the data, or write .csv"
        )

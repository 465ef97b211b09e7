"""Places of holes: tables of text, and variables of moments."""

from __future__ import annotations

from pathlib import Path

from torchliner.file_checks import naming
from torchliner.records.holes import Holes
from torchliner.text_columns import read_lines, read_table

COLUMNS = {"x": "length", "diameter": "length", "z": "length"}
EXAMPLE = "x [mm], z [mm], diameter [mm]; without z for slits, whose diameter is their width"


def read_holes(path: str | Path) -> Holes:
    """Places of the holes of a liner from a table of text.

    Args:
        path: columns x, z and diameter with their units in the header, ``x [mm], z [mm], diameter
            [mm]``, in any order; slits have no z, and their diameter is their width. Lines behind
            '#' are remarks.
    Raises:
        FileNotFoundError, OSError: no such file, a folder.
        ValueError: a column missing, unknown or without a unit, a cell that is no number, a
            diameter that is not positive.
    """
    found = read_table(read_lines(path), COLUMNS, path, example=EXAMPLE, optional=("z",))
    with naming(str(path)):
        return Holes(**{name: tuple(values.tolist()) for name, values in found.items()})

"""Places of holes: variables of planes, moments and maps, and tables of text."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py

from torchliner.file_checks import naming
from torchliner.io.hdf5 import is_there
from torchliner.io.tables import read_variables
from torchliner.records.declared import Part, variables_of
from torchliner.records.holes import Holes
from torchliner.text_columns import read_lines, read_table

TABLE = [row.within(Part("hole_")) for row in variables_of(Holes)]
COLUMNS = {"x": "length", "diameter": "length", "z": "length"}
EXAMPLE = "x [mm], z [mm], diameter [mm]; without z for slits, whose diameter is their width"


def stored_holes(file: h5py.Group, path: Path) -> Holes | None:
    """What is in a file of ours; None where it has none of it.

    Raises:
        ValueError: a variable without the others, of another length or unit; as ``Holes``.
    """
    if not any(is_there(file, name, path) for row in TABLE for name in row.names):
        return None
    found: dict[str, Any] = read_variables(file, TABLE, path)
    with naming(str(path)):
        return Holes(**found)


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

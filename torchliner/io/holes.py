"""Places of holes: variables of planes, moments and maps, and tables of text."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py

from torchliner.file_checks import naming
from torchliner.io.hdf5 import is_there, write_index
from torchliner.io.tables import described, read_variables, real, write_variables
from torchliner.records.holes import Holes
from torchliner.text_columns import read_lines, read_table

HOLE = ("hole",)
TABLE = described((
    real("hole_x", "m", HOLE, field="x"),
    real("hole_diameter", "m", HOLE, field="diameter"),
    real("hole_z", "m", HOLE, field="z", optional=True),
), {"x": "streamwise coordinate of the centre of a hole", "z": "spanwise coordinate, likewise",
    "diameter": "diameter of a hole, or width of a slit along x"})  # fmt: skip
COLUMNS = {"x": "length", "diameter": "length", "z": "length"}
EXAMPLE = "x [mm], z [mm], diameter [mm]; without z for slits, whose diameter is their width"


def write_holes(file: h5py.Group, holes: Holes | None) -> None:
    """The variables, where there are holes."""
    if holes is not None:
        write_index(file, *HOLE, len(holes))
        write_variables(file, holes, TABLE)


def stored_holes(file: h5py.Group, path: Path) -> Holes | None:
    """What ``write_holes`` wrote; None where the file has none of it.

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

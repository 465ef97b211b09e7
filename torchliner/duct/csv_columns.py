"""Tables beside a duct's TOML file: a CSV of numbers below one header line."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np


def read_columns(
    path: Path, count: int, names: str, infinite: Sequence[int] = ()
) -> Sequence[np.ndarray]:
    """Columns of a CSV with one header line.

    Args:
        path: of the file.
        count, names: of the columns, the latter for messages.
        infinite: numbers of the columns that may hold inf.
    Raises:
        ValueError: no such file, no rows, other columns, a cell that is no number.
    """
    if not path.exists():
        raise ValueError(f"{path}: no such file; a CSV of {names} is needed")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of no rows, which is said below
            table = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    except ValueError as error:
        raise ValueError(f"{path} is no CSV of numbers below one header line: {error}") from error
    if table.size == 0:
        raise ValueError(f"{path} holds no rows below its header line; {names} are needed")
    if table.shape[1] != count:
        raise ValueError(f"{path} has {table.shape[1]} columns; {names} are needed")
    for number, column in enumerate(table.T):
        bad = np.isnan(column) if number in infinite else ~np.isfinite(column)
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            raise ValueError(
                f"{path}: row {row + 1} holds {column[row]} in column {number + 1} of {names}; a "
                "number is needed there"
            )
    return list(table.T)

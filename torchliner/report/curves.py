"""Numbers behind a figure: quantities over one variable."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchliner.report.table import Column, Table

Array = NDArray[np.float64]
COMPLEX_PART = {"resistance": "real", "reactance": "imag"}


def part_of(value: Any, part: str) -> Any:
    """'resistance' or 'reactance' of a complex number, or of a tensor as an array."""
    number = getattr(value, COMPLEX_PART[part])
    return number.detach().cpu().numpy() if hasattr(number, "detach") else number


@dataclass(frozen=True)
class Curves:
    """Quantities over one variable.

    Args:
        at: the variable, increasing, (N,).  values: columns by name, each (N,).
        label: for legends.  variable: its name and unit.
    """

    at: Array
    values: dict[str, Array]
    label: str
    variable: str = "x (m)"

    def write_csv(self, path: str | Path) -> None:
        """The variable and the values, by columns, nine digits."""
        names = (self.variable, *self.values)
        rows = [
            dict(zip(names, row, strict=True))
            for row in zip(self.at, *self.values.values(), strict=True)
        ]
        Table(rows, [Column(name) for name in names], ".9g").write_csv(path)

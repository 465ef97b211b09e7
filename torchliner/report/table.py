"""Tables."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchliner.io.whole_file import written_whole

Array = NDArray[np.float64]


COMPLEX_PART = {"resistance": "real", "reactance": "imag"}


def write_rows(rows: Sequence[Mapping[str, Any]], path: str | Path) -> None:
    """CSV of rows that share their columns; columns are named by the first."""
    with written_whole(path) as temporary, temporary.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


@dataclass(frozen=True)
class Table:
    """Quantities over one variable.

    Args:
        at: the variable, increasing, (N,).
        values: columns by name, each (N,).
        label: for legends.
        variable: its name and unit.
    """

    at: Array
    values: dict[str, Array]
    label: str
    variable: str = "x (m)"

    def write_csv(self, path: str | Path) -> None:
        """The variable and the values, by columns."""
        with written_whole(path) as temporary, temporary.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow([self.variable, *self.values])
            for row in zip(self.at, *self.values.values(), strict=True):
                writer.writerow([f"{number:.9g}" for number in row])


def format_complex(value: complex) -> str:
    """'0.168-0.066j'; no zero has a minus."""
    real, imaginary = (round(part, 3) + 0.0 for part in (value.real, value.imag))
    return f"{real:.3f}{imaginary:+.3f}j"

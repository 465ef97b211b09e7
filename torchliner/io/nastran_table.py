"""Impedance over frequency as NASTRAN bulk data: two TABLED1 in large fields."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.io.own_file import OwnFile
from torchliner.io.result_writers import ResultWriter
from torchliner.io.solver_table import about, over_frequency
from torchliner.io.whole_file import written_whole

NUMBERS = {"resistance": 1, "reactance": 2}  # of the tables
LONGEST = 70  # characters of a comment: a line has 72 to 80


def write_nastran(_: OwnFile, record: Any, path: str | Path) -> None:
    """TABLED1 1 is R(f), 2 is X(f) of the whole liner, in units of rho c.

    Raises:
        ValueError: a single frequency, of which no table can be interpolated; as
            ``over_frequency``.
    """
    table = over_frequency(record, path)
    WRITER.require(path, len(table))
    lines = [f"$ {part}" for line in about(record) for part in textwrap.wrap(line, LONGEST)]
    for column, (part, number) in enumerate(NUMBERS.items(), 1):
        lines += [f"$ {part} over frequency in Hz", *_table(number, table[:, (0, column)])]
    with written_whole(path, ".bdf", ".dat") as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="ascii", errors="replace")


def _table(number: int, pairs: np.ndarray) -> Iterator[str]:
    """One TABLED1: its number and axes, then pairs, two a line, to ENDT."""
    yield f"{'TABLED1*':8}{number:16d}{'LINEAR':>16}{'LINEAR':>16}"
    yield "*"
    fields = [f"{value:16.9E}" for value in pairs.reshape(-1)] + [f"{'ENDT':>16}"]
    for begin in range(0, len(fields), 4):
        yield f"{'*':8}{''.join(fields[begin : begin + 4])}"


WRITER = ResultWriter(write_nastran, frequencies=2)

"""Bursts in columns without a header: their order and units are stated, nothing is guessed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from torchliner.checks import require_choice
from torchliner.io.burst_text import named_columns, read_columns, record_of
from torchliner.records import BurstRecord
from torchliner.text_columns import read_lines

SEPARATORS = {"blank": None, "tab": "\t", "comma": ",", "semicolon": ";"}


def read_burst_columns(
    path: str | Path, columns: str | Sequence[str], separator: str = "blank", **about: Any
) -> BurstRecord:
    """Bursts of one station from columns of numbers.

    Args:
        path: text, UTF-8 or latin-1, decimal point or comma; no header.
        columns: names with units in the order of the file, as a list or separated by commas:
            "row, arrival_time [ms], transit_time [us], streamwise [m/s], wall_normal [m/s]".
            ``row`` and ``skip`` are passed over; a minus turns a velocity round.
        separator: ``blank`` (any white space), ``tab``, ``comma`` or ``semicolon``.
        about: further fields of the record: x, y, z (m), frequency, fluid, ...
    Raises:
        FileNotFoundError, OSError: no such file, a folder.
        ValueError: empty, a header or another number of columns than stated, a wrong unit, an
            unreadable or missing cell, mixed decimal marks.
    """
    labels = columns.split(",") if isinstance(columns, str) else list(columns)
    wanted = named_columns(labels, path)
    between = SEPARATORS[require_choice("separator", separator, SEPARATORS)]
    lines = read_lines(path)
    count = len(lines[0].split(between))
    if count != len(labels):
        raise ValueError(
            f"{path}: line 1 has {count} cells, {len(labels)} columns are stated: "
            f"{', '.join(label.strip() for label in labels)}; name every column, 'skip' included"
        )
    found = read_columns(lines, 1, wanted, path, between)
    provenance = {"format": "columns", "columns": [label.strip() for label in labels]}
    return record_of(found, path, provenance=provenance, **about)

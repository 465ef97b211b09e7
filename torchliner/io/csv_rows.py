"""Results as rows of CSV: one a place and frequency, from columns that broadcast."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

import torch

from torchliner.io.whole_file import printable, written_whole

Rows = list[dict[str, Any]]


def rows_of(columns: Mapping[str, Any], shape: Sequence[int]) -> Rows:
    """One row for each element of ``shape``, the last axis fastest.

    Args:
        columns: by heading, tensors or lists that broadcast to ``shape``; texts and None stand in
            every row.
        shape: of the table, as (places, frequencies).
    """
    flat = []
    for values in columns.values():
        if values is None or isinstance(values, str):
            flat.append([values] * (shape[0] * shape[1]))
        else:
            there = torch.as_tensor(values).detach().cpu()
            flat.append(there.broadcast_to(*shape).reshape(-1).tolist())
    return [dict(zip(columns, row, strict=True)) for row in zip(*flat, strict=True)]


def write_rows(rows: Sequence[Mapping[str, Any]], path: str | Path, number: str = "", end: str = "\r\n") -> None:
    """A CSV file with the headings of all rows, whole or not at all.

    Args:
        rows: at least one.
        path: file.
        number: format of numbers, as ".9g"; default: as many digits as they have.
        end: of lines.
    """
    with written_whole(path, ".csv") as temporary, temporary.open("w", newline="") as file:
        fill_csv(file, rows, number, end)


def fill_csv(file: TextIO, rows: Sequence[Mapping[str, Any]], number: str = "", end: str = "\r\n") -> None:
    """Into what is open, in memory too; arguments as for ``write_rows``."""
    writer = csv.writer(file, lineterminator=end)
    headings = dict.fromkeys(key for row in rows for key in row)
    writer.writerow(map(text_cell, headings))
    for row in rows:
        writer.writerow(_cell(row.get(key), number) for key in headings)


def _cell(value: Any, number: str) -> Any:
    if isinstance(value, str):
        return text_cell(value)
    return value if value is None or not number else format(float(value), number)


def text_cell(text: str) -> str:
    """A text that a spreadsheet takes as text: a formula gets a quote before it."""
    text = printable(text)
    if not text.startswith(("=", "+", "-", "@", "\t")):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text

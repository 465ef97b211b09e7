"""Impedance over frequency as columns of text, which COMSOL's interpolation and others read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from torchliner.io.own_file import OwnFile
from torchliner.io.result_writers import ResultWriter
from torchliner.io.whole_file import printable, written_whole


def write_solver_table(_: OwnFile, record: Any, path: str | Path) -> None:
    """f, R, X of the whole liner, a line each, after comments that begin with ``%``.

    Raises:
        ValueError: as ``over_frequency``.
    """
    heading = [*about(record), "frequency (Hz), resistance (rho c), reactance (rho c)"]
    with written_whole(path, ".txt") as temporary:
        np.savetxt(temporary, over_frequency(record, path), fmt="%.10g", comments="% ",
                   header="\n".join(heading), encoding="utf-8")  # fmt: skip


def over_frequency(record: Any, path: str | Path) -> np.ndarray:
    """f, R and X of a result's ``answer`` in the order of f, (F, 3).

    Raises:
        ValueError: Z is not finite somewhere: a solver would interpolate over it.
    """
    value = record.answer.detach().cpu().numpy()
    table = np.stack([record.frequency.numpy(), value.real, value.imag], 1)
    bad = ~np.isfinite(table).all(1)
    if bad.any():
        raise ValueError(
            f"{path}: Z of the whole liner is not finite at {table[bad, 0].tolist()} Hz; educe "
            "without these frequencies"
        )
    return table[table[:, 0].argsort()]


def about(record: Any) -> list[str]:
    """What the numbers are, a line each."""
    title = printable(getattr(record, "title", "") or getattr(record, "name", ""))
    return [
        *([" ".join(title.split())] if title else []),
        "Z = R + jX of the whole liner, normalised by rho c, exp(+j omega t), v into the liner",
    ]


WRITER = ResultWriter(write_solver_table)

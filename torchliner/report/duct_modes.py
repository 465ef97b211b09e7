"""Modes of a lined duct: table, CSV and picture."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from torch import Tensor

from torchliner.duct.modes import DuctModes
from torchliner.duct.presets import DuctSetup
from torchliner.report.figure import (
    COLOURS,
    ONE_ROW,
    Figure,
    finish,
    head_panel,
    label_axes,
    styled,
    subplots,
)
from torchliner.report.table import Column, Table, real_and_imaginary

NEPER = 20 * math.log10(math.e)  # dB
ROUNDING = 1e-12


def mode_table(setup: DuctSetup, modes: dict[str, DuctModes], growing: Tensor) -> Table:
    """One row per frequency, direction and mode; decay in dB over the liner's length too, below 0
    of a wave that grows in its direction.

    The growing wave (1/m, (F,), nan for none) has no number.
    """
    length = setup.case.liner[0][1] - setup.case.liner[0][0] if setup.case.liner else math.nan
    rows = [
        (frequency, direction, n, complex(solved.wavenumber[f, n]),
         _decay(complex(solved.wavenumber[f, n]), direction))
        for direction, solved in modes.items()
        for f, frequency in enumerate(setup.frequency.tolist())
        for n in range(solved.wavenumber.shape[-1])
    ] + [
        (frequency, "downstream", None, complex(alpha), _decay(complex(alpha), "downstream"))
        for frequency, alpha in zip(setup.frequency.tolist(), growing, strict=True)
        if alpha == alpha
    ]  # fmt: skip
    return Table(rows, (
        Column("frequency (Hz)", lambda row: row[0], "f Hz", ".1f"),
        Column("direction", lambda row: row[1], "direction"),
        Column("mode", lambda row: row[2], "n", "d"),
        *real_and_imaginary("alpha real (1/m)", "alpha imaginary (1/m)", lambda row: row[3]),
        Column("", lambda row: row[3], "alpha 1/m", lambda z: f"{z.real:.5f}{z.imag:+.5f}j"),
        Column("decay (dB/m)", lambda row: NEPER * row[4], "dB/m", ".2f"),
        Column("decay over the liner (dB)", lambda row: NEPER * row[4] * length, "dB liner", ".2f"),
    ))  # fmt: skip


def _decay(alpha: complex, direction: str) -> float:
    """Neper/m along the wave's direction; rounding is 0."""
    if abs(alpha.imag) < ROUNDING * abs(alpha):
        return 0.0
    return -alpha.imag if direction == "downstream" else alpha.imag


def format_modes(setup: DuctSetup, table: Table) -> str:
    """What was solved, then one row per mode."""
    patches = len(setup.case.liner)
    which = f"above the first of {patches} lined patches; " if patches > 1 else ""
    grows = [row[0] for row in table.rows if row[2] is None]
    wave = (
        f"a hydrodynamic wave without a number grows downstream at {grows[0]:g} Hz"
        + f" and {len(grows) - 1} other frequencies" * (len(grows) > 1)
        if grows else "no growing wave was found"
    )  # fmt: skip
    return (f"{setup.name}: {which}waves e^(-j alpha x), mode n grew out of the rigid duct's "
            f"mode n as the wall's reflection went straight from 1; {wave}\n"
            f"{table.as_text()}")  # fmt: skip


@styled
def draw_modes(modes: dict[str, DuctModes], path: str | Path | None = None, frequency_index: int = 0) -> Figure:
    """|p| of each mode over the height."""
    figure, axes = subplots(1, 2, 3.4)
    for axis, (direction, solved) in zip(axes[0], modes.items(), strict=True):
        heights = np.linspace(0, float(solved.height[0]), 200)
        count = solved.wavenumber.shape[-1]
        pressure, _, _ = solved.at(heights)
        for n in range(count):
            shape = pressure[frequency_index, n].abs().numpy()
            axis.plot(shape / shape.max(), 1e3 * heights, color=COLOURS[n],
                      label=f"mode {n}")  # fmt: skip
        label_axes(axis, "$|p|$ over its maximum", "$y$ (mm), liner at 0")
        head_panel(axis, direction)
    return finish(figure, path, legend=ONE_ROW)

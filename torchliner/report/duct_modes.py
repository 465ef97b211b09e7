"""Modes of a lined duct: table, CSV and picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchliner.duct.modes import DuctModes, duct_modes
from torchliner.duct.presets import DuctSetup
from torchliner.duct.relation import DIRECTIONS
from torchliner.report.figure import COLOURS, Figure, finish, styled, subplots


def modes_of(setup: DuctSetup, count: int) -> dict[str, DuctModes]:
    """In each direction, above the first lined patch, as if it had no ends.

    Raises:
        ValueError: the impedance is a profile along x.
    """
    if callable(setup.impedance):
        raise ValueError(
            f"{setup.name} has an impedance that varies along x; modes need one: state impedance"
        )
    wall: Any = setup.impedance[0] if len(setup.impedance) else torch.inf
    return {
        direction: duct_modes(
            setup.case.profile, setup.frequency, wall, count=count, direction=direction,
            slip_condition=setup.case.slip_condition,
        )
        for direction in DIRECTIONS
    }  # fmt: skip


def mode_rows(setup: DuctSetup, modes: dict[str, DuctModes]) -> list[dict[str, Any]]:
    """A row a frequency, direction and mode; decay in dB over the liner's length too."""
    length = setup.case.liner[0][1] - setup.case.liner[0][0] if setup.case.liner else math.nan
    rows = []
    for direction, solved in modes.items():
        found = solved.wavenumber
        for f, frequency in enumerate(setup.frequency.tolist()):
            for n in range(found.shape[-1]):
                alpha = complex(found[f, n])
                rows.append({
                    "frequency (Hz)": frequency, "direction": direction, "mode": n,
                    "alpha real (1/m)": alpha.real, "alpha imaginary (1/m)": alpha.imag,
                    "decay (dB/m)": 20 * math.log10(math.e) * abs(alpha.imag),
                    "decay over the liner (dB)": 20 * math.log10(math.e) * abs(alpha.imag) * length,
                })  # fmt: skip
    return rows


def format_modes(setup: DuctSetup, rows: Sequence[dict[str, Any]]) -> str:
    """A line a mode."""
    patches = len(setup.case.liner)
    which = f"above the first of {patches} lined patches; " if patches > 1 else ""
    lines = [f"{setup.name}: {which}waves e^(-j alpha x), mode n grew out of the rigid duct's "
             "mode n",
             f"{'f Hz':>8s} {'direction':>10s} {'n':>3s} {'alpha 1/m':>22s} {'dB/m':>9s} "
             f"{'dB liner':>9s}"]  # fmt: skip
    for row in rows:
        alpha = f"{row['alpha real (1/m)']:.5f}{row['alpha imaginary (1/m)']:+.5f}j"
        lines.append(
            f"{row['frequency (Hz)']:8.1f} {row['direction']:>10s} {row['mode']:3d} {alpha:>22s} "
            f"{row['decay (dB/m)']:9.2f} {row['decay over the liner (dB)']:9.2f}"
        )
    return "\n".join(lines)


@styled
def draw_modes(
    modes: dict[str, DuctModes], path: str | Path | None = None, frequency_index: int = 0
) -> Figure:
    """|p| of each mode over the height."""
    figure, axes = subplots(1, 2, 3.4)
    for axis, (direction, solved) in zip(axes[0], modes.items(), strict=True):
        heights = np.linspace(0, float(solved.height[0]), 200)
        count = solved.wavenumber.shape[-1]
        pressure, _, _ = solved.at(heights)
        for n in range(count):
            shape = pressure[frequency_index, n].abs().numpy()
            axis.plot(shape / shape.max(), 1e3 * heights, color=COLOURS[n % len(COLOURS)],
                      label=f"mode {n}")  # fmt: skip
        axis.set_xlabel("$|p|$ over its maximum")
        axis.set_ylabel("$y$ (mm), liner at 0")
        axis.set_title(f"({'ab'[DIRECTIONS.index(direction)]}) {direction}", loc="left")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=count)
    return finish(figure, path)

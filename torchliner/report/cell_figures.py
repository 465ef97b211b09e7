"""Cell averages of maps at several heights, as markers along x."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from torchliner.records import ImpedanceMap
from torchliner.report.figure import COLOURS, MARKERS, entry
from torchliner.report.numbers import part_of

FACES = {"admittance": "grey", "velocity": "white", "phase-locked": "yellow"}
CROWD = 2  # heights, above which the other averagings' markers of a cell become a band
ASIDE = 0.012  # of the axis, between the markers of neighbouring heights


def draw_cells(axis: Any, ordered: Sequence[ImpedanceMap], part: str, frequency_index: int) -> list[Any]:
    """All averagings about the cells' centres, that of the answer filled, heights side by
    side; the others of many heights as a band with their median. Returns the values, none where
    no cell has a place."""
    if not any(np.isfinite(one.cell_x.numpy()).any() for one in ordered):
        return []
    left, right = axis.get_xlim()
    shown = []
    for averaging in sorted(ordered[0].averagings, key=lambda each: each == ordered[0].averaging):
        mine = averaging == ordered[0].averaging
        values = [part_of(one.cells[averaging].impedance[:, frequency_index], part) for one in ordered]
        shown += values
        crowd = not mine and len(ordered) > CROWD and len({len(each) for each in values}) == 1
        if crowd:
            shares = torch.tensor([0, 0.5, 1], dtype=torch.float64)
            every = torch.from_numpy(np.stack(values)).double()
            low, middle, high = torch.nanquantile(every, shares, 0).numpy()  # of known heights
            place = len(ordered) / 2 + 1 + 2 * list(FACES).index(averaging)
            x = 1e3 * ordered[0].cell_x.numpy() + (right - left) * ASIDE * place
            face = FACES[averaging]
            axis.vlines(x, low, high, color="k", linewidth=4.6, zorder=2)
            axis.vlines(x, low, high, color=face, linewidth=3.4, zorder=2.1)
            axis.plot(x, middle, "_", color="k", markersize=6, markeredgewidth=1, zorder=2.2)
            entry(axis, f"cells, {averaging}: range, median", "s", markerfacecolor=face)
            continue
        for i, result in enumerate(ordered):
            aside = (right - left) * ASIDE * (i - (len(ordered) - 1) / 2)
            _draw_cell_markers(axis, result, averaging, part, frequency_index, aside, i)
        face = "k" if mine else FACES[averaging]
        entry(axis, f"cells, {averaging}", "o", markerfacecolor=face)
    return shown


def _draw_cell_markers(
    axis: Any, result: ImpedanceMap, averaging: str, part: str, frequency_index: int, aside: float, i: int
) -> None:
    """Of one height, with its intervals."""
    colour, cells = COLOURS[i], result.cells[averaging]
    x = 1e3 * result.cell_x.numpy() + aside
    if cells.interval is not None:
        ends = (part_of(end[:, frequency_index], part) for end in (cells.interval.low, cells.interval.high))
        axis.vlines(x, *ends, color=colour, linewidth=1.2, zorder=2)
    mine = averaging == result.averaging
    axis.plot(
        x,
        part_of(cells.impedance[:, frequency_index], part),
        MARKERS[i],
        color=colour,
        markerfacecolor=colour if mine else FACES[averaging],
        markeredgecolor="k" if mine else colour,
        markeredgewidth=0.6,
        zorder=3 + mine,
        linestyle="none",
    )

"""Cell averages of maps at several heights, as markers along x."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from torchliner.names import ORDERS
from torchliner.records import ImpedanceMap
from torchliner.records.impedance_map import ENDS
from torchliner.report.figure import COLOURS, MARKERS, entry
from torchliner.report.numbers import part_of

FACES = {ORDERS[0]: "grey", ORDERS[1]: "white", ORDERS[2]: "yellow"}
CROWD = 2  # heights, above which the other orders' markers of a cell become a band
ASIDE = 0.012  # of the axis, between the markers of neighbouring heights


def draw_cells(axis: Any, ordered: Sequence[ImpedanceMap], part: str, frequency_index: int) -> list[Any]:
    """All orders of averaging about the cells' centres, that of the answer filled, heights side by
    side; the others of many heights as a band with their median. Returns the values, none where
    no cell has a place."""
    if not any(np.isfinite(one.cell_x.numpy()).any() for one in ordered):
        return []
    left, right = axis.get_xlim()
    shown = []
    for order in sorted(ordered[0].orders, key=lambda each: each == ordered[0].order):
        mine = order == ordered[0].order
        values = [part_of(one.of_cells(order)[:, frequency_index], part) for one in ordered]
        shown += values
        crowd = not mine and len(ordered) > CROWD and len({len(each) for each in values}) == 1
        if crowd:
            shares = torch.tensor([0, 0.5, 1], dtype=torch.float64)
            every = torch.from_numpy(np.stack(values)).double()
            low, middle, high = torch.nanquantile(every, shares, 0).numpy()  # of known heights
            place = len(ordered) / 2 + 1 + 2 * ORDERS.index(order)
            x = 1e3 * ordered[0].cell_x.numpy() + (right - left) * ASIDE * place
            face = FACES[order]
            axis.vlines(x, low, high, color="k", linewidth=4.6, zorder=2)
            axis.vlines(x, low, high, color=face, linewidth=3.4, zorder=2.1)
            axis.plot(x, middle, "_", color="k", markersize=6, markeredgewidth=1, zorder=2.2)
            entry(axis, f"cells, {order}: range, median", "s", markerfacecolor=face)  # fmt: skip
            continue
        for i, result in enumerate(ordered):
            aside = (right - left) * ASIDE * (i - (len(ordered) - 1) / 2)
            _draw_cell_markers(axis, result, order, part, frequency_index, aside, i)
        face = "k" if mine else FACES[order]
        entry(axis, f"cells, {order}", "o", markerfacecolor=face)
    return shown


def _draw_cell_markers(
    axis: Any, result: ImpedanceMap, order: str, part: str, frequency_index: int, aside: float,
    i: int,
) -> None:  # fmt: skip
    """Of one height, with its intervals."""
    colour, found = COLOURS[i], result.uncertainty
    x = 1e3 * result.cell_x.numpy() + aside
    interval = None if found is None else getattr(found, f"cells{ENDS[order]}")
    if interval is not None:
        ends = (part_of(end[:, frequency_index], part) for end in (interval.low, interval.high))
        axis.vlines(x, *ends, color=colour, linewidth=1.2, zorder=2)
    mine = order == result.order
    axis.plot(
        x, part_of(result.of_cells(order)[:, frequency_index], part), MARKERS[i],
        color=colour, markerfacecolor=colour if mine else FACES[order],
        markeredgecolor="k" if mine else colour, markeredgewidth=0.6, zorder=3 + mine,
        linestyle="none",
    )  # fmt: skip

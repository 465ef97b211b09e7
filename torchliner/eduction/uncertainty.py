r"""How far a map may be off because its record is finite: moving blocks over time.

The educed R is a weighted mean over time, so the block means of one pass (``replay.block_lines``)
hold all that a bootstrap needs. What is resampled is the first-order deviation of R; R is turned
into Z draw by draw. Averages over probes are resampled with the same blocks of time for all
probes, so that eddies which pass several of them are not counted several times.

What an interval does not cover: how Z differs from place to place (the spread), what the model, the
phase rule and the other choices do (``torchliner audit``), and a record that is not stationary.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchliner.conversions import (
    admittance_from_reflection,
    impedance_from_admittance,
    impedance_from_reflection,
)
from torchliner.eduction.block_deviations import BlockDeviations
from torchliner.eduction.prepare import Prepared
from torchliner.eduction.resampling import COLUMNS, Resampling
from torchliner.eduction.walls import find_walls
from torchliner.records import Interval, Uncertainty

FEWEST_RUNS = 8  # below, an interval says little
SMALLEST_WIDTH = 1e-9  # a frozen |v| leaves rounding


def uncertainty_of(ready: Prepared, reflection: Tensor, moved: BlockDeviations) -> Uncertainty:
    """Intervals of probes, rows, cells and the whole liner.

    Args:
        ready: prepared plane, with blocks.
        reflection: R of probes and cell averages, complex128, (P + C, F).
        moved: its deviation in each block.
    """
    chosen, plane, cells = ready.chosen, ready.plane, ready.cells
    assert ready.blocks is not None and chosen.interval is not None  # noqa: PT018
    weights = ready.blocks.sums(ready.record.weights(0, plane.samples))
    how = Resampling(weights / weights.sum(), chosen.interval, chosen.draws, chosen.seed)
    wall, _ = find_walls(ready)
    silent = ~ready.used.to(reflection.device)[:, None].expand(-1, reflection.shape[1])
    silent = silent if wall is None else silent | wall
    groups = _groups(ready, reflection, silent)
    parts = []
    step = max(1, COLUMNS // reflection.shape[1])
    for low in range(0, plane.probes, step):
        part = slice(low, min(low + step, plane.probes))
        series = moved.of(part)
        parts.append(how.over_time(series, reflection[part], impedance_from_reflection))
        slope = torch.where(silent[part], 0, admittance_slope(reflection[part]) * series)
        for group in groups.values():
            group.add(part, slope)
    series = moved.of(slice(plane.probes, plane.probes + cells.count))
    averaged = reflection[plane.probes :]
    first = admittance_from_reflection(averaged).mean(0)
    return Uncertainty(
        probes=_join(parts),
        along_x=groups["x"].interval(how) if "x" in groups else None,
        cells=groups["cells"].interval(how),
        cells_velocity_first=how.over_time(series, averaged, impedance_from_reflection),
        liner=_of_liner(groups, how, chosen.resample),
        liner_velocity_first=how.over_time(
            (admittance_slope(averaged) * series).mean(1), first, impedance_from_admittance
        ),
        settings={
            "level": how.level, "draws": how.draws, "seed": how.seed, "resample": chosen.resample,
            "blocks": ready.blocks.count, "periods_per_block": ready.blocks.periods,
        },
    )  # fmt: skip


def review_uncertainty(ready: Prepared, found: Uncertainty) -> list[str]:
    """Doubts: fewer than eight runs behind the whole liner, nothing to resample along z."""
    return _few_runs(ready, found) + _one_row(ready)


def _few_runs(ready: Prepared, found: Uncertainty) -> list[str]:
    runs = float(found.liner.runs.min())
    moves = float((found.liner.high - found.liner.low).abs().max()) > SMALLEST_WIDTH
    if runs >= FEWEST_RUNS or not moves:
        return []
    periods = found.settings["blocks"] * found.settings["periods_per_block"]
    return [
        f"{ready.plane.name}: the error bars rest on {runs:.2g} independent blocks, fewer than "
        f"{FEWEST_RUNS}; they are rough, and {math.ceil(FEWEST_RUNS / runs * periods)} periods "
        f"instead of {periods} would give {FEWEST_RUNS}"
    ]


def _one_row(ready: Prepared) -> list[str]:
    rule = ready.chosen.resample
    if rule == "time" or int(_rows(ready).max()) > 0:
        return []
    kind = "cell" if rule == "time-cells" else "row along z"
    return [
        f"{ready.plane.name}: resample {rule!r} finds one {kind}; the intervals are over time alone"
    ]


def admittance_slope(reflection: Tensor) -> Tensor:
    """dY/dR of Y = (1 - R)/(1 + R)."""
    return -2 / (1 + reflection) ** 2


def _join(parts: list[Interval]) -> Interval:
    names = vars(parts[0])
    return Interval(*(torch.cat([getattr(part, name) for part in parts]) for name in names))


class _Group:
    """Probes sorted into G groups: their mean admittance, and how it deviates block by block."""

    def __init__(
        self, labels: Tensor, count: int, used: Tensor, admittance: Tensor, blocks: int
    ) -> None:
        """``labels`` 0 to G - 1 or -1 for none, (P,); ``admittance`` (P, F)."""
        device = admittance.device
        self.count = count
        # One group more takes what belongs to none.
        self.labels = torch.where(used & (labels >= 0), labels, count).to(device)
        self.sizes = torch.bincount(self.labels, minlength=count + 1)[:count, None].clamp(min=1)
        shape = (count + 1, admittance.shape[1])
        total = torch.zeros(shape, dtype=torch.complex128, device=device)
        self.mean = total.index_add_(0, self.labels, admittance)[:count] / self.sizes
        self.sums = torch.zeros((blocks, *shape), dtype=torch.complex128, device=device)

    def add(self, part: slice, deviation: Tensor) -> None:
        """Some of the probes: deviation of the admittance, (S, p, F)."""
        self.sums.index_add_(1, self.labels[part], deviation)

    @property
    def series(self) -> Tensor:
        """Deviation of each group's mean, (S, G, F)."""
        return self.sums[:, : self.count] / self.sizes

    def interval(self, how: Resampling) -> Interval:
        """Of each group, (G, F)."""
        return how.over_time(self.series, self.mean, impedance_from_admittance)


def _groups(ready: Prepared, reflection: Tensor, silent: Tensor) -> dict[str, _Group]:
    """``silent``: probes that add nothing to a mean admittance, left out or wall, (P, F)."""
    plane, cells = ready.plane, ready.cells
    assert ready.blocks is not None
    blocks = ready.blocks.count
    used = ready.used
    admittance = torch.where(silent, 0, admittance_from_reflection(reflection[: plane.probes]))
    counts = {"liner": 1, "cells": cells.count}
    labels = {
        "liner": torch.zeros(plane.probes, dtype=torch.int64),
        "cells": cells.labels,
    }
    if len(plane.probe_shape) == 2:
        counts["x"] = plane.probe_shape[1]
        labels["x"] = torch.arange(plane.probes) % counts["x"]
    if ready.chosen.resample != "time":
        labels["rows"] = _rows(ready)
    return {
        name: _Group(values, counts.get(name, int(values.max()) + 1), used, admittance, blocks)
        for name, values in labels.items()
    }


def _rows(ready: Prepared) -> Tensor:
    """Groups of probes that are alike: cells, or rows of cells along z, or rows of probes."""
    cells, plane = ready.cells, ready.plane
    if ready.chosen.resample == "time-cells":
        return cells.labels
    centres = cells.z[torch.isfinite(cells.z)].unique()
    if len(centres) > 1:
        row = torch.searchsorted(centres, cells.z)
        return torch.where(cells.labels >= 0, row[cells.labels.clamp(min=0)], -1)
    if len(plane.probe_shape) == 2:
        return torch.arange(plane.probes) // plane.probe_shape[1]
    return torch.zeros(plane.probes, dtype=torch.int64)


def _of_liner(groups: dict[str, _Group], how: Resampling, resample: str) -> Interval:
    """(F,): blocks of time, or tiles of time and of rows or cells."""
    liner = groups["liner"]
    rows = groups.get("rows", liner)
    if rows.count < 2:
        return how.over_time(liner.series[:, 0], liner.mean[0], impedance_from_admittance)
    return how.over_tiles(
        rows.series, liner.mean[0], impedance_from_admittance, independent=resample == "time-cells"
    )

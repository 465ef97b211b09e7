r"""How far a map may be off because its record is finite: moving blocks over time.

The educed R is a weighted mean over time, so the block means of one pass (``replay.block_lines``)
hold all that a bootstrap needs. What is resampled is the first-order deviation of R, whose scatter
bounds Z (``signals.resampling``). Averages over probes are resampled with the same blocks of time
for all probes, so that eddies which pass several of them are not counted several times.

What an interval does not cover: how Z differs from place to place (the spread), what the model, the
phase rule and the other choices do (``torchliner audit``), and a record that is not stationary.

A mean of many probes' admittances is also biased (``groups``): Y is not linear in R, and each
probe's R scatters over a short record, by an amount that does not fall with the number of probes.
The bounds are without that bias.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import torch
from torch import Tensor

from torchliner.compiled.threads import in_order
from torchliner.conversions import admittance_from_reflection, reflection_from_admittance
from torchliner.names import ORDERS
from torchliner.records import Interval, Uncertainty
from torchliner.signals.bootstrap import common_run_length
from torchliner.signals.resampling import Resampling
from torchliner.tdibc.groups import Groups, Members
from torchliner.tdibc.prepared import Prepared
from torchliner.tdibc.reduced import window_of

Series = dict[str, tuple[Tensor, Tensor]]  # by order: of R of liner (S, F) and cells (S, C, F)
FEWEST_RUNS = 8  # below, an interval says little
LONGEST_WINDOW = 0.25  # of a running rms, in records: 40 periods with 10 are covered by 96 %,
# with 20 by 87 %, with 80 by none
SMALLEST_WIDTH = 1e-9  # a frozen |v| leaves rounding
ELEMENTS = 1 << 18  # deviations of blocks, probes and frequencies that are worked on at once


def uncertainty_of(
    prepared: Prepared,
    reflection: Tensor,
    deviations: Callable[[slice], Tensor],
    wall: Tensor | None,
) -> tuple[Uncertainty, Series]:
    """Intervals of probes, rows, cells and the whole liner; the deviations behind the averages.

    Args:
        prepared: prepared plane, with blocks.
        reflection: R of all columns, complex128, (N, F).
        deviations: those of some of its columns in each block, (S, columns, F).
        wall: probes that count as wall, (P, F), of ``find_walls``.
    """
    chosen, plane, cells = prepared.chosen, prepared.plane, prepared.cells
    assert prepared.blocks is not None
    how = resampling_of(prepared)
    # What adds nothing to a mean admittance: probes left out, or wall.
    excluded = ~prepared.used.to(reflection.device)[:, None].expand(-1, reflection.shape[1])
    excluded = excluded if wall is None else excluded | wall
    admittance = torch.where(excluded, 0, admittance_from_reflection(reflection[: plane.probes]))
    groups = {
        name: Groups(torch.where(prepared.used, labels, -1), count, admittance, prepared.blocks.count)
        for name, (labels, count) in _labels(prepared).items()
    }
    intervals: list[Interval] = []

    def of_probes(part: slice) -> tuple[Members, Interval]:
        series = deviations(part)
        scatter = how.scatter(series)
        member = Members.of(part, reflection[part], series, scatter, excluded[part])
        return member, how.interval(scatter, reflection[part])

    def add(found: tuple[Members, Interval]) -> None:
        _add(groups.values(), found[0])
        intervals.append(found[1])

    in_order(of_probes, _parts(prepared), add)
    averaged = reflection[prepared.averaged]
    series = deviations(prepared.averaged)
    first = Groups(
        torch.zeros(cells.count, dtype=torch.int64), 1, admittance_from_reflection(averaged),
        prepared.blocks.count, cells.weight,
    )  # fmt: skip
    scatter = how.scatter(series)
    _add([first], Members.of(slice(0, cells.count), averaged, series, scatter))
    wide = _tile_rows(groups, chosen.resample)
    behind = {ORDERS[0]: (groups["liner"], groups["cells"].series), ORDERS[1]: (first, series)}
    star = _coherent_first(prepared, reflection, deviations, how, excluded)
    further: dict[str, Interval] = {}
    if star:
        behind[ORDERS[2]] = (star["liner"], star["cells"].series)
        further = {
            "cells_coherent_first": star["cells"].interval(how),
            "liner_coherent_first": star["liner"].interval(how).map(_only),
        }
    found = Uncertainty(
        probes=Interval.joined(intervals),
        along_x=groups["x"].interval(how) if "x" in groups else None,
        cells=groups["cells"].interval(how),
        cells_velocity_first=how.interval(scatter, averaged),
        liner=_of_liner(groups, how, wide),
        liner_velocity_first=first.interval(how).map(_only),
        **further,
        settings={
            "level": how.level,
            "resampled": chosen.resample if wide else "time",
            "blocks": prepared.blocks.count, "periods_per_block": prepared.blocks.periods,
        },
    )  # fmt: skip
    return found, {order: (whole.series[:, 0], cells) for order, (whole, cells) in behind.items()}


def resampling_of(prepared: Prepared) -> Resampling:
    """Of the blocks of a plane, weighted as its window is."""
    chosen = prepared.chosen
    assert prepared.blocks is not None and chosen.interval is not None  # noqa: PT018
    weights = prepared.blocks.sums(prepared.record.weights(0, prepared.plane.samples))
    return Resampling(weights / weights.sum(), chosen.interval)


def _parts(prepared: Prepared) -> Iterable[slice]:
    """Of the probes, alike whatever the threads: the size of a part may change the last digit."""
    assert prepared.blocks is not None
    probes = prepared.plane.probes
    size = probes * len(prepared.frequency) * prepared.blocks.count
    count = max(-(-size // ELEMENTS), 2 if size > ELEMENTS // 4 else 1)
    step = -(-probes // count)
    return (slice(low, min(low + step, probes)) for low in range(0, probes, step))


def _coherent_first(
    prepared: Prepared,
    reflection: Tensor,
    deviations: Callable[[slice], Tensor],
    how: Resampling,
    excluded: Tensor,
) -> dict[str, Groups]:
    """Cells and the whole liner under v*.

    Where the incoherent part was brought down to a share, so was what blocks tell of the coherent
    part, which is fitted to the whole record and stays as it is: deviations over that share are
    right for it, and generous for the rest.
    """
    if prepared.periodic is None or prepared.blocks is None:
        return {}
    begin, inside = len(reflection) - prepared.plane.probes, prepared.in_cells
    star, cells = reflection[begin:], prepared.cells
    outside = excluded | ~inside.to(star.device)[:, None]
    admittance = torch.where(outside, 0, admittance_from_reflection(star))
    groups = {
        "cells": (torch.where(inside, cells.labels, -1), cells.count),
        "liner": (torch.where(inside, 0, -1), 1),
    }
    found = {name: Groups(labels, count, admittance, prepared.blocks.count) for name, (labels, count) in groups.items()}

    share = prepared.periodic.scale.to(star.device)[:, None]

    def of_columns(part: slice) -> Members:
        series = deviations(slice(begin + part.start, begin + part.stop)) / share[part]
        return Members.of(part, star[part], series, how.scatter(series), outside[part])

    in_order(of_columns, _parts(prepared), lambda each: _add(found.values(), each))
    return found


def _add(groups: Iterable[Groups], member: Members) -> None:
    for group in groups:
        group.add(member)


def _only(value: Tensor) -> Tensor:
    """Of the one group, (F,)."""
    return value[0]


def review_uncertainty(prepared: Prepared, found: Uncertainty) -> list[str]:
    """Warnings about the whole liner: fewer than eight runs, one row to resample, a large bias."""
    return [
        *_few_runs(prepared, found), *_long_window(prepared), *_one_row(prepared, found),
        *_large_bias(prepared, found),
    ]  # fmt: skip


def _few_runs(prepared: Prepared, found: Uncertainty) -> list[str]:
    runs = float(found.liner.runs.min())
    moves = float(found.liner.widths.max()) > SMALLEST_WIDTH
    if runs >= FEWEST_RUNS or not moves:
        return []
    periods = found.settings["blocks"] * found.settings["periods_per_block"]
    return [
        f"{prepared.plane.name}: the error bars rest on {runs:.2g} independent blocks, fewer than "
        f"{FEWEST_RUNS}; they are rough, and about {_periods_for_eight(runs, periods)} periods "
        f"instead of {periods} would give {FEWEST_RUNS}"
    ]


def _long_window(prepared: Prepared) -> list[str]:
    """A running rms that hardly varies within the record says little of other records."""
    chosen, plane = prepared.chosen, prepared.plane
    window = window_of(chosen, prepared.frequency)
    if chosen.drive != "running-rms" or window <= LONGEST_WINDOW * plane.duration:
        return []
    return [
        f"{plane.name}: the running rms is over {window:.3g} s of a record of {plane.duration:.3g} "
        "s, so that it hardly varies in it, and the error bars are too narrow; take a shorter "
        "running_window, or drive='rms', whose error bars know it"
    ]


def _periods_for_eight(runs: float, periods: int) -> int:
    """Runs grow with the length of the record as S^(2/3), since their own length grows too."""
    return math.ceil((FEWEST_RUNS / runs) ** 1.5 * periods)


def _large_bias(prepared: Prepared, found: Uncertainty) -> list[str]:
    notes = []
    liner = found.liner
    for f, bias, error in zip(
        prepared.frequency.tolist(), liner.bias.tolist(), liner.standard_error.tolist(), strict=True
    ):
        if max(abs(bias.real) - error.real, abs(bias.imag) - error.imag) > SMALLEST_WIDTH:
            notes.append(
                f"{prepared.plane.name}: the mean of the probes' admittances is off by about "
                f"{bias.real:+.2g}{bias.imag:+.2g}j in Z at {f:g} Hz, more than its standard "
                "error, because each probe's record is short; the interval is without that bias, "
                "the value is not"
            )
    return notes


def _one_row(prepared: Prepared, found: Uncertainty) -> list[str]:
    rule = prepared.chosen.resample
    if rule == "time" or found.settings["resampled"] != "time":
        return []
    count = _labels(prepared)["rows"][1]
    one, many = ("cell", "cells") if rule == "time-cells" else ("row along z", "rows along z")
    reason = f"finds one {one}" if count == 1 else f"finds {count} {many} that move as one"
    return [f"{prepared.plane.name}: resample {rule!r} {reason}; the intervals are over time alone"]


def _labels(prepared: Prepared) -> dict[str, tuple[Tensor, int]]:
    """Groups of probes, -1 for none, and how many there are."""
    plane, cells = prepared.plane, prepared.cells
    found = {
        "liner": (torch.zeros(plane.probes, dtype=torch.int64), 1),
        "cells": (cells.labels, cells.count),
    }
    if len(plane.probe_shape) == 2:
        columns = plane.probe_shape[1]
        found["x"] = (torch.arange(plane.probes) % columns, columns)
    if prepared.chosen.resample != "time":
        rows = torch.where(prepared.used, _rows(prepared), -1)
        filled, number = torch.unique(rows, return_inverse=True)  # without rows left out
        none = int(filled[0] < 0)
        found["rows"] = (number - none, len(filled) - none)
    return found


def _rows(prepared: Prepared) -> Tensor:
    """Groups of probes that are alike: cells, rows of cells along z, or, without cells, rows.

    Rows of probes within one cell are not alike: each has its own place over the holes.
    """
    cells, plane = prepared.cells, prepared.plane
    if prepared.chosen.resample == "time-cells":
        return cells.labels
    centres = cells.z[torch.isfinite(cells.z)].unique()
    if len(centres) > 1:
        row = torch.searchsorted(centres, cells.z)
        return torch.where(cells.labels >= 0, row[cells.labels.clamp(min=0)], -1)
    if len(plane.probe_shape) == 2 and prepared.liner.cell_pitch is None:
        return torch.arange(plane.probes) // plane.probe_shape[1]
    return torch.zeros(plane.probes, dtype=torch.int64)


def _tile_rows(groups: dict[str, Groups], resample: str) -> int:
    """Rows (cells) that a tile is wide; 0 where tiles gain nothing over blocks of time."""
    rows = groups.get("rows", groups["liner"])
    if rows.count == 1:
        return 0
    wide = 1 if resample == "time-cells" else common_run_length(rows.series.movedim(1, 0))
    return 0 if wide == rows.count else wide


def _of_liner(groups: dict[str, Groups], how: Resampling, wide: int) -> Interval:
    """(F,): blocks of time, or tiles of time and of ``wide`` rows or cells."""
    liner = groups["liner"]
    if not wide:
        return liner.interval(how).map(_only)
    bias = liner.bias(how.scatter(liner.series))
    reflection = reflection_from_admittance(liner.mean - bias)
    tiled = how.over_tiles(groups["rows"].series, reflection[0], wide)
    return liner.with_bias(tiled.map(lambda value: value[None]), bias).map(_only)

"""Statistical intervals of the in situ and microphone methods, from blocks of time.

They say how far Z may be off because the record is finite; not what the formula, the cavity's
numbers or the microphones' own errors do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from torchliner.records import Interval, PointUncertainty, PressureRecord
from torchliner.records.cells import Cells
from torchliner.signals.plane_waves import split_waves
from torchliner.signals.resampling import FROM_ADMITTANCE, ITSELF
from torchliner.signals.tone_blocks import FEWEST_RUNS, SMALLEST_WIDTH, blocks_of

LEVEL = 0.95


def require_level(level: float | None) -> None:
    """Refuse what is no share of all cases; None is for no intervals."""
    if level is not None and not 0 < level < 1:
        raise ValueError(f"interval is {level:g}; it is a level between 0 and 1 (95 % is 0.95)")


def dean_uncertainty(
    record: PressureRecord, frequency: Tensor, drive: Tensor, found: Mapping[str, Tensor],
    cells: Cells, rows: Tensor, options: Mapping[str, Any], level: float | None,
) -> PointUncertainty | None:  # fmt: skip
    """Intervals of cells and surface in both orders; None for fewer than four blocks.

    Args:
        record, frequency, options: as ``in_situ`` has them.  drive: rho c v_in/p_b, (F,).
        found: impedances of points, cells and surface.
        cells, rows: of the probes, and the row of the backplate that belongs to each.
        level: of the intervals; None for none.
    """
    if level is None:
        return None
    assert record.facesheet is not None and record.backplate is not None  # noqa: PT018
    back = record.backplate.reshape(-1, record.samples)
    face = record.facesheet.reshape(-1, record.samples)
    used = rows >= 0
    member = cells.membership(used).T.to(torch.complex128)
    inside = ((cells.labels >= 0) & used)[:, None]
    parts: dict[str, list[Interval]] = {}
    count = 0
    for f, hertz in enumerate(frequency):
        blocks = blocks_of((face, back), hertz[None], record.sampling_rate, **options)
        if blocks is None:
            return None
        count = min(count or len(blocks.weights), len(blocks.weights))
        pressure, bottom = blocks.amplitudes
        through = (bottom * drive[f])[:, rows.clamp(min=0)]
        at = {name: value[..., f : f + 1] for name, value in found.items()}
        points = at["point_impedance"]
        change = -blocks.h1(through, pressure, points) / points**2
        admittance = member @ torch.where(inside, change, 0)
        through, pressure = member @ through, member @ pressure
        first = "_pressure_first"
        series = {
            "cells": (admittance, 1 / at["cell_impedance"], FROM_ADMITTANCE),
            "liner": (admittance.mean(1), 1 / at["liner_impedance"], FROM_ADMITTANCE),
            f"cells{first}": (blocks.h1(through, pressure, at[f"cell_impedance{first}"]),
                              at[f"cell_impedance{first}"], ITSELF),
            f"liner{first}": (blocks.h1(through.mean(1), pressure.mean(1),
                                        at[f"liner_impedance{first}"]),
                              at[f"liner_impedance{first}"], ITSELF),
        }  # fmt: skip
        for name, (change, value, conversion) in series.items():
            parts.setdefault(name, []).append(blocks.interval(change, value, level, conversion))
    return PointUncertainty(
        **{name: Interval.joined(each, -1) for name, each in parts.items()},
        settings={"level": level, "resampled": "time", "blocks": count},
    )  # fmt: skip


def wave_interval(
    record: PressureRecord, signals: Sequence[Tensor], frequency: Tensor, reflection: Tensor,
    places: Tensor, options: Mapping[str, Any], level: float | None,
) -> Interval | None:  # fmt: skip
    """Of Z at y = 0 from plane waves, (F,); None for fewer than four blocks.

    Args:
        record, frequency, options: as ``decompose_waves`` has them.
        signals: pressures of the microphones, and rho c v_in there if velocities are used.
        reflection: R, (F,).  places: y, m.  level: of the interval; None for none.
    """
    if level is None:
        return None
    parts = []
    for f, hertz in enumerate(frequency):
        blocks = blocks_of(signals, hertz[None], record.sampling_rate, **options)
        if blocks is None:
            return None
        waves, _, _ = split_waves(
            blocks.amplitudes[0], places, hertz[None], record.fluid.sound_speed,
            record.microphone_mach, *blocks.amplitudes[1:],
        )  # fmt: skip
        value = reflection[f : f + 1]
        parts.append(blocks.interval(blocks.h1(waves[:, 0], waves[:, 1], value), value, level))
    return Interval.joined(parts)


def few_blocks_note(name: str, found: Interval | None, level: float | None) -> list[str]:
    """Where an interval is missing or rough."""
    if level is None:
        return []
    if found is None:
        return [f"{name}: no statistical interval, since the record holds fewer than four blocks "
                "(periods of the tone, or segments)"]  # fmt: skip
    runs, width = float(found.runs.min()), float((found.high - found.low).abs().max())
    if runs >= FEWEST_RUNS or not width > SMALLEST_WIDTH:
        return []
    return [
        f"{name}: the error bars rest on {runs:.2g} independent blocks of time, fewer than "
        f"{FEWEST_RUNS}; they are rough"
    ]

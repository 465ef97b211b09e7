"""First-order deviation of the educed R in each block of the record."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from torchliner.liners.response import impedance_of
from torchliner.reduction.plan import PassPlan, block_waves
from torchliner.replay.incident import LineSums, Means
from torchliner.replay.phase_rule import PhaseRule
from torchliner.tdibc.prepared import Prepared

RMS_STEP = 1e-4  # of the mean square, relative: the slope errs by 1e-8


def block_deviations(prepared: Prepared, rule: PhaseRule, means: Means) -> Callable[[slice], Tensor]:
    """dR of the columns in a slice of N, complex128, (S, columns, F), for several threads.

    Args:
        prepared: prepared plane.
        rule: phase rule.
        means: over the whole record.
    """
    if prepared.chosen.drive == "rms":  # which holds |v|: R moves with the mean square alone
        slope = _slope_of_rms(prepared)  # here: a user's liner may not know several threads
        return lambda columns: _of_rms(prepared, slope[columns], columns)
    return lambda columns: _of_means(prepared, rule, means, columns)


def _of_means(prepared: Prepared, rule: PhaseRule, means: Means, columns: slice) -> Tensor:
    blocks = prepared.block_means(columns)
    assert blocks is not None
    da, db, dv = _away(blocks.forward), None, None
    if rule.several_tones:
        assert blocks.turned is not None and prepared.reader is not None  # noqa: PT018
        db = _turned(blocks, means.a[columns], prepared.sums.plan, prepared.reader.turns)
    elif rule.needs_backward:
        assert blocks.backward is not None
        db = _away(blocks.backward)
    if rule.needs_velocity:
        assert prepared.survey.blocks is not None
        dv = -_away(prepared.survey.blocks.line[:, columns])  # v into the liner is -v
    return rule.deviation(means, columns, da, db, dv)


def _turned(blocks: LineSums, mean: Tensor, plan: PassPlan, turns: Tensor) -> Tensor:
    """Changes of ``Means.turned``; the mean of R turns too, but of 2 f over whole periods to 0."""
    assert blocks.turned is not None
    turns = turns.clone()
    turns.diagonal()[:] = 0
    waves = block_waves(plan.blocks, turns, plan.sampling_rate).to(mean.device)[:, None]
    return _away(blocks.turned - torch.where(turns != 0, waves, 0) * mean[..., None])


def _of_rms(prepared: Prepared, slope: Tensor, columns: slice) -> Tensor:
    seen = prepared.survey.blocks
    assert seen is not None
    change = _away(seen.mean_square[:, columns])
    if prepared.chosen.mean == "removed":
        mean = prepared.survey.mean[columns]
        change = change - 2 * mean * _away(seen.mean[:, columns])
    return change[..., None] * slope


def _slope_of_rms(prepared: Prepared) -> Tensor:
    """dR/d(v'^2) of all columns, (N, F)."""
    seen, ends = prepared.survey, []
    square = seen.mean_square
    if prepared.chosen.mean == "removed":
        square = square - seen.mean**2
    square = square.clamp(min=0).cpu()
    with torch.no_grad():
        for factor in (1 - RMS_STEP, 1 + RMS_STEP):
            speed = (square * factor).sqrt()
            z = impedance_of(prepared.liner, prepared.frequency, speed[:, None])
            ends.append((z - 1) / (z + 1))
    slope = (ends[1] - ends[0]) / (2 * RMS_STEP * square.clamp(min=1e-300))[:, None]
    return slope.to(seen.mean.device)


def _away(values: Tensor) -> Tensor:
    """Less the mean over the blocks, in double precision."""
    wide = values.to(torch.complex128 if values.is_complex() else torch.float64)
    return wide - wide.mean(0)

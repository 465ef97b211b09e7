"""What is known beforehand of v*, a probe's velocity with the coherent part of its cell."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import torch
from torch import Tensor

from torchliner.records.cells import Cells
from torchliner.records.slabs import bounds_of
from torchliner.reduction.block_sums import VelocityBlocks
from torchliner.reduction.periodic import PeriodicPart
from torchliner.reduction.survey import Survey
from torchliner.signals.blocks import Blocks
from torchliner.signals.tones import BLOCK, line_sums, waves


def with_coherent(
    seen: Survey,
    part: PeriodicPart,
    cells: Cells,
    frequency: Tensor,
    weights: Tensor,
    blocks: Blocks | None,
) -> Survey:
    """The survey of probes and cells, followed by that of v* of each probe.

    All follows from sums of the one pass, but the largest |v*|, which is a bound. Its coherence is
    that of the cell, whose tone it is; over blocks its mean square moves as that of v, since what
    is taken off is periodic.

    Args:
        seen: of P probes and C cells.
        part: what is taken off.
        cells: of the probes.
        frequency: Hz, (F,).
        weights: window of the survey, (n,).
        blocks: of the survey, None if it kept none.
    """
    probes = part.deviation.shape[1]
    taken, top = part.mean, part.largest
    of_rows = _row_lines(part, frequency, weights)  # (K, F)
    scale = part.scale
    line = scale[:, None] * seen.line[:probes] - part.deviation.T.to(of_rows.dtype) @ of_rows
    labels = cells.labels.to(seen.mean.device)
    of_cell = seen.coherence[probes:][labels.clamp(min=0)]
    star = dataclasses.replace(
        seen,
        mean=scale * seen.mean[:probes] - taken,
        mean_square=part.mean_square(seen.mean_square[:probes]),
        smallest=scale * seen.smallest[:probes] - top,
        largest=scale * seen.largest[:probes] + top,
        bad=seen.bad[:probes],
        first_bad=seen.first_bad[:probes],
        line=line,
        coherence=torch.where(labels[:, None] >= 0, of_cell, seen.coherence[:probes]),
        blocks=None if seen.blocks is None or blocks is None
        else _of_blocks(seen.blocks, part, frequency, blocks, probes),
    )  # fmt: skip
    return Survey.join([seen, star])


def _row_lines(part: PeriodicPart, frequency: Tensor, weights: Tensor) -> Tensor:
    """sum w (row - its mean) e^{-j omega t} of each row, complex128, (K, F)."""
    rate, gram = part.harmonics.sampling_rate, part.gram.cpu()
    means = gram[0] / gram[0, 0]
    total = torch.zeros(len(means), len(frequency), dtype=torch.complex128)
    for begin, end in bounds_of(len(weights), BLOCK):
        rows = part.harmonics.rows(begin, end) - means[:, None]
        total += line_sums(weights[begin:end] * rows, frequency, rate, begin)
    return total.to(part.deviation.device)


def _of_blocks(
    seen: VelocityBlocks, part: PeriodicPart, frequency: Tensor, blocks: Blocks, probes: int
) -> VelocityBlocks:
    rate = part.harmonics.sampling_rate
    means, lines = [], []
    for begin, end in pairwise(blocks.borders):
        rows = part.harmonics.rows(begin, end)
        means.append(rows.mean(1))
        lines.append(rows.to(torch.complex128) @ waves(frequency, rate, begin, end).T / (end - begin))
    device, away = part.deviation.device, part.deviation.T
    row_means, row_lines = torch.stack(means).to(device), torch.stack(lines).to(device)
    mean = part.scale * seen.mean[:, :probes] - row_means @ away.T
    line = part.scale[:, None] * seen.line[:, :probes] - away.to(torch.complex128) @ row_lines
    return VelocityBlocks(mean, part.scale**2 * seen.mean_square[:, :probes], line)

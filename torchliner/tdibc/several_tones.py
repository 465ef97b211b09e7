r"""Several tones in v at once, each with the lines that it would have alone.

Over a record that is not whole periods of all, the line of one tone holds some of every other. With
:math:`W(g) = \sum w\,e^{-2\pi jgt}` and the means N_j of :math:`e^{j\omega_j t}`, which the mean of
the record holds, the lines of v less that mean are
:math:`L_i = \sum_j A_j [W(f_i - f_j) - W(f_i) N_j] + A_j^* [W(f_i + f_j) - W(f_i) N_j^*]`: F
complex equations for the amplitudes, exact in any record that tells the tones apart.
"""

from __future__ import annotations

import dataclasses
from itertools import combinations

import torch
from torch import Tensor

from torchliner.reduction.block_sums import VelocityBlocks
from torchliner.reduction.plan import block_waves, geometric
from torchliner.replay.edges import Record
from torchliner.signals.tones import line_sums
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.prepared import Prepared

MOST_TONES = 5  # of F tones a probe keeps 2 F^2 + 1 times the moments of one


def review_tones(name: str, frequency: Tensor, record: Record, chosen: Choices) -> None:
    """Refuse tones that one wave, or this record, cannot hold.

    Raises:
        ValueError: too many, closer than the record tells apart, or another window or engine.
    """
    tones = frequency.tolist()
    if chosen.engine != "spectral" or not chosen.whole_periods:
        raise ValueError(
            "phase 'joint' weighs emission times over the whole record: leave engine and window "
            "out; Tones.of_map gives the wave that it finds to engine 'unfold'"
        )
    if len(tones) > MOST_TONES:
        raise ValueError(
            f"phase 'joint' takes {len(tones)} frequencies as tones that sound at once; "
            f"{MOST_TONES} are the most (each pair needs moments of its own): name the tones that "
            "were sent with frequency=, and educe other frequencies with phase='averaged'"
        )
    seconds = (record.end - record.start) / record.sampling_rate
    for one, other in combinations(sorted(tones), 2):
        if (apart := other - one) * seconds < 1 - 1e-6:
            remedy = f"{1e3 / apart:.4g} ms of record are the least" if apart else "name it once"
            raise ValueError(
                f"{name}: tones of {one:g} and {other:g} Hz are {apart:.4g} Hz apart, and the "
                f"{1e3 * seconds:.4g} ms that are weighed tell tones {1 / seconds:.4g} Hz apart; "
                f"{remedy}"
            )


def each_alone(prepared: Prepared) -> Prepared:
    """The plane with a survey in which each tone stands as if it were alone, and with a coherence
    over the blocks of the record, since segments of two periods do not tell several tones apart.

    Raises:
        ValueError: the moments were reduced without blocks.
    """
    seen, plan, frequency = prepared.survey, prepared.sums.plan, prepared.frequency
    if seen.blocks is None or not len(seen.blocks.mean):
        raise ValueError(
            f"{prepared.plane.name}: phase 'joint' needs v over blocks of the record, which these "
            "moments do not hold; reduce the data again with phase='joint' and these frequencies"
        )
    rate, device = plan.sampling_rate, seen.mean.device
    both = torch.stack([frequency[:, None] - frequency, frequency[:, None] + frequency])
    record = prepared.record
    weights = record.window.weights
    of_window = line_sums(weights, both.flatten(), rate, record.start).reshape(both.shape)
    once = line_sums(weights, frequency, rate, record.start)[:, None]
    means = geometric(frequency, rate, 0, plan.samples).conj() / plan.samples
    minus, plus = of_window - once * torch.stack([means, means.conj()])[:, None]
    system = torch.cat([torch.cat([minus, plus], 1), torch.cat([plus, minus], 1).conj()])
    lines = torch.cat([seen.line, seen.line.conj()], 1).T
    amplitude = torch.linalg.solve(system.to(device), lines)[: len(frequency)].T  # of v, (N, F)
    window = prepared.window_sums
    # What is constant: the mean of the record less what the tones leave in it.
    constant = seen.mean - 2 * (amplitude * means.to(device)).real.sum(1)
    waves = block_waves(plan.blocks, both, rate).to(device)  # (S, 2, F, F)
    own = torch.eye(len(frequency), dtype=torch.bool, device=device)

    def steady(values: Tensor, which: Tensor) -> Tensor:
        """Of the tones ``which``, (F, F), in each line of each block, (S, n, F)."""
        minus, plus = torch.where(which, waves, 0).unbind(1)
        return values @ minus.mT + values.conj() @ plus.mT

    def alone(blocks: VelocityBlocks, values: Tensor) -> VelocityBlocks:
        line = blocks.line.to(torch.complex128) - steady(values, ~own)
        return dataclasses.replace(blocks, line=line)

    blocks = alone(seen.blocks, amplitude)
    of_constant = block_waves(plan.blocks, frequency, rate).to(device)[:, None] * constant[:, None]
    left = (blocks.line - steady(amplitude, own) - of_constant).abs().square().mean(0)
    power = amplitude.abs().square()
    cells = seen.cell_blocks and alone(seen.cell_blocks, amplitude[prepared.averaged])
    survey = dataclasses.replace(
        seen, line=window.zero * amplitude + window.twice * amplitude.conj(),
        coherence=torch.where(power > 0, power / (power + left).clamp(min=1e-300), 0.0),
        segments=(plan.rest,) * len(frequency), blocks=blocks, cell_blocks=cells,
    )  # fmt: skip
    return dataclasses.replace(prepared, survey=survey)

"""Whether a record holds the tone at all: coherence over its blocks against chance."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from torchliner.engine.moments import Moments
from torchliner.engine.survey import Membership, Survey
from torchliner.records.notes import Note
from torchliner.velocity.choices import Choices

CHANCE = 0.01  # of records without a tone, of which the test finds one
STEADY = 1e-18  # of the mean square: less than rounding
FEWEST = 3  # blocks, from which coherence says anything
NO_TONE = "no-tone"  # code of the note with which phase-locked averaging gives way to ``admittance``


def coherence_by_chance(blocks: int, chance: float = CHANCE) -> float:
    """Squared coherence c that noise exceeds in this share of records of S blocks: (1 - c)^(S - 1)."""
    return 1 - chance ** (1 / (blocks - 1))


def tone_coherence(seen: Survey, cells: Membership, frequency: Tensor) -> Tensor:
    """Squared coherence of the velocity averaged over each cell with steady tones, over all cells, (F,).

    A single probe in turbulence hardly sees the sound that all holes of its cell pass. Of several cells power is
    added, so that a wave that grazes them counts; chance then exceeds the limit of one cell less often.

    Args:
        frequency: Hz, (F,).
    Returns:
        0 to 1; nan where a line was not measured, or a steady velocity has none.
    """
    of_v, of_one = seen.line_sums(frequency)
    lines = (of_v - seen.mean[:, None] * of_one[:, None]) / seen.lengths[:, None, None]
    lines = cells.mean(lines.transpose(1, 2))  # (S, F, C)
    power = lines.abs().square().mean(0).sum(-1)
    found = lines.mean(0).abs().square().sum(-1) / power.clamp(min=1e-300)
    steady = power <= STEADY * seen.mean_square.mean() * cells.count
    return torch.where(steady, torch.nan, found)


def review_tone(known: Moments, frequency: Tensor, chosen: Choices) -> Iterator[Note]:
    """A record without the tone that is stated, or without any of those asked for, where none is.

    Raises:
        ValueError: the phase is to be found from that tone.
    """
    plane, seen, count = known.plane, known.survey, known.survey.blocks.count
    tested = frequency if plane.frequency is None else torch.tensor([plane.frequency], dtype=torch.float64)
    if count < FEWEST or seen.sums.device.type == "meta":
        return
    found = float(tone_coherence(seen, known.membership, tested).nan_to_num(1).max())
    limit = coherence_by_chance(count)
    if found > limit:
        return
    lines = " ".join(f"{f:g}" for f in tested[:3].tolist()) + " ..." * (len(tested) > 3)
    text = (
        f"{plane.name}: v holds no tone of {lines} Hz that can be told from noise: its squared coherence over {count} "
        f"blocks is {found:.2g}, and noise reaches {limit:.2g} in {100 * CHANCE:g} % of records"
    )
    if chosen.phase == "self-consistent":
        raise ValueError(f"{text}; phase 'self-consistent' needs one: choose phase='averaged'")
    level = plane.incident_level is not None and plane.source_side not in ("none", "unknown")
    if level or chosen.background is not None:  # there is sound for all that: the averaging that was chosen stays
        yield Note("hidden-tone", f"{text}; the phase-locked velocity, and the level check with it, is mostly noise")
    else:
        yield Note(NO_TONE, f"{text}; Z is the response to turbulence alone, averaging 'admittance'")

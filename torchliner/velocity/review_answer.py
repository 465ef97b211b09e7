"""Warnings about an answer: phases, rules, error bars and what else the tone stirs, as notes of the map."""

from __future__ import annotations

import math
from collections.abc import Iterator

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.conversions import impedance_from_reflection
from torchliner.engine.blocks import Blocks
from torchliner.engine.drives import tone_variances
from torchliner.engine.intervals import FEWEST_RUNS, SMALLEST_WIDTH
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import response
from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane
from torchliner.records.notes import Note
from torchliner.velocity.averages import Averages
from torchliner.velocity.choices import Choices

CHANCE = 0.01  # of probes that pass a limit of coherence without any tone, above which a warning is given
PHASES = 64  # of the tone, and equally likely values of the turbulence
LARGEST_CHANGE = 0.05  # of Z by the tone's part, relative to |Z|, that goes without a note


def review_rule(held: Tensor, count: int, chosen: Choices) -> Iterator[Note]:
    """How many values fell back to ``averaged``, bool (P, F), and how many pass by chance with ``count`` blocks."""
    if chosen.phase != "self-consistent":
        return
    limit = chosen.minimum_coherence
    if not bool(held.all()):
        text = f"{int((~held).sum())} of {held.numel()} values have a coherence below {limit:g} with the tone"
        yield Note("phase-fell-back", f"self-consistent phase: {text}; they are 'averaged' instead")
    chance = (1 - limit) ** (count - 1)
    if chance > CHANCE and limit > 0:
        text = f"with {count} blocks, {100 * chance:.2g} % of probes pass a coherence of {limit:g} without any tone"
        remedy = "a longer record or a higher minimum_coherence is safer"
        yield Note("coherence-by-chance", f"self-consistent phase: {text}; {remedy}")


def review_intervals(plane: VelocityPlane, found: Averages, blocks: Blocks, frequency: Tensor) -> Iterator[Note]:
    """Fewer than eight runs; a large bias of a mean of admittances."""
    interval = found.liner.interval
    if interval is None:
        return
    runs = float(interval.runs.min())
    width = float(interval.widths.max())
    if runs < FEWEST_RUNS and width > SMALLEST_WIDTH:
        # Runs grow with the length of the record as S^(2/3), since their own length grows too.
        wanted = math.ceil((FEWEST_RUNS / runs) ** 1.5 * blocks.periods)
        text = (
            f"{plane.name}: the error bars rest on {runs:.2g} independent blocks, fewer than {FEWEST_RUNS}; they are "
            f"rough, and about {wanted} periods instead of {blocks.periods} would give {FEWEST_RUNS}"
        )
        yield Note("few-blocks", text, width / 2 if math.isfinite(width) else None)
    for f, bias, error in zip(
        frequency.tolist(), interval.bias.tolist(), interval.standard_error.tolist(), strict=True
    ):
        if max(abs(bias.real) - error.real, abs(bias.imag) - error.imag) > SMALLEST_WIDTH:
            text = (
                f"{plane.name}: the mean of the probes' admittances is off by about {bias.real:+.2g}{bias.imag:+.2g}j "
                f"in Z at {f:g} Hz, more than its standard error, because each probe's record is short; the interval "
                "is without that bias, the value is not"
            )
            yield Note("biased-mean", text, abs(bias))


ToneShare = tuple[float, float, float, float]


def tone_share(known: Moments) -> ToneShare | None:
    """Share of the variance of v* that is periodic with the tone, mean, rms of that part and of the rest, m/s.

    None unless the plane states its tone and averaging is ``phase-locked``.
    """
    if known.locked is None or known.plane.frequency is None or not known.survey.harmonics:
        return None
    mean, periodic, rest = (float(each) for each in tone_variances(known.locked, known.survey, known.membership))
    return periodic / max(periodic + rest, 1e-300), mean, periodic**0.5, rest**0.5


def review_other_tones(
    plane: VelocityPlane, known: Moments, liner: LinerModel, frequency: Tensor, found: ToneShare | None
) -> Iterator[Note]:
    """Where |v| is the tone's own, by its share ``found``, Z at other frequencies is not that of a tone sent alone."""
    if found is None or known.settings["drive"] != "instantaneous" or plane.frequency is None:
        return
    share, _, periodic, rest = found
    other = (frequency / plane.frequency - 1).abs() >= SAME_FREQUENCY
    if not bool(other.any()):
        return
    beside, alone = (gaussian_impedance(known, liner, frequency, found, tone=tone) for tone in (1.0, 0.0))
    change = torch.where(other, ((alone - beside) / beside).abs(), 0)
    worst = int(change.argmax())
    if float(change[worst]) > LARGEST_CHANGE:
        asked = dict.fromkeys(f"{float(f):g}" for f in (frequency[other].min(), frequency[other].max()))
        text = (
            f"{plane.name}: {100 * share:.3g} % of the variance of v is in step with the tone of {plane.frequency:g} "
            f"Hz ({periodic:.3g} m/s rms, the rest {rest:.3g}): at {' to '.join(asked)} Hz Z is that of a weak second "
            f"tone beside this one, not of a tone sent alone. Without this one it would be about "
            f"{complex(alone[worst]):.2f} instead of {complex(beside[worst]):.2f} at {float(frequency[worst]):g} Hz"
        )
        yield Note("other-tone", text, float((alone - beside)[worst].abs()))


def gaussian_impedance(
    known: Moments, liner: LinerModel, frequency: Tensor, found: ToneShare, *, tone: float = 1.0, rest: float = 1.0
) -> Tensor:
    """Z of the model, (F,), for the tone beside Gaussian turbulence; ``tone``, ``rest``: factors on their rms."""
    _, mean, periodic, turbulent = found
    middle = (torch.arange(PHASES, dtype=torch.float64) + 0.5) / PHASES
    noise = mean + rest * turbulent * 2**0.5 * torch.erfinv(2 * middle - 1)
    tonal = tone * periodic * 2**0.5 * torch.cos(2 * torch.pi * middle)
    speed = (noise[:, None] + tonal).abs().flatten().clamp(max=known.top_speed(liner))
    with torch.no_grad():
        return impedance_from_reflection(response(liner, frequency, speed).mean(1))

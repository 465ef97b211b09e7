"""The sound beside the turbulence: whether a record holds the tone, how strong it is, and what that does to Z."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.conversions import impedance_from_reflection
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import response
from torchliner.engine.survey import coherence_by_chance, gram_of
from torchliner.liners.model import LinerModel
from torchliner.records.notes import Note
from torchliner.velocity.choices import Choices

CHANCE = 0.01  # of records without a tone, of which the test finds one
FEWEST = 3  # blocks, from which coherence says anything
NO_TONE = "no-tone"  # code of the note with which phase-locked averaging gives way to ``admittance``
PHASES = 64  # of the tone, and equally likely values of the turbulence
LARGEST_CHANGE = 0.05  # of Z by the tone's part, relative to |Z|, that goes without a note
LIMIT = 0.1  # of the velocity ratio, above which jets pass the plane as turbulence
WEAK, STRONG = 0.062, 0.26  # between which the share falls from 1 to a half: scripts/answers_page.py fits them
HALF, SCATTER = 0.5, 0.18  # share of the incoherent velocity that acts beyond; s.d. of the cases about the curve


def review_tone(known: Moments, frequency: Tensor, chosen: Choices) -> Iterator[Note]:
    """A record without the tone that is stated, or without any of those asked for, where none is.

    Raises:
        ValueError: the phase is to be found from that tone.
    """
    plane, seen, count = known.plane, known.survey, known.survey.blocks.count
    tested = frequency if plane.frequency is None else torch.tensor([plane.frequency], dtype=torch.float64)
    if count < FEWEST:
        return
    found, limit = (
        float(seen.coherence(tested, known.membership).nan_to_num(1).max()),
        coherence_by_chance(count, CHANCE),
    )
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


class Sound(NamedTuple):
    """Of v* with a stated tone: share of its variance that is periodic with it; mean, rms of that part and of the
    rest, m/s."""

    share: float
    mean: float
    periodic: float
    rest: float


def sound_of(known: Moments) -> Sound | None:
    """None unless the plane states its tone and averaging is ``phase-locked``."""
    locked, seen, cells = known.locked, known.survey, known.membership
    if locked is None or known.plane.frequency is None or not seen.harmonics:
        return None
    gram = gram_of(seen.blocks, seen.lines[: seen.harmonics]).sum(0)
    sums, samples = seen.sums.sum(0)[seen.rows_of_harmonics()], seen.lengths.sum()
    fit, gram = torch.linalg.pinv(gram, hermitian=True, rtol=1e-9).to(sums) @ sums, gram.to(sums)
    of_cells = cells.mean(fit)
    periodic = ((of_cells * (gram @ of_cells)).sum(0) / samples - of_cells[0] ** 2).clamp(min=0).mean()
    left = (seen.mean_square - (fit * sums).sum(0) / samples).clamp(min=0)
    rest = cells.sum(left if locked.scale is None else left * locked.scale**2).sum() / cells.sizes.sum()
    share = periodic / (periodic + rest).clamp(min=1e-300)
    return Sound(*map(float, (share, of_cells[0].mean(), periodic.sqrt(), rest.sqrt())))


def gaussian_impedance(
    known: Moments, liner: LinerModel, frequency: Tensor, found: Sound, *, tone: float = 1.0, rest: float = 1.0
) -> Tensor:
    """Z of the model, (F,), for the tone beside Gaussian turbulence; ``tone``, ``rest``: factors on their rms."""
    middle = (torch.arange(PHASES, dtype=torch.float64) + 0.5) / PHASES
    noise = found.mean + rest * found.rest * 2**0.5 * torch.erfinv(2 * middle - 1)
    tonal = tone * found.periodic * 2**0.5 * torch.cos(2 * torch.pi * middle)
    speed = (noise[:, None] + tonal).abs().flatten().clamp(max=known.top_speed(liner))
    with torch.no_grad():
        return impedance_from_reflection(response(liner, frequency, speed).mean(1))


def velocity_ratio(known: Moments, liner: LinerModel, frequency: Tensor) -> float | None:
    """|V1|/(phi M c) at the tone: peak of the phase-locked velocity of the cells, over porosity and flow velocity.

    None where porosity or Mach number are not stated, there is no flow, or the tone is not asked for.
    """
    plane, porosity, seen = known.plane, liner.surface_porosity, known.survey
    place = [i for i, f in enumerate(frequency.tolist()) if plane.frequency in (None, f)]
    if not (plane.mach and porosity and len(place) == 1):
        return None
    tone = seen.tone(frequency[place], seen.mean_of)[0, :, 0]
    found = float(known.membership.mean(tone).abs().mean()) / (porosity * plane.mach * float(plane.fluid.sound_speed))
    return found if math.isfinite(found) else None


def likely_share(ratio: float, weak: float = WEAK, strong: float = STRONG) -> float:
    """Share of the incoherent velocity that acts, by the velocity ratio: 1 up to ``weak``, a half from ``strong``,
    linear in the logarithm of the ratio between.

    Fitted to five cases of an orifice in turbulence at half a millimetre, of which two lie between 1 and a half; two
    slits in two dimensions count in ``SCATTER`` (docs/background.md).
    """
    fallen = math.log(max(ratio, weak) / weak) / math.log(strong / weak)
    return 1 - (1 - HALF) * min(fallen, 1.0)


def review_sound(
    known: Moments, liner: LinerModel, frequency: Tensor, ratio: float | None, found: Sound | None
) -> Iterator[Note]:
    """Strong sound in weak flow without a background: by how much R is probably too high; and where |v| is the tone's
    own, Z at other frequencies is not that of a tone sent alone."""
    plane = known.plane
    if found is None or plane.frequency is None:
        return
    if ratio is not None and ratio > LIMIT and known.settings["background"] is None:
        share = likely_share(ratio)
        whole, less, lowest = (
            float(gaussian_impedance(known, liner, frequency[:1], found, rest=each).real)
            for each in (1.0, share, share - SCATTER)
        )
        text = (
            f"{plane.name}: velocity ratio |V1|/(phi M c) = {ratio:.2g} (limit {LIMIT:g}): v holds vortices of the "
            f"jets that the sound makes, which are no turbulence of the flow. In resolved cases about {share:.2g} +- "
            f"{SCATTER:g} of the incoherent velocity acts at this ratio, so that R is probably too high by about "
            f"{whole - less:.2g} (up to {whole - lowest:.2g}); nothing is taken off: give a run without sound "
            "(background=, --background)"
        )
        yield Note("velocity-ratio", text, whole - less)
    other = (frequency / plane.frequency - 1).abs() >= SAME_FREQUENCY
    if known.settings["drive"] != "instantaneous" or not bool(other.any()):
        return
    beside, alone = (gaussian_impedance(known, liner, frequency, found, tone=tone) for tone in (1.0, 0.0))
    change = torch.where(other, ((alone - beside) / beside).abs(), 0)
    worst = int(change.argmax())
    if float(change[worst]) > LARGEST_CHANGE:
        asked = dict.fromkeys(f"{float(f):g}" for f in (frequency[other].min(), frequency[other].max()))
        z, other_z, at = complex(beside[worst]), complex(alone[worst]), float(frequency[worst])
        text = (
            f"{plane.name}: {100 * found.share:.3g} % of the variance of v is in step with the tone of "
            f"{plane.frequency:g} Hz ({found.periodic:.3g} m/s rms, the rest {found.rest:.3g}): at "
            f"{' to '.join(asked)} Hz Z is that of a weak second tone beside this one, not of a tone sent alone. "
            f"Without this one it would be about {other_z:.2f} instead of {z:.2f} at {at:g} Hz"
        )
        yield Note("other-tone", text, float((alone - beside)[worst].abs()))

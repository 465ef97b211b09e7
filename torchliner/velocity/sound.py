"""The sound beside the turbulence: whether a record holds the tone, how strong it is, and what that does to Z."""

import math
from typing import Any, NamedTuple

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.conversions import impedance_from_reflection
from torchliner.engine.moments import Moments
from torchliner.engine.survey import coherence_by_chance
from torchliner.liners.model import LinerModel, reflection_of
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
    rows, samples = seen.rows, seen.lengths.sum()
    gram, sums = seen.gram.sum(0)[rows][:, rows], seen.sums.sum(0)[rows]
    fit, gram = torch.linalg.pinv(gram, hermitian=True, rtol=1e-9).to(sums) @ sums, gram.to(sums)
    of_cells = cells.mean(fit)
    periodic = ((of_cells * (gram @ of_cells)).sum(0) / samples - of_cells[0] ** 2).clamp(min=0).mean()
    left = (seen.mean_square - (fit * sums).sum(0) / samples).clamp(min=0)
    left = cells.mean(left if locked.scale is None else left * locked.scale**2)
    rest = (left * cells.sizes).sum() / cells.sizes.sum()
    share = periodic / (periodic + rest).clamp(min=1e-300)
    return Sound(*map(float, (share, of_cells[0].mean(), periodic.sqrt(), rest.sqrt())))


def likely_share(ratio: float, weak: float = WEAK, strong: float = STRONG) -> float:
    """Share of the incoherent velocity that acts, by the velocity ratio: 1 up to ``weak``, a half from ``strong``,
    linear in the logarithm of the ratio between.

    Fitted to five cases of an orifice in turbulence at half a millimetre, of which two lie between 1 and a half; two
    slits in two dimensions count in ``SCATTER`` (docs/background.md).
    """
    fallen = math.log(max(ratio, weak) / weak) / math.log(strong / weak)
    return 1 - (1 - HALF) * min(fallen, 1.0)


def review_sound(
    known: Moments, liner: LinerModel, frequency: Tensor, chosen: Choices
) -> tuple[list[Note], dict[str, Any]]:
    """Notes, and for the ``choices`` of the result ``velocity_ratio``, |V1|/(phi M c): peak of the phase-locked
    velocity of the cells at the tone over porosity and flow velocity, and ``tone_share``, of the variance of v*.

    A record without the tone that is stated, or without any of those asked for, where none is; strong sound in weak
    flow without a background, by how much R is probably too high; and where |v| is the tone's own, Z at other
    frequencies is not that of a tone sent alone.

    Raises:
        ValueError: there is no tone, and the phase is to be found from it.
    """
    plane, seen, cells, count = known.plane, known.survey, known.membership, known.survey.blocks.count
    name, porosity, ratio, notes = plane.name, liner.surface_porosity, None, list[Note]()
    tested = frequency if plane.frequency is None else torch.tensor([plane.frequency], dtype=torch.float64)
    coherence = float(seen.coherence(tested, cells).nan_to_num(1).max()) if count >= FEWEST else 1.0
    limit = coherence_by_chance(max(count, FEWEST), CHANCE)
    if coherence <= limit:
        lines = " ".join(f"{f:g}" for f in tested[:3].tolist()) + " ..." * (len(tested) > 3)
        text = (
            f"{name}: v holds no tone of {lines} Hz that can be told from noise: its squared coherence over {count} "
            f"blocks is {coherence:.2g}, and noise reaches {limit:.2g} in {100 * CHANCE:g} % of records"
        )
        if chosen.phase == "self-consistent":
            raise ValueError(f"{text}; phase 'self-consistent' needs one: choose phase='averaged'")
        if chosen.background is not None or (
            plane.incident_level is not None and plane.source_side not in ("none", "unknown")
        ):  # there is sound for all that: the averaging that was chosen stays
            text += "; the phase-locked velocity, and the level check with it, is mostly noise"
            notes.append(Note("hidden-tone", text))
        else:
            notes.append(Note(NO_TONE, f"{text}; Z is the response to turbulence alone, averaging 'admittance'"))
    place = [i for i, f in enumerate(frequency.tolist()) if plane.frequency in (None, f)]
    if coherence > limit and plane.mach and porosity and len(place) == 1:
        peak = float(cells.mean(seen.tone(frequency[place])[0, :, 0]).abs().mean())
        ratio = peak / (porosity * plane.mach * float(plane.fluid.sound_speed))
        ratio = ratio if math.isfinite(ratio) else None
    found, facts = sound_of(known) if chosen.averaging == "phase-locked" else None, {"velocity_ratio": ratio}
    if found is None or plane.frequency is None:
        return notes, facts
    sound, other = found, (frequency / plane.frequency - 1).abs() >= SAME_FREQUENCY

    def impedance(asked: Tensor, tone: float = 1.0, rest: float = 1.0) -> Tensor:
        """Z of the model, (F,), for the tone beside Gaussian turbulence, with factors on their rms."""
        middle = (torch.arange(PHASES, dtype=torch.float64) + 0.5) / PHASES
        noise = sound.mean + rest * sound.rest * 2**0.5 * torch.erfinv(2 * middle - 1)
        tonal = tone * sound.periodic * 2**0.5 * torch.cos(2 * torch.pi * middle)
        speed = (noise[:, None] + tonal).abs().flatten().clamp(max=known.top_speed(liner))
        with torch.no_grad():
            return impedance_from_reflection(reflection_of(liner, asked[:, None], speed).mean(1))

    if ratio is not None and ratio > LIMIT and known.settings["background"] is None:
        share = likely_share(ratio)
        whole, less, least = (float(impedance(frequency[:1], rest=s).real) for s in (1.0, share, share - SCATTER))
        text = (
            f"{name}: velocity ratio |V1|/(phi M c) = {ratio:.2g} (limit {LIMIT:g}): v holds vortices of the "
            f"jets that the sound makes, which are no turbulence of the flow. In resolved cases about {share:.2g} +- "
            f"{SCATTER:g} of the incoherent velocity acts at this ratio, so that R is probably too high by about "
            f"{whole - less:.2g} (up to {whole - least:.2g}); nothing is taken off: give a run without sound "
            "(background=, --background)"
        )
        notes.append(Note("velocity-ratio", text, whole - less))
    if known.settings["drive"] == "instantaneous" and bool(other.any()):
        beside, alone = impedance(frequency), impedance(frequency, tone=0.0)
        change = torch.where(other, ((alone - beside) / beside).abs(), 0)
        worst = int(change.argmax())
        asked = dict.fromkeys(f"{float(f):g}" for f in (frequency[other].min(), frequency[other].max()))
        text = (
            f"{name}: {100 * found.share:.3g} % of the variance of v is in step with the tone of "
            f"{plane.frequency:g} Hz ({found.periodic:.3g} m/s rms, the rest {found.rest:.3g}): at "
            f"{' to '.join(asked)} Hz Z is that of a weak second tone beside this one, not of a tone sent alone. "
            f"Without this one it would be about {complex(alone[worst]):.2f} instead of {complex(beside[worst]):.2f} "
            f"at {float(frequency[worst]):g} Hz"
        )
        if float(change[worst]) > LARGEST_CHANGE:
            notes.append(Note("other-tone", text, float((alone - beside)[worst].abs())))
    return notes, facts | {"tone_share": found.share}

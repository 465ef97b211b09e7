"""How strong the sound is beside the flow: above a velocity ratio of 0.1 its jets pass the plane as turbulence."""

from __future__ import annotations

import math
from collections.abc import Iterator

from torch import Tensor

from torchliner.engine.moments import Moments
from torchliner.liners.model import LinerModel
from torchliner.records.notes import Note
from torchliner.velocity.averages import survey_of_columns
from torchliner.velocity.review_answer import ToneShare, gaussian_impedance

WEAK, STRONG = 0.1, 0.3  # velocity ratios between which the share falls from 1 to a half
HALF, SCATTER = 0.5, 0.2  # share of the incoherent velocity that acts beyond; of the cases about the curve


def velocity_ratio(known: Moments, liner: LinerModel, frequency: Tensor) -> float | None:
    """|V1|/(phi M c) at the tone: peak of the phase-locked velocity of the cells, over porosity and flow velocity.

    None where porosity or Mach number are not stated, there is no flow, or the tone is not asked for.
    """
    plane, porosity = known.plane, liner.surface_porosity
    place = [i for i, f in enumerate(frequency.tolist()) if plane.frequency in (None, f)]
    if not (plane.mach and porosity and len(place) == 1):
        return None
    seen = survey_of_columns(known, "velocity")
    found = float(seen.tone(frequency, seen.mean_of)[0, :, place[0]].abs().mean())
    return found / (porosity * plane.mach * float(plane.fluid.sound_speed)) if math.isfinite(found) else None


def likely_share(ratio: float) -> float:
    """Share of the incoherent velocity that acts, by the velocity ratio: 1 to 0.1, 0.5 from 0.3, linear in its
    logarithm between. Of ten resolved cases at half a millimetre; they scatter by 0.2 about it (docs/background.md)."""
    fallen = math.log(max(ratio, WEAK) / WEAK) / math.log(STRONG / WEAK)
    return 1 - (1 - HALF) * min(fallen, 1.0)


def review_ratio(
    known: Moments, liner: LinerModel, frequency: Tensor, ratio: float | None, tone: ToneShare | None
) -> Iterator[Note]:
    """Strong sound in weak flow without a background: by how much R is probably too high."""
    if ratio is None or ratio <= WEAK or tone is None or known.settings["background"] is not None:
        return
    share = likely_share(ratio)
    whole, less, lowest = (
        float(gaussian_impedance(known, liner, frequency[:1], tone, rest=each).real)
        for each in (1.0, share, share - SCATTER)
    )
    text = (
        f"{known.plane.name}: velocity ratio |V1|/(phi M c) = {ratio:.2g} (limit {WEAK:g}): v holds vortices of the "
        f"jets that the sound makes, which are no turbulence of the flow. In resolved cases about {share:.2g} +- "
        f"{SCATTER:g} of the incoherent velocity acts at this ratio, so that R is probably too high by about "
        f"{whole - less:.2g} (up to {whole - lowest:.2g}); nothing is taken off: give a run without sound "
        "(background=, --background)"
    )
    yield Note("velocity-ratio", text, whole - less)

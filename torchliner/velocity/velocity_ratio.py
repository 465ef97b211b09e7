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

LIMIT = 0.1  # of the velocity ratio, above which a note says so
WEAK, STRONG = 0.062, 0.26  # between which the share falls from 1 to a half: scripts/answers_page.py fits them
HALF, SCATTER = 0.5, 0.18  # share of the incoherent velocity that acts beyond; s.d. of the cases about the curve


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
    """Share of the incoherent velocity that acts, by the velocity ratio.

    Fitted to five cases of an orifice in turbulence at half a millimetre, of which two lie between 1 and a half; two
    slits in two dimensions count in ``SCATTER`` (docs/background.md).
    """
    return share_between(ratio, WEAK, STRONG)


def share_between(ratio: float, weak: float, strong: float) -> float:
    """1 up to ``weak``, a half from ``strong``, linear in the logarithm of the ratio between."""
    fallen = math.log(max(ratio, weak) / weak) / math.log(strong / weak)
    return 1 - (1 - HALF) * min(fallen, 1.0)


def review_ratio(
    known: Moments, liner: LinerModel, frequency: Tensor, ratio: float | None, tone: ToneShare | None
) -> Iterator[Note]:
    """Strong sound in weak flow without a background: by how much R is probably too high."""
    if ratio is None or ratio <= LIMIT or tone is None or known.settings["background"] is not None:
        return
    share = likely_share(ratio)
    whole, less, lowest = (
        float(gaussian_impedance(known, liner, frequency[:1], tone, rest=each).real)
        for each in (1.0, share, share - SCATTER)
    )
    text = (
        f"{known.plane.name}: velocity ratio |V1|/(phi M c) = {ratio:.2g} (limit {LIMIT:g}): v holds vortices of the "
        f"jets that the sound makes, which are no turbulence of the flow. In resolved cases about {share:.2g} +- "
        f"{SCATTER:g} of the incoherent velocity acts at this ratio, so that R is probably too high by about "
        f"{whole - less:.2g} (up to {whole - lowest:.2g}); nothing is taken off: give a run without sound "
        "(background=, --background)"
    )
    yield Note("velocity-ratio", text, whole - less)

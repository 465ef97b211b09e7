"""Strong sound in weak flow: vortices of the jets pass the plane as turbulence, so that R comes out too high.

How much of the incoherent velocity acts is known from resolved cases (docs/background.md); nothing is ever taken off.
"""

import math

import torch
from torch import Tensor

from torchliner.conversions import impedance_from_reflection
from torchliner.engine.drives import incoherent_square, survey_of_locked
from torchliner.engine.moments import Moments
from torchliner.liners.model import LinerModel, reflection_of

PHASES = 64  # of the tone, and equally likely values of the turbulence
LIMIT = 0.1  # of the velocity ratio
WEAK, STRONG = 0.062, 0.26  # between which the share falls from 1 to a half: scripts/answers_page.py fits them
HALF, SCATTER = 0.5, 0.18  # share of the incoherent velocity that acts beyond; s.d. of the cases about the curve


def likely_share(ratio: float, weak: float = WEAK, strong: float = STRONG) -> float:
    """Share of the incoherent velocity that acts, by the velocity ratio: 1 up to ``weak``, a half from ``strong``,
    linear in the logarithm of the ratio between.

    Fitted to five cases of an orifice in turbulence at half a millimetre, of which two lie between 1 and a half; two
    slits in two dimensions count in ``SCATTER``.
    """
    fallen = math.log(max(ratio, weak) / weak) / math.log(strong / weak)
    return 1 - (1 - HALF) * min(fallen, 1.0)


def parts_of_drive(known: Moments) -> tuple[float, float, float]:
    """Of v* of phase-locked averaging, over the cells: mean, m/s, mean square of what is periodic with the tone and of
    the rest, m2/s2."""
    assert known.locked is not None
    seen, cells, scale = known.survey, known.membership, known.locked.scale
    inside, star = cells.labels < cells.count, survey_of_locked(known.locked, seen)
    rest = incoherent_square(seen, cells) * (1.0 if scale is None else scale**2)
    square, left = float(star.rms.square()[inside].mean()), float(rest[inside].mean())
    return float(star.mean[inside].mean()), max(square - left, 0.0), left


def excess_resistance(known: Moments, liner: LinerModel, frequency: Tensor, ratio: float) -> tuple[float, float]:
    """By how much R at a frequency, Hz, (1,), is probably too high at a velocity ratio, and at most: of the model, for
    the tone beside Gaussian turbulence, less that with the likely share of it, and with the least."""
    mean, periodic, rest = parts_of_drive(known)
    middle = (torch.arange(PHASES, dtype=torch.float64) + 0.5) / PHASES
    noise = (2 * rest) ** 0.5 * torch.erfinv(2 * middle - 1)
    tone = mean + (2 * periodic) ** 0.5 * torch.cos(2 * torch.pi * middle)
    shares = torch.tensor([1.0, likely_share(ratio), likely_share(ratio) - SCATTER], dtype=torch.float64)
    speed = (shares[:, None, None] * noise[:, None] + tone).abs().flatten(1).clamp(max=known.top_speed(liner))
    with torch.no_grad():
        r = torch.stack([reflection_of(liner, frequency[:, None], each).mean() for each in speed])
    whole, less, least = impedance_from_reflection(r).real.tolist()
    return whole - less, whole - least

"""The turbulence of the flow without the sound: its rms, to which the incoherent velocity of a run is scaled.

Sound over a flow makes jets, whose vortices pass the plane as if they were turbulence. What drives the liner is the
turbulence that is there without the sound. Where that is not known R comes out too high; by how much follows from
resolved cases (docs/background.md) and is only said, nothing is ever taken off.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import one_number, require_positive
from torchliner.conversions import impedance_from_reflection
from torchliner.engine.drives import incoherent_square, survey_of_locked
from torchliner.engine.moments import Moments
from torchliner.engine.survey import Membership, Survey, coherence_by_chance
from torchliner.liners.model import LinerModel, reflection_of
from torchliner.records import VelocityPlane
from torchliner.records.case import same_probes
from torchliner.records.cells import sort_into_cells

Read = Callable[[VelocityPlane], Moments]
REMEDY = "give a run without sound of the same flow on the same plane, or its rms in m/s"
SAME = 0.02  # relative: heights and Mach numbers that differ by less are the same
HOLE = 0.5  # of a hole diameter: the height at which the rms of a quiet run acts
FALSE_ALARM = 1e-3  # of runs without sound, that are taken to hold the tone
PHASES = 64  # of the tone, and equally likely values of the turbulence
LIMIT = 0.1  # of the velocity ratio
WEAK, STRONG = 0.062, 0.26  # between which the share falls from 1 to a half: scripts/answers_page.py fits them
HALF, SCATTER = 0.5, 0.18  # share of the incoherent velocity that acts beyond; s.d. of the cases about the curve


@dataclass(frozen=True)
class Background:
    """rms of the velocity without the sound, m/s, one for the whole plane or one a cell; in ``choices`` of a result.

    Args:
        source: names of the planes; none of a stated number.
        height: of the rms, m; None where it is not stated.
    """

    rms: tuple[float, ...]
    source: tuple[str, ...] = ()
    height: float | None = None

    def scale(self, seen: Survey, cells: Membership) -> Tensor:
        """Factor on the incoherent velocity of each probe, at most 1, (P,)."""
        own = incoherent_square(seen, cells)
        wanted = torch.tensor(self.rms, dtype=own.dtype).to(own.device)
        wanted = torch.cat([wanted, wanted.mean()[None]])
        wanted = wanted[cells.labels] if len(self.rms) == cells.count else wanted[-1]  # of cells that are not all left
        return (wanted / own.sqrt().clamp(min=1e-300)).clamp(max=1)

    def describe(self) -> Any:
        """Plain values for a file: the number alone, or all fields."""
        plain = {"rms": list(self.rms), "source": list(self.source), "height": self.height}
        return plain if self.source else self.rms[0]


def background_of(
    plane: VelocityPlane, given: Any, liner: LinerModel | None, pitch: float | None, read: Read
) -> Background:
    """What is given as the choice ``background``, measured.

    Args:
        plane: with sound.  pitch: of the cells, m.  liner: whose holes count; None for moments of any liner.
        given: a number, m/s, a plane without sound or its moments, or planes of several heights, between which the rms
            is interpolated to half a hole diameter.
        read: moments of such a plane, with the lines of the tone.
    """
    several = given if isinstance(given, list | tuple) else [given]
    if not all(isinstance(each, VelocityPlane | Moments) for each in several):
        require_positive("background (m/s, or planes or moments)", given)
        return Background((one_number("background", given),))
    known = [_measured(each, plane, pitch, read, same_height=len(several) == 1) for each in several]
    if len(known) == 1:
        return known[0]
    target = plane.height if liner is None or not liner.hole_diameter else HOLE * liner.hole_diameter
    if target is None or any(each.height is None for each in known) or len({len(each.rms) for each in known}) > 1:
        raise ValueError("background: several planes need one grid, their heights and the liner's hole diameter")
    heights, rms = zip(*sorted((each.height, each.rms) for each in known), strict=True)
    if not heights[0] * (1 - SAME) <= target <= heights[-1] * (1 + SAME):
        shown = ", ".join(f"{1e3 * each:.4g}" for each in heights)
        text = f"background: planes at {shown} mm, none on either side of half a hole diameter, {1e3 * target:.4g} mm"
        raise ValueError(f"{text}; add one, or give the plane at the height of the run alone")
    between = tuple(float(np.interp(target, heights, of_cell)) for of_cell in zip(*rms, strict=True))
    return Background(between, tuple(name for each in known for name in each.source), target)


def _measured(
    quiet: VelocityPlane | Moments, plane: VelocityPlane, pitch: float | None, read: Read, *, same_height: bool
) -> Background:
    """rms of the incoherent velocity of each cell without sound; of all probes where these are others."""
    about = quiet.plane if isinstance(quiet, Moments) else quiet
    facts = [("Mach number", about.mach, plane.mach), ("height (m)", about.height, plane.height)]
    for what, there, here in facts[: 1 + same_height]:
        if there is not None and here is not None and not math.isclose(there, here, rel_tol=SAME):
            raise ValueError(f"background {about.name} has {what} {there:.4g}, and {plane.name} {here:.4g}; {REMEDY}")
    known, tone = quiet if isinstance(quiet, Moments) else read(quiet), plane.frequency or about.frequency
    whole = sort_into_cells(about, pitch if same_probes(about, plane) else None)
    cells, seen = whole.kept(known.used), known.survey
    members = Membership.of(cells, known.used, seen.sums.device)
    if tone is not None and (count := seen.blocks.count) > 2:
        found = float(seen.coherence(torch.tensor([tone], dtype=torch.float64), members).nan_to_num(0).max())
        if found > (limit := coherence_by_chance(count, FALSE_ALARM)):
            text = f"background {about.name} holds the tone of {tone:g} Hz (squared coherence {found:.2g}, noise has "
            raise ValueError(f"{text}{limit:.2g} in {100 * FALSE_ALARM:g} % of records); {REMEDY}")
    rms = members.mean(incoherent_square(seen, members)).sqrt().tolist()
    rms = rms if cells.count == whole.count else [sum(rms) / len(rms)]  # the plane may have lost others
    return Background(tuple(rms), (about.name,), about.height)


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

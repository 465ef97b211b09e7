"""The turbulence of the flow without the sound: its rms, to which the incoherent velocity of a run is scaled.

Sound over a flow makes jets, whose vortices pass the plane as if they were turbulence. What drives the liner is the
turbulence that is there without the sound (docs/background.md).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import one_number, require_positive
from torchliner.engine.blocks import Blocks
from torchliner.engine.drives import Drive, incoherent_square
from torchliner.engine.moments import Moments
from torchliner.engine.sums import Job, PlaneRecord, reduce
from torchliner.engine.survey import Membership, Survey, coherence_by_chance, lines_of, survey_of, survey_sums
from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane
from torchliner.records.cells import sort_into_cells

SAME = 0.02  # relative: heights and Mach numbers that differ by less are the same
CLOSE = 1e-5  # m, of probes that are the same
HALF = 0.5  # of a hole diameter: the height at which the rms of a quiet run acts (docs/background.md)
FALSE_ALARM = 1e-3  # of runs without sound, that are taken to hold the tone


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
        if len(wanted) > 1:
            wanted = torch.cat([wanted, wanted.mean()[None]])[cells.labels]
        return (wanted / own.sqrt().clamp(min=1e-300)).clamp(max=1)

    def describe(self) -> Any:
        """Plain values for a file: the number alone, or all fields."""
        plain = {"rms": list(self.rms), "source": list(self.source), "height": self.height}
        return plain if self.source else self.rms[0]


def background_of(plane: VelocityPlane, given: Any, liner: LinerModel | None, pitch: float | None) -> Background:
    """What is given as the choice ``background``, measured.

    Args:
        plane: with sound.  pitch: of the cells, m.  liner: whose holes count; None for moments of any liner.
        given: a number, m/s, a plane without sound or its moments, or planes of several heights, between which the rms
            is interpolated to half a hole diameter.
    """
    if not isinstance(given, (VelocityPlane, Moments, list, tuple)):
        require_positive("background (m/s)", given)
        return Background((one_number("background", given),))
    several = given if isinstance(given, list | tuple) else [given]
    if not all(isinstance(each, VelocityPlane | Moments) for each in several):
        kinds = ", ".join(type(each).__name__ for each in several)
        raise TypeError(f"background is {kinds}; a number in m/s, planes or moments are needed")
    known = [_measured(each, plane, pitch, same_height=len(several) == 1) for each in several]
    if len(known) == 1:
        return known[0]
    target = plane.height if liner is None or not liner.hole_diameter else HALF * liner.hole_diameter
    if target is None or any(each.height is None for each in known) or len({len(each.rms) for each in known}) > 1:
        raise ValueError("background: several planes need one grid, their heights and the liner's hole diameter")
    heights, rms = zip(*sorted((each.height, each.rms) for each in known), strict=True)
    if not heights[0] * (1 - SAME) <= target <= heights[-1] * (1 + SAME):
        shown = ", ".join(f"{1e3 * each:.4g}" for each in heights)
        raise ValueError(
            f"background: planes at {shown} mm, and none is on either side of half a hole diameter, "
            f"{1e3 * target:.4g} mm; add one, or give the plane at the height of the run alone"
        )
    between = tuple(float(np.interp(target, heights, of_cell)) for of_cell in zip(*rms, strict=True))
    return Background(between, tuple(name for each in known for name in each.source), target)


def _measured(quiet: Any, plane: VelocityPlane, pitch: float | None, *, same_height: bool) -> Background:
    """rms of the incoherent velocity of each cell without sound; of all probes where these are others."""
    about = quiet.plane if isinstance(quiet, Moments) else quiet
    tone, same_grid = plane.frequency or about.frequency, _require_same(about, plane, same_height)
    if isinstance(quiet, Moments):
        seen = quiet.survey
    else:  # with the harmonics of the tone, which the plane need not have; without one, in 32 blocks
        rate = about.sampling_rate
        lines, harmonics = lines_of(tone, rate)
        blocks = Blocks.of(about.samples, rate, tone or 32.5 * rate / about.samples)
        job = Job(Drive(), survey_sums, lines.to(about.device), largest=1)
        (sums,) = reduce(PlaneRecord(about, torch.float64, about.device), blocks, [job])
        seen = survey_of(sums, blocks, lines, harmonics)
    cells, count = sort_into_cells(about, pitch if same_grid else None), seen.blocks.count
    members = Membership.of(cells, torch.ones(about.probes, dtype=torch.bool), seen.sums.device)
    if tone is not None and count > 2:
        found = float(seen.coherence(torch.tensor([tone], dtype=torch.float64), members).nan_to_num(0).max())
        limit = coherence_by_chance(count, FALSE_ALARM)
        if found > limit:
            raise ValueError(
                f"background {about.name} holds the tone of {tone:g} Hz (squared coherence {found:.2g}; noise exceeds "
                f"{limit:.2g} in {100 * FALSE_ALARM:g} % of records): give a run without sound, or its rms in m/s"
            )
    rms = members.mean(incoherent_square(seen, members)).sqrt()
    return Background(tuple(rms.tolist()), (about.name,), about.height)


def _require_same(quiet: VelocityPlane, plane: VelocityPlane, same_height: bool) -> bool:
    """Whether both have the same probes; refuse another flow or height."""
    facts = [("Mach number", quiet.mach, plane.mach), ("height (m)", quiet.height, plane.height)]
    for what, there, here in facts[: 1 + same_height]:
        if there is not None and here is not None and abs(there - here) > SAME * max(abs(there), abs(here)):
            raise ValueError(
                f"background {quiet.name} has {what} {there:.4g} and {plane.name} {here:.4g}; give the same plane of "
                "the same flow without sound, or its rms in m/s"
            )
    pairs = ((quiet.x, plane.x), (quiet.z, plane.z))
    return quiet.probe_shape == plane.probe_shape and all(
        a is b is None or (a is not None and b is not None and torch.allclose(a, b, rtol=0, atol=CLOSE))
        for a, b in pairs
    )

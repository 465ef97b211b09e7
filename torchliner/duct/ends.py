r"""The duct's ends: the plane-like mode of the rigid duct goes out, comes back and comes in.

A bare characteristic end, nothing comes in, reflects 1e-3 of a plane-like mode in a sheared flow,
since that mode is not made of outgoing characteristics alone. So at the right end, with a_m and b_m
the outgoing and incoming parts of mode m and w the projection on the mean of p + u, the amplitude
c = (w.a)/(w.a_m) of what goes out determines what comes in, b = c b_m: rank one, no reflection of
mode m. With an end that reflects it, r times as much of the mode the other way comes in too. At the
left end alike, with the mean of p - u.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.checks import tell
from torchliner.duct.case import DuctCase
from torchliner.duct.flow_profiles import MeanFlow
from torchliner.duct.modes import DuctModes, duct_modes
from torchliner.duct.rigid_spectrum import cut_on_frequency, rigid_wavenumbers

GONE = 2 * math.pi  # |Im alpha| times distance: 2e-3 is left, as without sound after 2 H
RUNS = 0.03  # |Im alpha| H below which a mode is cut on, within 1e-4 of its cut-on frequency


@dataclass(frozen=True, eq=False)
class EndModes:
    """The modes that the ends let out, p = 1 on the wall y = H; (F, ...) over N points.

    Args:
        wavenumber: alpha of the mode downstream and upstream, 1/m, (F, 2), complex.
        along: (p + u)/2 and, with flow, v, of both, (F, 2, N or 2 N).  against: (p - u)/2 of both, (F, 2, N).
    """

    wavenumber: Tensor
    along: Tensor
    against: Tensor

    def of_frequencies(self, at: Tensor) -> EndModes:
        """Some frequencies, by index."""
        return EndModes(self.wavenumber[at], self.along[at], self.against[at])


def plane_modes(profile: MeanFlow, frequency: Tensor, y: Tensor, flow: bool) -> EndModes:
    """Plane-like modes at heights y (m, (N,))."""
    down, up = (duct_modes(profile, frequency, count=1, direction=d) for d in ("downstream", "upstream"))
    return end_modes(down, up, y, flow)


def end_modes(down: DuctModes, up: DuctModes, y: Tensor, flow: bool) -> EndModes:
    """Modes 0 of both directions at heights y (m, (N,))."""
    along, against = [], []
    for modes in (down, up):
        p, u, v = (field[:, 0] for field in modes.at(y))
        along.append(torch.cat([(p + u) / 2, v] if flow else [(p + u) / 2], -1))
        against.append((p - u) / 2)
    wavenumber = torch.stack([modes.wavenumber[:, 0] for modes in (down, up)], -1)
    return EndModes(wavenumber, torch.stack(along, 1), torch.stack(against, 1))


def warn_of_mode_1(case: DuctCase, frequency: Tensor) -> None:
    """Ends let one mode out; the next, which the liner's edges make, must have died away there.

    Warns:
        DataWarning: a frequency at which mode 1 runs, or hardly decays from the liner to an end.
    """
    profile = case.profile
    runs = rigid_wavenumbers(profile, case.height * case.wavenumber(frequency), 2, "downstream")[:, 1].imag.abs() < RUNS
    if case.liner and not bool(runs.all()):
        _warn_of_near_ends(case, frequency[~runs].max())
    if bool(runs.any()):
        tell(
            f"at {float(frequency[runs].max()):g} Hz mode 1 runs too: its cut-on is {cut_on_frequency(profile):.5g} "
            "Hz. Only the plane-like mode is sent in, and the ends let only that out: they reflect some of mode 1",
            depth=2,
        )


def _warn_of_near_ends(case: DuctCase, frequency: Tensor) -> None:
    """At the highest frequency below cut-on, where mode 1 decays least."""
    kappa = case.height * case.wavenumber(frequency[None])
    ends = {"upstream": case.liner[0][0] - case.start, "downstream": case.end - case.liner[-1][1]}
    decay = {end: float(rigid_wavenumbers(case.profile, kappa, 2, end)[0, 1].imag.abs()) / case.height for end in ends}
    nearest = min(ends, key=lambda end: decay[end] * ends[end])
    lost = decay[nearest] * ends[nearest]
    if lost < GONE:
        tell(
            f"the liner lies {1e3 * ends[nearest]:.3g} mm from the {nearest} end: at {float(frequency):g} Hz "
            f"{100 * math.exp(-lost):.2g} % of mode 1, which its edges make, reaches the end, which reflects some of "
            f"it (limit {100 * math.exp(-GONE):.2g} %); lengthen the duct there to at least "
            f"{1e3 * GONE / decay[nearest]:.3g} mm beyond the liner",
            depth=3,
        )

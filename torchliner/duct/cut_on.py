"""The frequency at which a rigid duct starts to carry a higher mode."""

from __future__ import annotations

import math

import torch
from scipy.optimize import brentq

from torchliner.duct.relation import DIRECTIONS
from torchliner.duct.rigid_spectrum import rigid_wavenumbers
from torchliner.flow_profiles import MeanFlow


def cut_on_frequency(profile: MeanFlow, mode: int = 1) -> float:
    r"""Cut-on frequency of a mode between rigid walls, Hz.

    Without shear it is n c sqrt(1 - M^2)/(2 H). With shear it is the zero of the squared half
    difference of the two wavenumbers of the mode, downstream and upstream, which is real and
    crosses zero straight where they meet.

    Args:
        profile: mean flow.
        mode: n, 1 or above.
    Raises:
        ValueError: a mode below 1: the plane wave runs at every frequency.
        RuntimeError: no cut-on within 0.5 to 1.5 of the uniform flow's.
    """
    if mode < 1:
        raise ValueError(f"mode is {mode}; the plane wave, 0, runs at every frequency")
    uniform = mode * math.pi * math.sqrt(1 - profile.bulk_mach**2)
    to_hertz = profile.sound_speed / (2 * math.pi * profile.duct_height)

    def difference(kappa: float) -> float:
        at = torch.tensor([kappa], dtype=torch.float64)
        down, up = (rigid_wavenumbers(profile, at, mode + 1, d)[0, mode] for d in DIRECTIONS)
        return float(((down - up) / 2).square().real)

    low, high = 0.5 * uniform, 1.5 * uniform
    if difference(low) > 0 or difference(high) < 0:
        raise RuntimeError(
            f"mode {mode} has no cut-on within 0.5 to 1.5 of that of the uniform flow, "
            f"{uniform * to_hertz:.4g} Hz"
        )
    return to_hertz * float(brentq(difference, low, high, xtol=1e-9))

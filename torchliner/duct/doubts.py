"""What makes a solved duct doubtful, each a warning with its numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from torchliner.checks import tell
from torchliner.duct.boundaries import EnergyBalance
from torchliner.duct.case import DuctCase
from torchliner.duct.modes import cut_on_frequency, rigid_modes
from torchliner.names import DIRECTIONS

SLOWEST = 0.01  # k H: a wave 600 heights long
RAYL, RIGID = 50.0, 5e3  # |Z|: beyond the first a doubt, beyond the second as good as rigid
GONE = 2 * math.pi  # |Im alpha| times distance: 2e-3 is left, as without sound after 2 H
RUNS = 0.03  # |Im alpha| H below which a mode is cut on, within 1e-4 of its cut-on frequency


def doubt_sound(
    case: DuctCase, frequency: Sequence[float], impedance: Tensor | Callable[..., Tensor], width: float | None
) -> None:
    """Warn of a frequency in kHz, an impedance in rayl, a wave across the width (m).

    Warns:
        DataWarning: k H below 0.01; |Z| from 50 to 5000; a frequency above the spanwise cut-on.
    """
    speed, low, high = case.profile.sound_speed, min(frequency), max(frequency)
    if 0 < 2 * math.pi * low / speed * case.height < SLOWEST:
        tell(f"{low:g} Hz is a wave of {speed / low / case.height:.3g} duct heights; is it in kHz?")
    for z in [] if callable(impedance) else impedance.flatten().tolist():
        if RAYL < abs(z) < RIGID:
            tell(
                f"impedance {z:.4g} is large for one over rho c; if it is in rayl (Pa s/m), write "
                f"{z / (speed * case.density):.3g}, and 'rigid' for a hard wall"
            )
            break
    across = speed * math.sqrt(1 - case.profile.bulk_mach**2) / (2 * width) if width else math.inf
    if width and high >= across:
        tell(
            f"at {high:g} Hz a mode runs across the width of {1e3 * width:g} mm, from its cut-on of {across:.4g} Hz "
            "on; the duct is solved in two dimensions without it"
        )


def doubt_ends(case: DuctCase, frequency: Tensor) -> None:
    """Ends let one mode out; the next, which the liner's edges make, must have died away there.

    Warns:
        DataWarning: a frequency at which mode 1 runs, or hardly decays from the liner to an end.
    """
    profile, kappa = case.profile, case.height * case.wavenumber(frequency)
    down, up = (rigid_modes(profile, kappa, 2, d)[:, 1].imag.abs() for d in DIRECTIONS)
    runs = down < RUNS
    if case.liner and not bool(runs.all()):
        # At the highest frequency below cut-on mode 1 decays least.
        nearest = torch.where(runs, 0, frequency).argmax()
        ends = (
            (float(up[nearest]) / case.height, case.liner[0][0] - case.start, "upstream"),
            (float(down[nearest]) / case.height, case.end - case.liner[-1][1], "downstream"),
        )
        rate, length, end = min(ends, key=lambda each: each[0] * each[1])
        if rate * length < GONE:
            tell(
                f"the liner lies {1e3 * length:.3g} mm from the {end} end: at {float(frequency[nearest]):g} Hz "
                f"{100 * math.exp(-rate * length):.2g} % of mode 1, which its edges make, reaches the end, which "
                f"reflects some of it (limit {100 * math.exp(-GONE):.2g} %); lengthen the duct there to at least "
                f"{1e3 * GONE / rate:.3g} mm beyond the liner",
                depth=2,
            )
    if bool(runs.any()):
        tell(
            f"at {float(frequency[runs].max()):g} Hz mode 1 runs too: its cut-on is {cut_on_frequency(profile):.5g} "
            "Hz. Only the plane-like mode is sent in, and the ends let only that out: they reflect some of mode 1",
            depth=2,
        )


def doubt_gain(balance: EnergyBalance, frequency: Tensor) -> None:
    """Say where more energy goes out than comes in though the wall takes some: a wave grew.

    Warns:
        DataWarning: with the frequency and the ratio.
    """
    fed = balance.fed
    if bool((fed > 0).any()):
        item = int(fed.argmax())
        out, absorbed = (float(part.flatten()[item]) for part in balance)
        tell(
            f"at {float(frequency[item % len(frequency)]):g} Hz ({int((fed > 0).sum())} of {fed.numel()} cases) "
            f"{out:.3g} times the energy that comes in goes out and {absorbed:.3g} times is absorbed, though the wall "
            "is passive: a wave of the shear layer grows along the liner, or the mesh does not resolve it; do not rely "
            "on this field",
            depth=3,
        )

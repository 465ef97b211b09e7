"""Values of a duct that may be meant in another unit, or that its two dimensions leave out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from torch import Tensor

from torchliner.checks import tell
from torchliner.duct.case import DuctCase

SLOWEST = 0.01  # k H: a wave 600 heights long
RAYL, RIGID = 50.0, 5e3  # |Z|: beyond the first a doubt, beyond the second as good as rigid


def doubt_sound(
    case: DuctCase, frequency: Sequence[float], impedance: Tensor | Callable[..., Tensor],
    width: float | None,
) -> None:  # fmt: skip
    """Warn of a frequency in kHz, an impedance in rayl, a wave across the width.

    Warns:
        DataWarning: k H below 0.01; |Z| from 50 to 5000; a frequency above the spanwise cut-on.
    """
    speed = case.profile.sound_speed
    low, high = min(frequency), max(frequency)
    if 0 < 2 * math.pi * low / speed * case.height < SLOWEST:
        tell(f"{low:g} Hz is a wave of {speed / low / case.height:.3g} duct heights; is it in kHz?")
    if isinstance(impedance, Tensor):
        size = impedance.abs()
        odd = (size > RAYL) & (size < RIGID)
        if bool(odd.any()):
            z = complex(impedance[odd][0])
            unit = case.profile.sound_speed * case.density
            tell(
                f"impedance {z:.4g} is large for one over rho c; if it is in rayl (Pa s/m), write "
                f"{z / unit:.3g}, and 'rigid' for a hard wall"
            )
    if width is not None:
        across = speed * math.sqrt(1 - case.profile.bulk_mach**2) / (2 * width)
        if high >= across:
            tell(
                f"at {high:g} Hz a mode runs across the width of {1e3 * width:g} mm, from its "
                f"cut-on of {across:.4g} Hz on; the duct is solved in two dimensions without it"
            )

"""R(f, |v|) of any liner, checked."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchliner.conversions import reflection_from_impedance
from torchliner.liners.model import Liner


def reflection_of(liner: Liner, frequency: Tensor, speed: Tensor) -> Tensor:
    """R = (Z - 1)/(Z + 1), complex128, of the broadcast shape of frequency (Hz) and |v| (m/s)."""
    return reflection_from_impedance(impedance_of(liner, frequency, speed))


def impedance_of(liner: Liner, frequency: Tensor, speed: Tensor) -> Tensor:
    """``liner.impedance`` of any user's object as a complex128 tensor of the broadcast shape."""
    shape = np.broadcast_shapes(frequency.shape, speed.shape)
    found = torch.as_tensor(liner.impedance(frequency, speed)).to(torch.complex128)
    if not bool(torch.isfinite(found.detach().abs()).all()) or bool((found == -1).any()):
        raise ValueError(
            f"{type(liner).__name__}.impedance(frequency, speed) gave nan, inf or -1 between "
            f"{float(frequency.min()):g} and {float(frequency.max()):g} Hz and up to "
            f"{float(speed.max()):g} m/s; R = (Z - 1)/(Z + 1) has no value there"
        )
    try:
        return found.broadcast_to(shape)
    except RuntimeError as error:
        raise ValueError(
            f"{type(liner).__name__}.impedance(frequency, speed) gave shape {tuple(found.shape)} "
            f"for inputs that broadcast to {tuple(shape)}"
        ) from error

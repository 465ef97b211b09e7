"""R(f, |v|) of any liner, checked."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.conversions import reflection_from_impedance
from torchliner.liners.model import Liner


def reflection_of(liner: Liner, frequency: Tensor, speed: Tensor) -> Tensor:
    """R = (Z - 1)/(Z + 1), complex128, of the broadcast shape of frequency (Hz) and |v| (m/s)."""
    return reflection_from_impedance(impedance_of(liner, frequency, speed))


def complex_tensor(impedance: Any, name: str) -> Tensor:
    """What a user's ``impedance`` gave, tensor, array, list or number, as complex128.

    Raises:
        TypeError: None, text; ``name`` is that of the liner.
    """
    if isinstance(impedance, Tensor):
        return impedance.to(torch.complex128)
    array = np.asarray(impedance)  # torch takes Python's own numbers in its default precision
    if array.dtype.kind not in "fiuc":
        raise TypeError(
            f"{name}.impedance(frequency, speed) gave {type(impedance).__name__} of {array.dtype}; "
            "numbers are needed, normalised by rho c"
        )
    return torch.as_tensor(array.astype(np.complex128))


def impedance_of(liner: Liner, frequency: Tensor, speed: Tensor) -> Tensor:
    """``liner.impedance`` of any user's object as a complex128 tensor of the broadcast shape."""
    shape = np.broadcast_shapes(frequency.shape, speed.shape)
    found = complex_tensor(liner.impedance(frequency, speed), type(liner).__name__)
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

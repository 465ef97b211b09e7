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


def impedance_of(liner: Liner, frequency: Tensor, speed: Tensor) -> Tensor:
    """``liner.impedance`` of any user's object, as ``checked_impedance``."""
    name = f"{type(liner).__name__}.impedance(frequency, speed)"
    return checked_impedance(liner.impedance(frequency, speed), frequency, speed, name)


def checked_impedance(impedance: Any, frequency: Tensor, speed: Tensor, name: str) -> Tensor:
    """What a user's function ``name`` gave, as complex128 of the broadcast shape.

    Raises:
        TypeError: None, text.
        ValueError: another shape, nan, inf or -1, for which R has no value.
    """
    found = complex_tensor(impedance, name)
    if not bool(torch.isfinite(found.detach().abs()).all()) or bool((found == -1).any()):
        raise ValueError(
            f"{name} gave nan, inf or -1 between {float(frequency.min()):g} and {float(frequency.max()):g} Hz and up "
            f"to {float(speed.max()):g} m/s; R = (Z - 1)/(Z + 1) has no value there"
        )
    shape = np.broadcast_shapes(frequency.shape, speed.shape)
    try:
        return found.broadcast_to(shape)
    except RuntimeError as error:
        raise ValueError(
            f"{name} gave shape {tuple(found.shape)} for frequency {tuple(frequency.shape)} and speed "
            f"{tuple(speed.shape)}; {tuple(shape)} is needed"
        ) from error


def complex_tensor(impedance: Any, name: str) -> Tensor:
    """Tensor, array, list or number as complex128; TypeError for None and text, with the ``name`` that gave it."""
    if isinstance(impedance, Tensor):
        return impedance.to(torch.complex128)
    array = np.asarray(impedance)  # torch takes Python's own numbers in its default precision
    if array.dtype.kind not in "fiuc":
        raise TypeError(
            f"{name} gave {type(impedance).__name__} of {array.dtype}; numbers are needed, normalised by rho c"
        )
    return torch.as_tensor(array.astype(np.complex128))

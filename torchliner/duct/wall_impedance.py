"""The impedance of a duct's wall as it enters the equations: as a reflection."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import FEEDS, require_choice, tell
from torchliner.conversions import reflection_from_impedance
from torchliner.duct.flow_profiles import MeanFlow
from torchliner.names import CONDITIONS

ACTIVE = 1e-12  # |Z + 1| from which R overflows what the sums keep


def wall_reflection(impedance: Any, device: torch.device | None = None) -> Tensor:
    r"""R = (Z - 1)/(Z + 1), complex128, for any passive Z with 0 and infinity among them; gradients are kept.

    Args:
        impedance: Z, normalised, v into the wall.  device: of what is no tensor.
    Raises:
        ValueError: Z is nan, or -1, where a wall gives out waves without being asked.
    Warns:
        DataWarning: negative resistance.
    """
    if isinstance(impedance, Tensor):
        wall = impedance.to(torch.complex128)
    else:
        wall = torch.as_tensor(np.asarray(impedance, np.complex128), device=device)
    rigid = torch.isinf(wall.real) | torch.isinf(wall.imag)
    finite = torch.where(rigid, 1, wall)
    if bool(torch.isnan(finite).any()):
        raise ValueError("impedance is nan; a hard wall is inf")
    if bool(((finite + 1).abs() < ACTIVE).any()):
        raise ValueError("impedance is -1, a wall that sends waves unasked; change it slightly")
    resistance = finite.detach().real
    feeds = resistance < FEEDS
    if bool(feeds.any()):
        tell(
            f"impedance has a negative resistance, {float(resistance.min()):.3g} at least, in {int(feeds.sum())} of "
            f"{feeds.numel()} values: such a wall feeds the sound, and fields may have no bound",
            depth=2,
        )
    return torch.where(rigid, 1, reflection_from_impedance(finite))


def result_type(impedance: Any) -> torch.dtype:
    """complex64 for a tensor of single precision, else complex128; sums are done in complex128."""
    single = isinstance(impedance, Tensor) and impedance.dtype in (torch.complex64, torch.float32)
    return torch.complex64 if single else torch.complex128


def require_slip_condition(profile: MeanFlow, slip_condition: str | None) -> bool:
    """Whether the wall condition is Ingard-Myers'; either is the same where the flow does not slip.

    Raises:
        ValueError: the profile slips along the wall y = 0 and no condition is stated.
    """
    if slip_condition is not None:
        require_choice("slip condition", slip_condition, CONDITIONS)
    slip = float(profile.mach(0.0))
    if slip > 0 and slip_condition is None:
        raise ValueError(
            f"the flow slips along the lined wall at Mach {slip:.3g}; say which condition holds there: "
            "slip_condition='ingard-myers' (continuity of displacement) or 'continuous-velocity'"
        )
    return slip > 0 and slip_condition == "ingard-myers"

"""Modes of a stated duct."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from torchliner.duct.growing_wave import growing_wave
from torchliner.duct.modes import DuctModes, duct_modes
from torchliner.duct.presets import DuctSetup
from torchliner.duct.relation import DIRECTIONS


def modes_of(setup: DuctSetup, count: int) -> dict[str, DuctModes]:
    """In each direction, above the first lined patch, as if it had no ends.

    Raises:
        ValueError: the impedance is a profile along x.
    """
    case, wall = setup.case, _first_wall(setup)
    known: dict[str, Any] = {"count": count, "slip_condition": case.slip_condition}
    return {
        direction: duct_modes(case.profile, setup.frequency, wall, direction=direction, **known)
        for direction in DIRECTIONS
    }


def growing_of(setup: DuctSetup) -> Tensor:
    """The growing wave above the first lined patch, alpha in 1/m, (F,), nan where there is none."""
    case = setup.case
    return growing_wave(case.profile, setup.frequency, _first_wall(setup), case.slip_condition)


def _first_wall(setup: DuctSetup) -> Any:
    if callable(setup.impedance):
        raise ValueError(f"{setup.name} has an impedance that varies along x; modes need one: state impedance")
    return setup.impedance[..., 0] if setup.impedance.numel() else torch.inf

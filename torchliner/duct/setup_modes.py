"""Modes of a stated duct."""

from __future__ import annotations

from typing import Any

import torch

from torchliner.duct.modes import DuctModes, duct_modes
from torchliner.duct.presets import DuctSetup
from torchliner.duct.relation import DIRECTIONS


def modes_of(setup: DuctSetup, count: int) -> dict[str, DuctModes]:
    """In each direction, above the first lined patch, as if it had no ends.

    Raises:
        ValueError: the impedance is a profile along x.
    """
    if callable(setup.impedance):
        raise ValueError(
            f"{setup.name} has an impedance that varies along x; modes need one: state impedance"
        )
    wall: Any = setup.impedance[0] if len(setup.impedance) else torch.inf
    return {
        direction: duct_modes(
            setup.case.profile, setup.frequency, wall, count=count, direction=direction,
            slip_condition=setup.case.slip_condition,
        )
        for direction in DIRECTIONS
    }  # fmt: skip

"""What is asked of a plane that is to be reduced to moments, as a whole or in parts."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.records import VelocityPlane
from torchliner.reduction.basis import ANY_LINER, Basis, Chebyshev, choose_basis
from torchliner.reduction.moments import ReducedVelocity
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.prepare import ask
from torchliner.tdibc.reading import Asked
from torchliner.tdibc.review_kernels import frequencies_read


class AnyLiner(LinerModel):
    """A liner that is not known yet, but for its cells."""

    def __init__(self, cell_pitch: float | None) -> None:
        self.cell_pitch = cell_pitch


@dataclass(frozen=True)
class Request:
    """What ``moments`` is asked for; arguments as there."""

    liner: Liner | None = None
    frequency: Any = None
    cell_pitch: float | None = None
    choices: Mapping[str, Any] = field(default_factory=dict)


def without_velocity(plane: VelocityPlane) -> VelocityPlane:
    """All else that is stated of a plane."""
    left = ReducedVelocity(tuple(plane.velocity.shape), plane.velocity.dtype, plane.name)
    return dataclasses.replace(plane, velocity=left, streamwise=None)


def requested(plane: VelocityPlane, request: Request) -> tuple[Asked, LinerModel, Choices, Basis]:
    """What is asked of a plane, or of the record that a part belongs to."""
    if not isinstance(plane, VelocityPlane):
        raise TypeError(f"plane is {type(plane).__name__}; one VelocityPlane is needed")
    liner, frequency, cell_pitch = request.liner, request.frequency, request.cell_pitch
    chosen = Choices(**request.choices)
    if chosen.engine != "spectral":
        raise ValueError(
            f"moments are what engine 'spectral' reads, not {chosen.engine!r}; leave engine and "
            "incident out"
        )
    if liner is not None and cell_pitch is not None:
        raise ValueError("cell_pitch is the liner's; name it only where no liner is given")
    model = AnyLiner(cell_pitch) if liner is None else as_liner(liner)
    asked = ask(plane, model, frequency, chosen)
    basis: Basis = Chebyshev(*ANY_LINER)
    if liner is not None:
        tolerance = chosen.model_tolerance(plane.velocity.dtype)
        read = frequencies_read(asked.record, asked.frequency, chosen)
        basis = choose_basis([model], read, tolerance)
    return asked, model, chosen, basis

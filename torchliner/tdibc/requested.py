"""What is asked of a plane that is to be reduced to moments, as a whole or in parts."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
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
    """Liners that are not known yet, or several, by what they share: cells, the largest |v|."""

    speed_max: float | None = None

    def __init__(self, cell_pitch: float | None, several: Sequence[LinerModel] = ()) -> None:
        self.cell_pitch = cell_pitch
        tops = [liner.speed_max for liner in several if liner.speed_max is not None]
        self.speed_max = min(tops, default=None)


@dataclass(frozen=True)
class Request:
    """What ``moments`` is asked for; arguments as there, ``liner`` also several of one pitch."""

    liner: Liner | Sequence[LinerModel] | None = None
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
            f"moments are what engine 'spectral' reads, not {chosen.engine!r}; leave engine and incident out"
        )
    if liner is not None and cell_pitch is not None:
        raise ValueError("cell_pitch is the liner's; name it only where no liner is given")
    models: Sequence[LinerModel] = ()
    model: LinerModel = AnyLiner(cell_pitch)
    if isinstance(liner, (list, tuple)):
        models, model = liner, AnyLiner(liner[0].cell_pitch, liner)
    elif liner is not None:
        model = as_liner(liner)
        models = [model]
    asked = ask(plane, model, frequency, chosen)
    basis: Basis = Chebyshev(*ANY_LINER)
    if models:
        tolerance = chosen.model_tolerance(plane.velocity.dtype)
        read = frequencies_read(asked.record, asked.frequency, chosen)
        basis = choose_basis(models, read, tolerance)
    return asked, model, chosen, basis

"""Moments of a plane, from which any liner's impedance follows without the data."""

from __future__ import annotations

import dataclasses
from typing import Any

from torchliner.checks import tell
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.records import VelocityPlane
from torchliner.reduction.basis import ANY_LINER, Basis, Chebyshev, choose_basis
from torchliner.reduction.moments import SETTINGS, Moments, ReducedVelocity
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.prepare import ask
from torchliner.tdibc.prepared import Progress
from torchliner.tdibc.reading import Asked, read_plane
from torchliner.tdibc.review_kernels import frequencies_read


class AnyLiner(LinerModel):
    """A liner that is not known yet, but for its cells."""

    def __init__(self, cell_pitch: float | None) -> None:
        self.cell_pitch = cell_pitch


def moments(
    plane: VelocityPlane,
    liner: Liner | None = None,
    frequency: Any = None,
    *,
    cell_pitch: float | None = None,
    progress: Progress | None = None,
    **choices: Any,
) -> Moments:
    """Sums over a plane that hold R(f, |v|) of any liner at any frequency.

    Args:
        plane: wall-normal velocity, (..., T) m/s.
        liner: for which K and c are chosen, and whose cells are averaged over; default any: K = 64,
            c = 1.5 m/s, good for 1e-5 in R up to 6 kHz, and the result of each eduction states it.
        frequency: Hz, at which a phase rule other than ``averaged`` or a window is to be read, and
            for K and c; default the plane's own tone.
        cell_pitch: L_c, m, without a liner.
        progress: called with numbers of samples done, 2 T in all.
        choices: as for ``educe``: what concerns |v| (``drive``, ``mean``, ``order``, ...) and the
            rows that are kept (``phase``, ``window``); the rest is chosen when Z is asked for.
    Raises:
        TypeError: plane is no VelocityPlane.
        ValueError: data or options that cannot give an answer.
    """
    asked, model, chosen, basis = requested(plane, liner, frequency, cell_pitch, choices)
    _, sums, notes = read_plane(asked, model, chosen, basis, progress=progress)
    tell(tuple(notes))
    return Moments(
        without_velocity(plane), sums,
        {name: getattr(chosen, name) for name in SETTINGS}, model.cell_pitch, tuple(notes),
    )  # fmt: skip


def without_velocity(plane: VelocityPlane) -> VelocityPlane:
    """All else that is stated of a plane."""
    left = ReducedVelocity(tuple(plane.velocity.shape), plane.velocity.dtype, plane.name)
    return dataclasses.replace(plane, velocity=left, streamwise=None)


def requested(
    plane: VelocityPlane, liner: Liner | None, frequency: Any, cell_pitch: float | None,
    choices: dict[str, Any],
) -> tuple[Asked, LinerModel, Choices, Basis]:  # fmt: skip
    """What is asked of a plane, or of the record that a part belongs to."""
    if not isinstance(plane, VelocityPlane):
        raise TypeError(f"plane is {type(plane).__name__}; one VelocityPlane is needed")
    chosen = Choices(**choices)
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

"""The record of moments: all that a plane has to say, in the size of some hundred time samples."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor
from torchliner.liners.model import LinerModel, as_liner
from torchliner.names import resolve
from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells
from torchliner.records.summaries import Facts, Summarised, case_facts, heading_of, record_words
from torchliner.reduction.basis import Basis, Chebyshev, interpolation_error, response_of
from torchliner.reduction.periodic import PeriodicPart
from torchliner.reduction.plan import PassPlan
from torchliner.reduction.speed_sums import GroupMoments
from torchliner.reduction.survey import Survey

ASKED = torch.linspace(300.0, 6000.0, 58, dtype=torch.float64)  # Hz, of the error that is stated
SETTINGS = (  # of an eduction, that the moments contain
    "drive", "mean", "order", "pre_roll", "running_window", "oncoming_rms", "window",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class PlaneSums:
    """What the readings of a plane leave.

    Args:
        plan: pieces, blocks and rows of the pass.
        tones: Hz, of the survey's lines and coherence, (F,).
        survey: of all columns.
        cells: those that hold probes.
        used: probes without faults, (P,).
        periodic: what was taken off for the order ``coherent first``; None in other orders.
        basis: functions of |v|; None where no moments were summed.
        groups: moments of the probes, of the cells' velocities and, with a periodic part, of the
            probes with the coherent velocity of their cell.
    """

    plan: PassPlan
    tones: Tensor
    survey: Survey
    cells: Cells
    used: Tensor
    periodic: PeriodicPart | None
    basis: Basis | None
    groups: tuple[GroupMoments, ...]

    def without_coherent(self) -> PlaneSums:
        """As if the order ``coherent first`` had not been asked for, views."""
        if self.periodic is None:
            return self
        seen = self.survey.part(len(self.used) + self.cells.count)
        return dataclasses.replace(self, survey=seen, periodic=None, groups=self.groups[:2])


class ReducedVelocity:
    """Stands where the velocity of a plane was of which moments alone are left."""

    def __init__(self, shape: tuple[int, ...], dtype: torch.dtype, name: str) -> None:
        self.shape, self.dtype, self.name = shape, dtype, name

    def read(self, begin: int, end: int, out: Tensor | None = None) -> Tensor:
        """Refused.

        Raises:
            ValueError: always.
        """
        raise ValueError(
            f"{self.name} holds moments of |v|; its {self.shape[-1]} time samples are gone, which "
            "this needs; take the plane that was reduced"
        )

    def load(self) -> Tensor:
        """Refused, as ``read``."""
        return self.read(0, self.shape[-1])


@dataclass(frozen=True, eq=False, repr=False)
class Moments(Summarised):
    """What ``torchliner.moments`` leaves of a plane: Z of any liner at any frequency from it.

    Args:
        plane: with everything but its velocity.
        sums: moments, survey and periodic part.
        settings: choices that went into them, by name: they cannot be chosen again.
        cell_pitch: L_c of the cells, m, or None.
        notes: warnings of the reduction.
        readings: of the data, that the moments took; 0 of a file of moments.
    """

    plane: VelocityPlane
    sums: PlaneSums
    settings: dict[str, Any]
    cell_pitch: float | None
    notes: tuple[str, ...] = ()
    readings: int = 0

    def educe(self, liner: Any, frequency: Any = None, **choices: Any) -> Any:
        """``torchliner.educe`` of these moments: the same map, without reading data."""
        return resolve("torchliner.tdibc.educe:educe")(self, liner, frequency, **choices)

    @staticmethod
    def sum(parts: Sequence[Any], given: Moments | None = None) -> Moments:
        """Moments of a record from all its parts in time, of ``torchliner.moments_part``.

        Args:
            parts: in any order: the result is the same to the bit.
            given: the sum of the first reading, where ``parts`` are of the second.
        Raises:
            TypeError: something else than parts.
            ValueError: of another record or by other choices; samples overlap or are missing.
        """
        found: Moments = resolve("torchliner.tdibc.parts:sum_parts")(parts, given)
        return found

    def require_speeds(self, liner: LinerModel) -> None:
        """Refuse a liner that has no R at some of the speeds at which these moments ask for it.

        Raises:
            ValueError: it has none beyond its largest |v|.
        """
        top, basis = liner.speed_max, self.sums.basis
        if top is None or basis is None or float(basis.speeds.max()) <= top * (1 + 1e-9):
            return
        known = torch.tensor(liner.frequency_range or (1000.0,), dtype=torch.float64).mean()
        try:
            with torch.no_grad():
                response_of(liner)(known[None], basis.speeds)
        except ValueError as reason:
            kind = "any liner smooth in |v|" if isinstance(basis, Chebyshev) else "another table"
            raise ValueError(
                f"{self.plane.name} holds moments for {kind}, and {type(liner).__name__} is known "
                f"up to {top:g} m/s alone: reduce the data again with this liner (--liner, "
                "tl.moments(plane, liner))"
            ) from reason

    def error(self, liner: Any, frequency: Any = None) -> float:
        """Largest error in R of the interpolation over |v|, up to the largest |v| of the data.

        Args:
            liner: whose R.
            frequency: Hz; default 300 to 6000 Hz.
        Raises:
            ValueError: a liner that ends at a |v|, of moments that were not made for it.
        """
        model, seen = as_liner(liner), self.sums.survey
        self.require_speeds(model)
        asked = ASKED if frequency is None else frequency_tensor(frequency)
        peak = float(seen.peak.max())
        top = min(peak, model.speed_max or peak)
        assert self.sums.basis is not None
        return interpolation_error(self.sums.basis, response_of(model), asked, top)[0]

    def plot(self, path: str | Path | None = None, *, ax: Any = None) -> Any:
        """Mean and rms of v along x, as ``VelocityPlane.plot``."""
        return resolve("torchliner.report.figures:draw_velocity")(self, path, axes=ax)

    def _heading(self) -> str:
        return heading_of(self, *record_words(self.plane), f"{self.size / 1e6:.3g} MB")

    def _facts(self) -> Facts:
        basis = self.sums.basis
        known = {} if basis is None else basis.describe()
        return [("order", str(self.settings["order"])), *case_facts(self.plane),
                *((name, str(value)) for name, value in known.items())]  # fmt: skip

    def write(self, path: str | Path) -> None:
        """Write one netCDF-4 file, which ``torchliner.read_moments`` reads (docs/formats.md)."""
        resolve("torchliner.io.moments_file:write_moments")(self, path)

    @property
    def size(self) -> int:
        """Bytes of the moments."""
        return sum(
            value.nbytes
            for group in self.sums.groups
            for each in fields(group)
            if (value := getattr(group, each.name)) is not None
        )

"""The record of moments: all that a plane has to say, in the size of some hundred time samples."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor
from torchliner.engine.drives import Drive
from torchliner.engine.nodes import Chebyshev, Nodes, interpolation_error
from torchliner.engine.survey import Membership, Survey
from torchliner.liners.model import LinerModel, as_liner
from torchliner.names import resolve
from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells
from torchliner.records.notes import Note
from torchliner.records.outlets import Written

ASKED = torch.linspace(300.0, 6000.0, 58, dtype=torch.float64)  # Hz, of the error that is stated
# Choices that the moments contain: they cannot be made again.
SETTINGS = ("averaging", "phase", "drive", "running_window", "mean", "background", "missing", "allow_short")


@dataclass(frozen=True)
class ReducedVelocity:
    """Stands where the velocity of a plane was of which moments alone are left."""

    shape: tuple[int, ...]
    dtype: torch.dtype
    name: str
    in_file: bool = False  # whether that is the name of a file of moments

    def read(self, begin: int, end: int, out: Tensor | None = None) -> Tensor:
        """Refused."""
        raise ValueError(f"{self.name} holds moments of |v|, no time samples; take the plane that was reduced")

    def load(self) -> Tensor:
        """Refused, as ``read``."""
        return self.read(0, self.shape[-1])


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Layout:
    """How the sums of a record are laid out; it needs no look at the data."""

    plane: VelocityPlane  # of moments with everything but its velocity
    cell_pitch: float | None  # L_c of the cells, m
    cells: Cells  # that hold probes
    membership: Membership  # probes by cell, on the device of the sums
    used: Tensor  # probes that count, bool, (P,), on the host; ``membership`` has them on the device
    nodes: Nodes | None  # speeds at which R is weighed; None with drive ``rms``, which needs the survey alone
    turns: Tensor  # Hz, of the waves that the sums are weighed with beside 1, (Q,): 2 f for a phase rule that needs it
    # Coefficients of R of one liner at F frequencies, real and then imaginary parts, float64, (2 F, K), on the device:
    # sums of these two parts are kept instead of those of all K functions, which takes less memory.
    onto: Tensor | None = None


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Moments(Layout, Written):
    """What ``torchliner.moments`` leaves of a plane: Z of any liner at any frequency from it."""

    settings: Mapping[str, Any]  # choices that went into them, by name
    survey: Survey  # of the probes, over S blocks
    locked: Drive | None  # the phase-locked drive; None in other averagings, and before the second reading
    # By averaging, of the nodes' functions of |v|, float64, (S, 1 + 2 Q, K, N), none with drive ``rms``; and "square
    # of cells", those of the squares of the cells' velocity, (S, 1, 1, C).
    sums: Mapping[str, Tensor]
    notes: tuple[Note, ...] = ()

    FILE: ClassVar = "torchliner.io.moments_file:write_moments"

    def educe(self, liner: Any, frequency: Any = None, **choices: Any) -> Any:
        """``torchliner.educe`` of these moments: the same map, without reading data."""
        return resolve("torchliner.velocity.educe:educe")(self, liner, frequency, **choices)

    def require_speeds(self, liner: LinerModel) -> None:
        """ValueError for a liner that has no R at some of the speeds at which these moments ask for it."""
        top, nodes = liner.speed_max, self.nodes
        if top is not None and nodes is not None and float(nodes.speeds.max()) > top * (1 + 1e-9):
            kind = "any liner smooth in |v|" if isinstance(nodes, Chebyshev) else "another table"
            raise ValueError(
                f"{self.plane.name} holds moments for {kind}, and {type(liner).__name__} is known only up to {top:g} "
                "m/s: reduce the data again with this liner (--liner, tl.moments(plane, liner))"
            )

    def error(self, liner: Any, frequency: Any = None) -> float:
        """Model-table error: largest error in R of the interpolation over |v|, up to the largest |v| of the data;
        ``frequency`` in Hz, default 300 to 6000 Hz."""
        model = as_liner(liner)
        self.require_speeds(model)
        asked = ASKED if frequency is None else frequency_tensor(frequency)
        return 0.0 if self.nodes is None else interpolation_error(self.nodes, model, asked, self.top_speed(model))[0]

    def top_speed(self, liner: LinerModel) -> float:
        """Largest |v| of the data, no more than the liner knows, m/s."""
        peak = float(self.survey.peak.detach().nan_to_num(0).max())
        return max(min(peak, liner.speed_max or peak), 1e-3)

    def plot(self, path: str | Path | None = None, *, ax: Any = None) -> Any:
        """Mean and rms of v along x, as ``VelocityPlane.plot``."""
        return resolve("torchliner.report.curves:draw_velocity")(self, path, axes=ax)

    @property
    def size(self) -> int:
        """Bytes of the sums."""
        return sum(value.nbytes for value in (*self.sums.values(), self.survey.sums))

r"""Microphones seen from the source.

With s the distance from the source's side the wave above the liner is :math:`e^{-j\alpha' s}`: for a source upstream
s = x and alpha' = alpha; for one downstream the array is read backwards, s = -x, alpha' = -alpha, and the flow runs at
-M along s. Either way the wave decays along s.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from torchliner.names import SOURCES
from torchliner.records import MicrophoneLine


@dataclass(frozen=True)
class FromSource:
    """A line seen from its source.

    Args:
        line: as recorded.
        sign: 1 for a source upstream, -1 downstream.
        distance: s of the microphones from the first, m, (N,).
        pressure: Pa, (..., N, F), in the order of s.
        mach: of the flow along s.
    """

    line: MicrophoneLine
    sign: int
    distance: Tensor
    pressure: Tensor
    mach: float

    @property
    def origin(self) -> float:
        """x of the microphone nearest the source, m."""
        return float(self.line.x[0 if self.sign == 1 else -1])

    @property
    def source_side(self) -> str:
        """``upstream`` or ``downstream``."""
        return SOURCES[self.sign == -1]


def seen_from_source(line: MicrophoneLine, source_side: str | None) -> FromSource:
    """The line along s.

    Args:
        line: microphones.
        source_side: None for what the line says.
    Raises:
        ValueError: the side of the source or the Mach number is not known.
    """
    side = line.source_side if source_side is None else source_side
    if side not in SOURCES:
        raise ValueError(
            f"{line.name}: source_side is {side!r}; give 'upstream' or 'downstream': the array is read from the source"
        )
    mach = line.stated_mach
    if side == "downstream":
        return FromSource(line, -1, (line.x[-1] - line.x).flip(0), line.pressure.flip(-2), -mach)
    return FromSource(line, 1, line.x - line.x[0], line.pressure, mach)

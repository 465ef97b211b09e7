"""R of eq. (2.9) in real and imaginary part, for loops where complex numbers do not fuse."""

from __future__ import annotations

from torch import Tensor

Parts = tuple[Tensor, Tensor]


def reflection_parts(resistance: Tensor, reactance: Tensor) -> Parts:
    """Real and imaginary part of R = (Z - 1)/(Z + 1), as R = 1 - 2 (Z + 1)*/|Z + 1|^2."""
    above = resistance + 1
    scale = 2 / (above * above + reactance * reactance)
    return 1 - above * scale, reactance * scale

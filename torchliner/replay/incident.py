r"""What one pass over a record leaves for the phase rules.

Every engine returns two sums per probe and frequency, over a window w on the reflected signal:
the line f0 of the reply to exp(+j omega t), ``forward``, and that of the reply to exp(-j omega t),
``backward``. A real incident wave x = X e^{j omega t} + X* e^{-j omega t} has the reflected line
X forward + X* backward, so any phase rule is algebra on these two.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from torch import Tensor

from torchliner.signals.tones import WindowSums


@dataclass(frozen=True)
class LineSums:
    """What an engine returns.

    Args:
        forward: sum over time of w y_+ e^{-j omega t}, complex128, shape (P, F).
        backward: the same for the reply to e^{-j omega t}; None if it was not asked for.
        blocks: for error bars, MEANS of R(f, |v|) (``forward``) and of R(f, |v|) e^{-2 j omega t}
            over S blocks of the record, (S, P, F).
        turned: sums of w R(f, |v|) e^{-2 pi j turn t} over emission times, for a phase rule of
            several tones, (P, F, Q); ``backward`` is one of them.
    """

    forward: Tensor
    backward: Tensor | None
    blocks: LineSums | None = None
    turned: Tensor | None = None

    @classmethod
    def with_turns(cls, forward: Tensor, turned: Tensor) -> LineSums:
        """From the sums at the turns of a phase rule, (..., F, Q): none, 2 f, or all of ``Joint``,
        whose f_i + f_j come first."""
        count, turns = turned.shape[-2:]
        if turns < 2:
            return cls(forward, turned[..., 0] if turns else None)
        return cls(forward, turned[..., :count].diagonal(dim1=-2, dim2=-1), turned=turned)


@dataclass(frozen=True)
class Means:
    """Window-weighted means over a record.

    Args:
        averaged: R of the complex tone e^{j omega t}, (P, F).
        a, b: <R> and <R e^{-2 j omega t}>, free of the window's leakage from one to the other, so
            that b of a frozen |v| is 0; ``averaged`` and None without backward sums.
        turned: <(R - a) e^{-2 pi j turn t}>, (P, F, Q); None unless several tones are asked for.
    """

    averaged: Tensor
    a: Tensor
    b: Any
    turned: Tensor | None = None

    @classmethod
    def of(cls, sums: LineSums, window: WindowSums) -> Means:
        """From the lines of a reflected signal, in which R(-f) = R* replies to e^{-j omega t}."""
        averaged = sums.forward / window.zero
        if sums.backward is None:
            return cls(averaged, averaged, None)
        determinant = window.zero**2 - window.twice.abs() ** 2
        a = (window.zero * sums.forward - window.twice * sums.backward.conj()) / determinant
        b = (window.zero * sums.backward - window.twice * sums.forward.conj()) / determinant
        return cls(averaged, a, b)

    @classmethod
    def of_emissions(cls, sums: LineSums, window: WindowSums) -> Means:
        """From sums over emission times, each weighed with R(f) whichever way the tone turns."""
        averaged = sums.forward / window.zero
        if sums.backward is None:
            return cls(averaged, averaged, None)
        b = (sums.backward - window.twice * averaged) / window.zero
        turned = None
        if sums.turned is not None:
            assert window.turned is not None
            turned = (sums.turned - window.turned * averaged[..., None]) / window.zero
        return cls(averaged, averaged, b, turned)

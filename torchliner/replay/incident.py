r"""The incident tone, and what its phase relative to v does to the answer.

Every engine returns two sums per probe and frequency, over a window w on the reflected signal:
the line f0 of the reply to exp(+j omega t), ``forward``, and that of the reply to exp(-j omega t),
``backward``. A real incident wave x = X e^{j omega t} + X* e^{-j omega t} has the reflected line
X forward + X* backward, so any phase rule is algebra on these two.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.replay.block_lines import BlockMeans
from torchliner.signals.tones import WindowSums


@dataclass(frozen=True)
class LineSums:
    """What an engine returns.

    Args:
        forward: sum over time of w y_+ e^{-j omega t}, complex128, shape (P, F).
        backward: the same for the reply to e^{-j omega t}; None if it was not asked for.
        blocks: means over blocks of the record, for error bars.
    """

    forward: Tensor
    backward: Tensor | None
    blocks: BlockMeans | None = None


@dataclass(frozen=True)
class Means:
    """Window-weighted means free of leakage: a = <R> and b = <R e^{-2 j omega t}>, (P, F)."""

    a: Tensor
    b: Tensor | None

    @classmethod
    def of(cls, sums: LineSums, window: WindowSums) -> Means:
        """From an engine's sums. Without a backward sum, a is that of the complex tone."""
        if sums.backward is None:
            return cls(sums.forward / window.zero, None)
        determinant = window.zero**2 - window.twice.abs() ** 2
        a = (window.zero * sums.forward - window.twice * sums.backward.conj()) / determinant
        b = (window.zero * sums.backward - window.twice * sums.forward.conj()) / determinant
        return cls(a, b)


def given_reflection(means: Means, phase: Tensor) -> Tensor:
    """R for x = cos(omega t + phase): a + b e^{-2 j phase}. ``phase`` in rad, (P, F) or less."""
    assert means.b is not None
    return means.a + means.b * torch.exp(-2j * phase)


def self_consistent_reflection(means: Means, velocity: Tensor) -> tuple[Tensor, Tensor]:
    r"""R and X of the wave whose replayed reflection gives the measured coherent velocity.

    :math:`(1-a) X - b X^* = V`, hence
    :math:`X = [(1-a)^* V + b V^*]/(|1-a|^2 - |b|^2)`; iterating for X fails at high |v|.

    Args:
        means: a and b, (P, F).
        velocity: V, amplitude of v_in/c (into the liner) at f0, complex, (P, F).
    Returns:
        R and X, (P, F); X is scaled like V: the wave is x = X e^{j omega t} + conjugate, so its
        peak pressure is 2 rho c^2 |X|.
    """
    assert means.b is not None
    away = 1 - means.a
    wave = (away.conj() * velocity + means.b * velocity.conj()) / (
        away.abs() ** 2 - means.b.abs() ** 2
    )
    safe = torch.where(wave == 0, torch.ones_like(wave), wave)
    return means.a + means.b * safe.conj() / safe, wave

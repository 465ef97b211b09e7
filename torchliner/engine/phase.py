r"""What the phase of the incident tone relative to v does to R: a rule is algebra on two means.

Over a record of velocities the replayed tone :math:`X e^{j\omega t} + \text{conjugate}` comes back as
:math:`X a + X^* b` with :math:`a = \langle R \rangle` and :math:`b = \langle R e^{-2j\omega t} \rangle`, so that
:math:`R = a + b X^*/X`. A new rule is a function here and a row of ``PHASE_RULES``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Sound:
    """What a rule may know of the sound at each column.

    Args:
        velocity: V, half the complex peak amplitude of v into the liner at f, m/s, (..., N, F).
        held: whether v is coherent enough with the tone for its phase to mean anything, bool, (N, F).
        phase: psi of the incident tone cos(omega t + psi), stated by the user, rad, (N, F or 1).
    """

    velocity: Tensor | None = None
    held: Tensor | None = None
    phase: Tensor | None = None


def averaged(a: Tensor, b: Tensor, sound: Sound) -> Tensor:
    """Over all phases, since nothing else is known: R = a."""
    return a


def given(a: Tensor, b: Tensor, sound: Sound) -> Tensor:
    r"""The phase is stated: :math:`R = a + b e^{-2j\psi}`."""
    assert sound.phase is not None
    return a + b * torch.exp(-2j * sound.phase)


def self_consistent(a: Tensor, b: Tensor, sound: Sound) -> Tensor:
    r"""The wave whose replayed reflection gives the tone in v itself.

    :math:`(1 - a) X - b X^* = V` has the solution :math:`X = [(1 - a)^* V + b V^*]/(|1 - a|^2 - |b|^2)`; iterating
    for X fails at high |v|. Where v is not coherent with the tone the rule falls back to ``averaged``.
    """
    assert sound.velocity is not None
    assert sound.held is not None
    wave = (1 - a).conj() * sound.velocity + b * sound.velocity.conj()
    wave = wave / ((1 - a).abs().square() - b.abs().square())
    wave = torch.where(wave == 0, torch.ones_like(wave), wave)
    return torch.where(sound.held, a + b * wave.conj() / wave, a)


PhaseRule = Callable[[Tensor, Tensor, Sound], Tensor]
PHASE_RULES: dict[str, PhaseRule] = {"averaged": averaged, "self-consistent": self_consistent, "given": given}

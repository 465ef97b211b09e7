"""What the phase of the incident tone relative to v does to the answer, one rule a class.

Every rule is algebra on two means of one pass, a = <R> and b = <R e^{-2 j omega t}>. A new rule is
a file like ``averaged_phase`` and a row of ``names.PHASE_RULES``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from torchliner.names import PHASE_RULES, resolve
from torchliner.replay.incident import Means

CHANCE = 0.01  # of probes that pass the limit without any tone, above which a warning is given


@dataclass(frozen=True)
class PhaseRule:
    """One rule, with what it may know of the sound in each of P columns.

    Args:
        velocity: V, half the complex peak amplitude of v into the liner, any unit, (P, F).
        coherence: squared, of v with the tone, 0 to 1, (P, F).
        minimum_coherence: below it v tells no phase.
        segments: behind ``coherence``; None where chance needs no warning.
        phase: psi of x = cos(omega t + psi), rad, (P, F or 1), for a rule that takes one.
    """

    velocity: Tensor
    coherence: Tensor
    minimum_coherence: float
    segments: int | None = None
    phase: Tensor | None = None

    needs_backward: ClassVar[bool] = True  # b, hence the reply to e^{-j omega t}
    needs_velocity: ClassVar[bool] = False  # for error bars: v's own line in each block
    several_tones: ClassVar[bool] = False  # that sound at once, and are one wave
    takes_phase: ClassVar[bool] = False  # stated by the user

    @classmethod
    def turns(cls, frequency: Tensor) -> Tensor:
        """Hz, (F, Q): beside its mean, R(f) is averaged times e^{-2 pi j turn t} of each."""
        return (2 * frequency)[:, None][:, : int(cls.needs_backward)]

    @property
    def held(self) -> Tensor:
        """Whether the rule holds there, bool, (P, F)."""
        return torch.ones_like(self.coherence, dtype=torch.bool)

    def reflection(self, means: Means) -> Tensor:
        """R, (P, F)."""
        raise NotImplementedError

    def deviation(self, means: Means, columns: slice, da: Tensor, db: Any, dv: Any) -> Tensor:
        """First-order change of R of some columns in each block, (S, p, F).

        Args:
            means: of the whole record.
            columns: p of them.
            da, db, dv: changes of a, b and V, (S, p, F); None where the rule needs none. For a rule
                of several tones ``db`` is that of ``Means.turned``, (S, p, F, Q).
        """
        raise NotImplementedError

    def notes(self, probes: int, means: Means, frequency: Tensor) -> list[str]:
        """Warnings about the first ``probes`` columns; ``frequency`` in Hz, (F,)."""
        return []


def chance_note(rule: str, pieces: str, count: int | None, limit: float) -> list[str]:
    """Where too many probes pass a limit of coherence without any tone, (1 - limit)^(S - 1)."""
    chance = 0.0 if count is None else (1 - limit) ** (count - 1)
    if chance <= CHANCE or limit == 0:
        return []
    return [
        f"{rule}: with {count} {pieces}, {100 * chance:.2g} % of probes pass a coherence of "
        f"{limit:g} without any tone; a longer record or a higher minimum_coherence is safer"
    ]


def phase_rule(name: str) -> type[PhaseRule]:
    """The rule of a name in ``names.PHASE_RULES``."""
    rule: type[PhaseRule] = resolve(PHASE_RULES[name][0])
    return rule

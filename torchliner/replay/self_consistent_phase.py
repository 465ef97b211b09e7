r"""Phase rule ``self-consistent``: the wave whose replayed reflection gives v's own tone.

X e^{j omega t} + conjugate, replayed, makes the velocity (1 - a) X - b X^* = V, hence

    X = N/(|1 - a|^2 - |b|^2),  N = (1 - a)^* V + b V^*,  R = a + b X^*/X;

iterating for X fails at high |v|. With psi the argument of N the changes of a block follow:
dR = da + u db - 2 j u b Im(dN/N), u = N^*/N, dN = -(da)^* V + (1 - a)^* dV + db V^* + b dV^*.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from torchliner.replay.incident import Means
from torchliner.replay.phase_rule import PhaseRule, chance_note


class SelfConsistent(PhaseRule):
    """The phase from v's own part at f; ``averaged`` where turbulence would set it."""

    needs_velocity = True

    @property
    def held(self) -> Tensor:
        """Where v is coherent enough with the tone."""
        return self.coherence >= self.minimum_coherence

    def _wave(self, means: Means, columns: slice) -> Tensor:
        """N, up to a real factor X."""
        v = self.velocity[columns]
        return (1 - means.a[columns]).conj() * v + means.b[columns] * v.conj()

    def reflection(self, means: Means) -> Tensor:
        """a + b X*/X, or that of ``averaged``."""
        away = (1 - means.a).abs() ** 2 - means.b.abs() ** 2
        wave = self._wave(means, slice(None)) / away
        safe = torch.where(wave == 0, torch.ones_like(wave), wave)
        return torch.where(self.held, means.a + means.b * safe.conj() / safe, means.averaged)

    def deviation(self, means: Means, columns: slice, da: Tensor, db: Any, dv: Any) -> Tensor:
        """See above; da where the rule fell back."""
        a, b, v = means.a[columns], means.b[columns], self.velocity[columns]
        wave = self._wave(means, columns)
        wave = torch.where(wave == 0, torch.ones_like(wave), wave)
        change = -da.conj() * v + (1 - a).conj() * dv + db * v.conj() + b * dv.conj()
        own = wave.conj() / wave * (db - 2j * b * (change / wave).imag)
        return da + torch.where(self.held[columns], own, 0)

    def notes(self, probes: int, means: Means, frequency: Tensor) -> list[str]:
        """How many fell back; how many pass by chance, (1 - limit)^(S - 1) of S segments."""
        held, limit = self.held[:probes], self.minimum_coherence
        notes = []
        if not bool(held.all()):
            notes.append(
                f"self-consistent phase: {int((~held).sum())} of {held.numel()} values have a "
                f"coherence below {limit:g} with the tone; they are 'averaged' instead"
            )
        said = "self-consistent phase", "segments of few periods"
        return notes + chance_note(*said, self.segments, limit)

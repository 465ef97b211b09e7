r"""Phase rule ``joint``: several tones that sound at once, each from its own part of v.

Of the wave :math:`\sum_j X_j e^{j \omega_j t}` + conjugate the reflected line at f_i is

.. math:: Y_i = \sum_j A_{ij} X_j + B_{ij} X_j^*, \qquad
   A_{ij} = \langle R(f_i) e^{j(\omega_j - \omega_i)t} \rangle, \quad
   B_{ij} = \langle R(f_i) e^{-j(\omega_j + \omega_i)t} \rangle,

and V_i = X_i - Y_i is measured: 2 F real equations for the X of F tones; then R_i = Y_i/X_i. One
tone is ``self-consistent``. With dA, dB and dV of a block, from (1 - A) dX - B dX^* = dV + dA X +
dB X^* and R = 1 - V/X follows dR = ((1 - R) dX - dV)/X.

A tone that v does not hold, by its coherence there, is no part of the wave, and R is ``averaged``.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from torchliner.replay.incident import Means
from torchliner.replay.phase_rule import PhaseRule, chance_note

MIXED = 0.1  # of a reflected line, what other tones put there, above which a note is due


class Joint(PhaseRule):
    """The phases of all tones asked for, from v's own parts at them."""

    needs_velocity = True
    several_tones = True

    @classmethod
    def turns(cls, frequency: Tensor) -> Tensor:
        """f_i + f_j, then f_i - f_j, (F, 2 F)."""
        own = frequency[:, None]
        return torch.cat([own + frequency, own - frequency], 1)

    @property
    def held(self) -> Tensor:
        """Where v is coherent enough with each tone."""
        return self.coherence >= self.minimum_coherence

    def _matrices(self, means: Means, columns: slice) -> tuple[Tensor, Tensor]:
        """A and B of some columns, (p, F, F), 0 for tones that are not held."""
        assert means.turned is not None
        held = self.held[columns]
        both = held[:, :, None] & held[:, None, :]
        against, along = torch.where(both.repeat(1, 1, 2), means.turned[columns], 0).chunk(2, -1)
        eye = torch.eye(held.shape[1], dtype=along.dtype, device=along.device)
        own = torch.where(held, means.a[columns], 0)[..., None] * eye
        return along * (1 - eye) + own, against

    def _solved(self, a: Tensor, b: Tensor, sources: Tensor) -> Tensor:
        """X of (1 - A) X - B X* = sources, (..., p, F)."""
        left = torch.eye(a.shape[-1], dtype=a.dtype, device=a.device) - a
        system = torch.cat([torch.cat([left, -b], -1), torch.cat([-b, left], -1).conj()], -2)
        both = torch.cat([sources, sources.conj()], -1)
        return torch.linalg.solve(system, both[..., None])[..., : a.shape[-1], 0]

    def _waves(self, means: Means, columns: slice = slice(None)) -> tuple[Tensor, Tensor, Tensor]:
        """A, B and X; X is 0 where a tone is not held."""
        a, b = self._matrices(means, columns)
        return a, b, self._solved(a, b, torch.where(self.held[columns], self.velocity[columns], 0))

    def reflection(self, means: Means) -> Tensor:
        """Y/X, or that of ``averaged``."""
        a, b, wave = self._waves(means)
        safe = torch.where(wave == 0, 1.0, wave)
        return torch.where(wave == 0, means.averaged, _times(a, b, wave) / safe)

    def deviation(self, means: Means, columns: slice, da: Tensor, db: Any, dv: Any) -> Tensor:
        """See above; da where the rule fell back."""
        a, b, wave = self._waves(means, columns)
        safe = torch.where(wave == 0, 1.0, wave)
        reflection = _times(a, b, wave) / safe
        against, along = db.chunk(2, -1)
        along = along + torch.diag_embed(da - along.diagonal(dim1=-2, dim2=-1))
        source = torch.where(wave == 0, 0, dv + _times(along, against, wave))
        moved = (1 - reflection) * self._solved(a, b, source) - torch.where(wave == 0, 0, dv)
        return torch.where(wave == 0, da, moved / safe)

    def notes(self, probes: int, means: Means, frequency: Tensor) -> list[str]:
        """Tones that fell back, or pass by chance; reflected lines that other tones put there."""
        held, limit, notes = self.held[:probes], self.minimum_coherence, []
        for f, count in zip(frequency.tolist(), (~held).sum(0).tolist(), strict=True):
            if count:
                notes.append(
                    f"joint phases: v has a coherence below {limit:g} with {f:g} Hz at {count} of "
                    f"{probes} probes; there that tone counts as not sent, and its R is 'averaged'"
                )
        notes += chance_note("joint phases", "blocks", self.segments, limit)
        a, b, wave = self._waves(means, slice(0, probes))
        reflected = _times(a, b, wave)
        own = means.a[:probes] * wave + b.diagonal(dim1=-2, dim2=-1) * wave.conj()
        share = ((reflected - own) / torch.where(wave == 0, 1.0, reflected)).abs()
        for i, f in enumerate(frequency.tolist()):
            mine = share[wave[:, i] != 0, i]
            if len(mine) and float(mine.median()) > MIXED:
                notes.append(
                    f"joint phases: of the sound reflected at {f:g} Hz a share of "
                    f"{float(mine.median()):.2g} (median of the probes, limit {MIXED:g}) is what "
                    "|v(t)| makes of the other tones: R and Z there belong to this mixture of "
                    "tones with these levels and phases; phase='averaged' leaves it out"
                )
        return notes


def _times(a: Tensor, b: Tensor, wave: Tensor) -> Tensor:
    """A X + B X*, (..., F)."""
    return (a @ wave[..., None] + b @ wave.conj()[..., None])[..., 0]

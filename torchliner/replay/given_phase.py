"""Phase rule ``given``: a reference signal or the user states the phase of the incident tone."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from torchliner.replay.incident import Means
from torchliner.replay.phase_rule import PhaseRule


class Given(PhaseRule):
    r"""R of x = cos(omega t + psi): :math:`a + b e^{-2 j \psi}`."""

    takes_phase = True

    def _turn(self) -> Tensor:
        assert self.phase is not None
        return torch.exp(-2j * self.phase)

    def reflection(self, means: Means) -> Tensor:
        """a + b e^{-2 j psi}."""
        return means.a + means.b * self._turn()

    def deviation(self, means: Means, columns: slice, da: Tensor, db: Any, dv: Any) -> Tensor:
        """da + db e^{-2 j psi}."""
        return da + db * self._turn()[columns]

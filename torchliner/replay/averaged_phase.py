"""Phase rule ``averaged``: over all phases of the incident tone, since nothing is known of it."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from torchliner.replay.incident import Means
from torchliner.replay.phase_rule import PhaseRule


class Averaged(PhaseRule):
    """R of the complex tone: the line at 2 f drops out."""

    needs_backward = False

    def reflection(self, means: Means) -> Tensor:
        """Of e^{j omega t}."""
        return means.averaged

    def deviation(self, means: Means, columns: slice, da: Tensor, db: Any, dv: Any) -> Tensor:
        """da."""
        return da

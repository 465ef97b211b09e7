"""Z that agrees with a known level: a measurement by pressure and velocity, with the model for its phase."""

from __future__ import annotations

from torch import Tensor

from torchliner.records.declared import record, var


@record
class LevelMatched:
    """Z with the incoherent velocity scaled until the level check is 0; nan where that cannot be had.

    It measures |Z + 1| (from an incident wave) or |Z| (from a pressure at the wall); the phase is the model's. The
    bounds hold the scatter of the record and the stated uncertainty of the level.

    Args:
        uncertainty: of the level, as stated, dB.
    """

    impedance: Tensor = var("frequency", name="{}", text="that agrees with the known level")
    low: Tensor = var("frequency", name="{}_low", wide=True, text="lower bound,")
    high: Tensor = var("frequency", name="{}_high", wide=True, text="upper bound,")
    share: Tensor = var("frequency", wide=True, text="share of the answer's incoherent velocity")
    share_low: Tensor = var("frequency", wide=True, text="lower bound of the share")
    share_high: Tensor = var("frequency", wide=True, text="upper bound of the share")
    sensitivity: Tensor = var(
        "frequency", unit="dB", wide=True, text="change of the level check by a factor e in the incoherent velocity"
    )
    uncertainty: float = 0.0

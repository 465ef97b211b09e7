"""Level check: the pressure that velocity and impedance imply, against one that is known."""

import math

import torch
from torch import Tensor

from torchliner.records.declared import part, record, var

UNKNOWN = "not checked, state incident_level= or give wall pressures"
DEGREES_PER_DB = math.degrees(math.log(10) / 20)  # of equal weight in a complex ratio: 6.6
PASSES, INCONCLUSIVE, FAILS = "passes", "inconclusive", "fails"


@record
class Gap:
    """Implied over known pressure; float64 tensors of one shape.

    nan where nothing is known: bounds also without intervals, the phase also where what is known has none.
    """

    level: Tensor = var(unit="dB", name="level_gap", wide=True, text="implied over known pressure,")
    level_low: Tensor = var(unit="dB", name="level_gap_low", wide=True, text="lower bound of the level gap")
    level_high: Tensor = var(unit="dB", name="level_gap_high", wide=True, text="upper bound of the level gap")
    phase: Tensor = var(unit="degree", name="phase_gap", wide=True, text="implied less known phase,")
    phase_low: Tensor = var(unit="degree", name="phase_gap_low", wide=True, text="lower bound of the phase gap")
    phase_high: Tensor = var(unit="degree", name="phase_gap_high", wide=True, text="upper bound of the phase gap")

    def at(self, *place: int) -> dict[str, float | None]:
        """Plain values of one place, None for what is not known."""
        found = {name: float(value[place]) for name, value in vars(self).items()}
        return {name: value if math.isfinite(value) else None for name, value in found.items()}


@record
class LevelCheck:
    """How far an impedance and the velocity it belongs to are off a pressure that is known.

    Args:
        averaging: that of the answer, by which the whole is judged.
        known: what the pressure is, and which formula it is compared by, in words.
        kind: ``incident`` or ``wall``.
        limit: dB beyond which the check fails, the stated uncertainty of the level included.
        uncertainty: of the level, as stated, dB.
        confidence: of the statistical bounds, 0 to 1; None without any.
    """

    averagings: tuple[str, ...] = var("averaging", kind="text", name="averaging", text="averaging over the probes")
    averaging: str
    known: str
    kind: str
    pressure_level: Tensor = var("frequency", unit="dB", name="known_pressure_level", text="at the wall, nan: unknown")
    limit: float
    uncertainty: float
    confidence: float | None
    liner: Gap = part("", "averaging", "frequency", text="of the whole")
    cells: Gap = part("place_", "averaging", "places", "frequency", text="of each place")

    def verdict(self, averaging: str, index: int = 0) -> str:
        """Of the whole at one frequency: ``passes``, ``fails``, or ``inconclusive`` where the interval reaches back
        into the limit (that of the phase is as large an error of Z); "" where there is nothing to compare."""
        place, found = (self.averagings.index(averaging), index), []
        level, phase = torch.stack([value[place] for value in vars(self.liner).values()]).unflatten(0, (2, 3)).tolist()
        for (value, low, high), most in ((level, self.limit), (phase, self.limit * DEGREES_PER_DB)):
            if math.isfinite(value):
                low, high = (low, high) if math.isfinite(low) and math.isfinite(high) else (value, value)
                found.append(PASSES if abs(value) <= most else FAILS if low > most or high < -most else INCONCLUSIVE)
        if not math.isfinite(level[0]):
            return ""
        return next(word for word in (FAILS, INCONCLUSIVE, PASSES) if word in found)

    @property
    def failed(self) -> bool:
        """Whether the answer's averaging is beyond the limit at any frequency, whatever its interval."""
        count = len(self.pressure_level)
        return any(self.verdict(self.averaging, index) in (FAILS, INCONCLUSIVE) for index in range(count))

    def words(self, averaging: str, index: int = 0) -> str:
        """'-2.61 dB (-2.62 to -2.60), +3.1 degrees fails'; '-' where nothing is compared."""
        verdict = self.verdict(averaging, index)
        here, parts = self.liner.at(self.averagings.index(averaging), index), []
        for name, unit, digits in (("level", "dB", ".2f"), ("phase", "degrees", ".1f")):
            if here[name] is not None:
                low, high = here[f"{name}_low"], here[f"{name}_high"]
                bounds = "" if low is None else f" ({low:+{digits}} to {high:+{digits}})"
                parts.append(f"{here[name]:+{digits}} {unit}{bounds}")
        return f"{', '.join(parts)} {verdict}" if verdict else "-"

    def sentence(self, averaging: str, frequency: float, index: int = 0) -> str:
        """Why one averaging fails or is inconclusive at a frequency, and what to try; "" otherwise."""
        verdict = self.verdict(averaging, index)
        if verdict in ("", PASSES):
            return ""
        text = f"level check at {frequency:g} Hz, {averaging}: {self.words(averaging, index)}, off {self.known}, limit "
        text += f"{self.limit:.2g} dB or {self.limit * DEGREES_PER_DB:.2g} degrees: "
        tried = "give a run without sound (--background), calibrate the model, or take another height"
        return text + ("take a longer record" if verdict == INCONCLUSIVE else tried)


@record
class LevelMatched:
    """Z with the incoherent velocity scaled until the level check is 0; nan where no scale does that.

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
    sensitivity: Tensor = var("frequency", unit="dB", wide=True, text="change of the gap by a factor e in it")
    uncertainty: float = 0.0

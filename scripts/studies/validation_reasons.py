"""Why the rules miss: the velocity in the holes put through the model, and what the model can return."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from scipy.optimize import brentq

from studies.hole_velocity import hole_velocity
from studies.limits import reach, speed_that_gives
from torchliner.liners.sdof import SDoFLiner
from torchliner.records import PressureRecord, VelocityPlane
from torchliner.velocity.educe import educe

FASTEST = 100.0  # m/s, for the sets that a model can reach; o145 and the g cases stay below
Pair = tuple[float | None, float | None]


@dataclass(frozen=True)
class Reason:
    """One case with the velocity of its own holes, and what the model could return at all.

    Args:
        case, true: name; reference Z, normalised.
        speed: rms velocity in the holes times the porosity, m/s: the model's |v|.
        replayed, self_consistent, of_rms: Z educed from that velocity: default rules, with the phase that the tone in
            it sets, and from its rms.
        for_resistance, for_reactance: rms of a constant |v| and of a sine that give the reference R (X), m/s; None
            where none does.
        nearest: to the reference, of all that |v(t)| up to ``FASTEST`` gives with the phase averaged.
        factor: on the velocity of the holes that gives the reference R, replayed and as an rms; None where none from
            0.2 to 10 does.
        contraction: contraction coefficient that does, likewise, from 0.05 to 1.
    """

    case: str
    true: complex
    speed: float
    replayed: complex
    self_consistent: complex
    of_rms: complex
    for_resistance: Pair
    for_reactance: Pair
    nearest: complex
    factor: Pair
    contraction: Pair

    def plain(self) -> dict[str, Any]:
        """For CSV: pairs and complex values as two numbers."""
        row: dict[str, Any] = {}
        for key, value in vars(self).items():
            if isinstance(value, complex):
                row |= {f"{key}_resistance": value.real, f"{key}_reactance": value.imag}
            elif isinstance(value, tuple):
                ends = ("replayed", "rms") if key in ("factor", "contraction") else ("constant", "sine")
                row |= {f"{key}_{end}": "" if v is None else v for end, v in zip(ends, value, strict=True)}
            else:
                row[key] = value
        return row


def reason_of(record: PressureRecord, liner: SDoFLiner, case: str) -> Reason:
    """Of a case whose cavity pressure and reference impedance are known."""
    true, frequency = complex(record.reference["true"]), record.frequency
    assert frequency is not None
    holes = hole_velocity(record)

    def educed(**choices: Any) -> complex:
        found = educe(holes, liner, interval=None, averaging="admittance", **choices)
        return complex(found.answer[0])

    def needed(part: str) -> Pair:
        value = getattr(true, part)
        constant, sine = (
            speed_that_gives(liner, frequency, value, part, shape, FASTEST) for shape in ("constant", "sine")
        )
        return constant, sine

    return Reason(
        case=case,
        true=true,
        speed=float(holes.velocity.square().mean().sqrt()),
        replayed=educed(),
        self_consistent=educed(phase="self-consistent"),
        of_rms=educed(drive="rms"),
        for_resistance=needed("real"),
        for_reactance=needed("imag"),
        nearest=reach(liner, frequency, FASTEST).nearest(true),
        factor=_that_gives("velocity_gain", 0.2, 10.0, holes, liner, true.real),
        contraction=_that_gives("vena_contracta", 0.05, 1.0, holes, liner, true.real),
    )


def _that_gives(name: str, low: float, high: float, holes: VelocityPlane, liner: SDoFLiner, resistance: float) -> Pair:
    """Value of a parameter of the liner with which the holes' velocity gives R: replayed, rms."""

    def solved(drive: str) -> float | None:
        def excess(value: float) -> float:
            changed = liner.replace(**{name: value})
            found = educe(holes, changed, interval=None, averaging="admittance", drive=drive)
            return complex(found.answer[0]).real - resistance

        if excess(low) * excess(high) > 0:
            return None
        return float(brentq(excess, low, high, xtol=1e-4))

    return solved("instantaneous"), solved("rms")

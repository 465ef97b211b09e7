"""Why the rules miss: numbers on the velocity, on the holes and on what the model can return."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from scipy.optimize import brentq

from studies.harmonics import phase_locked_power
from studies.hole_velocity import hole_velocity
from studies.limits import reach, speed_that_gives
from torchliner.liners.sdof import SDoFLiner
from torchliner.records import PressureRecord, VelocityPlane
from torchliner.records.cells import sort_into_cells
from torchliner.velocity.educe import educe

FASTEST = 100.0  # m/s, for the sets that a model can reach; o145 and the g cases stay below


@dataclass(frozen=True)
class MotionRow:
    """The velocity of a plane, or of the holes; speeds in m/s, averages over probes as squares.

    Args:
        case, height: m; None for the holes, whose velocity is per unit of the liner's surface.
        rms: v'_rms.
        tone, harmonics, rest: shares of v'^2: keeping step with the tone, with its harmonics 2 to
            8, and neither. Estimates, so a share may be slightly below 0 or above 1.
        cell_rms: rms of the velocity averaged over each cell.
        blocks: of two periods behind the shares.
    """

    case: str
    height: float | None
    rms: float
    tone: float
    harmonics: float
    rest: float
    cell_rms: float
    blocks: int


def motion_row(plane: VelocityPlane, case: str, pitch: float | None = None) -> MotionRow:
    """Of a plane that states its tone.

    Args:
        plane: velocities.
        case: name.
        pitch: side of a cell, m; None counts every probe as a cell of its own.
    """
    assert plane.frequency is not None
    velocity = plane.load().velocity.reshape(plane.probes, -1).to(torch.float64)
    power = phase_locked_power(velocity, plane.frequency, plane.sampling_rate)
    total = float(power.variance.mean())
    averaged = velocity
    if pitch is not None:
        used = torch.ones(plane.probes, dtype=torch.bool)
        averaged = sort_into_cells(plane, pitch).membership(used).T @ velocity
    tone, harmonics, rest = (float(part.mean()) / total for part in (power.tone, power.harmonics, power.rest))
    cells = float(averaged.var(-1, correction=0).mean())
    return MotionRow(case, plane.height, total**0.5, tone, harmonics, rest, cells**0.5, power.blocks)


@dataclass(frozen=True)
class ReasonRow:
    """One case with the velocity of its own holes, and what the model could return at all.

    Args:
        case, true: name; Z, normalised.
        speed: rms velocity in the holes times the porosity, m/s: the model's |v|.
        tone: share of its square that keeps step with the tone.
        replayed, self_consistent, of_rms: Z educed from that velocity: default rules, with the
            phase that the tone in it sets, and from its rms.
        quasi_steady: R of the model at ``speed`` with S_t = 0, its factor 1/(1 + 2 S_t E) left out.
        at_rest, lowest: reactance of the model at |v| = 0 and as |v| grows without bound.
        for_resistance, for_reactance: rms of a constant |v| and of a sine that give the true R
            (the true X), m/s; None where none does.
        nearest: to the truth, of all that |v(t)| up to 100 m/s gives with the phase averaged.
        factor: on the velocity of the holes that gives the true R, replayed and as an rms; None
            where none from 0.2 to 10 does.
        contraction: vena contracta that does, likewise, from 0.05 to 1.
    """

    case: str
    true: complex
    speed: float
    tone: float
    replayed: complex
    self_consistent: complex
    of_rms: complex
    quasi_steady: float
    at_rest: float
    lowest: float
    for_resistance: tuple[float | None, float | None]
    for_reactance: tuple[float | None, float | None]
    nearest: complex
    factor: tuple[float | None, float | None]
    contraction: tuple[float | None, float | None]

    def plain(self) -> dict[str, Any]:
        """For CSV: pairs and complex values as two numbers."""
        row: dict[str, Any] = {}
        for key, value in vars(self).items():
            if isinstance(value, complex):
                row[f"{key}_resistance"], row[f"{key}_reactance"] = value.real, value.imag
            elif isinstance(value, tuple):
                ends = ("replayed", "rms") if key in ("factor", "contraction") else ("constant", "sine")
                for end, v in zip(ends, value, strict=True):
                    row[f"{key}_{end}"] = "" if v is None else v
            else:
                row[key] = value
        return row


def reason_row(record: PressureRecord, liner: SDoFLiner, case: str) -> ReasonRow:
    """Of a case whose cavity pressure and true impedance are known.

    Args:
        record: pressures, with a reference ``true``.
        liner: the model to be judged.
        case: name.
    Raises:
        ValueError: the record states no true impedance or no tone.
    """
    if "true" not in record.reference or record.frequency is None:
        raise ValueError(f"{record.name} states no true impedance or no tone")
    true, frequency = complex(record.reference["true"]), record.frequency
    holes = hole_velocity(record)
    motion = motion_row(holes, case)
    speed = float(holes.velocity.square().mean().sqrt())

    def educed(**choices: Any) -> complex:
        found = educe(holes, liner, interval=None, **choices)
        return complex(found.liner["admittance"].impedance[0])

    fast = 1e9  # m/s: all of the mass is lost, and the resistance grows in a straight line
    rest, end = (complex(liner.impedance(frequency, v)) for v in (0.0, fast))
    return ReasonRow(
        case=case,
        true=true,
        speed=speed,
        tone=motion.tone,
        replayed=educed(),
        self_consistent=educed(phase="self-consistent"),
        of_rms=educed(drive="rms"),
        quasi_steady=rest.real + (end.real - rest.real) * speed / fast,
        at_rest=rest.imag,
        lowest=end.imag,
        for_resistance=_needed(liner, frequency, true.real, "resistance"),
        for_reactance=_needed(liner, frequency, true.imag, "reactance"),
        nearest=reach(liner, frequency, FASTEST).nearest(true),
        factor=_that_gives("velocity_gain", 0.2, 10.0, holes, liner, true.real),
        contraction=_that_gives("vena_contracta", 0.05, 1.0, holes, liner, true.real),
    )


def _that_gives(
    name: str, low: float, high: float, holes: VelocityPlane, liner: SDoFLiner, resistance: float
) -> tuple[float | None, float | None]:
    """Value of a parameter of the liner with which the holes' velocity gives R: replayed, rms."""

    def solved(drive: str) -> float | None:
        def excess(value: float) -> float:
            found = educe(holes, liner.replace(**{name: value}), interval=None, drive=drive)
            return float(found.liner["admittance"].impedance[0].real) - resistance

        if excess(low) * excess(high) > 0:
            return None
        return float(brentq(excess, low, high, xtol=1e-4))

    return solved("instantaneous"), solved("rms")


def _needed(liner: SDoFLiner, frequency: float, value: float, part: str) -> tuple[float | None, float | None]:
    constant, sine = (
        speed_that_gives(liner, frequency, value, part, waveform, FASTEST) for waveform in ("constant", "sine")
    )
    return constant, sine


def plain_motion(rows: Sequence[MotionRow]) -> list[dict[str, Any]]:
    """For CSV."""
    return [{**vars(row), "height": "" if row.height is None else row.height} for row in rows]

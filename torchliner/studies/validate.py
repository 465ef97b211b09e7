"""Validation: every drive, mean, phase rule and averaging beside the reference impedance of resolved cases."""

from __future__ import annotations

import dataclasses
import itertools
import math
import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import torch

from torchliner.conversions import reflection_from_impedance
from torchliner.liners.model import Liner, as_liner
from torchliner.names import PHASES
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.studies.reference_cases import tone_speed
from torchliner.studies.variants import Source, Variant
from torchliner.velocity.answer import answer
from torchliner.velocity.choices import Choices

DRIVES = (("instantaneous", "kept"), ("instantaneous", "removed"), ("rms", "kept"), ("running-rms", "kept"))
DEFAULT = ("instantaneous", "kept", "averaged")
NOWHERE = complex(math.nan, math.nan)


@dataclass(frozen=True)
class ValidationRow:
    """One educed value beside the reference impedance, all normalised.

    Args:
        case, height: of the plane; height in m.
        drive, mean, phase, averaging: the rule.
        educed, true: Z, and the reference impedance.
        in_situ: what the file states for the in situ method, nan if it states none.
        low, high: bounds of the statistical interval (real parts: R, imaginary: X).
        level_check: level of the incident wave that Z and velocity imply over the stated one, dB; nan where it was
            not checked.
        speed: rms of the plane's mean velocity at the tone, m/s.
        velocity_rms: v'_rms over the probes, m/s.
        mach, incident_level: as the plane states them; nan where it does not.
        periods: of the tone in the record.
    """

    case: str
    height: float
    drive: str
    mean: str
    phase: str
    averaging: str
    educed: complex
    true: complex
    in_situ: complex = NOWHERE
    low: complex = NOWHERE
    high: complex = NOWHERE
    level_check: float = math.nan
    speed: float = math.nan
    velocity_rms: float = math.nan
    mach: float = math.nan
    incident_level: float = math.nan
    periods: float = math.nan

    @property
    def rule(self) -> tuple[str, str, str]:
        """Drive, mean and phase."""
        return self.drive, self.mean, self.phase

    @property
    def miss(self) -> complex:
        """Z less the reference: dR + j dX, in rho c."""
        return self.educed - self.true

    @property
    def error(self) -> float:
        """|Z less the reference|, in rho c."""
        return abs(self.miss)


def reference_wave_phase(plane: VelocityPlane, seen: ImpedanceMap) -> float:
    """Phase of the incident wave (rad) from the plane-mean velocity at f and the REFERENCE impedance.

    Only a resolved case knows it; with measured data a reference microphone has to give it.
    """
    reflection = reflection_from_impedance(torch.tensor(plane.reference["true"]))
    amplitude = seen.velocity_amplitude[..., 0].mean()
    return float((amplitude / (1 - reflection)).angle())


def validate(plane: VelocityPlane, liner: Liner) -> Iterator[ValidationRow]:
    """All drives x phase rules x averagings of one plane with a known impedance, in two readings.

    Short records are taken too: the rows say how many periods they rest on.

    Raises:
        ValueError: the plane states no reference impedance or no tone.
    """
    if "true" not in plane.reference:
        raise ValueError(f"{plane.name} states no reference impedance (reference 'true')")
    chosen, model = Choices(phase="given", allow_short=True), as_liner(liner)
    # The rms of the record is known after one reading, which finds what the other drives need.
    source = Source(plane, [model], None, dataclasses.replace(chosen, drive="rms"))
    with torch.no_grad():
        seen = answer(source.known, model, source.frequency, dataclasses.replace(source.chosen, phase="averaged"))
    psi = reference_wave_phase(plane, seen)
    ways = [
        Variant("", "", chosen.averaging, dataclasses.replace(chosen, drive=drive, mean=mean)) for drive, mean in DRIVES
    ]
    variants = [
        dataclasses.replace(
            way,
            averaging=averaging,
            chosen=dataclasses.replace(way.chosen, phase=phase),
            moments=known,
            psi=psi if phase == "given" else None,
        )
        for way, known in zip(ways, source.moments_of(ways), strict=True)
        for phase, averaging in itertools.product(PHASES, seen.averagings)
    ]
    for each in source.evaluate(variants):
        rule, interval = each.variant.chosen, each.found.liner.interval
        low, high = (NOWHERE, NOWHERE) if interval is None else interval.bounds(0)
        yield ValidationRow(
            case=str(plane.provenance.get("case", plane.title)),
            height=plane.height or 0.0,
            drive=rule.drive,
            mean=rule.mean,
            phase=rule.phase,
            averaging=each.variant.averaging,
            educed=complex(each.impedance[0]),
            true=complex(plane.reference["true"]),
            in_situ=complex(plane.reference.get("in situ", NOWHERE)),
            low=low,
            high=high,
            level_check=float(each.level_check[0]),
            speed=tone_speed(seen),
            velocity_rms=float(seen.velocity_rms.square().nanmean().sqrt()),
            mach=math.nan if plane.mach is None else plane.mach,
            incident_level=math.nan if plane.incident_level is None else plane.incident_level,
            periods=float(plane.duration * (plane.frequency or math.nan)),
        )


def validation_table(
    planes: Sequence[VelocityPlane],
    liner_of: Callable[[VelocityPlane], Liner],
    progress: Callable[[int], None] | None = None,
) -> list[ValidationRow]:
    """``validate`` of several planes, by case and height; ``progress`` per plane."""
    rows: list[ValidationRow] = []
    for plane in planes:
        rows += validate(plane, liner_of(plane))
        if progress is not None:
            progress(1)
    return rows


@dataclass(frozen=True)
class RuleErrors:
    """Errors of one rule over planes: medians and largest of |dR| (real part) and |dX|."""

    drive: str
    mean: str
    phase: str
    averaging: str
    planes: int
    median: complex
    largest: complex


def errors_by_rule(rows: Sequence[ValidationRow]) -> list[RuleErrors]:
    """Of every rule in the rows, in their order."""
    groups: dict[tuple[str, str, str, str], list[complex]] = {}
    for row in rows:
        groups.setdefault((*row.rule, row.averaging), []).append(row.miss)
    found = []
    for rule, misses in groups.items():
        parts = [[abs(miss.real) for miss in misses], [abs(miss.imag) for miss in misses]]
        median = complex(statistics.median(parts[0]), statistics.median(parts[1]))
        largest = complex(max(parts[0]), max(parts[1]))
        found.append(RuleErrors(*rule, len(misses), median, largest))
    return found

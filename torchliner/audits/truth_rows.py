"""Every rule beside the reference impedance of resolved cases."""

from __future__ import annotations

import dataclasses
import math
import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import torch

from torchliner.audits.known_truths import tone_speed
from torchliner.conversions import reflection_from_impedance
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import choose_nodes
from torchliner.liners.model import Liner, as_liner
from torchliner.names import PHASES
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.studies.source import Further, Source
from torchliner.velocity.answer import answer
from torchliner.velocity.choices import Choices

DRIVES = (("instantaneous", "kept"), ("instantaneous", "removed"), ("rms", "kept"), ("running-rms", "kept"))
DEFAULT = ("instantaneous", "kept", "averaged")
NOWHERE = complex(float("nan"), float("nan"))


@dataclass(frozen=True)
class TruthRow:
    """One educed value beside the reference impedance, all normalised.

    Args:
        case, height: of the plane; height in m.  drive, mean, phase, averaging: the rule.
        educed, true: Z.
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
        """Z - Z_true: dR + j dX, in rho c."""
        return self.educed - self.true

    @property
    def error(self) -> float:
        """|Z - Z_true|, in rho c."""
        return abs(self.miss)


def true_wave_phase(plane: VelocityPlane, seen: ImpedanceMap) -> float:
    """Phase of the incident wave (rad) from the plane-mean velocity at f and the REFERENCE impedance.

    Only a resolved case knows it; with measured data a reference microphone has to give it.
    """
    reflection = reflection_from_impedance(torch.tensor(plane.reference["true"]))
    amplitude = seen.velocity_amplitude[..., 0].mean()
    return float((amplitude / (1 - reflection)).angle())


def truth_rows(plane: VelocityPlane, liner: Liner) -> Iterator[TruthRow]:
    """All drives x phase rules x averagings of one plane with a known impedance, in two readings.

    Short records are taken too: the rows say how many periods they rest on.

    Raises:
        ValueError: the plane states no reference impedance or no tone.
    """
    if "true" not in plane.reference:
        raise ValueError(f"{plane.name} states no reference impedance (reference 'true')")
    case = str(plane.provenance.get("case", plane.title))
    model, chosen = as_liner(liner), Choices(phase="given", allow_short=True)
    frequency = plane.asked()
    nodes = choose_nodes([model], frequency, chosen.tolerance(plane.velocity.dtype))
    ways = [dataclasses.replace(chosen, drive=drive, mean=mean) for drive, mean in DRIVES]
    # The rms of the record is known after one reading, which finds what the other drives need.
    source = Source(plane, model, frequency, nodes, dataclasses.replace(chosen, drive="rms"))
    others = iter(source.others([Further(way) for way in ways if way.drive != "rms"]))
    for way in ways:
        known = source.known if way.drive == "rms" else next(others)

        def educed(phase: str, psi: float | None = None, way: Choices = way, known: Moments = known) -> ImpedanceMap:
            with torch.no_grad():
                return answer(known, model, frequency, dataclasses.replace(way, phase=phase), psi)

        averaged = educed("averaged")
        about = facts_of(plane, averaged)
        for phase in PHASES:
            found = educed(phase, true_wave_phase(plane, averaged) if phase == "given" else None)
            for averaging in found.averagings:
                low, high = found.bounds_of_liner(averaging) or (NOWHERE, NOWHERE)
                yield TruthRow(
                    case,
                    plane.height or 0.0,
                    way.drive,
                    way.mean,
                    phase,
                    averaging,
                    complex(found.liner[averaging].impedance[0]),
                    complex(plane.reference["true"]),
                    complex(plane.reference.get("in situ", NOWHERE)),
                    low,
                    high,
                    level_check_of(found, averaging),
                    **about,
                )


def level_check_of(found: ImpedanceMap, averaging: str) -> float:
    """dB, of the whole plane; nan where it was not checked."""
    check = found.level_check
    if check is None or averaging not in check.averagings:
        return math.nan
    return float(check.liner.level[check.averagings.index(averaging), 0])


def facts_of(plane: VelocityPlane, seen: ImpedanceMap) -> dict[str, float]:
    """What the rows of a plane share besides the reference."""
    stated = {"mach": plane.mach, "incident_level": plane.incident_level}
    return {
        "speed": tone_speed(seen),
        "velocity_rms": float(seen.velocity_rms.square().nanmean().sqrt()),
        **{name: math.nan if value is None else value for name, value in stated.items()},
        "periods": float(plane.duration * (plane.frequency or math.nan)),
    }


def truth_table(
    planes: Sequence[VelocityPlane],
    liner_of: Callable[[VelocityPlane], Liner],
    progress: Callable[[int], None] | None = None,
) -> list[TruthRow]:
    """``truth_rows`` of several planes, by case and height; ``progress`` per plane."""
    rows: list[TruthRow] = []
    for plane in planes:
        rows += truth_rows(plane, liner_of(plane))
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


def errors_by_rule(rows: Sequence[TruthRow]) -> list[RuleErrors]:
    """Of every rule in the rows, in their order."""
    groups: dict[tuple[str, str, str, str], list[complex]] = {}
    for row in rows:
        groups.setdefault((*row.rule, row.averaging), []).append(row.miss)
    return [
        RuleErrors(
            *rule,
            len(misses),
            *(
                complex(pick([abs(m.real) for m in misses]), pick([abs(m.imag) for m in misses]))
                for pick in (statistics.median, max)
            ),
        )
        for rule, misses in groups.items()
    ]

"""Every rule beside the true impedance of resolved cases."""

from __future__ import annotations

import dataclasses
import math
import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import torch

from torchliner.audits.known_truths import tone_speed
from torchliner.audits.variants import with_drive
from torchliner.conversions import reflection_from_impedance
from torchliner.liners.model import Liner
from torchliner.names import PHASE_RULES
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.replay.phase_rule import phase_rule
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.educe import replay
from torchliner.tdibc.prepare import prepare

DRIVES = (
    ("instantaneous", "kept"),
    ("instantaneous", "removed"),
    ("rms", "kept"),
    ("running-rms", "kept"),
)
PHASES = tuple(name for name in PHASE_RULES if not phase_rule(name).several_tones)
DEFAULT = ("instantaneous", "kept", "averaged")
NOWHERE = complex(float("nan"), float("nan"))


@dataclass(frozen=True)
class TruthRow:
    """One educed value beside the truth, all normalised.

    Args:
        case, height: of the plane; height in m.  drive, mean, phase, order: the rule.
        educed, true: Z.
        in_situ: what the file states for the in situ method, nan if it states none.
        low, high: bounds of the statistical interval (real parts: R, imaginary: X); nan where the
            replay did not keep the blocks that the rule needs (``self-consistent``).
        closure: level of the incident wave that Z and velocity imply over the stated one, dB; nan
            where it was not checked.
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
    order: str
    educed: complex
    true: complex
    in_situ: complex = NOWHERE
    low: complex = NOWHERE
    high: complex = NOWHERE
    closure: float = math.nan
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
    """Phase of the incident wave (rad) from the plane-mean velocity at f and the TRUE impedance.

    Only a resolved case knows it; with measured data a reference microphone has to give it.
    """
    reflection = reflection_from_impedance(torch.tensor(plane.reference["true"]))
    amplitude = seen.velocity_amplitude[..., 0].mean()
    return float((amplitude / (1 - reflection)).angle())


def truth_rows(plane: VelocityPlane, liner: Liner) -> Iterator[TruthRow]:
    """All drives x phase rules x averaging orders of one plane with a known impedance.

    Short records are taken too: the rows say how many periods they rest on.

    Raises:
        ValueError: the plane states no true impedance or no tone.
    """
    if "true" not in plane.reference:
        raise ValueError(f"{plane.name} states no true impedance (reference 'true')")
    case = str(plane.provenance.get("case", plane.title))
    # The rms of the record is known after one reading, and its error bars keep blocks of v.
    chosen = Choices(drive="rms", allow_short=True)
    (of_rms,) = prepare([plane], liner, None, chosen, every_rule=True)
    others = dataclasses.replace(of_rms, survey=dataclasses.replace(of_rms.survey, blocks=None))
    for drive, mean in DRIVES:
        of_drive = of_rms
        if drive != "rms":
            of_drive = with_drive(others, drive, mean, every_rule=True)
        replayed = replay(of_drive)
        averaged = replayed.map("averaged")
        about = facts_of(plane, averaged)
        for phase in PHASES:
            known = true_wave_phase(plane, averaged) if phase_rule(phase).takes_phase else None
            found = replayed.map(phase, known)
            for order in found.orders:
                low, high = found.bounds_of_liner(order) or (NOWHERE, NOWHERE)
                yield TruthRow(
                    case, plane.height or 0.0, drive, mean, phase, order,
                    complex(found.of_liner(order)[0]), complex(plane.reference["true"]),
                    complex(plane.reference.get("in situ", NOWHERE)), low, high,
                    closure_of(found, order), **about,
                )  # fmt: skip


def closure_of(found: ImpedanceMap, order: str) -> float:
    """dB, of the whole plane; nan where it was not checked."""
    closure = getattr(found, "closure", None)
    if closure is None or order not in closure.orders:
        return math.nan
    return float(closure.liner.level[closure.orders.index(order), 0])


def facts_of(plane: VelocityPlane, seen: ImpedanceMap) -> dict[str, float]:
    """What the rows of a plane share besides the truth."""
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
    """``truth_rows`` of several planes, ordered by case and height; ``progress`` per plane."""
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
    order: str
    planes: int
    median: complex
    largest: complex


def errors_by_rule(rows: Sequence[TruthRow]) -> list[RuleErrors]:
    """Of every rule in the rows, in their order."""
    groups: dict[tuple[str, str, str, str], list[complex]] = {}
    for row in rows:
        groups.setdefault((*row.rule, row.order), []).append(row.miss)
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

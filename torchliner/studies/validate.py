"""Validation: every drive, mean, phase rule and averaging beside the reference impedance of resolved cases."""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import torch

from torchliner.conversions import reflection_from_impedance
from torchliner.liners.model import Liner, as_liner
from torchliner.names import PHASES
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.studies.reference_cases import tone_speed
from torchliner.studies.rows import Row
from torchliner.studies.variants import Source, Variant
from torchliner.velocity.answer import answer
from torchliner.velocity.choices import Choices

DRIVES = (("instantaneous", "kept"), ("instantaneous", "removed"), ("rms", "kept"), ("running-rms", "kept"))
DEFAULT = ("instantaneous", "kept", "averaged")
NOWHERE = complex(math.nan, math.nan)
UNKNOWN = dict.fromkeys(("in_situ", "low", "high"), NOWHERE) | dict.fromkeys(
    ("level_check", "speed", "velocity_rms", "mach", "incident_level", "periods"), math.nan
)


def validation_row(rule: tuple[str, str, str], educed: complex, true: complex, **about: Any) -> Row:
    """One educed value beside the reference impedance ``true``, all normalised.

    Args:
        rule: drive, mean and phase.
        educed, true: Z, and the reference impedance.
        about: case, height (m) and averaging; where known in_situ (what the file states for the in situ method), low,
            high (of the statistical interval: R + jX), level_check (dB), speed (rms of the plane's mean velocity at the
            tone, m/s), velocity_rms (v'_rms over the probes, m/s), mach, incident_level (dB), periods (of the tone in
            the record).
    Returns:
        These, nan where unknown, and drive, mean, phase, miss (dR + j dX) and error (its size).
    """
    names, miss = dict(zip(("drive", "mean", "phase"), rule, strict=True)), educed - true
    known = {name: value for name, value in about.items() if value is not None}
    return Row(UNKNOWN | names | known, rule=rule, educed=educed, true=true, miss=miss, error=abs(miss))


def reference_wave_phase(plane: VelocityPlane, seen: ImpedanceMap) -> float:
    """Phase of the incident wave (rad) from the plane-mean velocity at f and the REFERENCE impedance.

    Only a resolved case knows it; with measured data a reference microphone has to give it.
    """
    reflection = reflection_from_impedance(torch.tensor(plane.reference["true"]))
    return float((seen.velocity_amplitude[..., 0].mean() / (1 - reflection)).angle())


def validate(plane: VelocityPlane, liner: Liner) -> list[Row]:
    """All drives x phase rules x averagings of one plane with a known impedance, in two readings.

    Short records are taken too: the rows say how many periods they rest on.

    Returns:
        Rows as of ``validation_row``.
    Raises:
        ValueError: the plane states no reference impedance or no tone.
    """
    if "true" not in plane.reference:
        raise ValueError(f"{plane.name} states no reference impedance (reference 'true')")
    chosen, model = Choices(phase="given", allow_short=True), as_liner(liner)
    # The rms of the record is known after one reading, which finds what the other drives need.
    source = Source(plane, [model], None, replace(chosen, drive="rms"))
    with torch.no_grad():
        seen = answer(source.known, model, source.frequency, replace(source.chosen, phase="averaged"))
    psi = reference_wave_phase(plane, seen)
    variants = [
        Variant(
            {"rule": (*drive, phase)},
            averaging,
            replace(chosen, drive=drive[0], mean=drive[1], phase=phase),
            psi=psi if phase == "given" else None,
        )
        for drive, phase, averaging in itertools.product(DRIVES, PHASES, seen.averagings)
    ]
    about = {
        "case": str(plane.provenance.get("case", plane.title)),
        "height": plane.height or 0.0,
        "in_situ": complex(plane.reference.get("in situ", NOWHERE)),
        "speed": tone_speed(seen),
        "velocity_rms": float(seen.velocity_rms.square().nanmean().sqrt()),
        "mach": plane.mach,
        "incident_level": plane.incident_level,
        "periods": float(plane.duration * (plane.frequency or math.nan)),
    }
    names, true = ("averaging", "low", "high", "level_check"), complex(plane.reference["true"])
    return [
        validation_row(row.rule, row.impedance, true, **about, **{name: row[name] for name in names})
        for row in source.evaluate(variants)
    ]


def validation_table(
    planes: Sequence[VelocityPlane],
    liner_of: Callable[[VelocityPlane], Liner],
    progress: Callable[[int], None] | None = None,
) -> list[Row]:
    """``validate`` of several planes, by case and height; ``progress`` per plane."""
    rows: list[Row] = []
    for plane in planes:
        rows += validate(plane, liner_of(plane))
        if progress is not None:
            progress(1)
    return rows


def errors_by_rule(rows: Sequence[Row]) -> list[Row]:
    """Medians and largest of |dR| (real part) and |dX| of every rule and averaging in the rows, over ``planes``."""
    groups: dict[tuple[tuple[str, str, str], str], list[complex]] = {}
    for row in rows:
        groups.setdefault((row.rule, row.averaging), []).append(row.miss)
    found = []
    for (rule, averaging), misses in groups.items():
        parts = [abs(miss.real) for miss in misses], [abs(miss.imag) for miss in misses]
        names = dict(zip(("drive", "mean", "phase"), rule, strict=True))
        median, largest = complex(*map(statistics.median, parts)), complex(*map(max, parts))
        found.append(Row(names, averaging=averaging, planes=len(misses), median=median, largest=largest))
    return found

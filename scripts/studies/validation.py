"""Where the impedance is known: every rule beside it."""

import itertools
import math
import statistics
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import torch

from torchliner.conversions import reflection_from_impedance
from torchliner.liners.model import Liner, as_liner
from torchliner.names import PHASES
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.studies.variants import Row, Variant, evaluate, read_again, read_for
from torchliner.velocity.choices import Choices
from torchliner.velocity.educe import answer

DRIVES = (("instantaneous", "kept"), ("instantaneous", "removed"), ("rms", "kept"), ("running-rms", "kept"))
DEFAULT = ("instantaneous", "kept", "averaged")
NOWHERE = complex(math.nan, math.nan)
UNKNOWN = dict.fromkeys(("in_situ", "low", "high"), NOWHERE) | dict.fromkeys(
    ("level_check", "speed", "velocity_rms", "mach", "incident_level", "periods"), math.nan
)


def validation_row(rule: tuple[str, str, str], educed: complex, true: complex, **about: Any) -> Row:
    """One educed value beside the reference impedance ``true``, normalised; ``rule``: drive, mean and phase.

    Returns:
        These, miss (dR + j dX), error (its size), and ``about``: case, height (m), averaging; nan where unknown
        in_situ (Z), low, high (of the statistical interval), level_check (dB), speed (see ``tone_speed``), velocity_rms
        (v'_rms, m/s), mach, incident_level (dB), periods (of the tone in the record).
    """
    names, miss = dict(zip(("drive", "mean", "phase"), rule, strict=True)), educed - true
    known = {name: value for name, value in about.items() if value is not None}
    return Row(UNKNOWN | names | known, rule=rule, educed=educed, true=true, miss=miss, error=abs(miss))


def reference_wave_phase(plane: VelocityPlane, seen: ImpedanceMap) -> float:
    """Phase of the incident wave (rad) from the plane-mean velocity at f and the reference impedance, which only a
    resolved case knows."""
    reflection = reflection_from_impedance(torch.tensor(plane.reference["true"]))
    return float((seen.velocity_amplitude[..., 0].mean() / (1 - reflection)).angle())


def validate(plane: VelocityPlane, liner: Liner) -> list[Row]:
    """All drives x phase rules x averagings of one plane with a known impedance, in two readings, short records too.

    Rows as of ``validation_row``; ValueError if the plane states no reference impedance or no tone.
    """
    if "true" not in plane.reference:
        raise ValueError(f"{plane.name} states no reference impedance (reference 'true')")
    chosen, model, asked = Choices(phase="given", allow_short=True), as_liner(liner), plane.asked(None)
    # The rms of the record is known after one reading, which finds what the other drives need.
    known, nodes = read_for(plane, [model], asked, replace(chosen, drive="rms"))
    with torch.no_grad():
        seen = answer(known, model, asked, replace(chosen, drive="rms", phase="averaged"))
    psi, variants = reference_wave_phase(plane, seen), list[Variant]()
    for (drive, mean), phase, averaging in itertools.product(DRIVES, PHASES, seen.averagings):
        own, stated = replace(chosen, drive=drive, mean=mean, phase=phase), psi if phase == "given" else None
        variants.append(Variant({"drive": drive, "mean": mean, "phase": phase}, known, model, averaging, own, stated))
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
        validation_row(
            (row.drive, row.mean, row.phase), row.impedance, true, **about, **{name: row[name] for name in names}
        )
        for row in evaluate(read_again(plane, nodes, asked, variants), asked, known)
    ]


def median_error(rows: Sequence[Row], rule: tuple[str, str, str], averaging: str) -> complex:
    """Medians of |dR| (real part) and |dX| of a rule, over the planes of the rows."""
    misses = [row.miss for row in rows if (row.rule, row.averaging) == (rule, averaging)]
    return complex(*(statistics.median(abs(getattr(miss, part)) for miss in misses) for part in ("real", "imag")))


def tone_speed(found: ImpedanceMap) -> float:
    """rms of the velocity at the tone, m/s: of its mean over the plane, of all probes if it grazes.

    A grazing wave changes its phase along the plane, so that its mean over it says nothing.
    """
    amplitude, coherence = (each[..., 0].reshape(-1) for each in (found.velocity_amplitude, found.coherence))
    known = torch.isfinite(amplitude.abs())
    if found.source_side in ("upstream", "downstream"):
        return float((amplitude.abs().square() * coherence.nan_to_num())[known].mean().sqrt()) / 2**0.5
    return float(amplitude[known].mean().abs()) / 2**0.5

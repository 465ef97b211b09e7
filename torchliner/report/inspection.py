"""Contents and usability of a plane: the facts behind ``torchliner info``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import FEWEST_PERIODS
from torchliner.engine.blocks import Blocks
from torchliner.engine.drives import Drive
from torchliner.engine.moments import Moments
from torchliner.engine.sums import Job, PlaneRecord, largest, linear, reduce
from torchliner.engine.survey import Survey, survey_of, survey_sums
from torchliner.liners.catalogue import load_liner, preset_names
from torchliner.records import VelocityPlane
from torchliner.records.notes import height_warnings, plane_unit_warnings
from torchliner.records.slabs import slab_bounds
from torchliner.velocity.reading import time_moments
from torchliner.velocity.review import first_fault

ALIGNMENT = 0.01  # share of the bulk velocity that |v0| may reach, section 5.5.1
SPECTRUM_PROBES, SPECTRUM_SAMPLES, SPECTRUM_SEGMENT = 64, 1 << 18, 1 << 14
STATED = {"frequency": " (Hz)", "incident_level": " (dB)", "mach": "", "source_side": "", "liner": ""}
OPTIONAL = ("height", "frequency", "incident_level", "mach", "displacement_thickness", "liner", "x", "z")


@dataclass(frozen=True)
class Inspection:
    """Facts by name, failed checks in words, and the names of missing facts."""

    facts: dict[str, Any]
    failures: list[str]
    missing: list[str]


def inspect_plane(plane: VelocityPlane) -> Inspection:
    """One pass over the data: sizes, faults, moments, spectrum peak, alignment.

    The alignment check compares the mean of v0 over the plane with 1 % of the bulk velocity: over
    a rigid wall, or over whole cells, the mean wall-normal velocity is near 0 (section 5.5.1).
    """
    host, tone = torch.device("cpu"), torch.tensor([plane.frequency or 1.0 / plane.duration], dtype=torch.float64)
    whole = Blocks.of(plane.samples, plane.sampling_rate, max(float(tone), 1.0 / plane.duration))
    rest = (plane.samples,) if whole.borders[-1] < plane.samples else ()
    blocks = Blocks(whole.borders + rest, plane.sampling_rate, whole.periods)
    moved = Drive().less(plane.read(0, 1)[0].to(host, torch.float64))
    jobs = [Job(Drive(), survey_sums, tone, largest=1), Job(_faults, linear), Job(moved, largest, largest=1)]
    sums, faulty, moves = reduce(PlaneRecord(plane, torch.float64, host), blocks, jobs)
    faults, still = faulty.sum((0, 1, 2)), moves.amax((0, 1, 2)) == 0
    facts, failures, good = _shape(plane) | _stated(plane), list[str](), faults == 0
    if not bool(good.all()):
        probe = int((faults > 0).nonzero()[0])
        failures.append(
            f"{int(faults.sum())} nan or inf at {int((faults > 0).sum())} of {plane.probes} probes, the first at probe "
            f"{probe}, sample {first_fault(plane, blocks, probe)} (educe --missing exclude leaves such probes out)"
        )
    if bool((still & good).any()):
        failures.append(f"{int((still & good).sum())} of {plane.probes} probes are constant in time")
    _velocity_facts(plane, survey_of(sums, blocks, tone, 0), good, facts, failures)
    failures += plane_unit_warnings(plane, plane.frequency)
    if plane.liner in preset_names():
        failures += height_warnings(plane, load_liner(plane.liner).cell_pitch)
    if plane.frequency is not None:
        periods = facts["periods of the tone"] = plane.frequency * plane.duration
        facts["samples per period"] = plane.sampling_rate / plane.frequency
        periodic = survey_of(sums[: whole.count], whole, tone, 0)
        facts["coherence with the tone (median)"] = float(periodic.coherence(tone).median())
        if periods < FEWEST_PERIODS * (1 - 1e-6):
            few = f"{periods:.3g} periods of the tone, fewer than {FEWEST_PERIODS:g}"
            failures.append(f"{few}: educe refuses them unless --allow-short is given")
        if plane.frequency >= plane.sampling_rate / 2:
            high = f"the tone, {plane.frequency:g} Hz, is at or above half the sampling rate"
            failures.append(f"{high}: educe refuses it")
    if bool(good.all()):
        facts["spectrum peak of v (Hz)"] = _spectrum_peak(plane)
    return Inspection(facts, failures, _missing(plane))


def _faults(v: Tensor, begin: int) -> Tensor:
    """1 where v is nan or inf."""
    return (~torch.isfinite(v)).to(v)


def inspect_moments(known: Moments) -> Inspection:
    """What is left of a plane: the same facts without its spectrum, and what the moments are."""
    settings = {f"reduced with {key.replace('_', ' ')}": value for key, value in known.settings.items()}
    facts = _shape(known.plane) | {name: value for name, value in settings.items() if value is not None}
    facts |= {"cells": known.cells.count, "blocks": known.survey.blocks.count} | _stated(known.plane)
    if known.nodes is not None:
        facts |= {"functions of |v|": known.nodes.count, "moments (MB)": known.size / 1e6}
    failures: list[str] = []
    _velocity_facts(known.plane, known.survey, known.used, facts, failures)
    return Inspection(facts, failures, _missing(known.plane))


def _shape(plane: VelocityPlane) -> dict[str, Any]:
    return {
        "title": plane.title,
        "probes": "x".join(str(n) for n in plane.probe_shape) or "1",
        "samples": plane.samples,
        "sampling rate (Hz)": float(plane.sampling_rate),
        "duration (ms)": 1e3 * plane.duration,
        "precision": str(plane.velocity.dtype).removeprefix("torch."),
    }


def _missing(plane: VelocityPlane) -> list[str]:
    return [name for name in OPTIONAL if (value := getattr(plane, name)) is None or value == ""]


def _stated(plane: VelocityPlane) -> dict[str, Any]:
    facts: dict[str, Any] = {} if plane.height is None else {"height (mm)": 1e3 * plane.height}
    for name in ("x", "z"):
        if (values := getattr(plane, name)) is not None:
            facts[f"{name} (mm)"] = _range(1e3 * values)
    facts |= {
        f"{name}{unit}": value for name, unit in STATED.items() if (value := getattr(plane, name)) not in (None, "")
    }
    if plane.holes is not None:
        facts["holes"] = plane.holes.words
    facts |= {f"reference, {name}": f"{z:.4f}" for name, z in plane.reference.items()}
    fluid = plane.fluid
    return facts | {"sound speed (m/s)": float(fluid.sound_speed), "density (kg/m3)": float(fluid.density)}


def _velocity_facts(
    plane: VelocityPlane, seen: Survey, good: Tensor, facts: dict[str, Any], failures: list[str]
) -> None:
    if not bool(good.any()):
        return
    mean, rms = float(seen.mean[good].mean()), seen.rms[good]
    facts |= {"v0 mean (m/s)": mean, "v0 smallest, largest (m/s)": _range(seen.mean[good])}
    facts |= {"v' rms (m/s)": float(rms.square().mean().sqrt()), "v' rms smallest, largest (m/s)": _range(rms)}
    facts["largest |v| (m/s)"] = float(seen.peak[good].max())
    if plane.streamwise is not None:
        mean_u, square = time_moments(VelocityPlane(plane.streamwise, sampling_rate=plane.sampling_rate))
        facts["u' rms (m/s)"] = float((square - mean_u**2).clamp(min=0).nanmean().sqrt())
    if plane.mach:
        bulk = plane.mach * plane.fluid.sound_speed
        share = facts["|v0| over bulk velocity"] = abs(mean) / bulk
        if share > ALIGNMENT:
            failures.append(
                f"mean |v0| is {100 * share:.2g} % of the bulk velocity, {bulk:.4g} m/s, above "
                "1 %: the velocity components may be misaligned"
            )


def _range(values: Tensor) -> str:
    return f"{float(values.min()):.4g} to {float(values.max()):.4g}"


def _spectrum_peak(plane: VelocityPlane) -> float:
    """Frequency of the largest line of the mean spectrum of up to 64 probes and 2^18 samples (Welch), Hz."""
    step, count = max(1, plane.probes // SPECTRUM_PROBES), min(plane.samples, SPECTRUM_SAMPLES)
    v = torch.cat([plane.read(*bounds)[:, ::step] for bounds in slab_bounds(count, plane.probes)]).double().numpy()
    from scipy.signal import welch  # takes half a second to import

    frequency, power = welch(v, plane.sampling_rate, nperseg=min(count, SPECTRUM_SEGMENT), axis=0)
    return float(frequency[1:][np.argmax(power[1:].mean(1))]) if count > 2 else 0.0

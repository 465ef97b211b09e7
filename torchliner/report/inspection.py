"""Contents and usability of a plane: the facts behind ``torchliner info``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

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
from torchliner.records.slabs import slab_bounds
from torchliner.records.unit_checks import height_warnings, plane_unit_warnings
from torchliner.velocity.reading import time_moments
from torchliner.velocity.review import first_fault

ALIGNMENT = 0.01  # share of the bulk velocity that |v0| may reach, section 5.5.1
SPECTRUM_PROBES, SPECTRUM_SAMPLES, SPECTRUM_SEGMENT = 64, 1 << 18, 1 << 14
OPTIONAL = ("height", "frequency", "incident_level", "mach", "displacement_thickness", "liner")


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
    rate, host = plane.sampling_rate, torch.device("cpu")
    tone = torch.tensor([plane.frequency or 1.0 / plane.duration], dtype=torch.float64)
    whole = Blocks.of(plane.samples, rate, max(float(tone), 1.0 / plane.duration))
    rest = (plane.samples,) if whole.borders[-1] < plane.samples else ()
    blocks = Blocks(whole.borders + rest, rate, whole.periods)
    first = plane.read(0, 1)[0].to(host, torch.float64)
    found = reduce(
        PlaneRecord(plane, torch.float64, host),
        blocks,
        [
            Job(Drive(), survey_sums, tone, largest=1),
            Job(_faults, linear),
            Job(Drive().less(first), largest, largest=1),
        ],
    )
    seen = survey_of(found[0], blocks, tone, 0)
    facts = _shape(plane)
    facts.update(_stated(plane))
    failures: list[str] = []
    faults, moved = found[1].sum((0, 1, 2)), found[2].amax((0, 1, 2))
    if bool((faults > 0).any()):
        probe = int((faults > 0).nonzero()[0])
        failures.append(
            f"{int(faults.sum())} nan or inf at {int((faults > 0).sum())} of {plane.probes} probes, the first at probe "
            f"{probe}, sample {first_fault(plane, blocks, probe)} (educe --missing exclude leaves such probes out)"
        )
    good = faults == 0
    if bool((flat := (moved == 0) & good).any()):
        failures.append(f"{int(flat.sum())} of {plane.probes} probes are constant in time")
    _velocity_facts(plane, seen, good, facts, failures)
    failures += plane_unit_warnings(plane, plane.frequency)
    if plane.liner in preset_names():
        failures += height_warnings(plane, load_liner(plane.liner).cell_pitch)
    if plane.frequency is not None:
        periods = facts["periods of the tone"] = plane.frequency * plane.duration
        if periods < FEWEST_PERIODS * (1 - 1e-6):
            failures.append(
                f"{periods:.3g} periods of the tone, fewer than {FEWEST_PERIODS:g}: educe refuses "
                "them unless --allow-short is given"
            )
        if plane.frequency >= plane.sampling_rate / 2:
            failures.append(
                f"the tone, {plane.frequency:g} Hz, is at or above half the sampling rate: educe refuses it"
            )
        facts["samples per period"] = plane.sampling_rate / plane.frequency
        periodic = survey_of(found[0][: whole.count], whole, tone, 0)
        facts["coherence with the tone (median)"] = float(periodic.coherence(tone).median())
    if bool(good.all()):
        facts["spectrum peak of v (Hz)"] = _spectrum_peak(plane)
    return Inspection(facts, failures, _missing(plane))


def _faults(v: Tensor, begin: int) -> Tensor:
    """1 where v is nan or inf."""
    return (~torch.isfinite(v)).to(v)


def inspect_moments(known: Moments) -> Inspection:
    """What is left of a plane: the same facts without its spectrum, and what the moments are."""
    plane, blocks = known.plane, known.survey.blocks
    facts: dict[str, Any] = _shape(plane)
    facts |= {
        f"reduced with {key.replace('_', ' ')}": value for key, value in known.settings.items() if value is not None
    }
    facts["cells"] = known.cells.count
    if known.cell_pitch is not None:
        facts["cell pitch (mm)"] = 1e3 * known.cell_pitch
    facts["blocks"] = blocks.count
    if known.nodes is not None:
        facts["functions of |v|"] = known.nodes.count
        facts["moments (MB)"] = known.size / 1e6
    facts["waves beside (Hz)"] = ", ".join(f"{line:g}" for line in known.turns.tolist()) or "none"
    facts |= _stated(plane)
    failures: list[str] = []
    _velocity_facts(plane, known.survey, known.used, facts, failures)
    return Inspection(facts, failures, _missing(plane))


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
    missing = [name for name in OPTIONAL if getattr(plane, name) in (None, "")]
    return missing + [name for name in ("x", "z") if getattr(plane, name) is None]


def _stated(plane: VelocityPlane) -> dict[str, Any]:
    facts: dict[str, Any] = {}
    if plane.height is not None:
        facts["height (mm)"] = 1e3 * plane.height
    for name in ("x", "z"):
        values = getattr(plane, name)
        if values is not None:
            facts[f"{name} (mm)"] = f"{1e3 * float(values.min()):.4g} to {1e3 * float(values.max()):.4g}"
    units = {"frequency": "Hz", "incident_level": "dB", "mach": "", "source_side": "", "liner": ""}
    for name, unit in units.items():
        value = getattr(plane, name)
        if value not in (None, ""):
            facts[f"{name}{f' ({unit})' if unit else ''}"] = value
    if plane.holes is not None:
        facts["holes"] = plane.holes.words
    for name, value in plane.reference.items():
        facts[f"reference, {name}"] = f"{value.real:.4f}{value.imag:+.4f}j"
    facts["sound speed (m/s)"] = float(plane.fluid.sound_speed)
    facts["density (kg/m3)"] = float(plane.fluid.density)
    return facts


def _velocity_facts(
    plane: VelocityPlane, seen: Survey, good: Tensor, facts: dict[str, Any], failures: list[str]
) -> None:
    if not bool(good.any()):
        return
    facts["v0 mean (m/s)"] = float(seen.mean[good].mean())
    facts["v0 smallest, largest (m/s)"] = _range(seen.mean[good])
    facts["v' rms (m/s)"] = float((seen.rms[good] ** 2).mean().sqrt())
    facts["v' rms smallest, largest (m/s)"] = _range(seen.rms[good])
    largest = seen.peak[good].max()
    facts["largest |v| (m/s)"] = float(largest)
    if plane.streamwise is not None:
        mean, mean_square = time_moments(VelocityPlane(plane.streamwise, sampling_rate=plane.sampling_rate))
        facts["u' rms (m/s)"] = float((mean_square - mean**2).clamp(min=0).nanmean().sqrt())
    if plane.mach:
        bulk = plane.mach * plane.fluid.sound_speed
        share = abs(float(seen.mean[good].mean())) / bulk
        facts["|v0| over bulk velocity"] = share
        if share > ALIGNMENT:
            failures.append(
                f"mean |v0| is {100 * share:.2g} % of the bulk velocity, {bulk:.4g} m/s, above "
                "1 %: the velocity components may be misaligned"
            )


def _range(values: Tensor) -> str:
    return f"{float(values.min()):.4g}, {float(values.max()):.4g}"


def _spectrum_peak(plane: VelocityPlane) -> float:
    """Frequency of the largest line of the mean spectrum of up to 64 probes and 2^18 samples (Welch), Hz."""
    step, count = max(1, plane.probes // SPECTRUM_PROBES), min(plane.samples, SPECTRUM_SAMPLES)
    rows = [plane.read(*bounds)[:, ::step].to(torch.float64) for bounds in slab_bounds(count, plane.probes)]
    v, length = torch.cat(rows), min(count, SPECTRUM_SEGMENT)
    window, power = torch.hann_window(length, dtype=torch.float64)[:, None], torch.zeros(length // 2 + 1)
    for begin in range(0, count - length + 1, length - length // 2):
        segment = v[begin : begin + length]
        power = power + torch.fft.rfft(window * (segment - segment.mean(0)), dim=0).abs().square().sum(1)
    return float(power[1:].argmax() + 1) * plane.sampling_rate / length if len(power) > 1 else 0.0

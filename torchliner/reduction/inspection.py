"""Contents and usability of a plane: the facts behind ``torchliner info``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import FEWEST_PERIODS
from torchliner.liners.catalogue import load_liner, preset_names
from torchliner.records import VelocityPlane
from torchliner.records.cells import sort_into_cells
from torchliner.records.slabs import slab_bounds
from torchliner.records.unit_checks import height_warnings, plane_unit_warnings
from torchliner.reduction.moments import Moments
from torchliner.reduction.plan import PassPlan
from torchliner.reduction.probe_velocity import ProbeVelocity
from torchliner.reduction.readings import Wanted, read_once
from torchliner.reduction.survey import Survey
from torchliner.signals.blocks import Blocks

ALIGNMENT = 0.01  # share of the bulk velocity that |v0| may reach, section 5.5.1
SPECTRUM_PROBES, SPECTRUM_SEGMENTS, SPECTRUM_SAMPLES = 64, 64, 16384
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
    frequency = torch.tensor([plane.frequency or 1.0 / plane.duration], dtype=torch.float64)
    velocity = ProbeVelocity(plane, None, torch.float64, torch.device("cpu"))
    hann = torch.hann_window(plane.samples, dtype=torch.float64)
    blocks = Blocks((0, plane.samples), 1)
    plan = PassPlan(plane.samples, plane.sampling_rate, 0, plane.samples, blocks)
    wanted = Wanted(plan, frequency, hann, None, plane.frequency, keeps_blocks=False)
    everywhere = torch.ones(plane.probes, dtype=torch.bool)
    first, _ = read_once(velocity, wanted, sort_into_cells(plane, None), everywhere, None)
    seen = first.survey
    facts = _shape(plane)
    facts.update(_stated(plane))
    failures: list[str] = []
    _velocity_facts(plane, seen, facts, failures)
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
        facts["coherence with the tone (median)"] = float(seen.coherence.median())
    if not int(seen.bad.sum()):
        facts["spectrum peak of v (Hz)"] = _spectrum_peak(plane)
    return Inspection(facts, failures, _missing(plane))


def inspect_moments(known: Moments) -> Inspection:
    """What is left of a plane: the same facts without its spectrum, and what the moments are."""
    plane, sums = known.plane, known.sums
    facts: dict[str, Any] = _shape(plane)
    facts |= {f"reduced with {key.replace('_', ' ')}": value
              for key, value in known.settings.items() if value is not None}  # fmt: skip
    facts["cells"] = sums.cells.count
    if known.cell_pitch is not None:
        facts["cell pitch (mm)"] = 1e3 * known.cell_pitch
    facts["blocks"] = sums.plan.rest
    if sums.basis is not None:
        facts["functions of |v|"] = sums.basis.count
        facts["moments (MB)"] = known.size / 1e6
    facts["waves beside (Hz)"] = ", ".join(f"{line:g}" for line in sums.plan.lines) or "none"
    facts |= _stated(plane)
    failures: list[str] = []
    _velocity_facts(plane, sums.survey.part(plane.probes), facts, failures)
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


def _velocity_facts(plane: VelocityPlane, seen: Survey, facts: dict[str, Any], failures: list[str]) -> None:
    bad = seen.bad > 0
    good = ~bad
    if bool(bad.any()):
        first = int(bad.nonzero()[0])
        failures.append(
            f"{int(seen.bad.sum())} nan or inf at {int(bad.sum())} of {plane.probes} probes, the "
            f"first at probe {first}, sample {int(seen.first_bad[first])} (educe --missing "
            "exclude leaves such probes out)"
        )
    if not bool(good.any()):
        return
    flat = (seen.largest == seen.smallest) & good
    if bool(flat.any()):
        failures.append(f"{int(flat.sum())} of {plane.probes} probes are constant in time")
    facts["v0 mean (m/s)"] = float(seen.mean[good].mean())
    facts["v0 smallest, largest (m/s)"] = _range(seen.mean[good])
    facts["v' rms (m/s)"] = float((seen.rms[good] ** 2).mean().sqrt())
    facts["v' rms smallest, largest (m/s)"] = _range(seen.rms[good])
    largest = seen.peak[good].max()
    facts["largest |v| (m/s)"] = float(largest)
    if plane.streamwise is not None:
        stream = VelocityPlane(plane.streamwise, sampling_rate=plane.sampling_rate)
        facts["u' rms (m/s)"] = _rms(stream)
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


def _rms(plane: VelocityPlane) -> float:
    """Of all probes; along z, then along x, as squares."""
    mean, square = time_moments(plane)
    variance = (square - mean**2).reshape(plane.probe_shape)
    along_x = variance.nanmean(0) if variance.ndim == 2 else variance
    return float(along_x.clamp(min=0).mean().sqrt())


def _spectrum_peak(plane: VelocityPlane) -> float:
    """Frequency of the largest line of the mean spectrum (Hann, half overlapping segments).

    Segments of up to 16 384 samples, up to 64 evenly spread probes and 64 segments.
    """
    step = max(1, plane.probes // SPECTRUM_PROBES)
    length = min(plane.samples, SPECTRUM_SAMPLES)
    starts = torch.arange(0, plane.samples - length + 1, max(1, length // 2))
    starts = starts[:: max(1, len(starts) // SPECTRUM_SEGMENTS)]
    window = torch.hann_window(length, dtype=torch.float64)[:, None]
    power = torch.zeros(length // 2 + 1, dtype=torch.float64)
    for start in starts.tolist():
        rows = [
            plane.read(start + low, start + high)[:, ::step].to(torch.float64)
            for low, high in slab_bounds(length, plane.probes)
        ]
        signal = torch.cat(rows)
        lines = torch.fft.rfft((signal - signal.mean(0)) * window, dim=0)
        power += (lines.abs() ** 2).mean(1)
    line = int(power[1:].argmax()) + 1 if length > 2 else 0
    return line * plane.sampling_rate / length


def time_moments(plane: VelocityPlane) -> tuple[Tensor, Tensor]:
    """Time mean of v and of v squared, m/s and m2/s2, each (P,), by slabs in float64."""
    total = torch.zeros(plane.probes, dtype=torch.float64)
    square = torch.zeros_like(total)
    for begin, end in slab_bounds(plane.samples, plane.probes):
        slab = plane.read(begin, end).cpu().to(torch.float64)
        total += slab.sum(0)
        square += (slab**2).sum(0)
    return total / plane.samples, square / plane.samples

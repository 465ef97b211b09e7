"""Contents and usability of a plane: the facts behind ``torchliner info``."""

from typing import Any, NamedTuple

import torch
from torch import Tensor

from torchliner.engine.blocks import Blocks
from torchliner.engine.drives import Drive
from torchliner.engine.moments import Moments
from torchliner.engine.sums import Job, PlaneRecord, linear, reduce
from torchliner.engine.survey import Survey, survey_of, survey_sums
from torchliner.liners.catalogue import load_liner, preset_names
from torchliner.records import VelocityPlane
from torchliner.records.notes import plane_notes

ALIGNMENT = 0.01  # share of the bulk velocity that |v0| may reach, section 5.5.1
STATED = {"frequency": " (Hz)", "incident_level": " (dB)", "mach": "", "source_side": "", "liner": ""}
Facts = dict[str, Any]
OPTIONAL = ("height", "frequency", "incident_level", "mach", "displacement_thickness", "liner", "x", "z")


class Inspection(NamedTuple):
    """Facts by name, failed checks in words, and the names of missing facts."""

    facts: Facts
    failures: list[str]
    missing: list[str]


def inspect_plane(plane: VelocityPlane) -> Inspection:
    """One pass over the data: sizes, faults, moments; that the mean of v0 over the plane is within 1 % of the bulk
    velocity, as it is over a rigid wall and over whole cells (section 5.5.1)."""
    host, tone = torch.device("cpu"), torch.tensor([plane.frequency or 1.0 / plane.duration], dtype=torch.float64)
    whole = Blocks.of(plane.samples, plane.sampling_rate, max(float(tone), 1.0 / plane.duration))
    rest = (plane.samples,) if whole.borders[-1] < plane.samples else ()
    blocks = Blocks(whole.borders + rest, plane.sampling_rate, whole.periods)
    jobs = [Job(Drive(), survey_sums, tone, largest=1), Job(_faults, linear)]
    sums, faulty = reduce(PlaneRecord(plane, torch.float64, host), blocks, jobs)
    seen, faults, failures = survey_of(sums, blocks, tone, 0), faulty.sum((0, 1, 2)), list[str]()
    good = faults == 0
    still = good & seen.constant
    if not bool(good.all()):
        probe = int((faults > 0).nonzero()[0])
        failures.append(
            f"{int(faults.sum())} nan or inf at {int((faults > 0).sum())} of {plane.probes} probes, the first at probe "
            f"{probe}, sample {plane.first_fault(probe)} (educe --missing exclude leaves such probes out)"
        )
    if bool(still.any()):
        failures.append(f"{int(still.sum())} of {plane.probes} probes are constant in time")
    found = _inspection(plane, seen, good, failures, {})
    pitch = load_liner(plane.liner).cell_pitch if plane.liner in preset_names() else None
    failures += [note.text for note in plane_notes(plane, plane.frequency, pitch)]
    if plane.frequency is not None:
        found.facts["periods of the tone"] = plane.frequency * plane.duration
        found.facts["samples per period"] = plane.sampling_rate / plane.frequency
        periodic = survey_of(sums[: whole.count], whole, tone, 0)
        found.facts["coherence with the tone (median)"] = float(periodic.coherence(tone).median())
    return found


def _faults(v: Tensor, begin: int) -> Tensor:
    """1 where v is nan or inf."""
    return (~torch.isfinite(v)).to(v)


def inspect_moments(known: Moments) -> Inspection:
    """What is left of a plane: the same facts, and what the moments are."""
    about: dict[str, Any] = {f"reduced with {key.replace('_', ' ')}": value for key, value in known.settings.items()}
    about |= {"cells": known.cells.count, "blocks": known.survey.blocks.count}
    if known.nodes is not None:
        about |= {"functions of |v|": known.nodes.count, "moments (MB)": known.size / 1e6}
    return _inspection(known.plane, known.survey, known.used, [], about)


def _inspection(plane: VelocityPlane, seen: Survey, good: Tensor, failures: list[str], about: Facts) -> Inspection:
    """Sizes, what is stated, what v is; ``about``: facts between them."""
    facts: dict[str, Any] = {
        "title": plane.title,
        "probes": "x".join(str(n) for n in plane.probe_shape) or "1",
        "samples": plane.samples,
        "sampling rate (Hz)": float(plane.sampling_rate),
        "duration (ms)": 1e3 * plane.duration,
        "precision": str(plane.velocity.dtype).removeprefix("torch."),
        **about,
        "height (mm)": None if plane.height is None else 1e3 * plane.height,
        **{f"{name} (mm)": _range(1e3 * at) for name in ("x", "z") if (at := getattr(plane, name)) is not None},
        **{f"{name}{unit}": getattr(plane, name) for name, unit in STATED.items()},
        **{f"reference, {name}": f"{z:.4f}" for name, z in plane.reference.items()},
        "sound speed (m/s)": float(plane.fluid.sound_speed),
        "density (kg/m3)": float(plane.fluid.density),
    }
    facts = {name: value for name, value in facts.items() if value is not None and (value != "" or name == "title")}
    if bool(good.any()):
        mean, rms = float(seen.mean[good].mean()), seen.rms[good]
        facts |= {"v0 mean (m/s)": mean, "v0 smallest, largest (m/s)": _range(seen.mean[good])}
        facts |= {"v' rms (m/s)": float(rms.square().mean().sqrt()), "v' rms smallest, largest (m/s)": _range(rms)}
        facts["largest |v| (m/s)"] = float(seen.peak[good].max())
        if plane.mach:
            bulk = plane.mach * plane.fluid.sound_speed
            share = facts["|v0| over bulk velocity"] = abs(mean) / bulk
            if share > ALIGNMENT:
                failures.append(
                    f"mean |v0| is {100 * share:.2g} % of the bulk velocity, {bulk:.4g} m/s, above "
                    "1 %: the velocity components may be misaligned"
                )
    return Inspection(facts, failures, [name for name in OPTIONAL if getattr(plane, name) in (None, "")])


def _range(values: Tensor) -> str:
    return f"{float(values.min()):.4g} to {float(values.max()):.4g}"

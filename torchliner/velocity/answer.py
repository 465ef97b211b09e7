"""From moments and choices to the map that the user gets."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import index_of_frequency, phase_tensor, real_tensor
from torchliner.engine.moments import Moments
from torchliner.io.moments_file import holds_moments
from torchliner.io.plane_parts import named_planes
from torchliner.liners.model import LinerModel, impedance_of
from torchliner.liners.plates import goodrich_resistance
from torchliner.names import __version__
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.level_check import Gap
from torchliner.records.notes import Note
from torchliner.records.origin import origin_of
from torchliner.velocity import review, sound
from torchliner.velocity.averages import Asked, Averages, average
from torchliner.velocity.background import widened, with_background
from torchliner.velocity.choices import Choices
from torchliner.velocity.known_pressure import known_pressure
from torchliner.velocity.level_check import change_that_passes, check_level


def averages_of(
    known: Moments, liner: LinerModel, frequency: Tensor, chosen: Choices, reference_phase: Any = None
) -> tuple[Asked, dict[str, Averages]]:
    """R under every averaging, on the device of the moments, with nothing read back to the host."""
    phase = None
    if chosen.phase == "given" or reference_phase is not None:
        phase = _phase_of(known.plane, chosen, reference_phase, len(frequency))
    asked = Asked.of(known, liner, frequency, chosen, phase)
    return asked, {name: average(known, asked, name) for name in chosen.averagings}


def answer(
    known: Moments,
    liner: LinerModel,
    frequency: Tensor,
    chosen: Choices,
    reference_phase: Any = None,
    pressure: Any = None,
    ends: Sequence[Moments] = (),
) -> ImpedanceMap:
    """The map from moments; arguments as of ``educe``; ``ends``: with the bounds of the background.

    Raises:
        ValueError: the moments do not fit what is asked.
    """
    plane, seen, liner = known.plane, known.survey, liner.in_flow(known.plane.mach)
    review.require_periods(plane, frequency, chosen)
    chosen = with_background(plane, chosen, liner, known.cell_pitch)
    require_fitting(known, liner, frequency, chosen)
    asked, found = averages_of(known, liner, frequency, chosen, reference_phase)
    if ends:
        own, others = found["phase-locked"], [average(each, asked, "phase-locked") for each in ends]
        names = ("probes", "cells", "liner", "along_x")
        every: Any = {name: widened(getattr(own, name), [getattr(each, name) for each in others]) for name in names}
        found["phase-locked"] = dataclasses.replace(own, **every)
    answered, silent = chosen.averaging, list(sound.review_tone(known, frequency, chosen))
    if answered == "phase-locked" and any(note.code == sound.NO_TONE for note in silent):
        answered = "admittance"
    chief, held = found[answered].liner, found["admittance"].held
    z = chief.impedance.detach().cpu()
    error, doubts = review.review_table(known, liner, frequency, z)
    tone = sound.sound_of(known) if "phase-locked" in found else None
    ratio = None if silent else sound.velocity_ratio(known, liner, frequency)
    notes = [
        *review.review_record(plane, frequency),
        *review.review_liner(plane, liner),
        *known.notes,
        *doubts,
        *silent,
        *sound.review_sound(known, liner, frequency, ratio, tone),
        *review.review_walls(known, asked.wall, frequency, chosen.wall_filter),
        *review.review_rule(held, chosen),
        *review.review_intervals(plane, chief, seen.blocks, frequency),
    ]
    pressures = known_pressure(known, frequency, pressure)
    check, checked = None, pressures
    if not isinstance(pressures, str):
        check, checked = check_level(pressures, found, chosen, answered), "checked"
        place = check.averagings.index(answered)
        gap = Gap(*(value[place] for value in vars(check.liner).values()))
        sizes = change_that_passes(pressures, z, gap).abs()
        for i, f in enumerate(frequency.tolist()):
            if text := check.sentence(answered, f, i):
                notes.append(Note("level-check", f"{plane.name}: {text}", float(sizes[i])))
    facts = facts_of(known, liner, chosen, error)
    if tone is not None:
        facts["tone_share"] = tone.share
    return map_of(
        known,
        liner,
        frequency,
        found,
        answered,
        phase_rule=held,
        wall=asked.wall,
        choices=facts | {"averaging": answered, "level_check": checked, "velocity_ratio": ratio},
        notes=tuple(dict.fromkeys(notes)),
        level_check=check,
    )


def require_fitting(known: Moments, liner: LinerModel, frequency: Tensor, chosen: Choices) -> None:
    """Refuse what the moments of a plane cannot answer: another drive, averaging, cell and so on.

    Raises:
        ValueError: what differs, and what to do.
    """
    name = known.plane.name
    known.require_speeds(liner)
    wanted = chosen.describe() | {"running_window": chosen.window(frequency)}
    again = {"phase", "missing", "allow_short"}  # choices that may be made again; a phase where its line is held
    again |= {"averaging"} if chosen.averaging in known.sums or chosen.drive == "rms" else set()
    again |= set() if "phase-locked" in chosen.averagings else {"background"}
    for key, made in known.settings.items():
        if wanted[key] != made and key not in again:
            remedy = f"leave {key} out" if made is None else f"choose {key}={made!r}"
            raise ValueError(
                f"{name} was reduced with {key} {made!r}, and {wanted[key]!r} is asked for; {remedy}, or reduce the "
                "data again"
            )
    if liner.cell_pitch != known.cell_pitch:
        pitches = (known.cell_pitch, liner.cell_pitch)
        of_data, of_liner = ("all probes" if pitch is None else f"{1e3 * float(pitch):.6g} mm" for pitch in pitches)
        raise ValueError(
            f"{name} was reduced for cells of {of_data}, and the liner's are of {of_liner}; reduce the data again with "
            "that liner"
        )
    needed = []
    if chosen.phase != "averaged":
        needed.append((f"the line of phase {chosen.phase!r}", known.turns / 2, "choose phase='averaged'"))
    if chosen.wall_filter is not None or chosen.phase == "self-consistent":
        remedy = "choose phase='averaged'" if chosen.wall_filter is None else "leave wall_filter out"
        needed.append(("the coherence of v with the tone", known.survey.lines, remedy))
    for what, lines, remedy in needed:
        for f in frequency.tolist():
            if index_of_frequency(lines, f) is None:
                held = ", ".join(f"{line:g}" for line in lines.tolist()) + " Hz" if len(lines) else "no line"
                raise ValueError(
                    f"{name} holds {what} at {held}, and not at {f:g} Hz; {remedy}, or reduce the data again with that "
                    "frequency"
                )


def map_of(
    known: Moments,
    liner: LinerModel,
    frequency: Tensor,
    found: Mapping[str, Averages],
    averaging: str,
    *,
    phase_rule: Tensor,
    wall: Tensor | None = None,
    **about: Any,
) -> ImpedanceMap:
    """The map of averages; arguments as of ``ImpedanceMap``, tensors on their device, of (P, F) probes."""
    plane, seen, used = known.plane, known.survey, known.used

    def on_probes(value: Tensor) -> Tensor:
        """On the plane's axes; nan where a probe was left out."""
        value = value.cpu()
        if value.dtype != torch.bool:
            value = torch.where(used.reshape(-1, *[1] * (value.ndim - 1)), value, torch.nan)
        return value.reshape((*plane.probe_shape, *value.shape[1:]))

    parts: dict[str, Any] = {
        part: {name: own.map(Tensor.cpu) for name, each in found.items() if (own := getattr(each, part)) is not None}
        for part in ("cells", "liner", "along_x")
    }
    stated = {
        name: getattr(plane, name)
        for name in ("x", "z", "height", "fluid", "mach", "incident_level", "source_side", "title", "holes")
    }
    return ImpedanceMap(
        frequency=frequency,
        probes={name: each.probes.map(on_probes) for name, each in found.items() if each.probes is not None},
        averaging=averaging,
        mean_velocity=on_probes(seen.mean),
        velocity_rms=on_probes(seen.rms),
        velocity_amplitude=on_probes(-seen.tone(frequency, seen.mean_of)[0]),
        coherence=on_probes(seen.coherence(frequency)),
        phase_rule=on_probes(phase_rule),
        cell_x=known.cells.x,
        cell_z=known.cells.z,
        cell_weight=known.cells.weight,
        wall=None if wall is None else on_probes(wall),
        reference=dict(plane.reference),
        goodrich=goodrich_of(plane, liner, frequency),
        **parts,
        **stated,
        **about,
    )


def _phase_of(plane: VelocityPlane, chosen: Choices, phase: Any, count: int) -> Tensor:
    """psi of all probes, (P, F or 1)."""
    if chosen.phase != "given":
        raise ValueError(f"reference_phase is only used with phase='given', not {chosen.phase!r}")
    if phase is None:
        raise ValueError("phase='given' needs reference_phase, in rad, one for all or per probe")
    values, shape = phase_tensor(phase).cpu(), plane.probe_shape
    if count > 1 and values.shape == (count,) and shape[-1:] == (count,):
        raise ValueError(
            f"reference_phase has shape ({count},), and there are {count} probes and {count} frequencies; give "
            "(probes, 1) or (1, frequencies)"
        )
    for candidate in (shape, (*shape, count)):
        try:
            return values.broadcast_to(candidate).reshape(plane.probes, -1)
        except RuntimeError:
            continue
    raise ValueError(
        f"reference_phase has shape {tuple(values.shape)}; it must broadcast over probes of shape {shape} (and {count} "
        "frequencies)"
    )


def goodrich_of(plane: VelocityPlane, liner: LinerModel, frequency: Tensor) -> Tensor | None:
    """Linear liner plus eq. (2.7), (F,), where the plane states Mach number and displacement thickness; what the
    liner's own law adds for the flow is taken off before."""
    porosity, diameter = liner.surface_porosity, liner.hole_diameter
    if not (plane.mach and plane.displacement_thickness and porosity and diameter is not None):
        return None
    added = goodrich_resistance(plane.mach, porosity, plane.displacement_thickness, diameter) - liner.flow_resistance
    with torch.no_grad():
        return impedance_of(liner, frequency, torch.zeros(1)) + added


def facts_of(known: Moments, liner: LinerModel, chosen: Choices, error: float) -> dict[str, Any]:
    """Every choice, and what followed from it."""
    plane, blocks, locked = known.plane, known.survey.blocks, known.locked
    facts: dict[str, Any] = {
        "version": __version__,
        **chosen.describe(),
        "running_window": known.settings["running_window"],
        "liner": liner.describe(),
        "sampling_rate": plane.sampling_rate,
        "samples": plane.samples,
        "blocks": blocks.count,
        "periods": blocks.periods,
        "source": plane.name,
        "tone": plane.frequency,
        "surface": plane.liner,
        "data": dict(plane.provenance),
        "nodes": None if known.nodes is None else known.nodes.describe(),
        "model_error": error,
    }
    if locked is not None and "phase-locked" in chosen.averagings:
        cells, scale = known.membership, locked.scale
        mean = 1.0 if scale is None else float(cells.sum(scale).sum() / cells.sizes.sum())
        facts |= {"phase_locked_lines": locked.lines.tolist(), "phase_locked_share": locked.share.mean(1).tolist()}
        facts |= {"tone_share": None, "incoherent_scale": mean}  # of all cells
    return facts


def origin_facts(plane: Any, liner: LinerModel, pressure: Any, phase: Any) -> dict[str, Any]:
    """What a map keeps so that it can be made again, beside its choices."""
    data: VelocityPlane = plane.plane if isinstance(plane, Moments) else plane
    named = named_planes(data)
    if isinstance(plane, Moments) and Path(data.name).is_file() and holds_moments(data.name):
        named = [("moments", data.name)]
    named += [("liner", name) for name in liner.files]
    named += [] if pressure is None else [("wall pressure", getattr(pressure, "name", ""))]
    stated = None if phase is None else real_tensor(phase).tolist()
    return origin_of(named, reference_phase=stated)

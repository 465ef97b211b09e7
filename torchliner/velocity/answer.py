"""From moments and choices to the map that the user gets."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import index_of_frequency, real_tensor
from torchliner.engine.moments import Moments
from torchliner.io.moments_file import holds_moments
from torchliner.io.plane_parts import named_planes
from torchliner.liners.model import LinerModel, impedance_of
from torchliner.liners.plates import goodrich_resistance
from torchliner.names import __version__
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.origin import origin_of
from torchliner.velocity import review
from torchliner.velocity.averages import Averages, average
from torchliner.velocity.choices import COMPUTED, Choices
from torchliner.velocity.level_check import check_level
from torchliner.velocity.reading import settled

STATED = ("x", "z", "height", "fluid", "mach", "incident_level", "source_side", "title")


def answer(
    known: Moments,
    liner: LinerModel,
    frequency: Tensor,
    chosen: Choices,
    reference_phase: Any = None,
    pressure: Any = None,
) -> ImpedanceMap:
    """The map from moments that fit what is asked; ``chosen``: those with which the plane was read just now, or of
    ``fitting``; else as of ``educe``."""
    plane, liner, names = known.plane, liner.in_flow(known.plane.mach), COMPUTED[chosen.averaging]
    found = {name: average(known, liner, frequency, chosen, name, reference_phase) for name in names}
    heard, of_sound = review.review_sound(known, liner, frequency, chosen)
    without_tone = any(note.code == review.NO_TONE for note in heard)
    answered = "admittance" if without_tone and chosen.averaging == "phase-locked" else chosen.averaging
    chief, z = found[answered].liner, found[answered].liner.impedance.detach().cpu()
    error, doubts = review.review_table(known, liner, frequency, z)
    check, words, failures = check_level(known, frequency, found, chosen, answered, pressure)
    notes = [
        *review.review_case(plane, liner, frequency),
        *known.notes,
        *doubts,
        *heard,
        *review.review_answer(known, found["admittance"], chief, frequency, chosen),
        *failures,
    ]
    facts = facts_of(known, liner, chosen, error, pressure, reference_phase)
    facts |= {"averaging": answered, "level_check": words, **of_sound}
    about: dict[str, Any] = {"averaging": answered, "choices": facts, "level_check": check}
    return map_of(known, liner, frequency, found, notes=tuple(dict.fromkeys(notes)), **about)


def fitting(known: Moments, liner: LinerModel, frequency: Tensor, chosen: Choices) -> Choices:
    """Choices, with their background measured, by which moments that were made before answer; ValueError where these do
    not fit what is asked."""
    liner = liner.in_flow(known.plane.mach)
    chosen = settled(known.plane, chosen, frequency, liner, known.cell_pitch)
    require_fitting(known, liner, frequency, chosen)
    return chosen


def require_fitting(known: Moments, liner: LinerModel, frequency: Tensor, chosen: Choices) -> None:
    """Refuse what the moments of a plane cannot answer: another drive, averaging, cell and so on."""
    name, again = f"{known.plane.name} was reduced", "or reduce the data again"
    known.require_speeds(liner)
    wanted = chosen.describe() | {"running_window": chosen.window(frequency)}
    free = {"phase", "missing", "allow_short"}  # choices that may be made again; a phase where its line is held
    free |= {"averaging"} if chosen.averaging in known.sums or chosen.drive == "rms" else set()
    free |= set() if chosen.averaging == "phase-locked" else {"background"}
    for key, made in known.settings.items():
        if wanted[key] != made and key not in free:
            remedy = f"leave {key} out" if made is None else f"choose {key}={made!r}"
            raise ValueError(f"{name} with {key} {made!r}, and {wanted[key]!r} is asked for; {remedy}, {again}")
    if liner.cell_pitch != known.cell_pitch:
        raise ValueError(
            f"{name} for a cell_pitch of {known.cell_pitch} m, and the liner has {liner.cell_pitch} m; {again[3:]}"
        )
    needed = []
    if chosen.phase != "averaged":
        needed.append((f"the line of phase {chosen.phase!r}", known.turns / 2))
    if chosen.wall_filter is not None or chosen.phase == "self-consistent":
        needed.append(("the coherence of v with the tone", known.survey.lines))
    for what, lines in needed:
        for f in (f for f in frequency.tolist() if index_of_frequency(lines, f) is None):
            held = ", ".join(f"{line:g}" for line in lines.tolist()) + " Hz" if len(lines) else "no line"
            raise ValueError(
                f"{name} with {what} at {held}, and not at {f:g} Hz; choose phase='averaged', no wall_filter, {again}"
            )


def map_of(
    known: Moments, liner: LinerModel, frequency: Tensor, found: Mapping[str, Averages], **about: Any
) -> ImpedanceMap:
    """The map of averages, whose tensors are on their device; ``about``: further fields of ``ImpedanceMap``."""
    plane, seen, used, first = known.plane, known.survey, known.used, found["admittance"]

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
    return ImpedanceMap(
        frequency=frequency,
        probes={name: each.probes.map(on_probes) for name, each in found.items() if each.probes is not None},
        mean_velocity=on_probes(seen.mean),
        velocity_rms=on_probes(seen.rms),
        velocity_amplitude=on_probes(-seen.tone(frequency)[0]),
        coherence=on_probes(seen.coherence(frequency)),
        phase_rule=on_probes(first.held),
        cell_x=known.cells.x,
        cell_z=known.cells.z,
        cell_weight=known.cells.weight,
        wall=None if first.wall is None else on_probes(first.wall),
        reference=dict(plane.reference),
        goodrich=goodrich_of(plane, liner, frequency) if plane.mach else None,
        **parts,
        **{name: getattr(plane, name) for name in STATED},
        **about,
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


def facts_of(
    known: Moments, liner: LinerModel, chosen: Choices, error: float, pressure: Any = None, phase: Any = None
) -> dict[str, Any]:
    """Every choice, what followed from it, and where all came from, so that a result can be made again."""
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
        "nodes": None if known.nodes is None else vars(known.nodes),
        "model_error": error,
    }
    if locked is not None and chosen.averaging == "phase-locked":
        scale = torch.ones_like(known.survey.mean) if locked.scale is None else locked.scale
        sizes = known.membership.sizes
        facts |= {"phase_locked_lines": locked.lines.tolist(), "phase_locked_share": locked.share.mean(1).tolist()}
        facts["incoherent_scale"] = float((known.membership.mean(scale) * sizes).sum() / sizes.sum())  # of all cells
    named = [("moments", plane.name)] if holds_moments(plane.name) else named_planes(plane)
    named += [("liner", name) for name in liner.files]
    named += [] if pressure is None else [("wall pressure", getattr(pressure, "name", ""))]
    return facts | origin_of(named, reference_phase=None if phase is None else real_tensor(phase).tolist())

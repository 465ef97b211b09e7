"""DIR-TDIBC: impedance from wall-normal velocity, probe by probe, without a propagation model."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import index_of_frequency, real_tensor, tell
from torchliner.engine.moments import Moments, ReducedVelocity
from torchliner.engine.sums import reduce
from torchliner.io.plane_parts import named_planes
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.liners.plates import goodrich_of
from torchliner.names import __version__
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.origin import origin_of
from torchliner.velocity import review
from torchliner.velocity.averages import Averages, average
from torchliner.velocity.choices import COMPUTED, Choices
from torchliner.velocity.level_check import check_level, match_level
from torchliner.velocity.reading import Progress, Reduce, reading_of, settled, take_moments

STATED = ("x", "z", "height", "fluid", "mach", "incident_level", "source_side", "title")


def educe(
    plane: Any,
    liner: Liner,
    frequency: Any = None,
    *,
    reference_phase: Any = None,
    pressure: Any = None,
    progress: Progress | None = None,
    **choices: Any,
) -> ImpedanceMap:
    """Impedance map of a plane: a known tone replayed through a liner driven by |v(t)|.

    The educed reflection is the mean over the record of the liner model's own R(f, |v(t)|) (plus its 2 f line once a
    phase is stated): it is the response of YOUR model to YOUR velocity data.

    Args:
        plane: ``VelocityPlane``, (..., T) m/s, or the ``Moments`` of one.
        liner: ``SDoFLiner``, ``TabulatedLiner`` or any object with ``impedance(frequency, speed)``.
        frequency: Hz, one or several; default the plane's own tone.
        reference_phase: psi in rad for ``phase="given"``: x(t) = cos(2 pi f t + psi) with t = 0 at the first sample.
            It is broadcast over the probe axes (add a last axis for several frequencies).
        pressure: ``PressureRecord`` of the same run, whose facesheet the level check takes; default the
            ``incident_level`` that the plane states.
        progress: called with numbers of samples read.
        choices: see ``torchliner.velocity.choices.Choices``.
    Returns:
        The map, on the probe axes of the plane, with cells and liner in every averaging.
    Raises:
        ValueError: data or options that cannot give an answer; the message says what would.
        TypeError: a value of the wrong kind.
    Warns:
        DataWarning: the answer stands but is doubtful; the same text is in ``notes``.
    Source: Roncen et al. (2026), section 3. Departures: phase rules, averagings and drives are named
        (docs/method.md); R comes from the model itself, without impulse responses, which ``replay`` uses.

    >>> steady = torch.full((2, 900), 5.0, dtype=torch.float64)  # m/s, two probes
    >>> plane = tl.VelocityPlane(steady, sampling_rate=42e3, frequency=1400.0)
    >>> found = tl.educe(plane, tl.load_liner("polito"), interval=None)
    >>> f"{complex(found.answer[0]):.2f}"  # |v| never changes: the model's own value
    '4.62-0.65j'
    """
    model, chosen = as_liner(liner), Choices(**choices)
    if isinstance(plane, Moments):
        if chosen.level_matched:
            raise ValueError(f"level_matched reads {plane.plane.name} several times; give the plane, not its moments")
        known, asked = plane, plane.plane.asked(frequency)
        chosen = fitting(known, model, asked, chosen)
    else:
        reading = reading_of(plane, [model], frequency, chosen, projected=True)
        known, asked, chosen = take_moments(reading, progress=progress), reading.frequency, reading.chosen
    found = answer(known, model, asked, chosen, reference_phase, pressure)
    if chosen.level_matched:
        matched, notes = match_level(reading, known, model, pressure, reference_phase)
        found = dataclasses.replace(found, level_matched=matched, notes=(*found.notes, *notes))
    tell([note.text for note in found.notes])
    return found


def moments(
    plane: VelocityPlane,
    liner: Liner | None = None,
    frequency: Any = None,
    *,
    cell_pitch: float | None = None,
    progress: Progress | None = None,
    run: Reduce | None = None,
    **choices: Any,
) -> Moments:
    """Sums over a plane that hold R(f, |v|) of any liner at any frequency.

    Args:
        plane: wall-normal velocity, (..., T) m/s.
        liner: for which the nodes are chosen, and whose cells are averaged over; several of one pitch as a list;
            default any liner: 64 nodes, which give R of holes of 0.5 to 2.5 mm up to 6 kHz to 1e-5 for 5 to 15 % open
            area, to 3e-4 for 3 %; each result states the error.
        frequency: Hz, at which a phase rule other than ``averaged`` is to be used, and for the nodes; default the
            plane's own tone.
        cell_pitch: L_c, m, without a liner.
        progress: called with numbers of samples read.
        run: the loop over the data; workers of dask share ``torchliner.campaign.workers.share_out(client)``.
        choices: as for ``educe``; what concerns |v| is fixed here, the rest is chosen when Z is asked for.
    Raises:
        TypeError: plane is no VelocityPlane.
        ValueError: data or options that cannot give an answer.
    """
    if liner is not None and cell_pitch is not None:
        raise ValueError("cell_pitch is the liner's; name it only where no liner is given")
    several = liner if isinstance(liner, list | tuple) else [] if liner is None else [liner]
    models = [as_liner(each) for each in several]
    reading = reading_of(plane, models, frequency, Choices(**choices), cell_pitch=cell_pitch)
    known = take_moments(reading, run or reduce, progress)
    if inputs := origin_of(named_planes(plane))["inputs"]:
        about = dataclasses.replace(known.plane, provenance={**known.plane.provenance, "inputs": inputs})
        known = dataclasses.replace(known, plane=about)
    return known


def answer(
    known: Moments,
    liner: LinerModel,
    frequency: Tensor,
    chosen: Choices,
    reference_phase: Any = None,
    pressure: Any = None,
) -> ImpedanceMap:
    """The map from moments that were just read, or by choices of ``fitting``."""
    plane, liner, names = known.plane, liner.in_flow(known.plane.mach), COMPUTED[chosen.averaging]
    found = {name: average(known, liner, frequency, chosen, name, reference_phase) for name in names}
    heard, of_sound = review.review_sound(known, liner, frequency, chosen)
    without_tone = any(note.code == review.NO_TONE for note in heard)
    answered = "admittance" if without_tone and chosen.averaging == "phase-locked" else chosen.averaging
    chief = found[answered].liner
    error, doubts = review.review_answer(known, liner, found["admittance"], chief, frequency, chosen)
    check, words, failures = check_level(known, frequency, found, chosen, answered, pressure)
    notes = [*review.review_case(plane, liner, frequency), *known.notes, *heard, *doubts, *failures]
    facts = facts_of(known, liner, chosen, error, pressure, reference_phase)
    facts |= {"averaging": answered, "level_check": words, **of_sound}
    about: dict[str, Any] = {"averaging": answered, "choices": facts, "level_check": check}
    return map_of(known, liner, frequency, found, notes=tuple(dict.fromkeys(notes)), **about)


def fitting(known: Moments, liner: LinerModel, frequency: Tensor, chosen: Choices) -> Choices:
    """Choices, settled for the plane of moments; a ValueError for what these cannot answer: another drive, averaging,
    cell and so on."""
    name, again = f"{known.plane.name} was reduced", "or reduce the data again"
    liner = liner.in_flow(known.plane.mach)
    known.require_speeds(liner)
    chosen = settled(known.plane, chosen, frequency, liner, known.cell_pitch)
    wanted = chosen.describe()
    free = {"phase", "missing", "allow_short"}  # choices that may be made again; a phase where its line is held
    free |= {"averaging"} if chosen.averaging in known.sums or chosen.drive == "rms" else set()
    free |= set() if chosen.averaging == "phase-locked" else {"background"}
    for key, made in known.settings.items():
        if wanted[key] != made and key not in free:
            remedy = f"leave {key} out" if made is None else f"choose {key}={made!r}"
            raise ValueError(f"{name} with {key} {made!r}, and {wanted[key]!r} is asked for; {remedy}, {again}")
    if liner.cell_pitch != known.cell_pitch:
        pitches = f"a cell_pitch of {known.cell_pitch} m, and the liner has {liner.cell_pitch} m"
        raise ValueError(f"{name} for {pitches}; {again[3:]}")
    needed = []
    if chosen.phase != "averaged":
        needed.append((f"the line of phase {chosen.phase!r}", known.turns / 2))
    if chosen.wall_filter is not None or chosen.hears_tone:
        needed.append(("the coherence of v with the tone", known.survey.lines))
    for what, lines in needed:
        for f in (f for f in frequency.tolist() if index_of_frequency(lines, f) is None):
            held = ", ".join(f"{line:g}" for line in lines.tolist()) + " Hz" if len(lines) else "no line"
            text = f"{name} with {what} at {held}, and not at {f:g} Hz"
            raise ValueError(f"{text}; choose phase='averaged', no wall_filter, {again}")
    return chosen


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


def facts_of(
    known: Moments, liner: LinerModel, chosen: Choices, error: float, pressure: Any = None, phase: Any = None
) -> dict[str, Any]:
    """Every choice, what followed from it, and where all came from, so that a result can be made again."""
    plane, blocks, locked = known.plane, known.survey.blocks, known.locked
    facts: dict[str, Any] = {
        "version": __version__,
        **chosen.describe(),
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
        facts["incoherent_scale"] = float((known.membership.mean(scale) * sizes).sum() / sizes.sum())  # of all cells
    in_file = isinstance(plane.velocity, ReducedVelocity) and plane.velocity.in_file
    named = [("moments", plane.name)] if in_file else named_planes(plane)
    named += [("liner", name) for name in liner.files]
    named += [] if pressure is None else [("wall pressure", getattr(pressure, "name", ""))]
    return facts | origin_of(named, reference_phase=None if phase is None else real_tensor(phase).tolist())

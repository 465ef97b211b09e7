"""DIR-TDIBC: impedance from wall-normal velocity, probe by probe, without a propagation model."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY, stated_frequency, tell
from torchliner.engine.moments import Moments, projection_of
from torchliner.engine.nodes import ANY_LINER, Nodes, choose_nodes
from torchliner.engine.sums import reduce
from torchliner.engine.threads import is_differentiated
from torchliner.engine.workers import Reduce, reduce_on
from torchliner.io.kept_rows import KeptRows
from torchliner.io.plane_join import named_planes
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.notes import Note
from torchliner.records.origin import origin_of
from torchliner.velocity import review
from torchliner.velocity.answer import answer, origin_facts
from torchliner.velocity.choices import Choices
from torchliner.velocity.parts import measure_part
from torchliner.velocity.reading import Progress, Reading, measure


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
        reference_phase: psi in rad for ``phase="given"``: x(t) = cos(2 pi f t + psi) with t = 0 at the first sample;
            broadcast over the probe axes (add a last axis for several frequencies).
        pressure: ``PressureRecord`` of the same run, or ``MicrophoneLine`` along the wall, for the level check;
            default the ``incident_level`` that the plane states.
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
    '4.61-0.27j'
    """
    model, chosen = as_liner(liner), Choices(**choices)
    if isinstance(plane, Moments):
        asked = stated_frequency(frequency, plane.plane.frequency, plane.plane.name, plane.plane.sampling_rate)
        chosen = with_window(chosen, asked)
        require_fitting(plane, chosen, model, asked)
        known, notes = plane, [*plane.notes, *review.review_record(plane.plane, asked, chosen)]
        notes += review.review_liner(plane.plane, model)
    else:
        asked, notes, known = _measured(plane, model, frequency, chosen, progress)
        chosen = with_window(chosen, asked)
    found = answer(known, model, asked, chosen, reference_phase, pressure, notes)
    found = dataclasses.replace(
        found, choices={**found.choices, **origin_facts(plane, model, pressure, reference_phase)}
    )
    tell([note.text for note in found.notes])
    return found


def moments(
    plane: VelocityPlane,
    liner: Liner | None = None,
    frequency: Any = None,
    *,
    cell_pitch: float | None = None,
    progress: Progress | None = None,
    client: Any = None,
    kept: str | Path | None = None,
    blocks: Iterable[int] | None = None,
    given: Moments | None = None,
    **choices: Any,
) -> Moments:
    """Sums over a plane that hold R(f, |v|) of any liner at any frequency.

    Args:
        plane: wall-normal velocity, (..., T) m/s.
        liner: for which the nodes are chosen, and whose cells are averaged over; several of one pitch as a list;
            default any: 64 nodes, which know R of holes of 0.5 to 2.5 mm up to 6 kHz to 1e-5 in 5 to 15 % open area,
            to 3e-4 in 3 %; each result states the error.
        frequency: Hz, at which a phase rule other than ``averaged`` is to be used, and for the nodes; default the
            plane's own tone.
        cell_pitch: L_c, m, without a liner.
        progress: called with numbers of samples read.
        client: of dask.distributed, whose workers read the plane; it must still be in its file
            (``read_plane(file, lazy=True)``). The same bits whatever the workers.
        kept: folder, of this plane alone, for finished shares, so that a reading that was killed goes on; the plane
            as for ``client``.
        blocks: numbers of those that are read, of the S <= 32 of the record: ``Moments.join`` makes the whole of such
            parts. Where that still lacks what a second reading must find (averaging ``phase-locked``, the default;
            ``mean`` removed), read the same parts again with it as ``given``, and join these.
        given: of parts, see ``blocks``.
        choices: as for ``educe``; what concerns |v| is fixed here, the rest is chosen when Z is asked for.
    Raises:
        TypeError: plane is no VelocityPlane.
        ValueError: data or options that cannot give an answer.
    """
    reading, notes = reading_of(plane, liner, frequency, cell_pitch, choices)
    if blocks is None and given is not None:
        raise ValueError("given is of parts; name their blocks, too")
    run: Reduce = reduce
    if client is not None or kept is not None:
        run = reduce_on(client, None if kept is None else KeptRows(Path(kept)))
    if blocks is None:
        known = measure(reading, run, progress)
    else:
        known = measure_part(reading, blocks, given, run, progress)
    found = review.review_moments(reading.plane, known)
    notes += [] if known.only is not None else found  # of parts, when they are joined
    notes += review.review_lost_cells(reading.plane, reading.cells, known.cells)
    if inputs := origin_of(named_planes(plane))["inputs"]:
        about = dataclasses.replace(known.plane, provenance={**known.plane.provenance, "inputs": inputs})
        known = dataclasses.replace(known, plane=about)
    return dataclasses.replace(known, notes=tuple(notes))


def reading_of(
    plane: VelocityPlane, liner: Any, frequency: Any, cell_pitch: float | None, choices: Any
) -> tuple[Reading, list[Note]]:
    """What ``moments`` reads, with the first notes; arguments as there."""
    if not isinstance(plane, VelocityPlane):
        raise TypeError(f"plane is {type(plane).__name__}; one VelocityPlane is needed")
    if liner is not None and cell_pitch is not None:
        raise ValueError("cell_pitch is the liner's; name it only where no liner is given")
    several = liner if isinstance(liner, list | tuple) else [] if liner is None else [liner]
    models = [as_liner(each) for each in several]
    asked = stated_frequency(frequency, plane.frequency, plane.name, plane.sampling_rate)
    chosen = with_window(Choices(**choices), asked)
    nodes: Nodes = choose_nodes(models, asked, chosen.tolerance(plane.velocity.dtype)) if models else ANY_LINER
    notes = [note for model in models for note in review.review_liner(plane, model)]
    notes = [*review.review_record(plane, asked, chosen), *dict.fromkeys(notes)]
    shared = models[0] if models else _AnyLiner(cell_pitch)
    return reading_for(plane, shared, asked, nodes, chosen, notes, projected=False), notes


class _AnyLiner(LinerModel):
    """Liners that are not known yet, by the cells that they share."""

    def __init__(self, cell_pitch: float | None) -> None:
        self.cell_pitch = cell_pitch


def with_window(chosen: Choices, frequency: Tensor) -> Choices:
    """With the length of the running rms, by default a period of the lowest frequency asked for, (F,)."""
    if chosen.drive != "running-rms" or chosen.running_window is not None:
        return chosen
    return dataclasses.replace(chosen, running_window=1 / float(frequency.min()))


def _measured(
    plane: Any, liner: LinerModel, frequency: Any, chosen: Choices, progress: Progress | None
) -> tuple[Tensor, list[Note], Moments]:
    if not isinstance(plane, VelocityPlane):
        raise TypeError(f"plane is {type(plane).__name__}; make a VelocityPlane of your data first")
    asked = stated_frequency(frequency, plane.frequency, plane.name, plane.sampling_rate)
    chosen = with_window(chosen, asked)
    notes = review.review_record(plane, asked, chosen) + review.review_liner(plane, liner)
    nodes = choose_nodes([liner], asked, chosen.tolerance(plane.velocity.dtype))
    reading = reading_for(plane, liner, asked, nodes, chosen, notes, projected=True)
    known = measure(reading, progress=progress)
    notes += review.review_moments(plane, known) + review.review_lost_cells(plane, reading.cells, known.cells)
    return asked, notes, known


def reading_for(
    plane: VelocityPlane,
    liner: LinerModel,
    frequency: Tensor,
    nodes: Nodes,
    chosen: Choices,
    notes: list[Note],
    *,
    projected: bool,
) -> Reading:
    """How a plane is read for a liner; ``projected``: for this liner at these frequencies (Hz, (F,)) alone.

    Raises:
        ValueError: the velocity carries derivatives; the record holds no whole period.
    """
    if torch.is_grad_enabled() and isinstance(plane.velocity, Tensor) and is_differentiated(plane.velocity):
        raise ValueError(
            f"{plane.name}: velocity carries a gradient, which sums over |v| would lose; replay gives the reflected "
            "signal with its derivatives, or detach the velocity"
        )
    summed = None if chosen.drive == "rms" else nodes
    projection = projection_of(nodes, liner, frequency) if projected and summed is not None else None
    reading = Reading.of(plane, chosen, frequency, summed, liner.cell_pitch, projection)
    notes += review.review_cells(plane, liner, frequency, reading.cells, chosen)
    notes += review.review_blocks(plane, reading.blocks, plane.frequency or float(frequency.min()), chosen)
    return reading


def require_fitting(known: Moments, chosen: Choices, liner: LinerModel, frequency: Tensor) -> None:
    """Refuse what the moments of a plane cannot answer: another drive, averaging, cell and so on.

    Raises:
        ValueError: what differs, and what to do.
    """
    name = known.plane.name
    known.require_speeds(liner)
    if known.only is not None:
        raise ValueError(
            f"{name} holds a part, blocks {', '.join(map(str, known.only))}: join all of them; where that lacks the "
            "second reading, read the parts again with it as given"
        )
    for key, made in known.settings.items():
        wanted = getattr(chosen, key)
        within = (
            (key == "averaging" and wanted in known.sums)
            or (key == "averaging" and chosen.drive == "rms")
            or (key == "phase" and wanted == "averaged")
            or key in ("missing", "allow_short")
            or (key == "background_rms" and "phase-locked" not in chosen.averagings)
        )
        if wanted != made and not within:
            remedy = f"leave {key} out" if made is None else f"choose {key}={made!r}"
            raise ValueError(
                f"{name} was reduced with {key} {made!r}, and {wanted!r} is asked for; {remedy}, or reduce the data "
                "again"
            )
    if liner.cell_pitch != known.cell_pitch:
        raise ValueError(
            f"{name} was reduced for cells of {_length(known.cell_pitch)}, and the liner's are of "
            f"{_length(liner.cell_pitch)}; reduce the data again with that liner"
        )
    if chosen.phase != "averaged":
        for f in frequency.tolist():
            if not bool(((known.turns / (2 * f) - 1).abs() < SAME_FREQUENCY).any()):
                raise ValueError(
                    f"{name} holds the line of phase {chosen.phase!r} at {_listed(known.turns / 2)}, and not at "
                    f"{f:g} Hz; reduce the data again with that frequency"
                )
    lines = known.survey.index_of(frequency)
    if (chosen.wall_filter is not None or chosen.phase == "self-consistent") and -1 in lines:
        f = float(frequency[lines.index(-1)])
        raise ValueError(
            f"{name} holds the coherence of v with {_listed(known.survey.lines)}, and not with {f:g} Hz, which "
            "wall_filter and phase 'self-consistent' need: reduce the data again with that frequency"
        )


def _listed(frequency: Tensor) -> str:
    return ", ".join(f"{f:g}" for f in frequency.tolist()) + " Hz" if len(frequency) else "no line"


def _length(pitch: float | None) -> str:
    return "all probes (no cell_pitch)" if pitch is None else f"{1e3 * float(pitch):.6g} mm"

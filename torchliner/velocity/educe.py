"""DIR-TDIBC: impedance from wall-normal velocity, probe by probe, without a propagation model."""

import dataclasses
from pathlib import Path
from typing import Any

from torchliner.checks import tell
from torchliner.engine.moments import Moments
from torchliner.engine.sums import reduce
from torchliner.io.plane_parts import named_planes
from torchliner.liners.model import Liner, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.origin import origin_of
from torchliner.velocity.answer import answer, fitting
from torchliner.velocity.choices import Choices
from torchliner.velocity.level_check import match_level
from torchliner.velocity.reading import Progress, reading_of, take_moments
from torchliner.velocity.workers import Reduce, reduce_on


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
    client: Any = None,
    kept: str | Path | None = None,
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
    run: Reduce = reduce
    if client is not None or kept is not None:
        run = reduce_on(client, None if kept is None else Path(kept))
    known = take_moments(reading, run, progress)
    if inputs := origin_of(named_planes(plane))["inputs"]:
        about = dataclasses.replace(known.plane, provenance={**known.plane.provenance, "inputs": inputs})
        known = dataclasses.replace(known, plane=about)
    return known

"""DIR-TDIBC along a line of laser Doppler stations, resumable station by station."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import torch

from torchliner.checks import tell
from torchliner.io.burst_sources import Place, StationSource, list_stations, order_of
from torchliner.io.line_parts import LineParts
from torchliner.ldv.join_stations import join_lines, review_line
from torchliner.ldv.line_average import average_line
from torchliner.ldv.line_choices import StationChoices
from torchliner.ldv.station import checked_phase, educe_station
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.records import BurstRecord, ImpedanceLine, ReferenceChannel
from torchliner.tdibc.choices import Choices
from torchliner.version import __version__

Station = BurstRecord | StationSource
Reference = ReferenceChannel | Callable[[Station], ReferenceChannel]


def educe_bursts(
    stations: str | Path | Sequence[Station],
    liner: Liner,
    frequency: Any = None,
    *,
    reference: Reference | Sequence[Reference] | None = None,
    reference_phase: Any = None,
    parts: str | Path | LineParts | None = None,
    progress: Callable[[int], None] | None = None,
    **choices: Any,
) -> ImpedanceLine:
    """Impedance along a line of stations of bursts, segment by segment, and its averages.

    Each station is put on a uniform grid, cut into overlapping segments, and these are replayed as
    one batch. A station's result depends on no other station.

    Args:
        stations: file or folder, as for ``read_bursts``; or records; or what ``list_stations``
            returns, which is read one by one, so that the line need not fit into memory.
        liner: as for ``educe``.
        frequency: Hz, one or several; default the stations' own tone.
        reference: channel that carries the phase of the sound, one for all or one a station in the
            order of ``stations``, or functions that read it for a station. With it the coherence
            of v is that with the reference, ``self-consistent`` takes the part of v that follows
            it, and ``given`` its phase.
        reference_phase: psi, rad, for ``phase="given"``, one for all or one a station in the order
            of ``stations``: x(t) = cos(2 pi f t + psi) on the clock of the arrivals, or, with a
            reference, ahead of it by psi.
        parts: folder where each finished station is kept; a run that was broken off takes up what
            is there and was made from the same data with the same choices.
        progress: called with 1 after each station.
        choices: see ``StationChoices`` and ``Choices``; ``segment`` is the former's.
    Returns:
        The line in the order of x, y, z, with the average (5.2) over the stations that count.
    Raises:
        ValueError: data or options that cannot give an answer; the message names the station.
        TypeError: a value of the wrong kind.
    Warns:
        DataWarning: the answer stands but is doubtful; the same text is in ``notes``.
    Source: Roncen et al. (2026), sections 3.3, 5.5.2, 5.5.3. Departures: the tone is corrected for
        the interpolation, flagged stations do not count in averages, intervals.
    """
    if isinstance(stations, (str, Path)):
        stations = list_stations(stations)
    stations = _checked(stations)
    model = as_liner(liner)
    how, chosen = _sorted_choices(choices)
    if reference_phase is not None and chosen.phase != "given":
        raise ValueError(f"reference_phase is only used with phase='given', not {chosen.phase!r}")
    references = _references(reference, len(stations))
    phases = checked_phase(reference_phase, len(stations))
    kept = LineParts(parts) if isinstance(parts, (str, Path)) else parts
    # What all keys share; a table takes some work to tell.
    shared = [] if kept is None else [
        liner_fingerprint(model), _plain(frequency), how.describe(), chosen.describe(),
    ]  # fmt: skip
    lines = []
    for station, channel, phase in _along_x(stations, references, phases):
        known = _channel(channel, station)

        def work(station: Station = station, known: Any = known, phase: Any = phase) -> Any:
            record = station.read() if isinstance(station, StationSource) else station
            return educe_station(record, model, frequency, how, chosen, known, phase)

        if kept is None:
            lines.append(work())
        else:
            lines.append(kept.take_up(_key(station, known, [*shared, phase]), work))
        if progress is not None:
            progress(1)
    return finished_line(lines, how, chosen)


def _along_x(
    stations: Sequence[Station], references: Sequence[Any], phases: Sequence[Any]
) -> list[tuple[Station, Any, Any]]:
    """Stations with what belongs to each, in the order of x, y, z where all are known.

    Raises:
        ValueError: two stations have the same position.
    """
    triples = list(zip(stations, references, phases, strict=True))
    places = [_place_of(station) for station in stations]
    if any(None in place for place in places):
        return triples
    return [triples[i] for i in order_of(places, [station.name for station in stations])]


def _place_of(station: Station) -> Place:
    if isinstance(station, StationSource):
        return station.place
    return (station.x, station.y, station.z)


def _channel(channel: Any, station: Station) -> ReferenceChannel | None:
    known = channel(station) if callable(channel) else channel
    if known is not None and not isinstance(known, ReferenceChannel):
        raise TypeError(
            f"a reference is {type(known).__name__}; make a ReferenceChannel of your samples and "
            "their rate first"
        )
    return known


def finished_line(
    lines: Sequence[ImpedanceLine], how: StationChoices, chosen: Choices
) -> ImpedanceLine:
    """Stations joined, with their average; what is doubtful is warned of once."""
    line = join_lines(lines)
    line = dataclasses.replace(line, average=average_line(line, chosen, how.monte_carlo))
    notes = review_line(line)
    tell(notes, depth=2)
    return dataclasses.replace(line, notes=tuple(notes))


def _checked(stations: Any) -> list[Station]:
    found = [stations] if isinstance(stations, (BurstRecord, StationSource)) else list(stations)
    if not found:
        raise ValueError("no station is given")
    for each in found:
        if not isinstance(each, (BurstRecord, StationSource)):
            raise TypeError(
                f"a station is {type(each).__name__}; make a BurstRecord of your bursts first"
            )
    return found


def _sorted_choices(choices: dict[str, Any]) -> tuple[StationChoices, Choices]:
    """Those between bursts and segments, and those of the replay."""
    mine = {field.name for field in fields(StationChoices)}
    how = StationChoices(**{key: value for key, value in choices.items() if key in mine})
    rest = {key: value for key, value in choices.items() if key not in mine}
    if rest.get("incident") is not None:
        raise ValueError("stations of bursts are educed for tones; leave incident out")
    return how, Choices(**rest)


def _references(reference: Any, count: int) -> list[Any]:
    if not isinstance(reference, (list, tuple)):
        return [reference] * count
    if len(reference) != count:
        raise ValueError(
            f"{len(reference)} reference channels for {count} stations; one for all or one a "
            "station, in their order"
        )
    return list(reference)


def _key(station: Station, channel: ReferenceChannel | None, said: list[Any]) -> str:
    """What a station's result follows from, hashed."""

    if isinstance(station, StationSource):
        source = f"{station.digest()} {station.name}"
    else:
        source = _hash(list(vars(station).values()))
    reference = [] if channel is None else [channel.values, channel.sampling_rate, channel.start]
    text = json.dumps([__version__, source, _hash(reference), *said], default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def liner_fingerprint(liner: LinerModel) -> str:
    """Hash of what a liner says of itself and of its impedances: tables say too little."""
    low, high = liner.frequency_range or (300.0, 3500.0)
    top = min(20.0, liner.speed_max or 20.0)
    speeds = torch.linspace(0, top, 41, dtype=torch.float64)
    with torch.no_grad():
        values = [
            torch.as_tensor(liner.impedance(float(f), speeds)).to(torch.complex128)
            for f in torch.linspace(float(low), float(high), 9)
        ]
    facts = json.dumps(liner.describe(), default=str)
    return _hash([torch.view_as_real(torch.stack(values)), facts])


def _hash(values: list[Any]) -> str:
    digest = hashlib.sha256()
    for value in values:
        digest.update(value.numpy().tobytes() if hasattr(value, "numpy") else repr(value).encode())
    return digest.hexdigest()


def _plain(frequency: Any) -> Any:
    return frequency.tolist() if hasattr(frequency, "tolist") else frequency

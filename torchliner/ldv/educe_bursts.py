"""DIR-TDIBC along a line of laser Doppler stations, resumable station by station."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from torchliner.checks import tell
from torchliner.io.burst_format import Place
from torchliner.io.burst_sources import StationSource, list_stations, order_of
from torchliner.io.line_parts import LineParts
from torchliner.ldv.join_stations import join_lines
from torchliner.ldv.line_average import average_line
from torchliner.ldv.line_choices import StationChoices
from torchliner.ldv.line_closure import with_line_closure
from torchliner.ldv.line_warnings import warnings_of
from torchliner.ldv.station import educe_station
from torchliner.ldv.station_key import liner_fingerprint, station_key
from torchliner.ldv.station_reference import checked_phases
from torchliner.liners.model import Liner, as_liner
from torchliner.names import ORDERS
from torchliner.records import BurstRecord, ImpedanceLine, ReferenceChannel
from torchliner.replay.phase_rule import phase_rule
from torchliner.tdibc.choices import Choices

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
        liner: as for ``educe``.  frequency: Hz, one or several; default the stations' own tone.
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
    stations = _checked_stations(stations)
    model = as_liner(liner)
    station_choices, replay_choices = _split(choices)
    if reference_phase is not None and not phase_rule(replay_choices.phase).takes_phase:
        raise ValueError(
            f"reference_phase is only used with phase='given', not {replay_choices.phase!r}"
        )
    references = _checked_references(reference, len(stations))
    phases = checked_phases(reference_phase, len(stations))
    kept = LineParts(parts) if isinstance(parts, (str, Path)) else parts
    shared: list[Any] = []
    if kept is not None:  # the fingerprint of a table takes some work
        wanted = frequency.tolist() if hasattr(frequency, "tolist") else frequency
        shared = [
            liner_fingerprint(model), wanted, station_choices.describe(), replay_choices.describe(),
        ]  # fmt: skip
    lines = []
    for i in _order(stations):
        channel = _channel(references[i], stations[i])
        work = partial(
            _read_and_educe, stations[i], model, frequency, station_choices, replay_choices,
            channel, phases[i],
        )  # fmt: skip
        if kept is None:
            lines.append(work())
        else:
            key = station_key(stations[i], channel, [*shared, phases[i]])
            lines.append(kept.take_up(key, work))
        if progress is not None:
            progress(1)
    line = join_lines(lines)
    average = average_line(line, replay_choices, station_choices.monte_carlo)
    line = with_line_closure(dataclasses.replace(line, average=average), replay_choices)
    notes = warnings_of(line)
    tell(notes)
    return dataclasses.replace(line, notes=tuple(notes))


def _read_and_educe(station: Station, *arguments: Any) -> ImpedanceLine:
    record = station.read() if isinstance(station, StationSource) else station
    return educe_station(record, *arguments)


def _order(stations: Sequence[Station]) -> list[int]:
    """Numbers of the stations in the order of x, y, z where all are known.

    Raises:
        ValueError: two stations have the same position.
    """
    places: list[Place] = [
        each.place if isinstance(each, StationSource) else (each.x, each.y, each.z)
        for each in stations
    ]
    if any(None in place for place in places):
        return list(range(len(stations)))
    return order_of(places, [each.name for each in stations])


def _channel(reference: Any, station: Station) -> ReferenceChannel | None:
    channel = reference(station) if callable(reference) else reference
    if channel is not None and not isinstance(channel, ReferenceChannel):
        raise TypeError(
            f"a reference is {type(channel).__name__}; make a ReferenceChannel of your samples and "
            "their rate first"
        )
    return channel


def _checked_stations(stations: Any) -> list[Station]:
    if isinstance(stations, (str, Path)):
        return list(list_stations(stations))
    found = [stations] if isinstance(stations, (BurstRecord, StationSource)) else list(stations)
    if not found:
        raise ValueError("no station is given")
    for each in found:
        if not isinstance(each, (BurstRecord, StationSource)):
            raise TypeError(
                f"a station is {type(each).__name__}; make a BurstRecord of your bursts first"
            )
    return found


def _checked_references(reference: Any, count: int) -> list[Any]:
    if not isinstance(reference, (list, tuple)):
        return [reference] * count
    if len(reference) != count:
        raise ValueError(
            f"{len(reference)} reference channels for {count} stations; one for all or one a "
            "station, in their order"
        )
    return list(reference)


def _split(choices: dict[str, Any]) -> tuple[StationChoices, Choices]:
    """Choices between bursts and segments, and those of the replay."""
    names = {field.name for field in dataclasses.fields(StationChoices)}
    station_choices = StationChoices(**{k: v for k, v in choices.items() if k in names})
    rest = {key: value for key, value in choices.items() if key not in names}
    if rest.get("incident") is not None:
        raise ValueError("stations of bursts are educed for tones; leave incident out")
    # A station is one place: the coherent velocity of its cell is not known.
    return station_choices, Choices(**{"order": ORDERS[0], **rest})

"""DIR-TDIBC along a line of laser Doppler stations, resumable station by station."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import tell
from torchliner.engine.workers import tasks_in_order
from torchliner.io.burst_format import Place
from torchliner.io.burst_sources import StationSource, list_stations, order_of
from torchliner.io.line_parts import LineParts
from torchliner.ldv.line_average import average_line
from torchliner.ldv.line_choices import StationChoices
from torchliner.ldv.line_level_check import with_level_check
from torchliner.ldv.line_warnings import warnings_of
from torchliner.ldv.station import CASE, educe_station
from torchliner.ldv.station_segments import checked_phases
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.records import BurstRecord, ImpedanceLine, Interval, ReferenceChannel
from torchliner.records.origin import origin_of, with_choices
from torchliner.velocity.choices import Choices
from torchliner.version import __version__

Station = BurstRecord | StationSource
Reference = ReferenceChannel | Callable[[Station], ReferenceChannel]
SHARED = ("frequency", "goodrich")  # tensors that are those of the whole line
LISTS = ("names", "flags", "dropped", "station_notes")
ONE_PLACE = {"averaging": "admittance", "background_rms": None, "missing": "refuse"}
PADDED = ("reflection", "segment_start")  # nan for the segments that a shorter station lacks


def educe_bursts(
    stations: str | Path | Sequence[Station], liner: Liner, frequency: Any = None, *,
    reference: Reference | Sequence[Reference] | None = None, reference_phase: Any = None,
    parts: str | Path | LineParts | None = None, progress: Callable[[int], None] | None = None,
    client: Any = None, **choices: Any,
) -> ImpedanceLine:  # fmt: skip
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
            it, and ``given`` its phase. Without it closure of the line needs times that count from
            the same instant of the sound's generator at all stations.
        reference_phase: psi, rad, for ``phase="given"``, one for all or one a station in the order
            of ``stations``: x(t) = cos(2 pi f t + psi) on the clock of the arrivals, or, with a
            reference, ahead of it by psi.
        parts: folder where each finished station is kept; a run that was broken off takes up what
            is there and was made from the same data with the same choices.
        progress: called with 1 after each station.
        client: of dask.distributed, whose workers take a station each; stations of a file or folder
            they read themselves, under the same path. The line is the same to the bit.
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
    if reference_phase is not None and replay_choices.phase != "given":
        raise ValueError(f"reference_phase is only used with phase='given', not {replay_choices.phase!r}")
    references: list[Any] = [reference] * len(stations)
    if isinstance(reference, (list, tuple)):
        references = list(reference)
    if len(references) != len(stations):
        raise ValueError(
            f"{len(references)} reference channels for {len(stations)} stations; one for all or "
            "one a station, in their order"
        )
    phases = checked_phases(reference_phase, len(stations))
    kept = LineParts(parts) if isinstance(parts, (str, Path)) else parts
    order, keys = _order(stations), []
    if kept is not None:  # the fingerprint of a table takes some work
        wanted = frequency.tolist() if hasattr(frequency, "tolist") else frequency
        shared = [
            liner_fingerprint(model), wanted, station_choices.describe(), replay_choices.describe(),
        ]  # fmt: skip
        keys = [station_key(stations[i], _channel(references[i], stations[i]), [*shared, phases[i]]) for i in order]
    missing = [i for i, key in zip_longest(order, keys) if kept is None or not kept.holds(key)]
    made = tasks_in_order(
        client, _read_and_educe, (model, frequency, station_choices, replay_choices),
        [(stations[i], references[i], phases[i]) for i in missing],
    )  # fmt: skip
    lines = []
    for _, key in zip_longest(order, keys):
        lines.append(next(made) if kept is None else kept.take_up(key, partial(next, made)))
        if progress is not None:
            progress(1)
    line = join_lines(lines)
    average = average_line(line, replay_choices, station_choices.monte_carlo)
    line = with_level_check(dataclasses.replace(line, average=average), replay_choices)
    notes = warnings_of(line)
    tell(notes)
    known = None if reference_phase is None else phases
    origin = origin_of(_named(stations, references, model), reference_phase=known)
    return with_choices(dataclasses.replace(line, notes=tuple(notes)), **origin)


def _named(stations: Sequence[Station], references: Sequence[Any], liner: LinerModel) -> Iterator[tuple[str, str]]:
    """What went into a line, and the names of its files."""
    for each in stations:
        own = each.path if isinstance(each, StationSource) else each.name.split(", station ")[0]
        yield "bursts", str(own)
    for channel in references:  # a function is not called once more
        if isinstance(channel, ReferenceChannel):
            yield "reference channel", channel.name
    yield from (("liner", name) for name in liner.files)


def _read_and_educe(
    liner: LinerModel, frequency: Any, station_choices: StationChoices, choices: Choices,
    station: Station, reference: Any, phase: Any,
) -> ImpedanceLine:  # fmt: skip
    channel = _channel(reference, station)
    record = station.read() if isinstance(station, StationSource) else station
    return educe_station(
        record, liner, frequency, station_choices, choices, channel, phase
    )  # fmt: skip


def _order(stations: Sequence[Station]) -> list[int]:
    """Numbers of the stations in the order of x, y, z where all are known.

    Raises:
        ValueError: two stations have the same position.
    """
    places: list[Place] = [
        each.place if isinstance(each, StationSource) else (each.x, each.y, each.z) for each in stations
    ]
    if any(None in place for place in places):
        return list(range(len(stations)))
    return order_of(places, [each.name for each in stations])


def _channel(reference: Any, station: Station) -> ReferenceChannel | None:
    channel = reference(station) if callable(reference) else reference
    if channel is not None and not isinstance(channel, ReferenceChannel):
        raise TypeError(
            f"a reference is {type(channel).__name__}; make a ReferenceChannel of your samples and their rate first"
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
            raise TypeError(f"a station is {type(each).__name__}; make a BurstRecord of your bursts first")
    return found


def _split(choices: dict[str, Any]) -> tuple[StationChoices, Choices]:
    """Choices between bursts and segments, and those of the replay."""
    names = {field.name for field in dataclasses.fields(StationChoices)}
    station_choices = StationChoices(**{k: v for k, v in choices.items() if k in names})
    rest = {key: value for key, value in choices.items() if key not in names}
    for name, only in ONE_PLACE.items():
        if rest.setdefault(name, only) != only:
            raise ValueError(
                f"{name} is {rest[name]!r}; it is for planes. A station is one place without "
                f"neighbours, and bursts without a value are dropped: leave {name} out"
            )
    return station_choices, Choices(**rest)


def join_lines(lines: Sequence[ImpedanceLine]) -> ImpedanceLine:
    """Stations of several lines as one, in the order given; averages are not carried over.

    Raises:
        ValueError: lines of different cases or frequencies.
    """
    first = lines[0]
    for other in lines[1:]:
        _require_same_case(first, other)
    most = max(line.segment_start.shape[1] for line in lines)
    joined: dict[str, Any] = {}
    for name, value in vars(first).items():
        values = [getattr(line, name) for line in lines]
        if name in LISTS:
            joined[name] = tuple(chain.from_iterable(values))
        elif name in PADDED:
            joined[name] = torch.cat([_padded(each, most) for each in values])
        elif isinstance(value, Tensor) and name not in SHARED:
            joined[name] = torch.cat(values)
    intervals = [line.interval for line in lines if line.interval is not None]
    joined["interval"] = Interval.joined(intervals) if len(intervals) == len(lines) else None
    return dataclasses.replace(first, average=None, notes=(), **joined)


def _padded(values: Tensor, segments: int) -> Tensor:
    nan = complex(float("nan"), float("nan")) if values.is_complex() else float("nan")
    missing = values.new_full((len(values), segments - values.shape[1], *values.shape[2:]), nan)
    return torch.cat([values, missing], dim=1)


def _require_same_case(first: ImpedanceLine, other: ImpedanceLine) -> None:
    if not torch.equal(first.frequency, other.frequency):
        raise ValueError(
            f"{other.names[0]} is educed at {other.frequency.tolist()} Hz, {first.names[0]} at "
            f"{first.frequency.tolist()} Hz; name the frequency for all"
        )
    if first.choices["referred"] != other.choices["referred"]:
        with_one, without = (first, other) if first.choices["referred"] else (other, first)
        raise ValueError(
            f"{with_one.names[0]} has a reference channel, {without.names[0]} none: phases "
            "relative to a channel and to the clock of the arrivals are not of one line; give each "
            "station a channel, or none"
        )
    tones = [line.choices["tone"] for line in (other, first)]
    if None not in tones and tones[0] != tones[1]:
        raise ValueError(
            f"{other.names[0]} states a tone of {tones[0]:g} Hz, {first.names[0]} of {tones[1]:g} "
            "Hz; the stations of a line share one case"
        )
    mine, theirs = (None if line.goodrich is None else line.goodrich.tolist() for line in (first, other))
    if mine != theirs:
        raise ValueError(
            f"{other.names[0]} has another displacement thickness or Mach number than "
            f"{first.names[0]}; the stations of a line share one case"
        )
    for key in CASE:
        mine, theirs = getattr(first, key), getattr(other, key)
        if mine != theirs:
            raise ValueError(
                f"{other.names[0]} has {key} {theirs}, {first.names[0]} {mine}; the stations of a line share one case"
            )


def station_key(station: BurstRecord | StationSource, reference: ReferenceChannel | None, choices: list[Any]) -> str:
    """Hash of the data, the reference channel and all choices: 32 hexadecimal digits."""
    if isinstance(station, StationSource):
        source = f"{station.digest()} {station.name}"
    else:
        source = _hash(list(vars(station).values()))
    channel = [] if reference is None else [reference.values, reference.sampling_rate, reference.start]
    text = json.dumps([__version__, source, _hash(channel), *choices], default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def liner_fingerprint(liner: LinerModel) -> str:
    """Hash of a liner's description and impedances: the name of a table says too little."""
    low, high = liner.frequency_range or (300.0, 3500.0)
    top = min(20.0, liner.speed_max or 20.0)
    speeds = torch.linspace(0, top, 41, dtype=torch.float64)
    with torch.no_grad():
        values = [
            torch.as_tensor(liner.impedance(float(f), speeds)).to(torch.complex128)
            for f in torch.linspace(float(low), float(high), 9)
        ]
    about = json.dumps(liner.describe(), default=str)
    return _hash([torch.view_as_real(torch.stack(values)), about])


def _hash(values: list[Any]) -> str:
    digest = hashlib.sha256()
    for value in values:
        digest.update(value.numpy().tobytes() if hasattr(value, "numpy") else repr(value).encode())
    return digest.hexdigest()

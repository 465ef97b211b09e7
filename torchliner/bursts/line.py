"""DIR-TDIBC along a line of laser Doppler stations: one call, which takes up where it was broken off."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.bursts.averages import average_line
from torchliner.bursts.choices import StationChoices, split_choices
from torchliner.bursts.level_check import line_level_check
from torchliner.bursts.line_notes import notes_of
from torchliner.bursts.station import CASE, educe_station
from torchliner.checks import real_tensor, tell
from torchliner.engine.workers import tasks_in_order
from torchliner.io.burst_sources import StationSource, list_stations, order_of
from torchliner.io.line_parts import LineParts
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.records import BurstRecord, ImpedanceLine, Interval, LevelCheck, ReferenceChannel
from torchliner.records.origin import origin_of, with_choices
from torchliner.velocity.choices import Choices
from torchliner.version import __version__

Station = BurstRecord | StationSource
Reference = ReferenceChannel | Callable[[Station], ReferenceChannel]
SHARED = ("frequency", "goodrich")  # tensors that are those of the whole line
LISTS = ("names", "flags", "dropped", "station_notes")
PADDED = ("reflection", "segment_start")  # nan for the segments that a shorter station lacks


def educe_bursts(
    stations: str | Path | Sequence[Station],
    liner: Liner,
    frequency: Any = None,
    *,
    reference: Reference | Sequence[Reference] | None = None,
    reference_phase: Any = None,
    parts: str | Path | LineParts | None = None,
    progress: Callable[[int], None] | None = None,
    client: Any = None,
    **choices: Any,
) -> ImpedanceLine:
    """Impedance along a line of stations of bursts, segment by segment, and its averages.

    Each station is put on a uniform grid, cut into overlapping segments, and these are educed as one batch. A station's
    result depends on no other station. The paper to the letter is ``educe_bursts(stations, liner, frequency,
    correction="none", window="hann", flagged="use")``: linear interpolation, segments of 1 s that overlap by half,
    Hann's window, mean of Z over segments (5.1), mean of admittances over stations (5.2), 5000 draws as a check.

    Args:
        stations: file or folder, as for ``read_bursts``; or records; or what ``list_stations`` returns, which is read
            one by one, so that the line need not fit into memory.
        liner: as for ``educe``.
        frequency: Hz, one or several; default the stations' own tone.
        reference: channel that carries the phase of the sound, one for all or one a station in the order of
            ``stations``, or functions that read it for a station. With it the coherence of v is that with the
            reference, ``self-consistent`` takes the part of v that follows it, and ``given`` its phase. Without it the
            level check of the line needs times that count from the same instant of the sound's generator at all
            stations.
        reference_phase: psi, rad, for ``phase="given"``, one for all or one a station in the order of ``stations``:
            x(t) = cos(2 pi f t + psi) on the clock of the arrivals, or, with a reference, ahead of it by psi.
        parts: folder where each finished station is kept; a run that was broken off takes up what is there and was made
            from the same data with the same choices.
        progress: called with 1 after each station.
        client: of dask.distributed, whose workers take a station each; stations of a file or folder they read
            themselves, under the same path. The line is the same to the bit.
        choices: see ``StationChoices`` and ``Choices``; ``segment`` is the former's.
    Returns:
        The line in the order of x, y, z, with the average (5.2) over the stations that count.
    Raises:
        ValueError: data or options that cannot give an answer; the message names the station.
        TypeError: a value of the wrong kind.
    Warns:
        DataWarning: the answer stands but is doubtful; the same text is in ``notes``.
    Source: Roncen et al. (2026), sections 3.3, 5.5.2, 5.5.3. Departures: the tone is corrected for the interpolation,
        flagged stations do not count in averages, intervals.
    """
    places, model = _stations(stations), as_liner(liner)
    own, chosen = split_choices(choices)
    if reference_phase is not None and chosen.phase != "given":
        raise ValueError(f"reference_phase is only used with phase='given', not {chosen.phase!r}")
    references = _each("reference channels", reference, len(places))
    phases = _each("reference phases", _radians(reference_phase), len(places))
    tasks = [(places[i], references[i], phases[i]) for i in _order(places)]
    work = partial(tasks_in_order, client, _read_and_educe, (model, frequency, own, chosen))
    if parts is None:
        made = work(tasks)
    else:
        kept = LineParts(parts) if isinstance(parts, (str, Path)) else parts
        shared = [*_facts_of(model), frequency, own, chosen.describe()]
        keys = [_digest(*_facts_of(place), *_facts_of(_channel(channel, place)), phase, *shared)
                for place, channel, phase in tasks]  # fmt: skip
        missing = work([task for task, key in zip(tasks, keys, strict=True) if not kept.holds(key)])
        made = (kept.take_up(key, partial(next, missing)) for key in keys)
    lines = []
    for each in made:
        lines.append(each)
        if progress is not None:
            progress(1)
    line = join_lines(lines)
    line = dataclasses.replace(line, average=average_line(line, chosen.interval, own.monte_carlo))
    check = line_level_check(line, chosen)
    if isinstance(check, LevelCheck):
        line, check = dataclasses.replace(line, level_check=check), "checked"
    notes = tuple(notes_of(line))
    tell([note.text for note in notes])
    known = None if reference_phase is None else phases
    origin = origin_of(_inputs(places, references, model), reference_phase=known)
    return with_choices(dataclasses.replace(line, notes=notes), level_check=check, **origin)


def _stations(stations: Any) -> list[Station]:
    if isinstance(stations, (str, Path)):
        return list(list_stations(stations))
    found = [stations] if isinstance(stations, (BurstRecord, StationSource)) else list(stations)
    if not found:
        raise ValueError("no station is given")
    for each in found:
        if not isinstance(each, (BurstRecord, StationSource)):
            raise TypeError(f"a station is {type(each).__name__}; make a BurstRecord of your bursts first")
    return found


def _radians(phase: Any) -> list[float] | None:
    if phase is None:
        return None
    values = real_tensor(phase).reshape(-1)
    if not bool(torch.isfinite(values).all()):
        raise ValueError("reference_phase holds values that are not finite; it is in rad")
    return [float(each) for each in values]


def _each(what: str, given: Any, stations: int) -> list[Any]:
    """Of each station, from one for all or one a station."""
    found = list(given) if isinstance(given, (list, tuple)) else [given]
    if len(found) not in (1, stations):
        raise ValueError(f"{len(found)} {what} for {stations} stations; one for all or one a station, in their order")
    return found * stations if len(found) == 1 else found


def _order(stations: Sequence[Station]) -> list[int]:
    """Numbers of the stations in the order of x, y, z where all are known; two at one place are refused."""
    places = [each.place if isinstance(each, StationSource) else (each.x, each.y, each.z) for each in stations]
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


def _read_and_educe(
    liner: LinerModel,
    frequency: Any,
    own: StationChoices,
    chosen: Choices,
    station: Station,
    reference: Any,
    phase: Any,
) -> ImpedanceLine:
    channel = _channel(reference, station)
    record = station.read() if isinstance(station, StationSource) else station
    return educe_station(record, liner, frequency, own, chosen, channel, phase)


def _inputs(stations: Sequence[Station], references: Sequence[Any], liner: LinerModel) -> Iterator[tuple[str, str]]:
    """What went into a line, and the names of its files."""
    for each in stations:
        yield "bursts", str(each.path) if isinstance(each, StationSource) else each.name.split(", station ")[0]
    for channel in references:  # a function is not called once more
        if isinstance(channel, ReferenceChannel):
            yield "reference channel", channel.name
    yield from (("liner", name) for name in liner.files)


def join_lines(lines: Sequence[ImpedanceLine]) -> ImpedanceLine:
    """Stations of several lines as one, in the order given; averages are not carried over.

    Raises:
        ValueError: lines of different cases or frequencies; phases relative to a channel beside phases on a clock.
    """
    first, most = lines[0], max(line.segment_start.shape[1] for line in lines)
    for other in lines[1:]:
        for what, mine in _case(first).items():
            theirs = _case(other)[what]
            if mine != theirs and not (what == "tone (Hz)" and None in (mine, theirs)):
                raise ValueError(
                    f"{other.names[0]} has {what} {theirs}, {first.names[0]} {mine}; the stations of a line share one "
                    "case"
                )
    joined: dict[str, Any] = {}
    for name, value in vars(first).items():
        values = [getattr(line, name) for line in lines]
        if name in LISTS:
            joined[name] = tuple(chain.from_iterable(values))
        elif isinstance(value, Tensor) and name not in SHARED:
            joined[name] = torch.cat([_padded(each, most) for each in values] if name in PADDED else values)
    intervals = [line.interval for line in lines if line.interval is not None]
    joined["interval"] = Interval.joined(intervals) if len(intervals) == len(lines) else None
    return dataclasses.replace(first, average=None, notes=(), **joined)


def _padded(values: Tensor, segments: int) -> Tensor:
    missing = values.new_full((len(values), segments - values.shape[1], *values.shape[2:]), torch.nan)
    return torch.cat([values, missing + 1j * missing if values.is_complex() else missing], dim=1)


def _case(line: ImpedanceLine) -> dict[str, Any]:
    """What the stations of a line share."""
    return {
        "frequency (Hz)": line.frequency.tolist(),
        "phases relative to": "a reference channel" if line.choices["referred"] else "the clock of its arrivals",
        "tone (Hz)": line.choices["tone"],
        **{key: getattr(line, key) for key in CASE},
        "displacement thickness that makes eq. (2.7)": None if line.goodrich is None else line.goodrich.tolist(),
    }


def _facts_of(source: Any) -> list[Any]:
    """All that a liner, a station or a channel is made of: the name of a table says too little."""
    if source is None:
        return [None]
    if isinstance(source, StationSource):
        return [source.digest(), source.name]
    if isinstance(source, (BurstRecord, ReferenceChannel)):
        return list(vars(source).values())
    low, high = source.frequency_range or (300.0, 3500.0)
    speeds = torch.linspace(0, min(20.0, source.speed_max or 20.0), 41, dtype=torch.float64)
    frequencies = torch.linspace(float(low), float(high), 9).tolist()
    with torch.no_grad():
        values = [torch.as_tensor(source.impedance(f, speeds)).to(torch.complex128) for f in frequencies]
    return [torch.stack(values), source.describe()]


def _digest(*facts: Any) -> str:
    """Hash of what a part follows from, 32 hexadecimal digits."""
    digest = hashlib.sha256(__version__.encode())
    for fact in facts:
        digest.update(fact.numpy().tobytes() if isinstance(fact, Tensor) else repr(fact).encode())
    return digest.hexdigest()[:32]

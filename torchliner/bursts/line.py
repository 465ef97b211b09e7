"""DIR-TDIBC along a line of laser Doppler stations: one call, which takes up where it was broken off."""

import dataclasses
import hashlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.bursts.averages import average_line, line_level_check
from torchliner.bursts.station import CASE, educe_station, split_choices
from torchliner.checks import phase_tensor, tell
from torchliner.io.burst_sources import LineParts, StationSource, list_stations, order_of
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.names import __version__
from torchliner.records import BurstRecord, ImpedanceLine, LevelCheck, ReferenceChannel
from torchliner.records.notes import Note
from torchliner.records.origin import origin_of, with_choices

Station = BurstRecord | StationSource
Reference = ReferenceChannel | Callable[[Station], ReferenceChannel]
Task = tuple[Station, Any, Any]  # a station, its reference channel and its phase
OF_LINE = ("frequency", "goodrich")  # tensors that are those of the whole line
OF_SEGMENTS = ("reflection", "segment_start")
ARRIVALS_A_PERIOD, DAMPED = 8.0, 0.95  # warned of below
SHOWN = 4  # names in a warning


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

    Each station, by itself, is put on a uniform grid and cut into overlapping segments, which are educed as one batch.
    The paper to the letter is ``educe_bursts(stations, liner, frequency, correction="none", window="hann",
    flagged="use")``: linear interpolation, segments of 1 s that overlap by half, Hann's window, mean of Z over segments
    (5.1), mean of admittances over stations (5.2), 5000 draws as a check.

    Args:
        stations: file or folder, as for ``read_bursts``; records; or what ``list_stations`` returns, read one by one.
        liner: as for ``educe``.
        frequency: Hz, one or several; default the stations' own tone.
        reference: channel that carries the phase of the sound, one for all or one a station in the order of
            ``stations``, or functions that read it for a station. With it the coherence of v is that with the
            reference, ``self-consistent`` takes the part of v that follows it, and ``given`` its phase.
        reference_phase: psi, rad, for ``phase="given"``, one for all or one a station in the order of ``stations``:
            x(t) = cos(2 pi f t + psi) on the clock of the arrivals, or, with a reference, ahead of it by psi.
        parts: folder where each finished station is kept; a run that was broken off takes up what was made from the
            same data with the same choices.
        progress: called with 1 after each station.
        choices: see ``StationChoices`` and ``Choices``.
    Returns:
        The line in the order of x, y, z, with the average (5.2) over the stations that count.
    Raises:
        ValueError, TypeError: data or options that cannot give an answer; the message names the station.
    Warns:
        DataWarning: the answer stands but is doubtful; the same text is in ``notes``.
    Source: Roncen et al. (2026), sections 3.3, 5.5.2, 5.5.3. Departures: the tone is corrected for the interpolation,
        flagged stations do not count in averages, intervals.
    """
    model, (own, chosen) = as_liner(liner), split_choices(choices)
    if reference_phase is not None:
        if chosen.phase != "given":
            raise ValueError(f"reference_phase is only used with phase='given', not {chosen.phase!r}")
        reference_phase = phase_tensor(reference_phase).reshape(-1).tolist()
        if len(reference_phase) == 1:  # for all stations
            (reference_phase,) = reference_phase
    tasks, lines = _tasks(stations, reference, reference_phase), list[ImpedanceLine]()
    kept = LineParts(Path(parts)) if isinstance(parts, (str, Path)) else parts
    for station, given, psi in tasks:
        channel = given(station) if callable(given) else given
        if channel is not None and not isinstance(channel, ReferenceChannel):
            raise TypeError(f"a reference is {type(channel).__name__}; make a ReferenceChannel of your samples first")
        key = _digest(model, station, channel, psi, frequency, own, chosen.describe()) if kept else ""
        part = kept.load(key) if kept else None
        if part is None:
            record = station.read() if isinstance(station, StationSource) else station
            part = educe_station(record, model, frequency, own, chosen, channel, psi)
            part = kept.keep(key, part) if kept else part
        lines.append(part)
        if progress is not None:
            progress(1)
    line = average_line(join_lines(lines), chosen.interval, own.monte_carlo)
    check = line_level_check(line, chosen)
    if isinstance(check, LevelCheck):
        line, check = dataclasses.replace(line, level_check=check), "checked"
    notes, inputs = tuple(notes_of(line)), list[tuple[str, str]]()
    tell([note.text for note in notes])
    for station, channel, _ in tasks:
        named = str(station.path) if isinstance(station, StationSource) else station.name.split(", station ")[0]
        inputs.append(("bursts", named))
        if isinstance(channel, ReferenceChannel):  # a function is not called once more
            inputs.append(("reference channel", channel.name))
    inputs += [("liner", name) for name in model.files]
    phases = None if reference_phase is None else [phase for _, _, phase in tasks]
    origin = origin_of(inputs, reference_phase=phases)
    return with_choices(dataclasses.replace(line, notes=notes), level_check=check, **origin)


def _tasks(stations: Any, reference: Any, phase: Any) -> list[Task]:
    """In the order of x, y, z where all are known."""
    if isinstance(stations, (str, Path)):
        stations = list_stations(stations)
    found = [stations] if isinstance(stations, Station) else list(stations)
    if not found:
        raise ValueError("no station is given")
    if wrong := [type(each).__name__ for each in found if not isinstance(each, Station)]:
        raise TypeError(f"a station is {wrong[0]}; make a BurstRecord of your bursts first")
    columns = [found]
    for what, given in (("reference channels", reference), ("reference phases", phase)):
        own = list(given) if isinstance(given, (list, tuple)) else [given] * len(found)
        if len(own) != len(found):
            raise ValueError(f"{len(own)} {what} for {len(found)} stations; one for all or one each, in their order")
        columns.append(own)
    tasks = list(zip(*columns, strict=True))
    places = [each.place if isinstance(each, StationSource) else (each.x, each.y, each.z) for each in found]
    if any(None in place for place in places):
        return tasks
    return [tasks[i] for i in order_of(places, [each.name for each in found])]


def join_lines(lines: Sequence[ImpedanceLine]) -> ImpedanceLine:
    """Stations of several lines as one, in the order given; averages and intervals are not carried over.

    Raises:
        ValueError: lines of different cases or frequencies; phases relative to a channel beside phases on a clock.
    """
    first, most = lines[0], max(line.segment_start.shape[1] for line in lines)
    for other in lines[1:]:
        for what, mine in _case(first).items():
            theirs = _case(other)[what]
            if mine != theirs and not (what == "tone (Hz)" and None in (mine, theirs)):
                both = f"{other.names[0]} has {what} {theirs}, {first.names[0]} {mine}"
                raise ValueError(f"{both}; the stations of a line share one case")
    joined: dict[str, Any] = {"average": None, "interval": None, "notes": ()}
    for name, value in vars(first).items():
        values = [getattr(line, name) for line in lines]
        if name in OF_SEGMENTS:  # nan for the segments that a shorter station lacks
            lacking = [(v[:, :1] * torch.nan).expand(-1, most - v.shape[1], *v.shape[2:]) for v in values]
            values = [torch.cat(each, 1) for each in zip(values, lacking, strict=True)]
        if isinstance(value, Tensor) and name not in OF_LINE:
            joined[name] = torch.cat(values)
        elif isinstance(value, tuple) and name != "notes":
            joined[name] = sum(values, ())
    return dataclasses.replace(first, **joined)


def _case(line: ImpedanceLine) -> dict[str, Any]:
    """What the stations of a line share."""
    return {
        "frequency (Hz)": line.frequency.tolist(),
        "phases relative to": "a reference channel" if line.choices["referred"] else "the clock of its arrivals",
        "tone (Hz)": line.choices["tone"],
        **{key: getattr(line, key) for key in CASE},
        "displacement thickness that makes eq. (2.7)": None if line.goodrich is None else line.goodrich.tolist(),
    }


def _digest(liner: LinerModel, station: Station, channel: ReferenceChannel | None, *more: Any) -> str:
    """Hash of what a finished station follows from: the name of a liner's table says too little."""
    low, high = liner.frequency_range or (300.0, 3500.0)
    speeds = torch.linspace(0, min(20.0, liner.speed_max or 20.0), 41, dtype=torch.float64)
    with torch.no_grad():
        response = [liner.impedance(f, speeds) for f in torch.linspace(float(low), float(high), 9).tolist()]
    facts = [torch.stack([*map(torch.as_tensor, response)]), liner.describe(), station.name, *more]
    facts += [station.digest()] if isinstance(station, StationSource) else vars(station).values()
    digest = hashlib.sha256(__version__.encode())
    for fact in facts + ([] if channel is None else [*vars(channel).values()]):
        digest.update(fact.numpy().tobytes() if isinstance(fact, Tensor) else repr(fact).encode())
    return digest.hexdigest()[:32]


def notes_of(line: ImpedanceLine) -> Iterator[Note]:
    """One note for each thing about a line that is doubtful, with numbers."""
    count, choices, rate = line.stations, line.choices, float(line.rate.min())
    if flagged := [i for i, flags in enumerate(line.flags) if flags]:
        counted = "count in the averages all the same" if bool(line.used.all()) else "do not count in the averages"
        text = f"{len(flagged)} of {count} stations are flagged and {counted}: "
        shown = ", ".join(line.names[i] for i in flagged[:SHOWN]) + ", ..." * (len(flagged) > SHOWN)
        yield Note("flagged-stations", f"{text}{shown}; the first: {line.flags[flagged[0]][0]}")
    for i, f in enumerate(line.frequency.tolist()):
        sizes = line.attenuation[:, i].abs()
        if float(sizes.min()) < DAMPED:
            mended = "corrected, the turbulence is not" if bool(line.corrected[:, i].all()) else "not corrected"
            text = f"{choices['method']} reconstruction damps {f:g} Hz to {float(sizes.mean()):.3f} in the mean"
            yield Note("damped-tone", f"{text} (least {float(sizes.min()):.3f}); the tone is {mended}")
        if rate < ARRIVALS_A_PERIOD * f:
            text = f"{rate / f:.3g} arrivals a period of {f:g} Hz (limit {ARRIVALS_A_PERIOD:g})"
            yield Note("few-arrivals", f"{text}: |v(t)| between them is guessed")
        if line.wall is not None:
            text = f"{int(line.wall[:, i].sum())} of {count} stations have a squared coherence below"
            yield Note(
                "wall-filter", f"{text} {choices['wall_filter']:g} with {f:g} Hz and count as wall, admittance 0"
            )
        if line.level_check is not None and (sentence := line.level_check.sentence("stations", f, i)):
            yield Note("level-check", sentence)
    if noted := [i for i, notes in enumerate(line.station_notes) if notes]:
        first = f"{line.names[noted[0]]}: {line.station_notes[noted[0]][0]}"
        yield Note("station-notes", f"{len(noted)} of {count} stations have notes (station_notes); the first, {first}")
    if line.interval is None and choices["interval"] is not None:
        yield Note("no-intervals", f"no error bars: a station has {int(line.segments.min())} segments, four are needed")

"""DIR-TDIBC along a line of laser Doppler stations: one call, which takes up where it was broken off."""

import contextlib
import dataclasses
import hashlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.bursts.averages import average_line
from torchliner.bursts.station import CASE, educe_station, split_choices
from torchliner.checks import tell
from torchliner.io.burst_sources import StationSource, list_stations
from torchliner.io.own_file import read_line
from torchliner.io.own_writer import write_record
from torchliner.liners.model import Liner, LinerModel, as_liner, reflection_of
from torchliner.names import __version__
from torchliner.records import BurstRecord, ImpedanceLine
from torchliner.records.notes import Note
from torchliner.records.origin import origin_of, with_choices

Station = BurstRecord | StationSource
OF_LINE = ("frequency", "goodrich")  # tensors that are those of the whole line
OF_SEGMENTS = ("reflection", "segment_start")
DAMPED = 0.95  # warned of below


def educe_bursts(
    stations: str | Path | Sequence[Station],
    liner: Liner,
    frequency: Any = None,
    *,
    parts: str | Path | None = None,
    progress: Callable[[int], None] | None = None,
    **choices: Any,
) -> ImpedanceLine:
    """Impedance along a line of stations of bursts, segment by segment, and its average over the stations that count.

    Each station, by itself, is put on a uniform grid and cut into overlapping segments, which are educed as one batch.
    The paper to the letter is ``educe_bursts(stations, liner, frequency, correction="none", window="hann",
    flagged="use")``: linear interpolation, segments of 1 s that overlap by half, Hann's window, mean of Z over segments
    (5.1), mean of admittances over stations (5.2), 5000 draws as a check.

    Args:
        stations: file or folder, as for ``read_bursts``; records; or what ``list_stations`` returns, read one by one.
        liner: as for ``educe``.
        frequency: Hz, one or several; default the stations' own tone.
        parts: folder where each finished station is kept; a run that was broken off takes up what was made from the
            same data with the same choices.
        progress: called with 1 after each station.
        choices: see ``StationChoices`` and ``Choices``.
    Raises:
        ValueError, TypeError: data or options that cannot give an answer; the message names the station.
    Warns:
        DataWarning: the answer stands but is doubtful; the same text is in ``notes``.
    Source: Roncen et al. (2026), sections 3.3, 5.5.2, 5.5.3. Departures: the tone is corrected for the interpolation,
        flagged stations do not count in averages, intervals.
    """
    model, (own, chosen), lines = as_liner(liner), split_choices(choices), list[ImpedanceLine]()
    if isinstance(stations, (str, Path)):
        stations = list_stations(stations)
    found = [stations] if isinstance(stations, Station) else list(stations)
    if not found or not all(isinstance(station, Station) for station in found):
        raise TypeError(f"stations are {found}; a file or folder of bursts, or BurstRecords, are needed")
    case: dict[str, Any] = {}
    for station in found:
        line = None
        if parts is not None:
            part = Path(parts) / f"{_digest(model, station, frequency, own, chosen.describe())}.h5"
            with contextlib.suppress(ValueError, OSError):  # not there, or damaged
                line = read_line(part)
        if line is None:
            record = station.read() if isinstance(station, StationSource) else station
            line = educe_station(record, model, frequency, own, chosen)
            if parts is not None:
                part.parent.mkdir(exist_ok=True)
                write_record(line, part)
        for key, value in {"tone (Hz)": line.choices["tone"], **{key: getattr(line, key) for key in CASE}}.items():
            if value != case.setdefault(key, value):
                raise ValueError(f"{line.names[0]} has {key} {value}, others {case[key]}; a line is of one case")
        lines.append(line)
        if progress is not None:
            progress(1)
    line = average_line(join_lines(lines), chosen.interval, own.monte_carlo)
    notes = tuple(notes_of(line))
    tell([note.text for note in notes])
    files = [str(each.path) if isinstance(each, StationSource) else each.name.split(", station ")[0] for each in found]
    origin = origin_of([*(("bursts", name) for name in files), *(("liner", name) for name in model.files)])
    return with_choices(dataclasses.replace(line, notes=notes), **origin)


def join_lines(lines: Sequence[ImpedanceLine]) -> ImpedanceLine:
    """Stations of several lines of one case as one, in the order given; averages and intervals are not carried over."""
    joined: dict[str, Any] = {"average": None, "interval": None, "notes": ()}
    for name, value in vars(lines[0]).items():
        values = [getattr(line, name) for line in lines]
        if name in OF_SEGMENTS:  # nan for the segments that a shorter station lacks
            each = [own for several in values for own in several]
            joined[name] = torch.nn.utils.rnn.pad_sequence(each, True, torch.nan)
        elif isinstance(value, Tensor) and name not in OF_LINE:
            joined[name] = torch.cat(values)
        elif isinstance(value, tuple) and name != "notes":
            joined[name] = sum(values, ())
    return dataclasses.replace(lines[0], **joined)


def _digest(liner: LinerModel, station: Station, *more: Any) -> str:
    """Hash of what a finished station follows from, unread: the name of a liner's table says too little."""
    facts = [*vars(station).values()] if isinstance(station, BurstRecord) else [*station.digest()]
    low, high = liner.frequency_range or (300.0, 3500.0)
    speeds = torch.linspace(0, min(20.0, liner.speed_max or 20.0), 41, dtype=torch.float64)
    response = reflection_of(liner, torch.linspace(float(low), float(high), 9, dtype=torch.float64)[:, None], speeds)
    digest = hashlib.sha256(__version__.encode())
    for fact in [response.detach(), liner.describe(), *more, *facts]:
        digest.update(fact.numpy().tobytes() if isinstance(fact, Tensor) else repr(fact).encode())
    return digest.hexdigest()[:32]


def notes_of(line: ImpedanceLine) -> Iterator[Note]:
    """One note for each thing about a line that is doubtful, with numbers."""
    count, choices = line.stations, line.choices
    if flagged := [i for i, flags in enumerate(line.flags) if flags]:
        counted = "count in the averages all the same" if bool(line.used.all()) else "do not count in the averages"
        first = f"{line.names[flagged[0]]}: {line.flags[flagged[0]][0]}"
        yield Note(
            "flagged-stations", f"{len(flagged)} of {count} stations are flagged and {counted}; the first, {first}"
        )
    for i, f in enumerate(line.frequency.tolist()):
        sizes = line.attenuation[:, i].abs()
        if float(sizes.min()) < DAMPED:
            mended = "corrected, the turbulence is not" if bool(line.corrected[:, i].all()) else "not corrected"
            text = f"{choices['method']} reconstruction damps {f:g} Hz to {float(sizes.mean()):.3f} in the mean"
            yield Note("damped-tone", f"{text} (least {float(sizes.min()):.3f}); the tone is {mended}")
    if noted := [i for i, notes in enumerate(line.station_notes) if notes]:
        first = f"{line.names[noted[0]]}: {line.station_notes[noted[0]][0]}"
        yield Note("station-notes", f"{len(noted)} of {count} stations have notes (station_notes); the first, {first}")
    if line.interval is None and choices["interval"] is not None:
        yield Note("no-intervals", f"no error bars: a station has {int(line.segments.min())} segments, four are needed")

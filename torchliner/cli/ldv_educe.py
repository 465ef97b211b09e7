"""torchliner ldv educe."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchliner.cli.choice_options import add_choice_options, chosen_from
from torchliner.cli.ldv_options import (
    add_filters,
    add_reading,
    files_in,
    filters_from,
    stations_from,
)
from torchliner.cli.options import (
    add_output_options,
    frequencies,
    known_liner,
    print_json,
    progress_bar,
    refuse_inputs,
    require_ending,
    warnings_on_stderr,
)

if TYPE_CHECKING:
    from torchliner.io.burst_sources import StationSource

REPLAY = (
    "engine phase drive mean kernel response edge window band levels spacing interpolation "
    "velocity_max running_window minimum_coherence wall_filter interval draws seed device dtype "
    "memory compile rank_tolerance"
).split()
STATION = "method grid_rate band_limit correction segment overlap flagged monte_carlo".split()
RECORDINGS = (".npy", ".wav", ".mat", ".h5")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options; their defaults are those of ``torchliner.educe_bursts``."""
    add_reading(parser)
    parser.add_argument("--liner", help="preset name, .toml or .csv; default: named in the file")
    parser.add_argument("--educe-at", nargs="+", type=frequencies, metavar="HZ", help="values or "
                        "ranges LOW:HIGH:STEP; default: the tone")  # fmt: skip
    parser.add_argument("-o", "--output", type=Path, help="line file, .h5/.nc or .csv")
    parser.add_argument("--figure", type=Path, help="draw Z along the line there")
    add_filters(parser)
    grid = parser.add_argument_group("from bursts to segments")
    grid.add_argument("--method", choices=["linear", "hold", "band-limited"],
                      help="of the reconstruction between arrivals; default linear")  # fmt: skip
    grid.add_argument("--grid-rate", type=float, metavar="HZ", help="default: twice the mean rate "
                      "of the station at least, in whole steps a period")  # fmt: skip
    grid.add_argument("--band-limit", type=float, metavar="HZ", help="of --method band-limited")
    grid.add_argument(
        "--correction", choices=["none", "tone", "tone-and-noise"],
        help="put back what the reconstruction took from the tone; default tone",
    )  # fmt: skip
    grid.add_argument("--segment", type=float, metavar="S", help="default 1")
    grid.add_argument("--overlap", type=float, metavar="SHARE", help="of segments; default 0.5")
    grid.add_argument(
        "--flagged", choices=["exclude", "use", "refuse"],
        help="stations with doubtful bursts, in averages; default exclude",
    )  # fmt: skip
    grid.add_argument("--monte-carlo", type=int, metavar="N", help="draws of (5.2); default 5000")
    _add_reference(parser)
    parser.add_argument("--no-intervals", action="store_true", help="no error bars")
    add_choice_options(parser, REPLAY)
    add_output_options(parser)


def _add_reference(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("reference channel (loudspeaker or microphone)")
    group.add_argument("--reference", type=Path, help="a recording for all stations, or a folder "
                       "with one a station, of its file's name: .npy, .wav, .mat, .h5")  # fmt: skip
    group.add_argument("--reference-rate", type=float, metavar="HZ", help="but for .wav")
    group.add_argument("--reference-start", type=float, metavar="S", help="time of its "
                       "first sample on the clock of the arrivals; default 0")  # fmt: skip
    group.add_argument("--reference-phase", type=float, metavar="RAD", help="for --phase given: "
                       "x(t) = cos(2 pi f t + RAD), or its lead over the reference")  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Educe every station, print a row each and the averages, write what was asked for."""
    from torchliner.io.line_parts import LineParts
    from torchliner.ldv.educe_bursts import educe_bursts
    from torchliner.report.line_table import format_line, plain_line

    require_ending(options.output, [".csv", ".h5", ".nc"], "--output")
    inputs: list[Any] = [*files_in(options.source), options.liner, options.reference]
    refuse_inputs((options.output,), inputs, options.figure)
    chosen = chosen_from(options) | _station_choices(options)
    if options.no_intervals:
        chosen["interval"] = None
    sources = stations_from(options, "liner", "title")
    wanted = None if options.educe_at is None else list(chain(*options.educe_at))
    liner = _liner(options, sources)
    parts = None if options.output is None else LineParts(f"{options.output}.parts")
    if parts is not None and parts.there and not options.quiet:
        print(f"{parts.folder} holds {parts.there} finished stations; those of the same data and "
              "choices are taken up", file=sys.stderr)  # fmt: skip
    with (
        warnings_on_stderr(options.quiet),
        progress_bar(len(sources), options.source.name, options.quiet, "station") as step,
    ):
        line = educe_bursts(
            sources, liner, wanted, reference=_reference(options), parts=parts, progress=step,
            reference_phase=options.reference_phase, **chosen,
        )  # fmt: skip
    if options.title is not None:
        line = replace(line, title=options.title)
    if options.output is not None:
        line.write(options.output)
    if parts is not None:
        parts.clear()
    if options.figure is not None:
        line.plot(options.figure)
    if options.json:
        print_json(plain_line(line))
    else:
        print(format_line(line))
    return 0


def _station_choices(options: argparse.Namespace) -> dict[str, Any]:
    chosen = {name: getattr(options, name) for name in STATION}
    chosen = {name: value for name, value in chosen.items() if value is not None}
    return chosen | {"filters": filters_from(options)}


def _liner(options: argparse.Namespace, sources: list[StationSource]) -> Any:
    from torchliner.liners.catalogue import load_liner

    if options.liner is not None:
        return load_liner(options.liner)
    return load_liner(known_liner(sources[0].read().liner, sources[0].path))


def _reference(options: argparse.Namespace) -> Any:
    """A channel for all stations, or a function that reads that of each."""
    if options.reference is None:
        if options.reference_rate is not None or options.reference_start is not None:
            raise ValueError(
                "--reference-rate and --reference-start are of a --reference; name the recording"
            )
        return None
    if not options.reference.exists():
        raise FileNotFoundError(f"{options.reference}: no such file or folder")
    if not options.reference.is_dir():
        return _channel(options.reference, options)
    return lambda source: _channel(_recording_of(source, options.reference), options)


def _recording_of(source: StationSource, folder: Path) -> Path:
    stem = source.path.stem if source.number is None else f"{source.path.stem}_{source.number}"
    for suffix in RECORDINGS:
        path = folder / f"{stem}{suffix}"
        if path.exists():
            return path
    raise FileNotFoundError(
        f"{folder} holds no recording {stem}{{{','.join(RECORDINGS)}}} for {source.name}"
    )


def _channel(path: Path, options: argparse.Namespace) -> Any:
    from torchliner.io.signal_file import read_signal
    from torchliner.records import ReferenceChannel

    found = read_signal(path, options.reference_rate)
    return ReferenceChannel(
        found.signal, found.sampling_rate, options.reference_start or 0.0, str(path)
    )

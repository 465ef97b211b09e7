"""torchliner ldv educe."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchliner import names
from torchliner.cli import ldv_options as ldv
from torchliner.cli.choice_options import EDUCED, choice_options, chosen_from
from torchliner.cli.files import preset_named, show_results
from torchliner.cli.options import (
    CLUSTER,
    frequency_option,
    level_check_code,
    progress_bar,
    shared,
    stated,
)

if TYPE_CHECKING:
    from torchliner.io.burst_sources import StationSource

NOT_HERE = ("averaging", "background_rms", "missing", "allow_short")
STATION = "method grid_rate band_limit correction segment overlap window flagged monte_carlo".split()
RECORDINGS = (".npy", ".wav", ".mat", ".h5")

CHOICES = [name for name in EDUCED if name not in NOT_HERE]
OWN = {
    "--reference-phase RAD": "for --phase given: x(t) = cos(2 pi f t + RAD), or its lead over the "
                             "reference; default: none",
}  # fmt: skip
OPTIONS = {
    "": ldv.READING | CLUSTER | shared("--liner", "--json", "--quiet", "--strict") | {
        **frequency_option("the tone", "--educe-at"),
        "--output FILE": f"write the line as {names.RESULT_ENDINGS}",
        "--figure PICTURE": "draw Z along the line there",
    },
    ldv.UNSTATED: {spec: text for spec, text in ldv.STATIONS.items() if spec != "--liner NAME"},
    ldv.VALID: ldv.FILTERS,
    "from bursts to segments": {
        "--method": (names.GRID_METHODS, "of reconstruction between arrivals; default linear"),
        "--grid-rate HZ": "Hz; default: twice the mean rate of the station at least, in whole "
                          "steps a period",
        "--band-limit HZ": "of --method band-limited, Hz; default a quarter of the station's mean "
                           "rate",
        "--correction": (names.CORRECTIONS, "put back what the reconstruction took from the tone; "
                         "default tone"),
        "--segment S": "length, s; default 1",
        "--overlap SHARE": "of segments, 0 to 1; default 0.5",
        "--window": (names.STATION_WINDOWS, "of a segment; default whole-periods, each of which weighs alike"),
        "--flagged": (names.FLAGGED, "stations with doubtful bursts, in averages; default exclude"),
        "--monte-carlo N": "draws of eq. (5.2); default 5000",
    },
    "reference channel (loudspeaker or microphone)": {
        "--reference PATH": "a recording for all stations, or a folder with one a station, of its "
                            "file's name: .npy, .wav, .mat, .h5; default: none",
        "--reference-rate HZ": "its sampling rate, Hz; default: that of a .wav",
        "--reference-start S": "time of its first sample on the clock of the arrivals, s; default "
                               "0",
    },
} | choice_options(CHOICES, OWN)  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Educe every station, print a row each and the averages, write what was asked for."""
    from torchliner.bursts.line import educe_bursts
    from torchliner.campaign.cluster import open_cluster
    from torchliner.io.line_parts import LineParts
    from torchliner.io.result_writers import require_result
    from torchliner.io.whole_file import writable_folder
    from torchliner.records.origin import input_file, with_choices
    from torchliner.report.line_table import format_line, plain_line

    chosen = chosen_from(options, CHOICES) | stated(options, STATION)
    if options.cluster is not None:  # workers may be in other folders
        options.source = options.source.absolute()
    sources = ldv.stations_from(options, "liner", "title")
    liner = _liner(options, sources)
    parts = None
    if options.output is not None:
        require_result(options.output, len(options.educe_at or [0]))
        parts = LineParts(f"{options.output}.parts")
        writable_folder(parts.folder)
    if parts is not None and parts.there and not options.quiet:
        print(f"{parts.folder} holds {parts.there} finished stations; those of the same data and "
              "choices are taken up", file=sys.stderr)  # fmt: skip
    with (
        open_cluster(options.cluster) as client,
        progress_bar(len(sources), options.source.name, options, "station") as step,
    ):
        line = educe_bursts(
            sources, liner, options.educe_at, reference=_reference(options), parts=parts,
            progress=step, client=client, filters=ldv.filters_from(options), **chosen,
        )  # fmt: skip
    line = with_choices(line, command=options.typed)
    if options.reference is not None and options.reference.is_dir():
        channels = input_file("reference channels", options.reference)
        line = with_choices(line, inputs=[*line.choices["inputs"], channels])
    if options.title is not None:
        line = replace(line, title=options.title)
    show_results(
        options, lambda: format_line(line), lambda: plain_line(line),
        output=line.write, figure=line.plot,
    )  # fmt: skip
    if parts is not None:
        parts.clear()
    return level_check_code(options, [line])


def _liner(options: argparse.Namespace, sources: list[StationSource]) -> Any:
    from torchliner.liners.catalogue import load_liner

    if options.liner is not None:
        return load_liner(options.liner)
    return load_liner(preset_named(sources[0].read().liner, sources[0].path))


def _reference(options: argparse.Namespace) -> Any:
    """A channel for all stations, or a function that reads that of each."""
    if options.reference is None:
        if options.reference_rate is not None or options.reference_start is not None:
            raise ValueError("--reference-rate and --reference-start are of a --reference; name the recording")
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
    raise FileNotFoundError(f"{folder} holds no recording {stem}{{{','.join(RECORDINGS)}}} for {source.name}")


def _channel(path: Path, options: argparse.Namespace) -> Any:
    from torchliner.io.signal_file import read_signal
    from torchliner.records import ReferenceChannel

    found = read_signal(path, options.reference_rate)
    return ReferenceChannel(found.signal, found.sampling_rate, options.reference_start or 0.0, str(path))

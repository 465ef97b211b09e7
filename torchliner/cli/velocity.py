"""Commands that educe an impedance from velocity: educe, replay, reduce, validate, follow."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import torchliner as tl
from torchliner.cli import kinds
from torchliner.cli import options as opt
from torchliner.cli.inputs import incident_signal, liners_of, planes_of, read_planes, read_records, with_facts
from torchliner.cli.kinds import Command, Option
from torchliner.cli.output import facts_text, progress_bar, show
from torchliner.names import SOURCE_SIDES


def educe(options: argparse.Namespace) -> int:
    """Educe every plane, print the answer of each, write what was asked for."""
    from torchliner.campaign.cluster import open_cluster
    from torchliner.io.microphone_file import read_wall_pressure
    from torchliner.pressure.dean import with_in_situ

    pressure = None if options.in_situ is None else tl.read_pressure(options.in_situ)
    wall = None if options.wall_pressure is None else read_wall_pressure(options.wall_pressure)
    records = [with_facts(each, opt.given(options, CASE)) for each in read_records(options.planes, options)]
    planes = planes_of(records)
    outputs = _outputs(options, planes, len(options.frequency or [0]))
    liners, found = liners_of(options, records, options.planes), []
    total = sum(2 * plane.samples for plane in planes)
    with open_cluster(options.cluster, options.wait) as client, progress_bar(total, options.planes[0], options) as step:
        for record, liner in zip(records, liners, strict=True):
            if client is not None and not hasattr(record, "plane"):  # moments are summed already
                summed = {key: value for key, value in options.chosen.items() if key != "reference_phase"}
                record = tl.moments(record, liner, options.frequency, client=client, progress=step, **summed)
            about = {"pressure": wall or pressure, "progress": step} | options.chosen
            found.append(tl.educe(record, liner, options.frequency, **about))
    if pressure is not None:
        found = with_in_situ(found, planes, pressure)
    return _finish(options, found, planes, outputs)


def replay(options: argparse.Namespace) -> int:
    """Replay the wave at every probe, print a row a frequency, write what was asked for."""
    incident = incident_signal(options)
    (plane,) = planes = read_planes([options.plane], options)
    outputs = _outputs(options, planes, len(options.frequency or [0]) if incident is None else math.inf)
    incident = incident or options.frequency or plane.frequency
    if incident is None:
        raise ValueError(f"{options.plane} states no tone; name --incident or --frequency")
    (liner,) = liners_of(options, planes, [options.plane])
    about = {"reflected": options.reflected} | options.chosen
    with progress_bar(plane.samples, options.plane, options) as step:
        found = tl.replay(plane, liner, incident, options.frequency, progress=step, **about)
    return _finish(options, [found], planes, outputs)


def _outputs(options: argparse.Namespace, planes: list[Any], frequencies: float) -> list[Path]:
    """The map file of each plane, if any: of several their names are appended."""
    from torchliner.io.result_writers import require_result
    from torchliner.io.whole_file import writable

    path: Path | None = options.output
    if path is None:
        return []
    several = len(planes) > 1
    found = [path.with_stem(f"{path.stem}_{each.stem}") for each in options.planes] if several else [path]
    if len(set(found)) < len(planes):
        raise ValueError("planes of the same name would share one map file; educe them one by one")
    for each, plane in zip(found, planes, strict=True):
        writable(each)
        require_result(each, frequencies, plane.x is not None or plane.z is not None)
    return found


def _finish(options: argparse.Namespace, found: list[Any], planes: list[Any], outputs: list[Path]) -> int:
    """Write, draw and print maps; the exit code."""
    from torchliner.records.origin import with_choices
    from torchliner.report.answer import answer_of
    from torchliner.report.pictures import draw_pictures

    found = [with_choices(each, command=options.typed) for each in found]

    def write(_: Any) -> None:
        for path, result in zip(outputs, found, strict=True):
            result.write(path)

    show(options, answer_of(found), write=write, draw=lambda _, folder: draw_pictures(found, planes, folder))
    return strict_code(options, *found)


def strict_code(options: argparse.Namespace, *results: Any) -> int:
    """1 with --strict where the level check of a map or a line fails, else 0."""
    return int(options.strict and any(each.level_check is not None and each.level_check.failed for each in results))


def reduce(options: argparse.Namespace) -> None:
    """Write the moments and say how large and how good they are."""
    (plane,) = read_planes([options.plane], options)
    liner = None if options.liner is None else tl.load_liner(options.liner)
    known = tl.load_liner(plane.liner) if liner is None and plane.liner in tl.preset_names() else liner
    pitch = options.cell_pitch
    if pitch is None and liner is None and known is not None:
        pitch = known.cell_pitch
    with progress_bar(2 * plane.samples, options.plane, options) as bar:
        found = tl.moments(plane, liner, options.frequency, cell_pitch=pitch, progress=bar, **options.chosen)
    found.write(options.output)
    nodes = {} if found.nodes is None else found.nodes.describe()
    where = None if liner is None else options.frequency or plane.frequency
    facts = {
        "output": str(options.output),
        "bytes": options.output.stat().st_size,
        "bytes_of_velocity": plane.velocity.dtype.itemsize * plane.samples * plane.probes,
        "probes": plane.probes,
        "cells": found.cells.count,
        "samples": plane.samples,
        "cell_pitch": found.cell_pitch,
        "blocks": found.survey.blocks.count,
        "functions": None if found.nodes is None else found.nodes.count,
        "centre": nodes.get("centre"),
        "any_liner": liner is None,
        "liner": None if known is None else known.describe().get("name"),
        "error_in_R": None if known is None else found.error(known, where),
    }
    show(options, facts, facts_text)


def validate(options: argparse.Namespace) -> None:
    """Print the best and the default rule of every case; with --verbose all rules."""
    from torchliner.report.answer import answer_of
    from torchliner.studies.validation import validation_table

    planes = read_planes(options.planes, options, lazy=False)
    liners = dict(zip(map(id, planes), liners_of(options, planes, options.planes), strict=True))
    with progress_bar(len(planes), "validation", options, "plane") as step:
        found = validation_table(planes, lambda plane: liners[id(plane)], step)
    show(options, answer_of(found))


def follow(options: argparse.Namespace) -> int:
    """A row each time samples have come; 1 if the half-width was not reached."""
    from torchliner.campaign.follow import Following, Frames
    from torchliner.campaign.follow import follow as watch
    from torchliner.checks import require_positive

    for name in ("every", "idle"):
        require_positive(f"--{name}", getattr(options, name))
    frames = Frames(options.plane, opt.given(options, opt.STATED))
    first = tl.read_plane(frames.files()[0], lazy=True, **frames.request)
    (liner,) = liners_of(options, [first], [options.plane])
    following = Following(frames, liner, options.frequency, until=options.until, **options.chosen)
    if not options.json:
        print("".join(f"{name:12s}" for name in STANDING), flush=True)

    def tell(rows: list[Any]) -> None:
        for row in rows:
            show(options, asdict(row), _standing)

    reached = False
    try:
        reached = watch(following, tell, every=options.every, idle=options.idle)
    finally:  # whatever ends it leaves what there is
        if options.output is not None and following.going is not None and following.going.periods:
            following.moments().write(options.output)
    return 0 if reached or options.until is None else 1


STANDING = ("samples", "record s", "f Hz", "R", "X", "half-width", "needed s", "until then")


def _standing(row: dict[str, Any]) -> str:
    """A line, in the order of ``STANDING``."""
    samples, duration, frequency, z, *rest = row.values()
    return f"{samples:<12d}" + "".join(
        f"{'-' if value != value else format(value, '.4g'):12s}"
        for value in (duration, frequency, z.real, z.imag, *rest)
    )


CASE = [
    Option("--incident-level", f"{opt.SPL}; default: that of the file", kinds.DB),
    Option("--source-side", "that the sound comes from; default: the file's", SOURCE_SIDES),
]
IN_SITU = Option("--in-situ", "pressure record, whose impedance is added to the results; default: none", kinds.FILE)
WALL = Option("--wall-pressure", "record or microphones for the level check; default: --in-situ", kinds.FILE)
HEIGHTS = replace(opt.PLANES, text="plane files, or what torchliner reduce made of them; several: heights of a case")
GROWING = Option("plane", "plane file that grows, or folder that files come into, in the order of names", kinds.PATH)
PITCH = Option("--cell-pitch", "side of the cells, m, without --liner; default: that of the file's preset", kinds.M)
PROBES = opt.averaging("admittance", "admittance", "velocity")
COMMANDS = {
    "educe": Command(
        educe,
        [
            *(HEIGHTS, opt.OF_LINER, opt.TONE),
            opt.output("write the map (of several planes, their names are appended)", *opt.RESULT),
            *(IN_SITU, WALL, *CASE, *opt.CLUSTER, opt.PICTURES_OF, opt.STRICT),
        ],
        (
            "plane.h5 -o map.h5 --figure pictures --holes holes.csv",
            "'run_*.nc' --normal y --frequency 300:6000:100 --liner mine.toml",
        ),
        opt.EDUCED,
    ),
    "replay": Command(
        replay,
        [
            *(opt.ONE_PLANE, *opt.INCIDENT, opt.frequency("the tone of the file, or the lines of --incident")),
            opt.output("write the map", *opt.RESULT),
            opt.output("write the reflected signal of every probe", *opt.HDF5, flag="--reflected"),
            *(opt.OF_LINER, opt.PICTURES_OF, opt.STRICT),
        ],
        (
            "plane.h5 --incident noise:300:3500 --segment 0.01 -o map.h5",
            "plane.h5 --kernel causal --spacing uniform --interpolation linear --window hann",
        ),
        [
            *(PROBES, *opt.choices("mean missing interval device dtype")),
            *opt.of(
                "velocity.replay:replay",
                "kernel levels spacing interpolation velocity_max window segment",
                shown=opt.SHOWN,
                group="kernel and replay",
            ),
        ],
    ),
    "reduce": Command(
        reduce,
        [
            *(opt.ONE_PLANE, opt.output("write the moments", *opt.HDF5, required=True)),
            replace(opt.OF_LINER, text="model that the moments are for, and whose cells count; default: any liner"),
            *(PITCH, opt.frequency("the tone of the file; rows of --phase are kept for it")),
        ],
        ("plane.h5 -o plane.moments.h5",),
        opt.choices("averaging phase drive running_window mean missing background allow_short device dtype"),
    ),
    "validate": Command(
        validate,
        [replace(opt.PLANES, text="files with a reference impedance"), opt.OF_LINER, opt.ROWS],
        ("data/slit_n130_y*.h5 -o rules.csv",),
    ),
    "follow": Command(
        follow,
        [
            *(GROWING, opt.OF_LINER, opt.TONE),
            Option("--until", "half-width of the interval of Z, over rho c, that ends it; default: none", kinds.NUMBER),
            Option("--every", "between two looks, s; default 5", kinds.S, default=5.0),
            Option("--idle", "without new samples, after which it ends, s; default 600", kinds.S, default=600.0),
            opt.output("write the moments so far, at the end, on Ctrl-C and on SIGTERM,", *opt.HDF5),
            *opt.group("missing metadata", *opt.STATED, further=True),
        ],
        ("plane.h5 --until 0.05",),
        [PROBES, *opt.of("velocity.choices:Choices", "phase interval dtype", phase=opt.NO_GIVEN_PHASE)],
    ),
}

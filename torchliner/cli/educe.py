"""torchliner educe."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torchliner as tl
from torchliner.cli import options as opt
from torchliner.cli.choices import EDUCED, READING
from torchliner.cli.files import liner_names, planes_of, read_records, seen_from_anywhere, show_results, with_facts
from torchliner.cli.messages import progress_bar
from torchliner.names import SOURCE_SIDES

if TYPE_CHECKING:
    from torchliner.records import ImpedanceMap

EXAMPLES = (
    "plane.h5 -o map.h5 --figure pictures --holes holes.csv",
    "'run_*.nc' --normal y --frequency 300:6000:100 --liner mine.toml",
)
CASE = [opt.LEVEL, opt.Option("--source-side", "that the sound comes from; default: the file's", SOURCE_SIDES)]
OWN = [
    replace(opt.PLANES, text="plane files, or what torchliner reduce made of them; several: heights of a case"),
    opt.OF_LINER,
    opt.TONE,
    opt.output("write the map (of several planes, their names are appended)", *opt.RESULT),
    opt.Option(
        "--in-situ", "pressure record, whose impedance stands in map, table and figures; default: none", opt.FILE
    ),
    opt.Option("--wall-pressure", "record or microphones for the level check; default: --in-situ", opt.FILE),
]
OPTIONS = [*OWN, *CASE, *opt.CLUSTER, *opt.PICTURES_OF, *opt.PRINTING, opt.STRICT, *EDUCED, *READING]


def run(options: argparse.Namespace) -> int:
    """Educe every plane, print one row each, write what was asked for."""
    from torchliner.campaign.cluster import open_cluster
    from torchliner.io.microphone_file import read_wall_pressure
    from torchliner.io.result_writers import require_result
    from torchliner.io.whole_file import writable
    from torchliner.pressure.dean import with_in_situ

    outputs = _outputs(options.output, options.planes)
    for path in outputs:
        writable(path)
    pressure = None if options.in_situ is None else tl.read_pressure(options.in_situ)
    wall = None if options.wall_pressure is None else read_wall_pressure(options.wall_pressure)
    read = read_records(seen_from_anywhere(options, options.planes), options)
    records = [with_facts(each, opt.given(options, CASE)) for each in read]
    planes = planes_of(records)
    for path, plane in zip(outputs, planes, strict=False):
        require_result(path, len(options.frequency or [0]), plane.x is not None or plane.z is not None)
    names = liner_names(options.liner, records, options.planes)
    liners = {name: tl.load_liner(name) for name in names}
    total = sum(2 * plane.samples for plane in planes)
    with (
        open_cluster(options.cluster, options.wait) as client,
        progress_bar(total, options.planes[0].name, options) as step,
    ):
        found = [
            _educed(record, liners[name], options, wall or pressure, client, step)
            for record, name in zip(records, names, strict=True)
        ]
    if pressure is not None:
        found = with_in_situ(found, planes, pressure)
    return finish(options, found, planes, outputs)


def finish(options: argparse.Namespace, found: list[ImpedanceMap], planes: list[Any], outputs: list[Path]) -> int:
    """Write, draw and print maps; the exit code."""
    from torchliner.records.origin import with_choices
    from torchliner.report.map_table import format_maps, plain_map
    from torchliner.report.pictures import draw_pictures

    found = [with_choices(each, command=options.typed) for each in found]
    for path, result in zip(outputs, found, strict=False):
        result.write(path)
    if options.figure is not None:
        draw_pictures(found, planes, options.figure)
    show_results(options, format_maps(found), [*map(plain_map, found)])
    return strict_code(options, *found)


def strict_code(options: argparse.Namespace, *results: Any) -> int:
    """1 with --strict where the level check of a map or a line fails, else 0."""
    return int(options.strict and any(each.level_check is not None and each.level_check.failed for each in results))


def _educed(record: Any, liner: Any, options: argparse.Namespace, pressure: Any, client: Any, step: Any) -> Any:
    """The map of a plane, by workers if there are any."""
    chosen = opt.given(options, EDUCED)
    if client is not None and not hasattr(record, "plane"):  # moments are summed already
        summed = {name: value for name, value in chosen.items() if name != "reference_phase"}
        record = tl.moments(record, liner, options.frequency, client=client, progress=step, **summed)
    return tl.educe(record, liner, options.frequency, pressure=pressure, progress=step, **chosen)


def _outputs(path: Path | None, planes: list[Path]) -> list[Path]:
    """The map file of each plane, if any."""
    if path is None or len(planes) == 1:
        return [] if path is None else [path]
    named = [path.with_stem(f"{path.stem}_{plane.stem}") for plane in planes]
    if len(set(named)) < len(planes):
        raise ValueError("planes of the same name would share one map file; educe them one by one")
    return named

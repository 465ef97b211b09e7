"""torchliner educe."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchliner.cli.choice_options import EDUCED, choice_options, chosen_from
from torchliner.cli.files import (
    liner_names,
    planes_of,
    read_records,
    seen_from_anywhere,
    show_results,
    with_facts,
)
from torchliner.cli.options import (
    CLUSTER,
    level_check_code,
    progress_bar,
    shared,
    stated,
)
from torchliner.cli.plane_options import plane_options
from torchliner.names import RESULT_ENDINGS, SOURCE_SIDES

if TYPE_CHECKING:
    from torchliner.records import ImpedanceMap

OPTIONS = {
    "": shared("--liner", "--frequency")
    | {
        "planes PLANE ...": "plane files, or what torchliner reduce made of them; several: heights "
                            "of a case",
        "--output FILE": f"write the map as {RESULT_ENDINGS}; names of "
                         "several planes are appended",
        "--in-situ FILE": "pressure record of the same case: its in situ impedance stands in "
                          "map, table and figures; default: none",
        "--wall-pressure FILE": "pressure record, or microphones along the wall, for the level "
                                "check; default: that of --in-situ, else the stated level",
        "--incident-level DB": "of the incident wave (normal incidence) or at the wall (grazing), "
                               "dB re 20 uPa rms; default: that of the file",
        "--source-side": (SOURCE_SIDES, "that the sound comes from; default: the file's"),
    }
    | CLUSTER
    | shared("--figure", "--json", "--quiet", "--strict"),
} | choice_options(EDUCED) | plane_options()  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Educe every plane, print one row each, write what was asked for."""
    from torchliner.campaign.cluster import open_cluster
    from torchliner.io.microphone_file import read_wall_pressure
    from torchliner.io.pressure_file import read_pressure
    from torchliner.io.result_writers import require_result
    from torchliner.io.whole_file import writable
    from torchliner.liners.catalogue import load_liner
    from torchliner.pressure.dean import with_in_situ

    outputs = _outputs(options.output, options.planes)
    for path in outputs:
        writable(path)
    pressure = None if options.in_situ is None else read_pressure(options.in_situ)
    wall = None if options.wall_pressure is None else read_wall_pressure(options.wall_pressure)
    stated_by_user = stated(options, ("incident_level", "source_side"))
    records = [with_facts(each, stated_by_user) for each in read_records(seen_from_anywhere(options), options)]
    planes = planes_of(records)
    for path, plane in zip(outputs, planes, strict=False):
        require_result(path, len(options.frequency or [0]), plane.x is not None or plane.z is not None)
    liners = {name: load_liner(name) for name in liner_names(options.liner, records, options.planes)}
    names = liner_names(options.liner, records, options.planes)
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
    show_results(options, lambda: format_maps(found), lambda: [*map(plain_map, found)])
    return level_check_code(options, found)


def _educed(record: Any, liner: Any, options: argparse.Namespace, pressure: Any, client: Any, step: Any) -> Any:
    """The map of a plane, by workers if there are any."""
    from torchliner.records import VelocityPlane
    from torchliner.velocity.educe import educe, moments

    choices = chosen_from(options, EDUCED)
    if client is not None and isinstance(record, VelocityPlane):
        summed = {name: value for name, value in choices.items() if name != "reference_phase"}
        record = moments(record, liner, options.frequency, client=client, progress=step, **summed)
    return educe(record, liner, options.frequency, pressure=pressure, progress=step, **choices)


def _outputs(output: Path | None, planes: list[Path]) -> list[Path]:
    """The map file of each plane, if any."""
    if output is None or len(planes) == 1:
        return [] if output is None else [output]
    named = [output.with_stem(f"{output.stem}_{plane.stem}") for plane in planes]
    if len(set(named)) < len(planes):
        raise ValueError("planes of the same name would share one map file; educe them one by one")
    return named

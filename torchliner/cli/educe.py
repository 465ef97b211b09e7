"""torchliner educe."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchliner.cli.choice_options import ALL, choice_options, chosen_from
from torchliner.cli.files import (
    incident_signal,
    liner_names,
    planes_of,
    read_records,
    seen_from_anywhere,
    show_results,
    with_facts,
)
from torchliner.cli.options import (
    CLUSTER,
    closure_code,
    frequency_option,
    progress_bar,
    shared,
    spelled,
    stated,
)
from torchliner.cli.plane_options import plane_options
from torchliner.names import RESULT_ENDINGS, SOURCE_SIDES

if TYPE_CHECKING:
    from torchliner.records import ImpedanceMap, VelocityPlane
    from torchliner.reduction.moments import Moments

OPTIONS = {
    "": shared("--liner")
    | {
        "planes PLANE ...": "plane files, or what torchliner reduce made of them; several: heights "
                            "of a case",
        **frequency_option("the tone of the file, or the lines of --incident"),
        "--output FILE": f"write the map as {RESULT_ENDINGS}; names of "
                         "several planes are appended",
        "--in-situ FILE": "pressure record of the same case: its in situ impedance stands in "
                          "map, table and figures; default: none",
        "--wall-pressure FILE": "pressure record, or microphones along the wall, that closure is "
                                "checked with; default: that of --in-situ, else the stated level",
        "--incident-level DB": "of the incident wave (normal incidence) or at the wall (grazing), "
                               "dB re 20 uPa rms; default: that of the file",
        "--source-side": (SOURCE_SIDES, "that the sound comes from; default: the file's"),
        "--incident SIGNAL": "tones:500,900, sweep:300:6000:logarithmic, noise:300:6000:SEED (Hz), "
                             "or a .wav or .npy file; default: tones of --frequency",
        "--incident-rate HZ": "sampling rate of an .npy file, Hz; default: none",
        "--reflected FILE": "write the reflected signal of every probe as .h5/.nc",
        "--hash": "keep the SHA-256 of all of each input, which reads them once more; default: of "
                  "inputs above 32 MiB that of 32 blocks",
    }
    | CLUSTER
    | shared("--figure", "--json", "--quiet", "--strict"),
} | choice_options(ALL) | plane_options()  # fmt: skip

OF_TONES = ("interval", "resample", "wall_pressure", "closure_limit", "level_doubt")


def run(options: argparse.Namespace) -> int:
    """Educe every plane, print one row each, write what was asked for."""
    from torchliner.campaign.cluster import open_cluster
    from torchliner.in_situ_method.beside_maps import with_in_situ
    from torchliner.io.microphone_file import read_wall_pressure
    from torchliner.io.pressure_file import read_pressure
    from torchliner.io.result_writers import require_result
    from torchliner.io.whole_file import writable
    from torchliner.records.origin import with_choices, with_whole_hashes
    from torchliner.report.map_table import format_maps, plain_map
    from torchliner.report.pictures import draw_pictures

    outputs = _outputs(options.output, options.planes)
    given = stated(options, OF_TONES) if options.incident is not None else {}
    if given:
        raise ValueError(
            f"{spelled(given)}: of tones; with --incident there are no error bars, and closure is "
            "not checked: leave this out"
        )
    if options.reflected is not None and len(options.planes) > 1:
        raise ValueError("several planes would share one reflected file; educe them one by one")
    for path in outputs:
        writable(path)
    if options.reflected in outputs:
        raise ValueError(f"--reflected {options.reflected} is another output; name another file")
    pressure = None if options.in_situ is None else read_pressure(options.in_situ)
    wall = None if options.wall_pressure is None else read_wall_pressure(options.wall_pressure)
    stated_by_user = stated(options, ("incident_level", "source_side"))
    records = [with_facts(each, stated_by_user) for each in read_records(seen_from_anywhere(options), options)]
    planes = planes_of(records)
    count = math.inf if options.incident else len(options.frequency or [0])
    for path, plane in zip(outputs, planes, strict=False):
        require_result(path, count, plane.x is not None or plane.z is not None)
    with open_cluster(options.cluster) as client:
        found = _educed(options, records, wall or pressure, client)
    if pressure is not None:
        found = with_in_situ(found, planes, pressure)
    found = [with_choices(each, command=options.typed) for each in found]
    if options.hash:
        found = [with_whole_hashes(each) for each in found]
    for path, result in zip(outputs, found, strict=False):
        result.write(path)
    if options.figure is not None:
        draw_pictures(found, planes, options.figure)
    show_results(options, lambda: format_maps(found), lambda: [*map(plain_map, found)])
    return closure_code(options, found)


def _educed(
    options: argparse.Namespace, records: list[VelocityPlane | Moments], pressure: Any, client: Any
) -> list[ImpedanceMap]:
    """The map of each plane; planes of one liner share levels and kernels."""
    from torchliner.liners.catalogue import load_liner
    from torchliner.tdibc.educe import educe

    choices = chosen_from(options, ALL) | {"incident": incident_signal(options)}
    names = liner_names(options.liner, records, options.planes)
    found: dict[int, ImpedanceMap] = {}
    for name in dict.fromkeys(names):
        members = [i for i, each in enumerate(names) if each == name]
        total = sum(2 * each.samples for each in planes_of([records[i] for i in members]))
        with progress_bar(total, options.planes[members[0]].name, options, reading=total // 2) as step:
            several = educe(
                [records[i] for i in members], load_liner(name), options.frequency,
                pressure=pressure, progress=step, reflected=options.reflected,
                client=client, **choices,
            )  # fmt: skip
        found |= dict(zip(members, several, strict=True))
    return [found[i] for i in range(len(records))]


def _outputs(output: Path | None, planes: list[Path]) -> list[Path]:
    """The map file of each plane, if any."""
    if output is None or len(planes) == 1:
        return [] if output is None else [output]
    named = [output.with_stem(f"{output.stem}_{plane.stem}") for plane in planes]
    if len(set(named)) < len(planes):
        raise ValueError("planes of the same name would share one map file; educe them one by one")
    return named

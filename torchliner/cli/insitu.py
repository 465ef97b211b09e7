"""torchliner insitu."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchliner.cli.options import (
    add_output_options,
    frequencies,
    print_json,
    refuse_inputs,
    require_ending,
    warnings_on_stderr,
)

if TYPE_CHECKING:
    from torchliner.records import ImpedanceMap, VelocityPlane

SAME_DURATION = 0.01
CHOICES = ("losses", "window", "segment", "start", "allow_short")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options; their defaults are those of ``torchliner.in_situ``."""
    parser.add_argument("record", type=Path, help="pressure record")
    parser.add_argument("--frequency", nargs="+", type=frequencies, metavar="HZ", help="values or "
                        "ranges LOW:HIGH:STEP; default: the tone of the file")  # fmt: skip
    parser.add_argument("-o", "--output", type=Path, help="rows as .csv, or points, cells and "
                        "surface as .h5/.nc")  # fmt: skip
    parser.add_argument("--figure", type=Path, help="draw Z along x there")
    parser.add_argument("--losses", choices=["none", "viscothermal"], help="in the cavity")
    parser.add_argument("--microphones", nargs=2, type=int, metavar="I", help="the two of the "
                        "two-microphone row, from 0; default: the best conditioned")  # fmt: skip
    parser.add_argument("--window", help="window of scipy, e.g. hann, boxcar")
    parser.add_argument("--segment", type=float, metavar="S", help="of the H1 estimate")
    parser.add_argument("--start", type=float, metavar="S", help="leave the beginning out")
    parser.add_argument("--allow-short", action="store_true", default=None,
                        help="accept fewer than four periods")  # fmt: skip
    add_output_options(parser)


def run(options: argparse.Namespace) -> int:
    """Print every method the record has signals for, beside the file's own values."""
    from torchliner.in_situ_method.every_method import in_situ_report
    from torchliner.io.pressure_file import read_pressure
    from torchliner.report.in_situ_report import draw_in_situ, format_in_situ, in_situ_table

    refuse_inputs([options.output], [options.record], options.figure)
    require_ending(options.output, [".csv", ".h5", ".nc"], "--output")
    chosen = {key: getattr(options, key) for key in CHOICES if getattr(options, key) is not None}
    if options.microphones is not None:
        chosen["pair"] = tuple(options.microphones)
    wanted = None if options.frequency is None else list(chain(*options.frequency))
    record = read_pressure(options.record)
    with warnings_on_stderr(options.quiet):
        report = in_situ_report(record, wanted, **chosen)
    wants_points = options.figure is not None or (
        options.output is not None and options.output.suffix.lower() != ".csv"
    )
    if report.points is None and wants_points:
        raise ValueError(
            f"{options.record} holds microphones alone: there is nothing along x to draw or to "
            "write; -o FILE.csv writes the rows"
        )
    if options.output is not None and options.output.suffix.lower() == ".csv":
        in_situ_table(report.rows).write_csv(options.output)
    elif options.output is not None and report.points is not None:
        report.points.write(options.output)
    if options.figure is not None and report.points is not None:
        draw_in_situ(record, report.points, options.figure)
    if options.json:
        rows = in_situ_table(report.rows).as_rows()
        print_json({"title": record.title, "rows": rows, "notes": report.notes})
    else:
        print(format_in_situ(record, report))
    return 0


def with_in_situ(
    found: Sequence[ImpedanceMap], planes: Sequence[VelocityPlane], path: Path
) -> list[ImpedanceMap]:
    """Maps with the in situ impedances of a pressure record beside them, for ``educe``."""
    from torchliner.checks import tell
    from torchliner.in_situ_method.dean import in_situ
    from torchliner.io.pressure_file import read_pressure
    from torchliner.records.same_case import require_same_case

    record = read_pressure(path)
    made: dict[tuple[float, ...], Any] = {}
    for result, plane in zip(found, planes, strict=True):
        require_same_case(
            plane, record, ("frequency", "incident_level", "mach"),
            "name the pressure record of the same run", where_stated=True,
        )  # fmt: skip
        key = tuple(result.frequency.tolist())
        if key not in made:
            made[key] = in_situ(record, result.frequency)
        if abs(record.duration / plane.duration - 1) > SAME_DURATION:
            tell(
                f"{path} lasts {1e3 * record.duration:.4g} ms, {plane.name} "
                f"{1e3 * plane.duration:.4g} ms: the two impedances are of different times"
            )
    return [result.with_alongside(made[tuple(result.frequency.tolist())]) for result in found]

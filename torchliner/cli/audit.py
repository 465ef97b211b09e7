"""torchliner audit."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from torchliner.cli.options import (
    add_output_options,
    liner_name,
    print_json,
    progress_bar,
    warnings_on_stderr,
)

CHOICES = ("edge", "window", "drive", "mean", "kernel", "levels", "velocity_max", "pre_roll",
           "missing", "interval", "draws", "seed", "resample", "memory", "compile", "device",
           "dtype", "wall_filter")  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options; those of the base are those of ``educe``."""
    parser.add_argument("planes", nargs="+", type=Path, help="the plane, and others of the same "
                        "case: its other heights")  # fmt: skip
    parser.add_argument("--liner", help="preset name, .toml or .csv; default: named in the file")
    parser.add_argument("--frequency", type=float, metavar="HZ", help="default: the tone")
    parser.add_argument("--order", default="probes first", metavar="ORDER",
                        choices=["probes first", "velocity first"],
                        help="of averaging: 'probes first' (default) or 'velocity first'"
                        )  # fmt: skip
    parser.add_argument("-o", "--output", type=Path, help="the rows as CSV")
    parser.add_argument("--figure", type=Path, help="picture of the table")
    base = parser.add_argument_group("base, as for educe")
    base.add_argument("--edge", choices=["auto", "finite", "wrap", "silent"])
    base.add_argument("--window")
    base.add_argument("--drive", choices=["instantaneous", "rms", "running-rms"])
    base.add_argument("--mean", choices=["kept", "removed"])
    base.add_argument("--kernel", choices=["two-sided", "causal"])
    base.add_argument("--levels", type=int)
    base.add_argument("--velocity-max", type=float, metavar="M/S")
    base.add_argument("--pre-roll", type=float, metavar="S")
    base.add_argument("--missing", choices=["refuse", "exclude"])
    base.add_argument("--wall-filter", type=float, metavar="COHERENCE")
    base.add_argument("--interval", type=float, metavar="LEVEL")
    base.add_argument("--draws", type=int)
    base.add_argument("--seed", type=int)
    base.add_argument("--resample", choices=["time", "time-span", "time-cells"])
    base.add_argument("--memory", metavar="SIZE")
    base.add_argument("--compile", choices=["auto", "never", "always"])
    base.add_argument("--device")
    base.add_argument("--dtype", choices=["float32", "float64"])
    add_output_options(parser)


def run(options: argparse.Namespace) -> int:
    """Print the table, sorted by what moves Z most."""
    from torchliner.eduction.audit import audit
    from torchliner.io.plane_file import read_plane
    from torchliner.liners.catalogue import load_liner
    from torchliner.report.audit import draw_audit, format_audit, plain_audit, write_audit

    chosen: dict[str, Any] = {
        key: getattr(options, key) for key in CHOICES if getattr(options, key) is not None
    }
    _check_targets(options)
    planes = [read_plane(path, lazy=True) for path in options.planes]
    liner = load_liner(options.liner or liner_name(planes[0], options.planes[0]))
    total = sum(2 * plane.samples for plane in planes) + 2 * planes[0].samples
    with (
        warnings_on_stderr(options.quiet),
        progress_bar(total, options.planes[0].name, options.quiet) as step,
    ):
        found = audit(
            planes, liner, options.frequency, order=options.order, progress=step, **chosen
        )
    if options.output is not None:
        write_audit(found, options.output)
    if options.figure is not None:
        draw_audit(found, options.figure)
    if options.json:
        print_json(plain_audit(found))
    else:
        print(format_audit(found))
    return 0


def _check_targets(options: argparse.Namespace) -> None:
    """No output may be an input or the other output."""
    taken = {path.resolve() for path in options.planes}
    if options.liner is not None:
        taken.add(Path(options.liner).resolve())
    for path in (options.output, options.figure):
        if path is not None and path.resolve() in taken:
            raise ValueError(f"the output {path} is an input or the other output; name another")
        if path is not None:
            taken.add(path.resolve())

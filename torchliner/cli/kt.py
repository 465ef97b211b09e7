"""torchliner kt."""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchliner.cli.options import (
    add_output_options,
    complex_number,
    frequencies,
    print_json,
    refuse_inputs,
    require_ending,
    warnings_on_stderr,
)
from torchliner.names import WALL_METHODS, resolve

if TYPE_CHECKING:
    from torchliner.records import MicrophoneLine
    from torchliner.report.wall_table import Educed

SHARED = ("source_side", "draws", "level_error", "phase_error")
OWN = {name: own for name, (_, _, own) in WALL_METHODS.items()}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options; their defaults are those of ``torchliner.kumaresan_tufts``."""
    parser.add_argument("lines", nargs="+", type=Path, metavar="LINE",
                        help="microphone lines: .csv, .h5 or .nc")  # fmt: skip
    parser.add_argument("--method", choices=list(OWN), default="kt",
                        help="Kumaresan-Tufts (default), a fit of two waves tied by one impedance, "
                        "of two free waves, or of the linearised Euler equations")  # fmt: skip
    parser.add_argument("--rank", type=int, metavar="K", help="waves that are kept (default 2)")
    parser.add_argument("--order", type=int, metavar="L", help="of the prediction; default half "
                        "the microphones")  # fmt: skip
    parser.add_argument("--weights", choices=["absolute", "relative"], help="of a fit: equal "
                        "errors in Pa (default) or in dB")  # fmt: skip
    parser.add_argument("--source-side", choices=["upstream", "downstream"],
                        help="default: what the file says")  # fmt: skip
    parser.add_argument("--condition", choices=["ingard-myers", "continuous-velocity"],
                        help="at the liner (default ingard-myers)")  # fmt: skip
    parser.add_argument("--margin", type=float, metavar="MM",
                        help="that microphones keep from the liner's ends")  # fmt: skip
    parser.add_argument("--duct", metavar="DUCT", help="of --method field: preset or .toml file, "
                        "as for torchliner duct")  # fmt: skip
    parser.add_argument("--far-end", choices=["fitted", "stated"], help="of --method field: it "
                        "reflects what is found (default), or what the duct states")  # fmt: skip
    parser.add_argument("--variation", choices=["constant", "linear"], help="of --method field: of "
                        "the impedance along the liner (default constant)")  # fmt: skip
    parser.add_argument("--start", metavar="Z", help="of --method field: R+Xj where "
                        "the search begins; default the best of a grid")  # fmt: skip
    parser.add_argument("--draws", type=int, metavar="N", help="of the microphones' errors, e.g. "
                        "500; default none")  # fmt: skip
    parser.add_argument("--level-error", type=float, metavar="DB", help="default 0.1")
    parser.add_argument("--phase-error", type=float, metavar="DEG", help="default 0.1")
    parser.add_argument("--seed", type=int, default=0, help="of the draws (default 0)")
    parser.add_argument("--frequency", nargs="+", type=frequencies, metavar="HZ", help="values or "
                        "ranges LOW:HIGH:STEP; default: those of the file")  # fmt: skip
    parser.add_argument("--segment", type=float, metavar="S", help="of time signals")
    parser.add_argument("-o", "--output", type=Path, help="rows as .csv")
    parser.add_argument("--figure", type=Path, help="draw impedance and levels there")
    add_output_options(parser)


def run(options: argparse.Namespace) -> int:
    """Educe each line and print its table."""
    import torch

    from torchliner.io.microphone_file import read_microphones
    from torchliner.report.wall_pressure import draw_wall
    from torchliner.report.wall_table import format_wall, wall_rows, wall_table

    refuse_inputs([options.output], options.lines, options.figure)
    require_ending(options.output, [".csv"], "--output")
    chosen = _chosen(options)
    wanted = None if options.frequency is None else list(chain(*options.frequency))
    lines, found = [], []
    with warnings_on_stderr(options.quiet):
        for path in options.lines:
            line = read_microphones(path, wanted, segment=options.segment)
            generator = torch.Generator().manual_seed(options.seed)
            found.append(educe_line(line, options.method, generator=generator, **chosen))
            lines.append(line)
    tables = [wall_rows(line, one) for line, one in zip(lines, found, strict=True)]
    if options.output is not None:
        wall_table([row for rows in tables for row in rows]).write_csv(options.output)
    if options.figure is not None:
        draw_wall(lines, found, options.figure)
    if options.json:
        print_json({"lines": [
            {"name": line.name, "title": line.title, "choices": dict(one.choices),
             "rows": wall_table(rows).as_rows(), "notes": [*line.notes, *one.notes]}
            for line, one, rows in zip(lines, found, tables, strict=True)
        ]})  # fmt: skip
    else:
        print("\n\n".join(format_wall(*each) for each in zip(lines, found, strict=True)))
    return 0


def _chosen(options: argparse.Namespace) -> dict[str, Any]:
    """Options that were given, for the method that knows them.

    Raises:
        ValueError: one belongs to other methods.
    """
    own = OWN[options.method]
    for key in dict.fromkeys(chain(*OWN.values())):
        if key not in own and getattr(options, key) is not None:
            named = "--" + key.replace("_", "-")
            raise ValueError(f"{named} is no option of --method {options.method}")
    named_keys = (*SHARED, *own)
    chosen = {key: getattr(options, key) for key in named_keys}
    chosen = {key: value for key, value in chosen.items() if value is not None}
    if "start" in chosen:
        chosen["start"] = complex_number(chosen["start"], "--start")
    if "margin" in chosen:
        chosen["margin"] *= 1e-3
    return chosen


def educe_line(
    line: MicrophoneLine, method: str, *, source_side: str | None = None, **options: Any
) -> Educed:
    """By one of ``WALL_METHODS``.

    Args:
        line: microphones.
        method: its name.
        source_side: instead of the line's.
        options: of the method.
    """
    if source_side is not None:
        line = replace(line, source_side=source_side)
    found: Educed = resolve(WALL_METHODS[method][0])(line, **options)
    return found

"""torchliner kt."""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchliner import names
from torchliner.cli.files import show_results
from torchliner.cli.options import complex_number, frequency_option, shared, spelled, stated

if TYPE_CHECKING:
    from torchliner.records import MicrophoneLine
    from torchliner.report.wall_table import Educed

SHARED = ("source_side", "mach", "draws", "level_error", "phase_error")
METHODS = {name: own for name, (_, _, own) in names.WALL_METHODS.items()}
MEANINGS = "; ".join(f"{name}, {text}" for name, (_, text, _) in names.WALL_METHODS.items())
OPTIONS = {
    "": {
        "lines LINE ...": "microphone lines: .csv, .h5 or .nc",
        "--method": {"choices": list(METHODS), "default": "kt", "help": f"{MEANINGS}; default kt"},
        **frequency_option("those of the file"),
        "--segment S": "of time signals, s; default: the whole record",
        "--source-side": (names.SOURCES, "side that the sound comes from; default: the file's"),
        "--mach M": "bulk Mach number, 0 for no flow; default: the file's, which must state one",
        "--figure PICTURE": "draw impedance and levels there",
    }
    | {"--output FILE": "write the rows as .csv, or all of the result as .h5 or .nc, for torchliner report"}
    | shared("--json", "--quiet"),
    "kt and fits of two waves": {
        "--rank N": "of kt: waves that are kept; default 2",
        "--order N": "of kt: of the prediction; default half the microphones",
        "--weights": (names.WEIGHTS, "of fits: equal errors in Pa or in dB; default absolute"),
        "--condition": (names.CONDITIONS, "at the liner; default ingard-myers"),
        "--margin MM": "that microphones keep from the liner's ends, mm; default 0",
    },
    "--method field": {
        "--duct DUCT": "preset or .toml file, as for torchliner duct; default: none",
        "--far-end": (names.FAR_ENDS, "it reflects what is found, or stated; default fitted"),
        "--variation": (names.VARIATIONS, "of Z along the liner; default constant"),
        "--start Z": "R+Xj where the search begins; default the best of a grid",
    },
    "error bars": {
        "--draws N": "of the microphones' errors, e.g. 500; default none",
        "--level-error DB": "standard error of a level, dB, raised where the residual asks for it; default 0.1",
        "--phase-error DEG": "standard error of a phase, degrees, likewise; default 0.1",
        "--seed N": {"default": 0, "help": "of the draws; default 0"},
    },
}


def run(options: argparse.Namespace) -> int:
    """Educe each line and print its table."""
    import torch

    from torchliner.io.microphone_file import read_microphones
    from torchliner.records.origin import origin_of, with_choices
    from torchliner.report.wall_pressure import draw_wall
    from torchliner.report.wall_table import format_wall, wall_rows, wall_table

    chosen = _chosen(options)
    lines: list[MicrophoneLine] = []
    found: list[Educed] = []
    for path in options.lines:
        line = read_microphones(path, options.frequency, segment=options.segment)
        generator = torch.Generator().manual_seed(options.seed)
        one = educe_line(line, options.method, generator=generator, **chosen)
        files = [("microphones", path), ("duct", options.duct or "")]
        found.append(with_choices(one, **origin_of(files, command=options.typed)))
        lines.append(line)
    tables = [wall_rows(line, one) for line, one in zip(lines, found, strict=True)]

    def write(path: Path) -> None:
        if path.suffix.lower() == ".csv":
            wall_table([*chain(*tables)]).write_csv(path)
        else:
            found[0].write(path, *found[1:])

    show_results(
        options,
        lambda: "\n\n".join(map(format_wall, lines, found)),
        lambda: {
            "lines": [
                {
                    "name": line.name,
                    "title": line.title,
                    "choices": dict(one.choices),
                    "rows": wall_table(rows).as_rows(),
                    "notes": [str(note) for note in (*line.notes, *one.notes)],
                }
                for line, one, rows in zip(lines, found, tables, strict=True)
            ]
        },
        output=write,
        figure=lambda path: draw_wall(lines, found, path),
    )
    return 0


def _chosen(options: argparse.Namespace) -> dict[str, Any]:
    """Options that were given, for the method that knows them.

    Raises:
        ValueError: one belongs to other methods.
    """
    own = METHODS[options.method]
    for key in dict.fromkeys(chain(*METHODS.values())):
        if key not in own and getattr(options, key) is not None:
            raise ValueError(f"{spelled([key])} is no option of --method {options.method}")
    chosen = stated(options, (*SHARED, *own))
    if "start" in chosen:
        chosen["start"] = complex_number(chosen["start"], "--start")
    if "margin" in chosen:
        chosen["margin"] *= 1e-3
    return chosen


def educe_line(
    line: MicrophoneLine,
    method: str,
    *,
    source_side: str | None = None,
    mach: float | None = None,
    **options: Any,
) -> Educed:
    """By one of ``WALL_METHODS``.

    Args:
        line: microphones.
        method: its name.
        source_side, mach: instead of the line's.
        options: of the method.
    """
    if source_side is not None:
        line = replace(line, source_side=source_side)
    if mach is not None:
        line = replace(line, mach=mach)
    found: Educed = names.resolve(names.WALL_METHODS[method][0])(line, **options)
    return found

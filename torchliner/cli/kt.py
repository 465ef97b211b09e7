"""torchliner kt."""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torchliner as tl
from torchliner import names
from torchliner.cli import options as opt
from torchliner.cli.files import show_results
from torchliner.cli.signatures import of

if TYPE_CHECKING:
    from torchliner.records import MicrophoneLine
    from torchliner.report.wall_table import Educed

EXAMPLES = (
    "wall.csv --mach 0.3 --draws 500 --figure z.png",
    "wall.csv --method field --duct b2a",
    "up.csv down.csv --draws 500 -o kt.h5",
)
METHODS = {name: own for name, (_, _, own) in names.WALL_METHODS.items()}
MEANINGS = "; ".join(f"{name}, {text}" for name, (_, text, _) in names.WALL_METHODS.items())
KT, WAVES, FIELD = "pressure.kumaresan_tufts:kumaresan_tufts", "kt and fits of two waves", "--method field"
ANY = [
    opt.Option("--source-side", "side that the sound comes from; default: the file's", names.SOURCES),
    opt.Option(
        "--mach",
        "bulk Mach number, 0 for no flow; default: the file's, which must state one; of --method field the duct's",
        opt.NUMBER,
    ),
    *of(KT, "draws level_error phase_error", group="error bars", draws={"kind": opt.INDEX}),
]
OWN = [
    *of(KT, "rank order condition", group=WAVES),
    *of("pressure.two_waves:two_wave_fit", "weights", group=WAVES),
    opt.Option("--margin", "that microphones keep from the liner's ends, mm; default 0", opt.MM, group=WAVES),
    opt.Option("--duct", "preset or .toml file, as for torchliner duct; default: none", opt.DUCT, group=FIELD),
    *of("pressure.fit_field:fit_field", "far_end start", group=FIELD, start={"kind": opt.COMPLEX}),
]
OPTIONS = [
    opt.Option("lines", "microphone lines: .csv, .h5 or .nc", opt.PATH, nargs="+"),
    opt.Option("--method", f"{MEANINGS}; default kt", METHODS, default="kt"),
    opt.frequency("those of the file"),
    opt.Option("--segment", "of time signals, s; default: the whole record", opt.S),
    *opt.figure("draw impedance and levels there"),
    opt.output("write the rows as .csv, or all of the result, for torchliner report,", ".csv", *opt.HDF5),
    *opt.PRINTING,
    *ANY,
    *OWN,
    opt.Option("--seed", "of the draws; default 0", opt.INDEX, default=0, group="error bars"),
]


def run(options: argparse.Namespace) -> int:
    """Educe each line and print its table."""
    import torch

    from torchliner.records.origin import origin_of, with_choices
    from torchliner.report.wall_pressure import draw_wall
    from torchliner.report.wall_table import format_wall, wall_rows, wall_table

    own = opt.given(options, OWN)
    if foreign := own.keys() - METHODS[options.method]:
        raise ValueError(f"{opt.spelled(sorted(foreign))} is no option of --method {options.method}")
    chosen = opt.given(options, ANY) | own | ({"margin": 1e-3 * own["margin"]} if "margin" in own else {})
    lines: list[MicrophoneLine] = []
    found: list[Educed] = []
    for path in options.lines:
        line = tl.read_microphones(path, options.frequency, segment=options.segment)
        generator = torch.Generator().manual_seed(options.seed)
        one = educe_line(line, options.method, generator=generator, **chosen)
        files = [("microphones", path), ("duct", options.duct or "")]
        found.append(with_choices(one, **origin_of(files, command=options.typed)))
        lines.append(line)
    tables = [wall_rows(line, one) for line, one in zip(lines, found, strict=True)]
    plain = [
        {
            "name": line.name,
            "title": line.title,
            "choices": dict(one.choices),
            "rows": wall_table(rows).as_rows(),
            "notes": [str(note) for note in (*line.notes, *one.notes)],
        }
        for line, one, rows in zip(lines, found, tables, strict=True)
    ]

    def write(path: Path) -> None:
        if path.suffix.lower() == ".csv":
            wall_table([*chain(*tables)]).write_csv(path)
        else:
            found[0].write(path, *found[1:])

    text = "\n\n".join(map(format_wall, lines, found))
    show_results(
        options, text, {"lines": plain}, output=write, figure=lambda path: draw_wall(lines, found, path)
    )  # fmt: skip
    return 0


def educe_line(line: MicrophoneLine, method: str, **chosen: Any) -> Educed:
    """By one of ``WALL_METHODS``; ``source_side`` and ``mach``, where they are chosen, instead of the line's."""
    about = {name: chosen.pop(name) for name in ("source_side", "mach") if name in chosen}
    found: Educed = names.resolve(names.WALL_METHODS[method][0])(replace(line, **about), **chosen)
    return found

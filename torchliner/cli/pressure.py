"""Commands that measure an impedance from pressure: insitu, kt."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import torchliner as tl
from torchliner import names
from torchliner.cli import kinds
from torchliner.cli import options as opt
from torchliner.cli.kinds import Command, Option
from torchliner.cli.output import show


def insitu(options: argparse.Namespace) -> None:
    """Print every method the record has signals for, beside the file's own values."""
    from torchliner.records.origin import with_choices
    from torchliner.report.of_line import of_pressures

    pair: dict[str, Any] = {} if options.microphones is None else {"pair": tuple(options.microphones)}
    record = tl.read_pressure(options.record)
    answer, points = of_pressures(record, options.frequency, **options.chosen, **pair)
    points = points and with_choices(points, command=options.typed)
    as_rows = options.output is None or options.output.suffix.lower() == ".csv"
    if points is None and not (as_rows and options.figure is None):
        raise ValueError(
            f"{options.record} holds microphones alone: there is nothing along x to draw or to "
            "write; -o FILE.csv writes the rows"
        )
    show(options, answer, write=None if as_rows or points is None else points.write)


def kt(options: argparse.Namespace) -> None:
    """Educe each line and print its table."""
    import torch

    from torchliner.records.origin import origin_of, with_choices
    from torchliner.report.answer import answer_of

    home, _, taken = names.WALL_METHODS[options.method]
    if foreign := {option.dest for option in OWN} & options.chosen.keys() - set(taken):
        raise ValueError(f"{opt.spelled(sorted(foreign))} is no option of --method {options.method}")
    about = {name: options.chosen.pop(name) for name in ("source_side", "mach") if name in options.chosen}
    found: list[Any] = []
    for path in options.lines:
        line = tl.read_microphones(path, options.frequency, segment=options.segment)
        generator = torch.Generator().manual_seed(options.seed)
        one = names.resolve(home)(replace(line, **about), generator=generator, **options.chosen)
        files = [("microphones", path), ("duct", options.duct or "")]
        found.append(with_choices(one, **origin_of(files, command=options.typed)))
    answer = answer_of(found)

    def write(path: Path) -> None:
        if path.suffix.lower() == ".csv":
            answer.table.write_csv(path)
        else:
            found[0].write(path, *found[1:])

    show(options, answer, write=write)


MEANINGS = "; ".join(f"{name}, {text}" for name, (_, text, _) in names.WALL_METHODS.items())
KT, WAVES, FIELD = "pressure.kumaresan_tufts:kumaresan_tufts", "kt and fits of two waves", "--method field"
OWN = [  # of some methods
    *opt.of(KT, "rank order condition margin", group=WAVES),
    *opt.of("pressure.two_waves:two_wave_fit", "weights", group=WAVES),
    Option("--duct", "preset or .toml file, as for torchliner duct; default: none", kinds.DUCT, group=FIELD),
    *opt.of("pressure.fit_field:fit_field", "far_end start", group=FIELD),
]
PAIR = Option("--microphones", "two of the row, from 0; default: the best conditioned pair", kinds.COUNT, nargs=2)
BULK_MACH = "bulk Mach number, 0 for no flow; default: the file's, which must state one; of --method field the duct's"
COMMANDS = {
    "insitu": Command(
        insitu,
        [
            Option("record", "pressure record", kinds.PATH),
            opt.output("write the rows as .csv, or points, cells and surface,", ".csv", *opt.HDF5),
            *(opt.figure("draw Z along x there"), PAIR, opt.TONE),
        ],
        ("pressure.h5 -o z.csv --figure z.png",),
        [
            *opt.of("pressure.dean:in_situ", "losses start window segment", window={"kind": kinds.TEXT}),
            *opt.choices("allow_short interval"),
        ],
    ),
    "kt": Command(
        kt,
        [
            Option("lines", "microphone lines: .csv, .h5 or .nc", kinds.PATH, nargs="+"),
            Option("--method", f"{MEANINGS}; default kt", names.WALL_METHODS, default="kt"),
            *(opt.frequency("those of the file"), opt.figure("draw impedance and levels there")),
            Option("--segment", "of time signals, s; default: the whole record", kinds.S),
            opt.output("write the rows as .csv, or all of the result, for torchliner report,", ".csv", *opt.HDF5),
            Option("--seed", "of the draws; default 0", kinds.COUNT, default=0, group="error bars"),
        ],
        (
            "wall.csv --mach 0.3 --draws 500 --figure z.png",
            "wall.csv --method field --duct b2a",
            "up.csv down.csv --draws 500 -o kt.h5",
        ),
        [
            Option("--source-side", "side that the sound comes from; default: the file's", names.SOURCES),
            Option("--mach", BULK_MACH, kinds.NUMBER),
            *opt.of(KT, "draws level_error phase_error", group="error bars"),
            *OWN,
        ],
    ),
}

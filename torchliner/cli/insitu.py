"""torchliner insitu."""

from __future__ import annotations

import argparse

import torchliner as tl
from torchliner.cli import options as opt
from torchliner.cli.choices import choices
from torchliner.cli.files import show_results
from torchliner.cli.signatures import of

EXAMPLES = ("pressure.h5 -o z.csv --figure z.png",)
CHOICES = [
    *of("pressure.dean:in_situ", "losses start window segment", window={"kind": opt.Kind("NAME")}),
    *choices("allow_short interval no_intervals"),
]
PAIR = opt.Option(
    "--microphones", "of the two-microphone row, from 0; default: the best conditioned", opt.INDEX, nargs=2
)
OWN = [
    opt.Option("record", "pressure record", opt.PATH),
    opt.output("write the rows as .csv, or points, cells and surface,", ".csv", *opt.HDF5),
    *opt.figure("draw Z along x there"),
]
OPTIONS = [*OWN, PAIR, opt.TONE, *opt.PRINTING, *CHOICES]


def run(options: argparse.Namespace) -> int:
    """Print every method the record has signals for, beside the file's own values."""
    from torchliner.pressure.tones import LEVEL
    from torchliner.records.origin import with_choices
    from torchliner.report.in_situ_report import draw_in_situ, every_method, format_in_situ, in_situ_table

    chosen = opt.given(options, CHOICES)
    if options.microphones is not None:
        chosen["pair"] = tuple(options.microphones)
    record = tl.read_pressure(options.record)
    rows, points, notes = every_method(record, options.frequency, **chosen)
    table, level = in_situ_table(rows), chosen.get("interval", LEVEL)
    points = points and with_choices(points, command=options.typed)
    as_rows = options.output is None or options.output.suffix.lower() == ".csv"
    if points is None and not (as_rows and options.figure is None):
        raise ValueError(
            f"{options.record} holds microphones alone: there is nothing along x to draw or to "
            "write; -o FILE.csv writes the rows"
        )
    told = [str(note) for note in notes]
    show_results(
        options,
        format_in_situ(record, rows, level),
        {"title": record.title, "interval_level": level, "rows": table.as_rows(), "notes": told},
        output=table.write_csv if as_rows or points is None else points.write,
        figure=None if points is None else lambda path: draw_in_situ(record, points, path),
    )
    return 0

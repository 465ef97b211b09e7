"""torchliner insitu."""

from __future__ import annotations

import argparse

from torchliner import names
from torchliner.cli.choice_options import choice_options, chosen_from
from torchliner.cli.files import show_results
from torchliner.cli.options import shared, stated

CHOICES = ("allow_short", "interval", "no_intervals")
OPTIONS = {
    "": {
        "record RECORD": "pressure record",
        "--output FILE": "write the rows as .csv, or points, cells and surface as .h5/.nc",
        "--figure PICTURE": "draw Z along x there",
        "--losses": (names.LOSSES, "in the cavity; default none"),
        "--microphones I I": "of the two-microphone row, from 0; default: the best conditioned",
        "--start S": "beginning that is left out, s; default 0",
        "--window NAME": "window of scipy, e.g. hann, boxcar; default hann",
        "--segment S": "of the H1 estimate, s; default the whole record",
    }
    | shared("--frequency", "--json", "--quiet"),
} | choice_options(CHOICES)


def run(options: argparse.Namespace) -> int:
    """Print every method the record has signals for, beside the file's own values."""
    from torchliner.io.pressure_file import read_pressure
    from torchliner.pressure.tones import LEVEL
    from torchliner.records.origin import with_choices
    from torchliner.report.in_situ_report import draw_in_situ, every_method, format_in_situ, in_situ_table

    chosen = chosen_from(options, CHOICES) | stated(options, ("losses", "start", "window", "segment"))
    if options.microphones is not None:
        chosen["pair"] = tuple(options.microphones)
    record = read_pressure(options.record)
    rows, points, notes = every_method(record, options.frequency, **chosen)
    table, level = in_situ_table(rows), chosen.get("interval", LEVEL)
    points = points and with_choices(points, command=options.typed)
    as_rows = options.output is None or options.output.suffix.lower() == ".csv"
    if points is None and not (as_rows and options.figure is None):
        raise ValueError(
            f"{options.record} holds microphones alone: there is nothing along x to draw or to "
            "write; -o FILE.csv writes the rows"
        )
    show_results(
        options,
        lambda: format_in_situ(record, rows, level),
        lambda: {
            "title": record.title,
            "interval_level": level,
            "rows": table.as_rows(),
            "notes": [str(note) for note in notes],
        },
        output=table.write_csv if as_rows or points is None else points.write,
        figure=None if points is None else lambda path: draw_in_situ(record, points, path),
    )
    return 0

"""torchliner audit."""

from __future__ import annotations

import argparse
from dataclasses import replace

import torchliner as tl
from torchliner.cli import options as opt
from torchliner.cli.choices import ALL, READING, choices
from torchliner.cli.files import liner_names, planes_of, read_records, show_results
from torchliner.cli.messages import progress_bar

EXAMPLES = ("plane.h5 --figure audit.png",)
VARIED = ("phase", "reference_phase", "averaging", "no_intervals")  # by the audit, or not at all
CHOICES = choices(" ".join(name for name in ALL.split() if name not in VARIED))
OWN = [
    replace(opt.PLANES, text="the plane, and others of the same case: its other heights"),
    opt.Option("--frequency", "default: the tone of the file", opt.HZ),
    *opt.figure("draw the table there"),
    opt.averaging("phase-locked"),
]
OPTIONS = [*OWN, opt.OF_LINER, opt.ROWS, *opt.PRINTING, *CHOICES, *READING]


def run(options: argparse.Namespace) -> int:
    """Print the table, sorted by what moves Z most."""
    from torchliner.report.studies import audit_table, format_audit
    from torchliner.report.study_figures import draw_audit

    records = read_records(options.planes, options)
    planes = planes_of(records)
    liner = tl.load_liner(liner_names(options.liner, planes[:1], options.planes[:1])[0])
    chosen = opt.given(options, CHOICES) | {"averaging": options.averaging}
    total = 2 * sum(plane.samples for plane in planes) + planes[0].samples
    with progress_bar(total, options.planes[0].name, options) as step:
        found = tl.audit(records, liner, options.frequency, progress=step, **chosen)
    show_results(
        options,
        format_audit(found),
        found,
        output=audit_table(found, everything=True).write_csv,
        figure=lambda path: draw_audit(found, path),
    )
    return 0

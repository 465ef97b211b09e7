"""torchliner audit."""

from __future__ import annotations

import argparse

from torchliner.cli.choice_options import EDUCED, choice_options, chosen_from
from torchliner.cli.files import liner_names, planes_of, read_records, show_results
from torchliner.cli.options import averaging_option, progress_bar, shared
from torchliner.cli.plane_options import plane_options

VARIED = ("phase", "reference_phase", "averaging", "no_intervals")
# By the audit, or not at all.

CHOICES = [name for name in EDUCED if name not in VARIED]
OPTIONS = (
    {
        "": {
            "planes PLANE ...": "the plane, and others of the same case: its other heights",
            "--frequency HZ": "default: the tone of the file",
            "--figure PICTURE": "draw the table there",
        }
        | averaging_option("phase-locked")
        | shared("--liner", "--output", "--json", "--quiet")
    }
    | choice_options(CHOICES)
    | plane_options()
)


def run(options: argparse.Namespace) -> int:
    """Print the table, sorted by what moves Z most."""
    from torchliner.liners.catalogue import load_liner
    from torchliner.report.studies import audit_table, format_audit
    from torchliner.report.study_figures import draw_audit
    from torchliner.studies.audit import audit

    records = read_records(options.planes, options)
    planes = planes_of(records)
    liner = load_liner(liner_names(options.liner, planes[:1], options.planes[:1])[0])
    reading = sum(plane.samples for plane in planes)
    total = 2 * reading + planes[0].samples
    with progress_bar(total, options.planes[0].name, options) as step:
        found = audit(
            records,
            liner,
            options.frequency,
            averaging=options.averaging,
            progress=step,
            **chosen_from(options, CHOICES),
        )
    show_results(
        options,
        lambda: format_audit(found),
        lambda: found,
        output=audit_table(found, everything=True).write_csv,
        figure=lambda path: draw_audit(found, path),
    )
    return 0

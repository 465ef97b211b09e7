"""torchliner sensitivity."""

from __future__ import annotations

import argparse

import torchliner as tl
from torchliner import names
from torchliner.cli import options as opt
from torchliner.cli.choices import READING, choices
from torchliner.cli.files import only_liner, planes_of, read_records, show_results
from torchliner.cli.messages import progress_bar

EXAMPLES = ("plane.h5 --tolerance porosity='2 %' --tolerance cavity_depth='0.1 mm'",)
CHOICES = choices("drive mean missing allow_short")
OWN = [
    opt.ONE_PLANE,
    opt.Option("--parameters", "of the liner, e.g. porosity; default: all", opt.Kind("NAME"), nargs="+"),
    opt.Option(
        "--tolerance",
        'half-width with its unit, e.g. orifice_diameter="0.02 mm", porosity="2 %", temperature="1 K"; default: '
        "none, then the change of Z for 1 % of each parameter",
        opt.Kind("NAME=VALUE"),
        many=True,
    ),
    opt.Option("--limits", "half-widths are limits (u = half-width/sqrt 3), or u; default rectangular", names.LIMITS),
    *opt.figure("draw bars of the contributions at the first frequency"),
    opt.averaging("velocity"),
]
OPTIONS = [*OWN, opt.OF_LINER, opt.TONE, opt.ROWS, *opt.PRINTING, *CHOICES, *READING]


def run(options: argparse.Namespace) -> int:
    """Print the sensitivities, or the budget of the tolerances."""
    from torchliner.report.studies import budget_notes, budget_table, slope_table
    from torchliner.report.study_figures import draw_contributions
    from torchliner.studies.sensitivities import correlation_of

    tolerances = _tolerances(options)
    (plane,) = planes = read_records([options.plane], options)
    liner = only_liner(options.liner, planes, [options.plane])
    parameters, chosen = options.parameters or (list(tolerances) or None), opt.given(options, CHOICES)
    with progress_bar(2 * planes_of(planes)[0].samples, options.plane.name, options) as step:
        found = tl.sensitivities(plane, liner, options.frequency, parameters, progress=step, **chosen)
    frequency, averaging, limits = found.found.frequency.tolist(), options.averaging, options.limits or "rectangular"
    table, words, meaning, together = slope_table(found, averaging), list[str](), "p in the unit shown", None
    if tolerances:
        budget = found.propagate(tolerances, limits=limits)
        table, words = budget_table(budget, found, averaging), budget_notes(budget, found, averaging)
        meaning, together = f"tolerances are {limits}", [correlation_of(each) for each in budget.covariance[averaging]]
    words.append(f"Z by rho c, averaging: {averaging}; {meaning}; first order")
    plain = {
        "averaging": averaging,
        "limits": limits if tolerances else None,
        "frequency": frequency,
        "impedance": found.found.liner[averaging].impedance.tolist(),
        "correlation_of_R_and_X": together,
        "rows": table.as_rows(),
        "notes": [str(note) for note in found.found.notes],
    }
    first = [row for row in table.as_rows() if row["frequency"] == frequency[0]]
    title = f"{found.found.title}, {frequency[0]:g} Hz, {averaging}; {meaning}"
    show_results(
        options,
        "\n".join([table.as_text(), *words]),
        plain,
        output=table.write_csv,
        figure=lambda path: draw_contributions(first, title, path),
    )
    return 0


def _tolerances(options: argparse.Namespace) -> dict[str, str]:
    """Half-widths as written, by parameter."""
    found: dict[str, str] = {}
    for text in options.tolerance:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or name in found:
            raise ValueError(f"--tolerance {text!r} cannot be read; write NAME=VALUE, once a parameter")
        found[name] = value
    if options.limits and not found:
        raise ValueError("--limits is one of tolerances; state them with --tolerance")
    return found

"""torchliner sensitivity."""

from __future__ import annotations

import argparse

from torchliner import names
from torchliner.cli.choice_options import NO_GIVEN_PHASE, choice_options, chosen_from
from torchliner.cli.files import only_liner, planes_of, read_records, show_results
from torchliner.cli.options import averaging_option, progress_bar, shared, split_pair
from torchliner.cli.plane_options import plane_options

CHOICES = ("phase", "drive", "mean", "missing", "allow_short")

OPTIONS = (
    {
        "": {
            "--parameters NAME ...": "of the liner, e.g. porosity; default: all",
            "--tolerance NAME=VALUE": {
                "action": "append",
                "default": [],
                "help": "half-width with its unit, e.g. "
                'orifice_diameter="0.02 mm", porosity="2 %%", temperature="1 K"; default: none, then '
                "the change of Z for 1 %% of each parameter",
            },
            "--limits": {
                "choices": names.LIMITS,
                "help": "what a half-width is: "
                "limits of equally likely values (u = half-width/sqrt 3), or the standard uncertainty; "
                "default rectangular",
            },
            "--correlation NAME,NAME=VALUE": {
                "action": "append",
                "default": [],
                "help": "of two parameters, -1 to 1; default 0",
            },
            "--figure PICTURE": "draw bars of the contributions at the first frequency",
        }
        | averaging_option("velocity")
        | shared("plane", "--liner", "--frequency", "--output", "--json", "--quiet"),
    }
    | choice_options(CHOICES, NO_GIVEN_PHASE)
    | plane_options()
)


def run(options: argparse.Namespace) -> int:
    """Print the sensitivities, or the budget of the tolerances."""
    from torchliner.report.studies import budget_notes, budget_table, slope_table
    from torchliner.report.study_figures import draw_contributions
    from torchliner.studies.sensitivities import correlation_of, sensitivities

    tolerances, correlation = _tolerances(options)
    (plane,) = planes = read_records([options.plane], options)
    liner = only_liner(options.liner, planes, [options.plane])
    parameters = options.parameters or (list(tolerances) or None)
    with progress_bar(2 * planes_of(planes)[0].samples, options.plane.name, options) as step:
        choices = chosen_from(options, CHOICES)
        found = sensitivities(plane, liner, options.frequency, parameters, progress=step, **choices)
    frequency, averaging, limits = found.found.frequency.tolist(), options.averaging, options.limits or "rectangular"
    table, words, meaning, together = slope_table(found, averaging), list[str](), "p in the unit shown", None
    if tolerances:
        budget = found.propagate(tolerances, limits=limits, correlation=correlation)
        table, words = budget_table(budget, found, averaging), budget_notes(budget, found, averaging)
        meaning, together = f"tolerances are {limits}", [correlation_of(each) for each in budget.covariance[averaging]]
    words.append(
        f"Z by rho c, averaging: {averaging}; {meaning}; first order, interpolation error of a derivative up to "
        f"{float(found.level_error.max()):.1e} of it"
    )
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
        lambda: "\n".join([table.as_text(), *words]),
        lambda: plain,
        output=table.write_csv,
        figure=lambda path: draw_contributions(first, title, path),
    )
    return 0


def _tolerances(options: argparse.Namespace) -> tuple[dict[str, str], dict[tuple[str, str], float]]:
    """Half-widths as written by parameter, and correlations by pair of parameters."""
    pairs = [split_pair(text, "--tolerance") for text in options.tolerance]
    if len(dict(pairs)) < len(pairs):
        raise ValueError("--tolerance names a parameter twice; give each once")
    for name in ("correlation", "limits"):
        if getattr(options, name) and not pairs:
            raise ValueError(f"--{name} is one of tolerances; state them with --tolerance")
    found: dict[tuple[str, str], float] = {}
    for text in options.correlation:
        pair, value = split_pair(text, "--correlation")
        first, comma, second = pair.partition(",")
        if not comma:
            raise ValueError(f"--correlation {text!r} cannot be read; write NAME,NAME=VALUE")
        both = first.strip(), second.strip()
        if both in found or both[::-1] in found:
            raise ValueError(f"--correlation names {' and '.join(both)} twice; give each pair once")
        try:
            found[both] = float(value)
        except ValueError:
            raise ValueError(f"--correlation {text!r} cannot be read; write NAME,NAME=VALUE, as a,b=0.5") from None
    return dict(pairs), found

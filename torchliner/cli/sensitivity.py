"""torchliner sensitivity."""

from __future__ import annotations

import argparse
from itertools import chain
from pathlib import Path
from typing import Any

from torchliner.cli.choice_options import (
    NO_GIVEN_PHASE,
    add_choice_options,
    add_order_option,
    chosen_from,
)
from torchliner.cli.options import (
    add_output_options,
    frequencies,
    liner_name,
    print_json,
    progress_bar,
    refuse_inputs,
    require_ending,
    split_pair,
    warnings_on_stderr,
)

CHOICES = ("phase", "drive", "mean", "edge", "kernel", "missing", "allow_short", "memory")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options."""
    parser.add_argument("plane", type=Path, help="plane file")
    parser.add_argument("--liner", help="preset name or .toml; default: named in the file")
    parser.add_argument("--frequency", nargs="+", type=frequencies, metavar="HZ")
    parser.add_argument("--parameters", nargs="+", metavar="NAME", help="default: all")
    parser.add_argument(
        "--tolerance", action="append", default=[], metavar="NAME=VALUE",
        help='half-width with its unit, e.g. orifice_diameter="0.02 mm", porosity="2 %%", '
        'temperature="1 K"; without any: the change of Z for 1 %% of each parameter',
    )  # fmt: skip
    parser.add_argument(
        "--limits", choices=["rectangular", "standard"], default="rectangular",
        help="what a half-width is: limits of equally likely values (u = half-width/sqrt 3, "
        "default), or the standard uncertainty",
    )  # fmt: skip
    parser.add_argument(
        "--correlation", action="append", default=[], metavar="NAME,NAME=VALUE",
        help="of two parameters, -1 to 1",
    )  # fmt: skip
    add_order_option(parser, "velocity first")
    add_choice_options(parser, CHOICES, phase=NO_GIVEN_PHASE)
    parser.add_argument("-o", "--output", type=Path, help="the rows as CSV")
    parser.add_argument("--figure", type=Path, help="bars of the contributions, first frequency")
    add_output_options(parser)


def run(options: argparse.Namespace) -> int:
    """Print the sensitivities, or the budget of the tolerances."""
    from torchliner.calibration.sensitivities import sensitivities
    from torchliner.io.plane_file import read_plane
    from torchliner.liners.catalogue import load_liner
    from torchliner.report.sensitivity_report import (
        budget_correlation,
        budget_table,
        draw_contributions,
        format_budget,
        nominal_impedance,
        sensitivity_table,
    )

    refuse_inputs([options.output], [options.plane, options.liner], options.figure)
    require_ending(options.output, [".csv"], "--output")
    pairs = [split_pair(text, "--tolerance") for text in options.tolerance]
    tolerances = dict(pairs)
    if len(tolerances) < len(pairs):
        raise ValueError("--tolerance names a parameter twice; give each once")
    if options.correlation and not tolerances:
        raise ValueError("--correlation is one of tolerances; state them with --tolerance")
    correlation = _correlation(options.correlation)
    wanted = None if options.frequency is None else list(chain(*options.frequency))
    with warnings_on_stderr(options.quiet):
        plane = read_plane(options.plane, lazy=True)
        liner: Any = load_liner(options.liner or liner_name(plane, options.plane))
        names = options.parameters or (list(tolerances) or None)
        with progress_bar(2 * plane.samples, options.plane.name, options.quiet) as step:
            found = sensitivities(
                plane, liner, wanted, names, progress=step, **chosen_from(options)
            )
    frequency, order = found.found.frequency.tolist(), options.order
    if tolerances:
        budget = found.propagate(tolerances, limits=options.limits, correlation=correlation)
        table = budget_table(budget, frequency, order)
        text = format_budget(budget, found, order, table)
        meaning = f"tolerances are {options.limits}"
    else:
        table = sensitivity_table(found, order)
        text, meaning = table.as_text(), "p in the unit shown"
    rows = table.as_rows()
    if options.output is not None:
        table.write_csv(options.output)
    if options.figure is not None:
        first = [row for row in rows if row["frequency"] == frequency[0]]
        title = f"{found.found.title}, {frequency[0]:g} Hz, {order}"
        title += f"; {meaning}" if tolerances else ""
        draw_contributions(first, title, options.figure)
    if options.json:
        together = [budget_correlation(budget, order, i) for i in range(len(frequency))] if (
            tolerances
        ) else None  # fmt: skip
        print_json({"order": order, "limits": options.limits if tolerances else None,
                    "frequency": frequency, "impedance": nominal_impedance(found, order),
                    "correlation_of_R_and_X": together, "rows": rows,
                    "notes": list(found.found.notes)})  # fmt: skip
        return 0
    print(text)
    print(f"Z by rho c, averaging: {order}; {meaning}; first order, interpolation error of a "
          f"derivative up to {float(found.level_error.max()):.1e} of it")  # fmt: skip
    return 0


def _correlation(texts: list[str]) -> dict[tuple[str, str], float]:
    found = {}
    for text in texts:
        names, value = split_pair(text, "--correlation")
        first, comma, second = names.partition(",")
        if not comma:
            raise ValueError(f"--correlation {text!r} cannot be read; write NAME,NAME=VALUE")
        found[first.strip(), second.strip()] = float(value)
    return found

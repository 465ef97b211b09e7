"""torchliner identify."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from torchliner.cli.calibrate import bounds_given, predicted_rows, references_given, source_of
from torchliner.cli.choice_options import choice_options, chosen_from
from torchliner.cli.files import only_liner, read_records, show_results, write_text
from torchliner.cli.options import averaging_option, complex_number, shared, spelled, stated
from torchliner.cli.plane_options import plane_options

CHOICES = ("drive", "mean", "missing", "allow_short")

OPTIONS = (
    {
        "": {
            "planes PLANE ...": "plane files, or moments, of several runs; planes of one case are one run",
            "--reference Z ...": {
                "help": "name of an impedance in the files, 'in-situ' (Dean's method, see --pressure), "
                "'level-check' (the stated level alone), or one value each; default true"
            },
            "--pressure PATH ...": "pressure records of the runs, for --reference in-situ or level-check, "
            "one a plane in their order; default: what the planes hold",
            "--fit MODEL": "'curve', fitted beside what is free; default where nothing is free",
            "--free NAMES": {
                "action": "append",
                "default": [],
                "help": "a model: parameters of the liner's law, with commas between, each with its "
                "bounds (NAME=LOW:HIGH, SI) or usual ones; several times to compare; default: none",
            },
            "--noise U": "standard uncertainty of R and X of the references, of levels dB; default 2 %% of |Z|, 0.2 dB",
            "--rest U+Uj": "standard uncertainty of R and X of the liner at rest, e.g. 0.01+0.01j; default: not known",
            "--freedom FACTOR": "standard deviation of the logarithm of the ratio of the curve to the "
            "prior shape over |v|; default the best of 0.1, 0.3, 1, 3",
            "--predict PLANE ...": {"default": [], "help": "to predict; default: none"},
            "--reach M/S": "last |v| of the table that is written; default 1.25 times what runs saw",
            "--output FILE": "write the liner as .csv (a table) or .toml",
            "--figure PICTURE": "draw curve and speeds there",
        }
        | averaging_option("phase-locked")
        | shared("--liner", "--frequency", "--json", "--quiet"),
    }
    | choice_options(CHOICES)
    | plane_options()
)


def run(options: argparse.Namespace) -> int:
    """Print what was found and what it predicts; 1 if a parameter is on a bound or unseen, or a
    prediction leaves the speeds of the runs."""
    from torchliner.io.pressure_file import read_pressure
    from torchliner.report import studies as report
    from torchliner.report.study_figures import draw_identification
    from torchliner.studies.fit import OUTSIDE, with_flow
    from torchliner.studies.identify import identify

    if options.reach is not None and options.output is None:
        raise ValueError("--reach is of the table that is written; name --output as well")
    given = stated(options, ("rest", "freedom", "reach"))
    if given and options.free and options.fit is None:
        raise ValueError(f"{spelled(given)}: of a curve; fit one too, with --fit curve, or leave this out")
    paths = [*options.planes, *options.predict]
    both = read_records(paths, options)
    liner = only_liner(options.liner, both, paths)
    models: list[Any] = [bounds_given(text.split(","), with_flow(liner)) for text in options.free]
    found = identify(
        both[: len(options.planes)],
        liner,
        references_given(options.reference or ["true"]),
        models=[*models, *([options.fit or "curve"] if options.fit or not models else [])],
        averaging=options.averaging,
        pressure=[read_pressure(path) for path in options.pressure or ()] or None,
        noise=options.noise,
        freedom=options.freedom,
        frequency=options.frequency,
        rest=None if options.rest is None else complex_number(options.rest, "--rest"),
        **chosen_from(options, CHOICES),
    )
    fit = found.fit
    rows = predicted_rows(fit, both[len(options.planes) :], liner, options, noise=0.0)
    table = f"\n\n{report.prediction_table(rows).as_text()}" if rows else ""
    plain = {
        **report.plain_fit(fit),
        "models": report.candidate_table(found).as_rows(),
        "curve": report.curve_table(fit).as_rows(),
        "seen": report.seen_table(fit).as_rows(),
        "left_out": {each.label: each.rows for each in found.candidates},
        "predictions": rows,
        "notes": found.notes,
    }
    show_results(
        options,
        lambda: report.format_identification(found) + table,
        lambda: plain,
        output=lambda path: _write(fit, path, options),
        figure=lambda path: draw_identification(found, path),
    )
    doubtful = fit.on_bound or fit.unseen or any(row.outside > OUTSIDE for row in rows)
    return int(bool(doubtful))


def _write(fit: Any, path: Path, options: argparse.Namespace) -> None:
    """A table as .csv, or a .toml that names one beside it; a law as .toml."""
    from torchliner.io.csv_rows import write_rows
    from torchliner.liners.catalogue import liner_text

    if not fit.law.frequencies:
        if path.suffix.lower() == ".csv":
            raise ValueError(
                f"{path}: {fit.law.label} were found, a law at every frequency and not a table; write it as .toml"
            )
        liner = fit.liner.replace(name=f"{fit.runs[0].liner.name} identified")
        write_text(liner_text(liner, f"identified by torchliner: {source_of(fit, options)}"), path)
        return
    table = fit.table(options.reach or 0.0)
    rows = [
        {"frequency": f, "speed": v, "resistance": z.real, "reactance": z.imag}
        for f, row in zip(table.frequency.tolist(), table.values.tolist(), strict=True)
        for v, z in zip(table.speed.tolist(), row, strict=True)
    ]
    write_rows(rows, path.with_suffix(".csv"), ".9g")
    if path.suffix.lower() != ".csv":
        lines = [f'model = "table"\nname = "{table.name}"\nfile = "{path.stem}.csv"']
        lines += [] if table.cell_pitch is None else [f"cell_pitch = {table.cell_pitch!r}"]
        write_text("\n".join(lines) + "\n", path)

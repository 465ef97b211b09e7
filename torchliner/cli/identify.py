"""torchliner identify."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import torchliner as tl
from torchliner.cli import options as opt
from torchliner.cli.calibrate import PREDICT, REFERENCE, bounds_given, predicted_rows, references_given, write_law
from torchliner.cli.choices import READING, choices
from torchliner.cli.files import only_liner, read_records, show_results, write_text
from torchliner.cli.signatures import of

EXAMPLES = (
    "low.h5 mid.h5 high.h5 --rest 0.01+0.01j -o mine.toml --figure curve.png",
    "low.h5 high.h5 --free vena_contracta --free vena_contracta,mass_loss -o law.toml",
)
CHOICES = choices("drive mean missing allow_short")
CURVE = of("studies.identify:identify", "rest freedom", rest={"kind": opt.COMPLEX})
REACH = opt.Option("--reach", "last |v| of the table that is written; default 1.25 times what runs saw", opt.MPS)
OWN = [
    replace(opt.PLANES, text="plane files, or moments, of several runs; planes of one case are one run"),
    REFERENCE,
    opt.Option("--pressure", "records for --reference in-situ or level-check, one a plane", opt.PATH, nargs="+"),
    opt.Option("--fit", "curve: a free curve over |v|, too; done by itself where nothing is free", opt.Kind("MODEL")),
    opt.Option(
        "--free",
        "a model: parameters of the liner's law, with commas between, each with its bounds (NAME=LOW:HIGH, SI) or "
        "usual ones; several times to compare; default: none",
        opt.Kind("NAMES"),
        many=True,
    ),
    opt.Option(
        "--noise",
        "standard uncertainty of R and X of the references, of levels dB; default 2 % of |Z|, 0.2 dB",
        opt.NUMBER,
    ),
    *CURVE,
    PREDICT,
    REACH,
    opt.output("write the liner, a table as .csv,", ".csv", ".toml"),
    *opt.figure("draw curve and speeds there"),
    opt.averaging("phase-locked"),
]
OPTIONS = [*OWN, opt.OF_LINER, opt.TONE, *opt.PRINTING, *CHOICES, *READING]


def run(options: argparse.Namespace) -> int:
    """Print what was found and what it predicts; 1 if a parameter is on a bound or unseen, or a
    prediction leaves the speeds of the runs."""
    from torchliner.report import studies as report
    from torchliner.report.study_figures import draw_identification
    from torchliner.studies.fit import OUTSIDE, with_flow

    if options.reach is not None and options.output is None:
        raise ValueError("--reach is of the table that is written; name --output as well")
    curve = opt.given(options, CURVE)
    if (of_curve := curve | opt.given(options, [REACH])) and options.free and options.fit is None:
        raise ValueError(f"{opt.spelled(of_curve)}: of a curve; fit one too, with --fit curve, or leave this out")
    paths = [*options.planes, *options.predict]
    both = read_records(paths, options)
    liner = only_liner(options.liner, both, paths)
    models: list[Any] = [bounds_given(text.split(","), with_flow(liner)) for text in options.free]
    found = tl.identify(
        both[: len(options.planes)],
        liner,
        references_given(options.reference),
        models=[*models, *([options.fit or "curve"] if options.fit or not models else [])],
        averaging=options.averaging,
        pressure=[tl.read_pressure(path) for path in options.pressure or ()] or None,
        noise=options.noise,
        frequency=options.frequency,
        **curve,
        **opt.given(options, CHOICES),
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
        report.format_identification(found) + table,
        plain,
        output=lambda path: _write(fit, path, options),
        figure=lambda path: draw_identification(found, path),
    )
    return int(bool(fit.on_bound or fit.unseen or any(row.outside > OUTSIDE for row in rows)))


def _write(fit: Any, path: Path, options: argparse.Namespace) -> None:
    """A table as .csv, or a .toml that names one beside it; a law as .toml."""
    from torchliner.io.csv_rows import write_rows

    if not fit.law.frequencies:
        if path.suffix.lower() == ".csv":
            raise ValueError(
                f"{path}: {fit.law.label} were found, a law at every frequency and not a table; write it as .toml"
            )
        write_law(fit, f"{fit.runs[0].liner.name} identified", "identified", options)
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

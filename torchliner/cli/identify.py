"""torchliner identify."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from torchliner import names
from torchliner.cli.calibrate import bounds_given, references_given
from torchliner.cli.choice_options import choice_options, chosen_from
from torchliner.cli.files import only_liner, read_records, show_results, write_text
from torchliner.cli.options import averaging_option, complex_number, shared, spelled, stated
from torchliner.cli.plane_options import plane_options

CHOICES = ("drive", "mean", "missing", "allow_short")

OPTIONS = {
    "": {
        "planes PLANE ...": "plane files, or moments, of several runs; planes of one case are one "
                            "run",
        "--reference Z ...": {
            "help": "name of an impedance in the files, 'in-situ' (Dean's method, see --pressure), "
            "'level-check' (the stated level alone), or one value each; default true"},
        "--pressure PATH ...": "pressure records of the runs, for --reference in-situ or level-check, "
                               "by case, or in the order of the planes where files state none; "
                               "default: what the planes hold",
        "--fit MODEL": "'curve', fitted beside what is free; default where nothing is free",
        "--free NAMES": {
            "action": "append", "default": [],
            "help": "a model: parameters of the liner's law, with commas between, each with its "
            "bounds (NAME=LOW:HIGH, SI) or usual ones; several times to compare; default: none"},
        "--noise U": "standard uncertainty of R and X of the references, of levels dB; default "
                     "2 %% of |Z|, 0.2 dB",
        "--rest U+Uj": "standard uncertainty of R and X of the liner at rest, e.g. 0.01+0.01j; "
                       "default: not known",
        "--freedom FACTOR": "standard deviation of the logarithm of the ratio of the curve to the "
                            "prior shape over |v|; default the best of 0.1, 0.3, 1, 3",
        "--prior": (names.CURVE_SHAPES, "shape where nothing is known: the liner's own law, or in "
                    "proportion to |v|; default law"),
        "--reactance": (names.REACTANCES, "direction over |v|; default falling, as where mass is "
                        "lost"),
        "--predict PLANE ...": {"default": [], "help": "to predict; default: none"},
        "--reach M/S": "last |v| of the table that is written; default 1.25 times what runs saw",
        "--output FILE": "write the liner as .csv (a table) or .toml",
        "--figure PICTURE": "draw curve and speeds there",
    }
    | averaging_option("phase-locked")
    | shared("--liner", "--frequency", "--json", "--quiet"),
} | choice_options(CHOICES) | plane_options()  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Print what was found and what it predicts; 1 if a parameter is on a bound or unseen, or a
    prediction leaves the speeds of the runs."""
    from torchliner.io.pressure_file import read_pressure
    from torchliner.report import identification_report as report
    from torchliner.studies.identify import identify

    if options.reach is not None and options.output is None:
        raise ValueError("--reach is of the table that is written; name --output as well")
    given = stated(options, ("rest", "freedom", "prior", "reactance", "reach"))
    if given and options.free and options.fit is None:
        raise ValueError(f"{spelled(given)}: of a curve; fit one too, with --fit curve, or leave this out")
    paths = [*options.planes, *options.predict]
    both = read_records(paths, options)
    liner = only_liner(options.liner, both, paths)
    references = references_given(options.reference or ["true"])
    models: list[Any] = [_bounds(text, liner) for text in options.free]
    found = identify(
        both[: len(options.planes)], liner, references,
        models=[*models, *([options.fit or "curve"] if options.fit or not models else [])],
        averaging=options.averaging,
        pressure=[read_pressure(path) for path in options.pressure or ()] or None,
        noise=options.noise, freedom=options.freedom, prior=options.prior or "law",
        rest=None if options.rest is None else complex_number(options.rest, "--rest"),
        reactance=options.reactance or "falling", frequency=options.frequency,
        **chosen_from(options, CHOICES),
    )  # fmt: skip
    predicted = [found.predict(plane, liner) for plane in both[len(options.planes) :]]
    rows = [
        {
            "label": path.stem, "frequency": f, "impedance": complex(each.impedance[i]),
            "standard": complex(each.standard[i]), "outside": float(each.outside[i]),
        }
        for path, each in zip(options.predict, predicted, strict=True)
        for i, f in enumerate(each.frequency.tolist())
    ]  # fmt: skip
    table = f"\n\n{report.predicted_table(rows).as_text()}" if rows else ""
    show_results(
        options,
        lambda: report.format_identification(found) + table,
        lambda: {**report.plain_identification(found), "predictions": rows},
        output=lambda path: _write(found, path, options),
        figure=lambda path: report.draw_identification(found, path),
    )
    return 1 if found.doubtful or any(each.notes for each in predicted) else 0


def _bounds(text: str, liner: Any) -> dict[str, tuple[float, float]]:
    """NAME, NAME=LOW:HIGH and commas."""
    from torchliner.studies.identification import with_flow
    from torchliner.studies.identify import bounds_for

    with_factors = with_flow(liner)
    found: dict[str, tuple[float, float]] = {}
    for part in (each.strip() for each in text.split(",")):
        stated = bounds_given([part], with_factors) if "=" in part else {}
        for name, pair in (stated or bounds_for([part], with_factors)).items():
            if name in found:
                raise ValueError(f"--free {text} names {name} twice")
            found[name] = pair
    return found


def _write(found: Any, path: Path, options: argparse.Namespace) -> None:
    """A table as .csv, or a .toml that names one beside it; a law as .toml."""
    from torchliner.liners.catalogue import liner_text
    from torchliner.report.identification_report import write_table

    if found.best.fitted.is_curve:
        write_table(found, path.with_suffix(".csv"), options.reach)
        if path.suffix.lower() == ".csv":
            return
        liner = found.table(options.reach)
        lines = [f'model = "table"\nname = "{liner.name}"\nfile = "{path.stem}.csv"']
        if liner.cell_pitch is not None:
            lines.append(f"cell_pitch = {liner.cell_pitch!r}")
        write_text("\n".join(lines) + "\n", path)
        return
    if path.suffix.lower() == ".csv":
        raise ValueError(
            f"{path}: {found.best.label} were found, a law at every frequency and not a table; write it as .toml"
        )
    fitted = found.best.fitted
    both = zip(fitted.values.items(), fitted.standard.values(), strict=True)
    source = "identified by torchliner: " + ", ".join(
        f"{name} = {value:.6g} +- {spread:.2g}" for (name, value), spread in both
    )
    source += f"; fitted to {', '.join(each.name for each in options.planes)}, {found.averaging}"
    write_text(liner_text(found.liner, source), path)

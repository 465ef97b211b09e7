"""torchliner calibrate."""

from __future__ import annotations

import argparse
from typing import Any

from torchliner.cli.choice_options import choice_options, chosen_from
from torchliner.cli.files import (
    only_liner,
    read_records,
    seen_from_anywhere,
    show_results,
    write_text,
)
from torchliner.cli.options import CLUSTER, averaging_option, shared
from torchliner.cli.plane_options import plane_options

CHOICES = ("drive", "mean", "missing", "allow_short")
FEWEST_DRAWS = 100

OPTIONS = (
    {
        "": {
            "planes PLANE ...": "plane files to fit",
            "--free NAME[=LOW:HIGH]": {
                "action": "append",
                "required": True,
                "help": "parameter to fit and its bounds, SI; "
                "default usual ones, else 50 %% about its value, of an offset 0.5 about it; 'offset' is both parts",
            },
            "--reference Z ...": {
                "help": "name of an impedance in the files, 'in-situ' (what the files hold of Dean's method), "
                "'level-check' (the stated level alone), or one value each, e.g. 0.168-0.066j; default true"
            },
            "--noise U": "standard uncertainty of R and X of the references, by rho c, of levels dB; "
            "default: from the residual",
            "--predict PLANE ...": {"default": [], "help": "to predict with the spread of the fit; default: none"},
            "--draws N": {"default": 2000, "help": "of the posterior, 0 for none; default 2000"},
            "--seed N": {"default": 0, "help": "of the draws; default 0"},
            "--output FILE": "write the calibrated liner as .toml",
            "--figure PICTURE": "draw the predictions there",
        }
        | averaging_option("velocity")
        | CLUSTER
        | shared("--liner", "--json", "--quiet"),
    }
    | choice_options(CHOICES)
    | plane_options()
)


def run(options: argparse.Namespace) -> int:
    """Print the fit and what it predicts; 1 if a parameter is on a bound or unseen."""
    from torchliner.report import studies as report
    from torchliner.report.study_figures import draw_predictions
    from torchliner.studies.calibrate import calibrate
    from torchliner.studies.runs import LEVEL_CHECK

    paths = [*options.planes, *options.predict]
    if options.draws and options.draws < FEWEST_DRAWS:
        raise ValueError(f"--draws is {options.draws}; the posterior needs at least {FEWEST_DRAWS}, or 0 for none")
    if options.figure is not None and not options.predict:
        raise ValueError("--figure draws predictions; name planes with --predict")
    both = read_records(seen_from_anywhere(options, paths), options)
    liner = only_liner(options.liner, both, paths)
    if options.cluster is not None:
        both = _reduced(both, liner, options)
    references = references_given(options.reference or ["true"])
    found = calibrate(
        both[: len(options.planes)],
        liner,
        references,
        bounds_given(options.free, liner),
        averaging=options.averaging,
        noise=options.noise,
        draws=options.draws,
        seed=options.seed,
        **chosen_from(options, CHOICES),
    )
    rows = predicted_rows(
        found, both[len(options.planes) :], liner, options, noise=0.0 if references == LEVEL_CHECK else options.noise
    )
    table = f"\n\n{report.prediction_table(rows).as_text()}" if rows else ""
    show_results(
        options,
        lambda: report.format_calibration(found) + table,
        lambda: {**report.plain_fit(found), "predictions": rows},
        output=lambda _: _write(found, liner, options),
        figure=lambda path: draw_predictions({f"averaging: {options.averaging}": rows}, "", path),
    )
    return 1 if found.on_bound or found.unseen else 0


def predicted_rows(found: Any, records: list[Any], liner: Any, options: argparse.Namespace, noise: Any) -> list[Any]:
    """Rows of the planes of --predict, labelled by their files."""
    from torchliner.studies.rows import Row

    name = (options.reference or ["true"])[0]
    return [
        Row(row, label=path.stem)
        for path, record in zip(options.predict, records, strict=True)
        for row in found.predict(record, liner, reference=name, noise=complex(noise or 0.0, noise or 0.0))
    ]


def _reduced(records: list[Any], liner: Any, options: argparse.Namespace) -> list[Any]:
    """The moments of all planes, summed by workers."""
    from torchliner.campaign.cluster import open_cluster
    from torchliner.engine.moments import Moments
    from torchliner.velocity.educe import moments

    choices = {"averaging": options.averaging} | chosen_from(options, CHOICES)
    with open_cluster(options.cluster, options.wait) as client:
        return [
            each if isinstance(each, Moments) else moments(each, cell_pitch=liner.cell_pitch, client=client, **choices)
            for each in records
        ]


def references_given(texts: list[str]) -> Any:
    """One name, or a value each."""
    try:
        return [complex(text) for text in texts]
    except ValueError:
        if len(texts) > 1:
            raise ValueError(
                f"--reference {' '.join(texts)} cannot be read; one name, or numbers such as 0.168-0.066j"
            ) from None
    return texts[0]


def bounds_given(texts: list[str], liner: Any) -> dict[str, tuple[float, float]]:
    """From NAME=LOW:HIGH, or names alone, which have usual bounds."""
    from torchliner.studies.laws import bounds_for

    found: dict[str, tuple[float, float]] = {}
    for text in texts:
        name, equals, rest = text.partition("=")
        pairs = bounds_for([name.strip()], liner)
        if equals:
            try:
                low, high = (float(part) for part in rest.split(":"))
            except ValueError:
                raise ValueError(f"--free {text!r} cannot be read; write NAME=LOW:HIGH in SI units") from None
            pairs = dict.fromkeys(pairs, (low, high))
        if twice := [each for each in pairs if each in found]:
            raise ValueError(f"--free names {twice[0]} twice")
        found |= pairs
    return found


def source_of(found: Any, options: argparse.Namespace) -> str:
    """What a file says of its liner."""
    spread = zip(found.numbers.items(), found.standard.tolist(), strict=True)
    return (
        f"{', '.join(f'{name} = {value:.6g} +- {u:.2g}' for (name, value), u in spread)}; fitted to "
        f"{', '.join(path.name for path in options.planes)} (reference {' '.join(options.reference or ['true'])}), "
        f"{options.averaging}" + (f"; on a bound: {', '.join(found.on_bound)}" if found.on_bound else "")
    )


def _write(found: Any, before: Any, options: argparse.Namespace) -> None:
    from torchliner.liners.catalogue import liner_text

    liner = found.liner.replace(name=f"{before.name} calibrated")
    write_text(
        liner_text(liner, f"{before.name} calibrated by torchliner: {source_of(found, options)}"), options.output
    )

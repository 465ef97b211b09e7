"""torchliner calibrate."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import torchliner as tl
from torchliner.cli import options as opt
from torchliner.cli.choices import READING, choices
from torchliner.cli.files import only_liner, read_records, seen_from_anywhere, show_results, write_text

EXAMPLES = (
    "noflow_*.h5 -o mine.toml",
    "quiet.h5 loud.h5 --free vena_contracta=0.4:1 --noise 0.002 -o mine.toml",
    "low.h5 high.h5 --reference level-check --free vena_contracta=0.4:1",
)
CHOICES = choices("drive mean missing allow_short")
FEWEST_DRAWS = 100
REFERENCE = opt.Option(
    "--reference",
    "name of an impedance in the files, 'in-situ' (Dean's method), 'level-check' (the stated level alone), or one "
    "value each, e.g. 0.168-0.066j; default true",
    opt.Kind("Z"),
    nargs="+",
    default=["true"],
)
PREDICT = opt.Option("--predict", "planes to predict; default: none", opt.PLANE, nargs="+", default=[])
OWN = [
    replace(opt.PLANES, text="plane files to fit"),
    opt.Option(
        "--free",
        "parameter to fit and its bounds, SI; default usual ones, else 50 % about its value, of an offset 0.5 about "
        "it; 'offset' is both parts. Default, for runs without flow: contraction coefficient, with two levels or more "
        "the offset, and the law of lost mass that predicts them best",
        opt.Kind("NAME[=LOW:HIGH]"),
        many=True,
    ),
    REFERENCE,
    opt.Option("--noise", "standard uncertainty of R and X of the references, of levels dB", opt.NUMBER),
    PREDICT,
    opt.Option("--draws", "of the posterior, 0 for none; default 2000", opt.INDEX, default=2000),
    opt.Option("--seed", "of the draws; default 0", opt.INDEX, default=0),
    opt.output("write the calibrated liner", ".toml"),
    *opt.figure("draw the predictions there"),
    opt.averaging(None, text="default velocity, without --free phase-locked"),
]
OPTIONS = [*OWN, *opt.CLUSTER, opt.OF_LINER, *opt.PRINTING, *CHOICES, *READING]


def run(options: argparse.Namespace) -> int:
    """Print the fit and what it predicts; 1 if a parameter is on a bound or unseen."""
    from torchliner.report import studies as report
    from torchliner.report.study_figures import draw_predictions
    from torchliner.studies.runs import LEVEL_CHECK
    from torchliner.studies.without_flow import AVERAGING, calibrate_without_flow

    paths = [*options.planes, *options.predict]
    if options.draws and options.draws < FEWEST_DRAWS:
        raise ValueError(f"--draws is {options.draws}; the posterior needs at least {FEWEST_DRAWS}, or 0 for none")
    if options.figure is not None and not options.predict:
        raise ValueError("--figure draws predictions; name planes with --predict")
    both = read_records(seen_from_anywhere(options, paths), options)
    liner = only_liner(options.liner, both, paths)
    options.averaging = options.averaging or ("velocity" if options.free else AVERAGING)
    chosen = {"averaging": options.averaging} | opt.given(options, CHOICES)
    if options.cluster is not None:
        both = _reduced(both, liner, options, chosen)
    references = references_given(options.reference)
    known, free = both[: len(options.planes)], bounds_given(options.free, liner)
    about = {"noise": options.noise, "draws": options.draws, "seed": options.seed}
    words, how = "", f"{liner.name} calibrated"
    if free:
        found = tl.calibrate(known, liner, references, free, **about, **chosen)
    else:
        found, scores = calibrate_without_flow(known, liner, references, **about, **chosen)
        low, high = found.seen_speeds
        how += f" without flow at |v| of {low:.3g} to {high:.3g} m/s"
        words = (
            f"law: {type(found.liner).__name__}; error of reactances left out: "
            + ", ".join(f"{name} {score:.3f}" for name, score in scores.items())
            + f"; fitted at |v| of {low:.3g} to {high:.3g} m/s\n\n"
        )
    noise = 0.0 if references == LEVEL_CHECK else options.noise
    of_law = liner if free else found.runs[0].liner
    rows = predicted_rows(found, both[len(options.planes) :], of_law, options, noise=noise)
    table = f"\n\n{report.prediction_table(rows).as_text()}" if rows else ""
    show_results(
        options,
        words + report.format_calibration(found) + table,
        {**report.plain_fit(found), "predictions": rows},
        output=lambda _: write_law(found, f"{liner.name} calibrated", how, options),
        figure=lambda path: draw_predictions({f"averaging: {options.averaging}": rows}, "", path),
    )
    return 1 if found.on_bound or found.unseen else 0


def predicted_rows(found: Any, records: list[Any], liner: Any, options: argparse.Namespace, noise: Any) -> list[Any]:
    """Rows of the planes of --predict, labelled by their files."""
    from torchliner.studies.rows import Row

    about = {"reference": options.reference[0], "noise": complex(noise or 0.0, noise or 0.0)}
    return [
        Row(row, label=path.stem)
        for path, record in zip(options.predict, records, strict=True)
        for row in found.predict(record, liner, **about)
    ]


def _reduced(records: list[Any], liner: Any, options: argparse.Namespace, chosen: dict[str, Any]) -> list[Any]:
    """The moments of all planes, summed by workers."""
    from torchliner.campaign.cluster import open_cluster

    with open_cluster(options.cluster, options.wait) as client:
        return [
            each if hasattr(each, "plane") else tl.moments(each, cell_pitch=liner.cell_pitch, client=client, **chosen)
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


def write_law(found: Any, name: str, how: str, options: argparse.Namespace) -> None:
    """Write the liner of a fit as .toml, with a comment on where it comes from."""
    from torchliner.liners.catalogue import liner_text

    spread = zip(found.numbers.items(), found.standard.tolist(), strict=True)
    source = (
        f"{', '.join(f'{key} = {value:.6g} +- {u:.2g}' for (key, value), u in spread)}; fitted to "
        f"{', '.join(path.name for path in options.planes)} (reference {' '.join(options.reference)}), "
        f"{options.averaging}" + (f"; on a bound: {', '.join(found.on_bound)}" if found.on_bound else "")
    )
    write_text(liner_text(found.liner.replace(name=name), f"{how} by torchliner: {source}"), options.output)

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

AROUND = 0.5  # bounds that are not stated: 50 % about the value, or 0.5 about an offset

CHOICES = ("drive", "mean", "missing", "allow_short")
FEWEST_DRAWS = 100

OPTIONS = {
    "": {
        "planes PLANE ...": "plane files to fit",
        "--free NAME[=LOW:HIGH]": {
            "action": "append", "required": True, "help": "parameter to fit and its bounds, SI; "
            "default 50 %% about its value, of an offset 0.5 about it; 'offset' is both parts"},
        "--reference Z ...": {
            "help": "name of an impedance in the files, or one value each, e.g. 0.168-0.066j; "
            "default true"},
        "--level-check": "fit to the stated levels of the sound alone, no reference: levels and "
                     "heights as planes",
        "--noise U": "standard uncertainty of R and X of the references, by rho c, with --level-check "
                     "of the levels, dB; default: from the residual",
        "--predict PLANE ...": {
            "default": [], "help": "to predict with the spread of the fit; default: none"},
        "--draws N": {"default": 2000, "help": "of the posterior, 0 for none; default 2000"},
        "--seed N": {"default": 0, "help": "of the draws; default 0"},
        "--output FILE": "write the calibrated liner as .toml",
        "--figure PICTURE": "draw the predictions there",
    }
    | averaging_option("velocity")
    | CLUSTER
    | shared("--liner", "--json", "--quiet"),
} | choice_options(CHOICES) | plane_options()  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Print the fit and what it predicts; 1 if a parameter is on a bound or unseen."""
    from torchliner.report import calibration_report as report
    from torchliner.studies.calibrate import calibrate

    paths = [*options.planes, *options.predict]
    if options.draws and options.draws < FEWEST_DRAWS:
        raise ValueError(f"--draws is {options.draws}; the posterior needs at least {FEWEST_DRAWS}, or 0 for none")
    if options.figure is not None and not options.predict:
        raise ValueError("--figure draws predictions; name planes with --predict")
    both = read_records(seen_from_anywhere(options, paths), options)
    liner = only_liner(options.liner, both, paths)
    if options.cluster is not None:
        both = _reduced(both, liner, options)
    planes, predicted = both[: len(options.planes)], both[len(options.planes) :]
    if options.level_check and options.reference is not None:
        raise ValueError("--level-check needs no --reference; leave one of them out")
    names = options.reference or ["true"]
    found = calibrate(
        planes, liner, None if options.level_check else references_given(names),
        bounds_given(options.free, liner), averaging=options.averaging, level_check=options.level_check,
        noise=options.noise, draws=options.draws, seed=options.seed,
        **chosen_from(options, CHOICES),
    )  # fmt: skip
    noise = 0.0 if options.level_check else options.noise or 0.0
    rows = [
        row
        for path, plane in zip(options.predict, predicted, strict=True)
        for row in found.rows(
            plane, liner, label=path.stem,
            reference=names[0], noise=complex(noise, noise),
        )
    ]  # fmt: skip
    panels = {f"averaging: {found.averaging}": rows}
    predicted_text = f"\n\n{report.prediction_table(rows).as_text()}" if rows else ""
    show_results(
        options,
        lambda: report.format_calibration(found) + predicted_text,
        lambda: report.plain_calibration(found, rows),
        output=lambda _: _write(found, liner, options),
        figure=lambda path: report.draw_predictions(panels, "", path),
    )
    return 1 if found.on_bound or found.unseen else 0


def _reduced(records: list[Any], liner: Any, options: argparse.Namespace) -> list[Any]:
    """The moments of all planes, summed by workers."""
    from torchliner.campaign.cluster import open_cluster
    from torchliner.engine.moments import Moments
    from torchliner.velocity.educe import moments

    choices = {"averaging": options.averaging} | chosen_from(options, CHOICES)
    with open_cluster(options.cluster, options.wait) as client:
        return [
            each if isinstance(each, Moments)
            else moments(each, cell_pitch=liner.cell_pitch, client=client, **choices)
            for each in records
        ]  # fmt: skip


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
    """From NAME=LOW:HIGH, or names alone."""
    from torchliner.liners.model import named_numbers

    found: dict[str, tuple[float, float]] = {}
    for text in texts:
        name, equals, rest = text.partition("=")
        for each, number in named_numbers(liner, [name.strip()]).items():
            if equals:
                try:
                    low, high = (float(part) for part in rest.split(":"))
                except ValueError:
                    raise ValueError(f"--free {text!r} cannot be read; write NAME=LOW:HIGH in SI units") from None
            else:
                # A share of what is above 0, else of 1.
                reach = AROUND * number.value if number.low >= 0 else AROUND
                low, high = number.value - reach, min(number.value + reach, number.high)
            if each in found:
                raise ValueError(f"--free names {each} twice")
            found[each] = (low, high)
    return found


def _held_to(options: argparse.Namespace) -> str:
    names = " ".join(options.reference or ["true"])
    return "level check with the stated levels" if options.level_check else f"reference {names}"


def _write(found: Any, before: Any, options: argparse.Namespace) -> None:
    from torchliner.liners.catalogue import liner_text

    fitted = ", ".join(
        f"{name} = {value:.6g} +- {spread:.2g}"
        for name, value, spread in zip(found.parameters, found.values.tolist(), found.standard.tolist(), strict=True)
    )
    source = (
        f"{before.name} calibrated by torchliner: {fitted}; fitted to "
        + ", ".join(path.name for path in options.planes)
        + f" ({_held_to(options)}), {found.averaging}, uncertainty from the "
        + found.scaling
    )
    if found.on_bound:
        source += f"; on a bound: {', '.join(found.on_bound)}"
    text = liner_text(found.liner.replace(name=f"{before.name} calibrated"), source)
    write_text(text, options.output)

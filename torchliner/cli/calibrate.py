"""torchliner calibrate."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from torchliner.cli.choice_options import add_choice_options, add_order_option, chosen_from
from torchliner.cli.options import (
    add_output_options,
    liner_name,
    print_json,
    refuse_inputs,
    require_ending,
    warnings_on_stderr,
)

AROUND = 0.5  # bounds that are not stated: 50 % about the value, or 0.5 about an offset

CHOICES = ("drive", "mean", "edge", "kernel", "missing", "allow_short", "memory")
FEWEST_DRAWS = 100


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options."""
    parser.add_argument("planes", nargs="+", type=Path, help="plane files to fit")
    parser.add_argument("--liner", help="preset name or .toml; default: named in the files")
    parser.add_argument(
        "--reference", nargs="+", default=["true"], metavar="Z",
        help="name of an impedance in the files (default: true), or one value each, e.g. "
        "0.168-0.066j",
    )  # fmt: skip
    parser.add_argument(
        "--free", action="append", required=True, metavar="NAME[=LOW:HIGH]",
        help="parameter to fit and its bounds, SI; without bounds 50 %% about its value, an "
        "offset 0.5 about it; 'offset' is both parts",
    )  # fmt: skip
    parser.add_argument("--noise", type=float, metavar="U", help="standard uncertainty of R and X "
                        "of the references, by rho c; default: from the residual")  # fmt: skip
    parser.add_argument("--predict", nargs="+", type=Path, default=[], metavar="PLANE",
                        help="planes to predict with the spread of the fit")  # fmt: skip
    add_order_option(parser, "velocity first")
    add_choice_options(parser, CHOICES)
    parser.add_argument("--draws", type=int, default=2000, help="of the posterior")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, help="the calibrated liner as TOML")
    parser.add_argument("--figure", type=Path, help="draw the predictions there")
    add_output_options(parser)


def run(options: argparse.Namespace) -> int:
    """Print the fit and what it predicts; 1 if a parameter is on a bound or unseen."""
    from torchliner.calibration.calibrate import calibrate
    from torchliner.calibration.predicted_planes import prediction_rows
    from torchliner.io.plane_file import read_plane
    from torchliner.report import calibration_report as report

    inputs = [*options.planes, *options.predict, options.liner]
    refuse_inputs([options.output], inputs, options.figure)
    require_ending(options.output, [".toml"], "--output")
    if options.draws and options.draws < FEWEST_DRAWS:
        raise ValueError(
            f"--draws is {options.draws}; the posterior needs at least "
            f"{FEWEST_DRAWS}, or 0 for none"
        )
    if options.figure is not None and not options.predict:
        raise ValueError("--figure draws predictions; name planes with --predict")
    with warnings_on_stderr(options.quiet):
        planes = [read_plane(path, lazy=True) for path in options.planes]
        predicted = [read_plane(path, lazy=True) for path in options.predict]
        liners = _liners(options, [*planes, *predicted])[: len(planes)]
        found = calibrate(
            planes, liners, _references(options.reference), _bounds(options.free, liners[0]),
            order=options.order, noise=options.noise, draws=options.draws, seed=options.seed,
            **chosen_from(options),
        )  # fmt: skip
        noise = options.noise or 0.0
        rows = [
            row
            for path, plane in zip(options.predict, predicted, strict=True)
            for row in prediction_rows(
                found, plane, liners[0], label=path.stem,
                reference=options.reference[0], noise=complex(noise, noise),
            )
        ]  # fmt: skip
    if options.output is not None:
        _write(found, liners[0], options)
    if options.figure is not None:
        report.draw_predictions({f"averaging: {found.order}": rows}, "", options.figure)
    if options.json:
        print_json(report.plain_calibration(found, rows))
    else:
        print(report.format_calibration(found))
        if rows:
            print(f"\n{report.prediction_table(rows).as_text()}")
    return 1 if found.on_bound or found.unseen else 0


def _liners(options: argparse.Namespace, planes: list[Any]) -> list[Any]:
    """The liner of each plane, one object by name."""
    from torchliner.liners.catalogue import load_liner

    names = [
        options.liner or liner_name(plane, path)
        for plane, path in zip(planes, [*options.planes, *options.predict], strict=True)
    ]
    if len(set(names)) > 1:
        raise ValueError(
            f"the planes name different liners, {', '.join(sorted(set(names)))}; calibrate one of "
            "them, or say with --liner that all are it"
        )
    made = {name: load_liner(name) for name in names}
    return [made[name] for name in names]


def _references(texts: list[str]) -> Any:
    try:
        return [complex(text) for text in texts]
    except ValueError:
        if len(texts) > 1:
            raise ValueError(
                f"--reference {' '.join(texts)} cannot be read; one name, or numbers such as "
                "0.168-0.066j"
            ) from None
    return texts[0]


def _bounds(texts: list[str], liner: Any) -> dict[str, tuple[float, float]]:
    from torchliner.liners.model import named_numbers

    found: dict[str, tuple[float, float]] = {}
    for text in texts:
        name, equals, rest = text.partition("=")
        for each, number in named_numbers(liner, [name.strip()]).items():
            if equals:
                try:
                    low, high = (float(part) for part in rest.split(":"))
                except ValueError:
                    raise ValueError(
                        f"--free {text!r} cannot be read; write NAME=LOW:HIGH in SI units"
                    ) from None
            else:
                # A share of what is above 0, else of 1.
                reach = AROUND * number.value if number.low >= 0 else AROUND
                low, high = number.value - reach, min(number.value + reach, number.high)
            if each in found:
                raise ValueError(f"--free names {each} twice")
            found[each] = (low, high)
    return found


def _write(found: Any, before: Any, options: argparse.Namespace) -> None:
    from torchliner.io.whole_file import written_whole
    from torchliner.liners.catalogue import liner_text

    fitted = ", ".join(
        f"{name} = {value:.6g} +- {spread:.2g}"
        for name, value, spread in zip(
            found.parameters, found.values.tolist(), found.standard.tolist(), strict=True
        )
    )
    source = (
        f"{before.name} calibrated by torchliner: {fitted}; fitted to "
        + ", ".join(path.name for path in options.planes)
        + f" (reference {' '.join(options.reference)}), {found.order}, uncertainty from the "
        + found.scaling
    )
    if found.on_bound:
        source += f"; on a bound: {', '.join(found.on_bound)}"
    text = liner_text(found.liner.replace(name=f"{before.name} calibrated"), source)
    with written_whole(options.output) as temporary:
        temporary.write_text(text, encoding="utf-8")

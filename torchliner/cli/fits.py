"""Commands for the parameters of a liner: sensitivity, calibrate, identify."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import torchliner as tl
from torchliner import names
from torchliner.cli import kinds
from torchliner.cli import options as opt
from torchliner.cli.inputs import only_liner, planes_of, read_records, write_text
from torchliner.cli.kinds import Command, Option
from torchliner.cli.output import progress_bar, show


def sensitivity(options: argparse.Namespace) -> None:
    """Print the sensitivities, or the budget of the tolerances."""
    from torchliner.report.answer import answer_of

    tolerances = {key: "".join(value) for key, value in _pairs(options.tolerance, "tolerance", str).items()}
    if options.limits is not None and not tolerances:
        raise ValueError(f"--limits {options.limits} says what tolerances are; state them with --tolerance")
    limits = options.limits or "rectangular"
    (plane,) = planes = read_records([options.plane], options)
    liner = only_liner(options, planes, [options.plane])
    parameters = options.parameters or (list(tolerances) or None)
    with progress_bar(2 * planes_of(planes)[0].samples, options.plane, options) as step:
        found = tl.sensitivities(plane, liner, options.frequency, parameters, progress=step, **options.chosen)
    budget = found.propagate(tolerances, limits=limits) if tolerances else None
    about = {"averaging": options.averaging, "budget": budget, "limits": limits}
    show(options, answer_of(found, **about))


def _pairs(texts: list[str], option: str, read: Any = float) -> dict[str, tuple[Any, ...]]:
    """NAME=VALUE or NAME=LOW:HIGH by name; a name alone has no values."""
    found: dict[str, tuple[Any, ...]] = {}
    for text in texts:
        name, equals, values = (part.strip() for part in text.partition("="))
        try:
            value = tuple(read(part) for part in values.split(":")) if equals else ()
            if len(value) not in ((1,) if read is str else (0, 2)):
                raise ValueError
        except ValueError:
            form = "NAME=VALUE" if read is str else "NAME=LOW:HIGH in SI units"
            raise ValueError(f"--{option} {text!r} cannot be read; write {form}") from None
        if name in found:
            raise ValueError(f"--{option} names {name} twice; give it once")
        found[name] = value
    return found


def calibrate(options: argparse.Namespace) -> int:
    """Print the fit and what it predicts; 1 if a parameter is on a bound or unseen."""
    from torchliner.report.answer import answer_of
    from torchliner.studies.calibrate import AVERAGING, calibrate_without_flow
    from torchliner.studies.runs import LEVEL_CHECK

    if options.figure is not None and not options.predict:
        raise ValueError("--figure draws predictions; name planes with --predict")
    known, predicted, liner = _planes(options)
    references, free = _references(options.reference), _bounds(options.free, liner)
    options.averaging = options.averaging or ("velocity" if free else AVERAGING)
    chosen = options.chosen | {"averaging": options.averaging, "noise": options.noise}
    law, words, how = liner, "", "calibrated"
    if free:
        found = tl.calibrate(known, liner, references, free, **chosen)
    else:
        found, scores = calibrate_without_flow(known, liner, references, **chosen)
        law, (low, high) = found.runs[0].liner, found.seen_speeds
        how += f" without flow at |v| of {low:.3g} to {high:.3g} m/s"
        left_out = ", ".join(f"{name} {score:.3f}" for name, score in scores.items())
        words = f"law: {type(found.liner).__name__}; error of reactances left out: {left_out}; {how}"
    rows = _predicted(found, predicted, law, options, 0.0 if references == LEVEL_CHECK else options.noise)
    show(
        options,
        answer_of(found, predicted=rows, words=words),
        write=lambda path: _write_law(found, f"{liner.name} calibrated", how, path, options),
    )
    return 1 if found.on_bound or found.unseen else 0


def identify(options: argparse.Namespace) -> int:
    """Print what was found and what it predicts; 1 if a parameter is on a bound or unseen, or a
    prediction leaves the speeds of the runs."""
    from torchliner.report.answer import answer_of
    from torchliner.studies.fit import OUTSIDE, with_flow

    known, predicted, liner = _planes(options)
    models = [text if text == CURVE else _bounds(text.split(","), with_flow(liner)) for text in options.free]
    if CURVE not in (models or [CURVE]) and (unused := sorted({"rest", "freedom"} & options.chosen.keys())):
        raise ValueError(f"{opt.spelled(unused)}: of a curve, and none is fitted; leave it out, or add --free {CURVE}")
    about = {"models": models or [CURVE], "noise": options.noise, "frequency": options.frequency}
    found = tl.identify(known, liner, _references(options.reference), **about, **options.chosen)
    fit = found.fit
    rows = _predicted(fit, predicted, liner, options, 0.0)
    show(
        options,
        answer_of(found, predicted=rows),
        write=lambda path: _write_law(fit, f"{fit.runs[0].liner.name} identified", "identified", path, options),
    )
    return int(bool(fit.on_bound or fit.unseen or any(row.outside > OUTSIDE for row in rows)))


def _planes(options: argparse.Namespace) -> tuple[list[Any], list[Any], Any]:
    """The planes to fit and those to predict, and the one liner of all."""
    paths = [*options.planes, *options.predict]
    both = read_records(paths, options)
    count = len(options.planes)
    return both[:count], both[count:], only_liner(options, both, paths)


def _predicted(found: Any, records: list[Any], liner: Any, options: Any, noise: Any) -> list[Any]:
    """Rows of the planes of --predict, labelled by their files."""
    from torchliner.studies.rows import Row

    about = {"reference": options.reference[0], "noise": complex(noise or 0.0, noise or 0.0)}
    return [
        Row(row, label=path.stem)
        for path, record in zip(options.predict, records, strict=True)
        for row in found.predict(record, liner, **about)
    ]


def _references(texts: list[str]) -> Any:
    """One name, or a value each."""
    try:
        return [complex(text) for text in texts]
    except ValueError:
        if len(texts) > 1:
            raise ValueError(
                f"--reference {' '.join(texts)} cannot be read; one name, or numbers such as 0.168-0.066j"
            ) from None
    return texts[0]


def _bounds(texts: list[str], liner: Any) -> dict[str, tuple[float, float]]:
    """From NAME=LOW:HIGH, or names alone, which have usual bounds."""
    from torchliner.studies.laws import bounds_for

    found: dict[str, Any] = {}
    for name, ends in _pairs(texts, "free").items():
        usual = bounds_for([name], liner)
        if twice := sorted(usual.keys() & found.keys()):
            raise ValueError(f"--free names {twice[0]} twice; give it once")
        found |= dict.fromkeys(usual, ends) if ends else usual
    return found


def _write_law(found: Any, name: str, how: str, path: Path, options: argparse.Namespace) -> None:
    """Write the liner of a fit as .toml, with a comment on where it comes from."""
    from torchliner.liners.catalogue import liner_text

    numbers = zip(found.numbers.items(), found.standard.tolist(), strict=True)
    words = ", ".join(f"{key} = {value:.6g} +- {u:.2g}" for (key, value), u in numbers)
    source = (
        f"{found.law.label if found.law.frequencies else words}; fitted to "
        f"{', '.join(path.name for path in options.planes)} (reference {' '.join(options.reference)}), "
        f"{options.averaging}" + (f"; on a bound: {', '.join(found.on_bound)}" if found.on_bound else "")
    )
    write_text(liner_text(found.liner.replace(name=name), f"{name}: {how} by torchliner: {source}"), path)


CURVE = "curve"
NOISE = "standard uncertainty of R and X of the references, of levels dB"
REFERENCE = Option(
    "--reference",
    "name of an impedance in the files, 'level-check' (the stated level alone), or one value each, e.g. 0.168-0.066j; "
    "default true",
    kinds.TEXT,
    nargs="+",
    default=["true"],
)
PREDICT = Option("--predict", "planes to predict; default: none", kinds.PLANE, nargs="+", default=[])
TOLERANCE = Option(
    "--tolerance",
    'half-width with its unit, e.g. orifice_diameter="0.02 mm", porosity="2 %", temperature="1 K"; default: none, then '
    "the change of Z for 1 % of each parameter",
    kinds.Kind("NAME=VALUE"),
    many=True,
)
LIMITS = "half-widths are limits (u = half-width/sqrt 3), or u; default rectangular"
FREE = Option(
    "--free",
    "parameter to fit and its bounds, SI; default usual ones, else 50 % about its value, of an offset 0.5 about it; "
    "'offset' is both parts. Default, for runs without flow: contraction coefficient, with two levels or more the "
    "offset, and the law of lost mass that predicts them best",
    kinds.Kind("NAME[=LOW:HIGH]"),
    many=True,
)
MODELS = Option(
    "--free",
    "a model: 'curve', a free curve over |v|; or parameters of the liner's law, with commas between, each with its "
    "bounds (NAME=LOW:HIGH, SI) or usual ones; several times to compare; default: curve",
    kinds.Kind("NAMES"),
    many=True,
)
RUNS = replace(opt.PLANES, text="plane files, or moments, of several runs; planes of one case are one run")
FIXED = opt.choices("drive mean missing allow_short")
COMMANDS = {
    "sensitivity": Command(
        sensitivity,
        [
            *(opt.ONE_PLANE, opt.OF_LINER, opt.TONE, TOLERANCE),
            Option("--parameters", "of the liner, e.g. porosity; default: all", kinds.TEXT, nargs="+"),
            Option("--limits", LIMITS, names.LIMITS),
            *(opt.figure("draw bars of the contributions at the first frequency"), opt.averaging("velocity"), opt.ROWS),
        ],
        ("plane.h5 --tolerance porosity='2 %' --tolerance cavity_depth='0.1 mm'",),
        FIXED,
    ),
    "calibrate": Command(
        calibrate,
        [
            *(replace(opt.PLANES, text="plane files to fit"), opt.OF_LINER, FREE, REFERENCE, PREDICT),
            Option("--noise", NOISE, kinds.NUMBER),
            *(opt.output("write the calibrated liner", ".toml"), opt.figure("draw the predictions there")),
            Option("--averaging", "over cells; default velocity, without --free phase-locked", names.AVERAGINGS),
        ],
        (
            "noflow_*.h5 -o mine.toml",
            "quiet.h5 loud.h5 --free vena_contracta=0.4:1 --noise 0.002 -o mine.toml",
            "low.h5 high.h5 --reference level-check --free vena_contracta=0.4:1",
        ),
        FIXED,
    ),
    "identify": Command(
        identify,
        [
            *(RUNS, opt.OF_LINER, opt.TONE, MODELS, REFERENCE, PREDICT),
            Option("--noise", f"{NOISE}; default 2 % of |Z|, 0.2 dB", kinds.NUMBER),
            *(opt.output("write the liner", ".toml"), opt.figure("draw curve and speeds")),
        ],
        (
            "low.h5 mid.h5 high.h5 --rest 0.01+0.01j -o mine.toml --figure curve.png",
            "low.h5 high.h5 --free vena_contracta --free vena_contracta,mass_loss -o law.toml",
        ),
        [*opt.of("studies.identify:identify", "rest freedom"), opt.averaging("phase-locked"), *FIXED],
    ),
}

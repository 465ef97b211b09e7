"""Commands that vary a choice, a height, a model or its parameters, or fit these."""

import argparse
from pathlib import Path
from typing import Any

import torchliner as tl
from torchliner.cli import work
from torchliner.liners.catalogue import liner_text
from torchliner.studies.calibrate import AVERAGING, NOISE, calibrate_without_flow, with_flow
from torchliner.studies.fit import OUTSIDE
from torchliner.studies.heights import study_heights
from torchliner.studies.laws import bounds_for
from torchliner.studies.variants import Row

CURVE = "curve"


def _asked(options: Any, call: Any, paths: list[Path], read: Any = work.read_records, **about: Any) -> Any:
    """A study of planes, or of one, and of their one liner."""
    records = read(paths, options)
    liner = work.only_liner(options, records, paths)
    with work.progress_bar(work.samples_of(records), options) as step:
        about |= {"progress": step} | work.choices_of(options)
        return call(records if hasattr(options, "planes") else records[0], liner, options.frequency, **about)


def audit(options: argparse.Namespace) -> None:
    """How far each open choice moves the impedance."""
    work.show(options, _asked(options, tl.audit, options.planes, work.read_planes))


def height(options: argparse.Namespace) -> None:
    """Impedance over height, and which height to take."""
    work.show(options, _asked(options, study_heights, options.planes))


def compare(options: argparse.Namespace) -> None:
    """Difference of two maps, by cell and for the liner."""
    found = tl.compare(tl.read_map(options.first), tl.read_map(options.second), **options.chosen)
    work.show(options, found)


def compare_models(options: argparse.Namespace) -> None:
    """Several models of the liner on one plane, in one pass."""
    models = {name: tl.load_liner(name) for name in options.liner}
    (record,) = records = work.read_records([options.plane], options)
    with work.progress_bar(work.samples_of(records), options) as step:
        found = tl.compare_models(record, models, options.frequency, progress=step, **work.choices_of(options))
    work.show(options, found)


def sensitivity(options: argparse.Namespace) -> None:
    """Change of Z with each parameter of a liner; tolerances."""
    about: Any = {"tolerances": dict(options.tolerance), "parameters": options.parameters}
    work.show(options, _asked(options, tl.sensitivities, [options.plane], **about), averaging=options.averaging)


def calibrate(options: argparse.Namespace) -> int:
    """Parameters of a liner fitted to known impedances. Exit code 1 if one is on a bound or unseen."""
    known, predicted, liner, references = _planes(options)
    free = {name: ends for each in options.free for name, ends in _bounds(each, liner).items()}
    averaging = options.averaging or ("velocity" if free else AVERAGING)
    chosen, words, how = options.chosen | {"averaging": averaging}, "", "calibrated"
    if free:
        found = tl.calibrate(known, liner, references, free, noise=options.noise, **chosen)
    else:
        found, scores = calibrate_without_flow(known, liner, references, noise=options.noise or NOISE, **chosen)
        low, high = found.seen_speeds
        how += f" without flow at |v| of {low:.3g} to {high:.3g} m/s"
        left_out = ", ".join(f"{name} {score:.3f}" for name, score in scores.items())
        words = f"law: {type(found.liner).__name__}; error of reactances left out: {left_out}; {how}"
    rows = _predicted(found, predicted, options, options.noise or 0.0)
    work.show(options, found, lambda path: _write(found, liner.name, how, path, options), predicted=rows, words=words)
    return int(bool(found.on_bound or found.unseen))


def identify(options: argparse.Namespace) -> int:
    """Response of a liner to |v| found from runs of known impedance. Exit code 1 if a parameter is on a bound or
    unseen, or a prediction leaves the speeds of the runs."""
    known, predicted, liner, references = _planes(options)
    models = [CURVE if [*each] == [CURVE] else _bounds(each, with_flow(liner)) for each in options.free]
    about = {"models": models or [CURVE], "noise": options.noise, "frequency": options.frequency}
    found = tl.identify(known, liner, references, **about, **options.chosen)
    fit = found.fit
    rows = _predicted(fit, predicted, options)
    work.show(options, found, lambda path: _write(fit, liner.name, "identified", path, options), predicted=rows)
    return int(bool(fit.on_bound or fit.unseen or any(row.outside > OUTSIDE for row in rows)))


def _planes(options: argparse.Namespace) -> tuple[list[Any], list[Any], Any, Any]:
    """The planes to fit and those to predict, the one liner of all, and the references: one name, or values."""
    paths, count, (first, *others) = [*options.planes, *options.predict], len(options.planes), options.reference
    both = work.read_records(paths, options)
    named = first if isinstance(first, str) and not others else options.reference
    return both[:count], both[count:], work.only_liner(options, both, paths), named


def _predicted(found: Any, records: list[Any], options: Any, noise: float = 0.0) -> list[Any]:
    """Rows of the planes of --predict, labelled by their files."""
    about = {"reference": options.reference[0], "noise": complex(noise, noise)}
    labelled = zip(options.predict, records, strict=True)
    return [Row(row, label=path.stem) for path, each in labelled for row in found.predict(each, **about)]


def _bounds(stated: dict[str, tuple[float, float]], liner: Any) -> dict[str, tuple[float, float]]:
    """As stated, or usual ones of a name alone."""
    usual = {name: bounds_for([name], liner) for name in stated}
    return {part: stated[name] or ends for name, parts in usual.items() for part, ends in parts.items()}


def _write(found: Any, name: str, how: str, path: Path, options: argparse.Namespace) -> None:
    """Write the liner of a fit as .toml, with a comment on where it comes from."""
    numbers = zip(found.numbers.items(), found.standard.tolist(), strict=True)
    words = ", ".join(f"{key} = {value:.6g} +- {u:.2g}" for (key, value), u in numbers)
    title = f"{name} {how.split()[0]}"
    source = f"{title}: {how} by torchliner: {found.law.label if found.law.frequencies else words}; fitted to "
    source += f"{', '.join(each.name for each in options.planes)} (reference {' '.join(map(str, options.reference))})"
    source += f"; on a bound: {', '.join(found.on_bound)}" if found.on_bound else ""
    work.write_text(liner_text(found.liner.replace(name=title), source), path)

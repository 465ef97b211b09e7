"""The answers of studies: audit, comparison, models, sensitivities, heights, levels, fits."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import torch

from torchliner.report import studies
from torchliner.report.answer import Answer, Grid, Picture, impedance_words
from torchliner.report.table import Table, bounds_of, format_complex, table_of
from torchliner.studies.fit import Fit
from torchliner.studies.variants import Row, Study, rows_of
from torchliner.velocity.ir_tdibc import LevelCurve

SPEEDS = (0.0, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0)  # of the last knot, at which a curve is shown
PREDICTED = "label,frequency,height,before,impedance,standard,fitted,true,misses,outside"


def of_audit(found: Study) -> Answer:
    """What each open choice moves, the largest first; on the screen the variant of each that moves Z most."""
    worst, level = {row.factor: row for row in reversed(found.rows)}, found.level_check
    words = impedance_words(found.base, bounds_of(found), found.level)
    lines = [
        f"{words}, whole liner, averaging {found.averaging}, {found.frequency:g} Hz.",
        f"Level check{':' if level is None else f' {level:+.2f} dB'} {found.level_check_words}.",
        *(f"{r.factor} moves Z most: {r.variant}, by {format_complex(r.change)}." for r in found.rows[:1]),
    ]
    draw, words = partial(studies.draw_audit, found), f"{found.title}: what each choice moves"
    return Answer(
        title=f"Audit: {found.title}",
        lines=lines,
        table=table_of(found.rows, "factor,variant,impedance,change,level_check"),
        brief=[row for row in found.rows if row is worst[row.factor]],
        caption="Every variant and how far it moves Z.",
        remarks=[*(f"{factor} does not apply: {reason}" for factor, reason in found.skipped.items())],
        notes=found.notes,
        step="".join(f"state which {r.factor} you take, and why: it moves Z most" for r in found.rows[:1]),
        pictures=[Picture("audit", words, draw, lambda: found.rows)],
        results=[found],
        more=found,
    )


def of_comparison(found: Study) -> Answer:
    """A row a place and frequency."""
    row = max((row for row in found.rows if row.place == "liner"), key=lambda each: abs(each.difference))
    differs = f"differs in {row.differs_in}" if row.differs_in else "no difference is shown"
    words = impedance_words(row.difference, bounds_of(row), found.level).removeprefix("Z = ")
    return Answer(
        title="Second map minus the first",
        lines=[f"Whole liner at {row.frequency:g} Hz: {words}; {differs}."],
        table=table_of(found.rows, "place,frequency,first,second,difference,interval,differs_in"),
        remarks=[found.words],
        pictures=[Picture("difference", "Difference", partial(studies.draw_comparison, found), lambda: found.rows)],
        more=found,
    )


def of_models(found: Study) -> Answer:
    """A row a frequency and model."""
    distances = "".join(f",distance.{name}" for name in found.references)
    drawn = [Row(row, name=f"{row.model}, {row.frequency:g} Hz") for row in found.rows[: studies.MOST_DRAWN]]
    title = f"{found.title}, averaging {found.averaging}"
    draw = partial(studies.draw_cases, drawn, references=found.references, title=title)
    return Answer(
        title=f"Models: {found.title}",
        lines=[
            f"Whole liner, averaging {found.averaging}.",
            *(f"{name}: {format_complex(value)}" for name, value in found.references.items()),
            f"Level check: {found.level_check_words}.",
        ],
        table=table_of(found.rows, f"model,frequency,impedance,interval,level_check{distances}"),
        caption="Z by each model.",
        notes=found.notes,
        pictures=[Picture("models", title, draw, lambda: found.rows)],
        more=found,
    )


def of_sensitivities(found: Study, averaging: str | None = None) -> Answer:
    """dZ of each parameter per SI unit and per 1 %, or its share of the uncertainty; largest first."""
    averaging, frequency = averaging or found.found.averaging, found.found.frequency.tolist()
    nominal = found.found.liner[averaging].impedance.tolist()
    lines = [f"Z = {format_complex(z)} at {f:g} Hz" for f, z in zip(frequency, nominal, strict=True)]
    shown, meaning, rows = "slope,step", "p in its unit", found.of(averaging=averaging)
    if "combined" in found:
        shown, meaning = "half_width,standard,change", "tolerances are limits, u = half-width/√3"
        for i, total in enumerate(found.combined[averaging].tolist()):
            rows.append(Row(frequency=frequency[i], parameter="combined", change=total))
            lines[i] += f", standard uncertainty of R {total.real:.2g} and of X {total.imag:.2g}"
    return Answer(
        title=f"Sensitivities: {found.found.title}",
        lines=lines[:3],
        table=table_of(rows, f"frequency,parameter,value,unit,{shown}"),
        remarks=[*lines[3:], f"Z over ρc, averaging {averaging}; {meaning}; first order."],
        notes=found.found.notes,
        results=[found.found],
        more={"averaging": averaging, "impedance": nominal},
    )


def of_heights(study: Study) -> Answer:
    """Z over height by averaging, what else speaks of a height, and which one to take."""
    shown = "height" + "".join(f",impedance.{name}" for name in study.rows[0].impedance)
    shown += "".join(f",level_check.{name}" for name in study.rows[0].level_check)
    found = {name: "none" if y is None else f"y = {1e3 * y:.3g} mm" for name, y in study.heights.items()}
    judges = "level check" if study.judged[0].name == "level check" else "change with height"
    lines = [f"The lowest that qualifies, {name}: {height}" for name, height in found.items()]
    lines.append(f"Judged by the {judges}; no reference impedance is used.")
    step = "none of these planes will do: calibrate the liner, give a run without sound, or take other heights"
    if study.height is not None:
        step = f"torchliner educe with the plane at y = {1e3 * study.height:.3g} mm"
    drawn = [Row(row, averaging=name, impedance=z) for row in study.rows for name, z in row.impedance.items()]
    title = f"{study.title}{' (null test)' * (study.choices.get('surface') == 'hard wall')}, {study.frequency:g} Hz"
    known = {"reference": study.reference["true"]} if "true" in study.reference else {}
    draw = partial(studies.draw_over_height, drawn, title, references=known)
    judged = table_of(study.judged, "averaging,height,name,value,limit,passed")
    return Answer(
        title=f"Heights: {study.title}, {study.frequency:g} Hz",
        lines=lines,
        table=table_of(study.rows, f"{shown},coherence,velocity_rms,drift"),
        caption="Each height, whole plane.",
        grids=[Grid("judged", "Level check in dB, all else a share of 1.", judged)],
        remarks=[f"not used above: {name}: {format_complex(z)}" for name, z in study.reference.items()],
        notes=study.notes,
        step=step,
        pictures=[Picture("heights", f"{study.title}: Z over height", draw, lambda: study.rows)],
        results=[study],
        more=study,
    )


def of_curve(curve: LevelCurve) -> Answer:
    """One row per level and frequency."""
    chosen = curve.choices
    rows = rows_of(
        level=curve.level[:, None],
        frequency=curve.frequency,
        impedance=curve.impedance,
        **{name: getattr(curve, name)[:, None] for name in ("rms_speed", "peak_speed", "drift")},
    )
    low, high = chosen["kernel_band"]
    kernel = f"kernel {chosen['kernel']}, error in R {chosen['kernel_error']:.1e} on {low:g}-{high:g} Hz"
    words = "Resistance and reactance over the level of the incident wave"
    return Answer(
        title=f"{chosen['liner']}: {chosen['incident']}",
        lines=[f"A record of {1e3 * chosen['duration']:.4g} ms at {chosen['sampling_rate']:g} Hz, {kernel}."],
        table=table_of(rows, "level,frequency,impedance,rms_speed,peak_speed,drift"),
        pictures=[Picture("levels", words, partial(studies.draw_levels, curve), lambda: rows)],
        results=[curve],
    )


def of_fit(found: Fit, predicted: Sequence[Any] = (), words: str = "") -> Answer:
    """Parameters, correlations, misfit; predictions of other planes; ``words``: how the law was found."""
    names, spread = found.law.names, found.standard
    pairs = [
        f"{names[i]} and {names[j]} {float(found.covariance[i, j] / (spread[i] * spread[j])):+.2f}"
        for i in range(len(names))
        for j in range(i)
        if spread[i] * spread[j] > 0
    ]
    title, drawn, about = f"averaging: {found.choices.averaging}", list(predicted or found.rows), _about(found)
    draw = partial(studies.draw_predictions, drawn, title)
    return Answer(
        title=f"Calibration: {found.law.label}",
        lines=[*filter(None, [words]), *([f"correlations: {', '.join(pairs)}"] if pairs else [])],
        table=_parameters(found),
        caption="The parameters that were fitted, SI.",
        grids=_planes(found.rows, "The planes that were fitted.", predicted),
        remarks=[f"{found.data} data, {len(names)} parameters; {title}"],
        notes=found.notes,
        step="predict other planes: --predict PLANE ..." if not predicted else "",
        pictures=[Picture("predictions", title, draw, lambda: drawn)],
        more=about,
    )


def _parameters(found: Fit) -> Table:
    """A row a parameter: value, spread, bounds, interval; SI."""
    numbers, names = found.runs[0].liner.numbers(), found.law.names
    rows = rows_of(
        parameter=names,
        unit=[numbers[name].unit for name in names],
        on_bound=[name in found.on_bound for name in names],
        value=found.values,
        standard=found.standard,
        **dict(zip(("lower_95", "upper_95"), found.interval, strict=True)),
        lowest=found.law.low,
        highest=found.law.high,
    )
    return table_of(rows, "parameter,value,unit,standard,lower_95,upper_95,lowest,highest")


def _planes(rows: Sequence[Any], caption: str, predicted: Sequence[Any]) -> list[Grid]:
    """Fitted ones, or those left out, and others; misses: in standard deviations."""
    other = Grid("predictions", "Other planes, by the fit.", table_of(predicted, PREDICTED))
    return [Grid("fitted", caption, table_of(rows, PREDICTED)), other]


def _about(found: Fit) -> dict[str, Any]:
    """Of a fit, for JSON."""
    about = {name: getattr(found, name) for name in ("covariance", "unseen", "seen_speeds")}
    squares = float(found.residuals.square().sum())
    return about | {"law": found.law.label, "averaging": found.choices.averaging, "sum_of_squares": squares}


def of_identification(found: Study, predicted: Sequence[Any] = ()) -> Answer:
    """Laws, the one that predicts best first; its curve; what the planes see of it."""
    fit, (slowest, fastest) = found.fit, found.fit.seen_speeds
    seen = f"Seen: |v| of about {slowest:.3g} to {fastest:.3g} m/s"
    if fit.law.frequencies:
        seen += f"; the data determine {fit.determined:.1f} of {len(fit.values)} parameters"
    rows, curve = list[Row](), list[Any]()
    for each in found.candidates:
        both = zip(each.fit.numbers.items(), each.fit.standard.tolist(), strict=True)
        values = ", ".join(f"{name} {value:.4g} +- {u:.2g}" for (name, value), u in both)
        row = Row(model=each.label, error=each.error, misfit=each.fit.misfit, lowest=each.lowest)
        rows.append(Row(row, values="" if each.fit.law.frequencies else values))
    speed = fit.knots.top * torch.tensor(SPEEDS, dtype=torch.float64)
    for frequency in sorted({f for run in fit.runs for f in run.frequency.tolist()}):
        z, low, high = fit.band(frequency, speed)
        known = (slowest <= speed) & (speed <= fastest)
        curve += rows_of(frequency=frequency, speed=speed, impedance=z, low=low, high=high, seen=known)
    at = table_of(curve, "frequency,speed,impedance,interval,seen")
    return Answer(
        title=f"Identified law: {fit.law.label}",
        lines=[f"{fit.law.label} predicts best what it has not seen.", f"{seen}."],
        table=table_of(rows, "model,error,misfit,values"),
        caption="Laws, the one that predicts best first; error: of planes left out.",
        grids=[
            Grid("curve", "The law at a few speeds, with its 95 % interval.", at),
            *([] if fit.law.frequencies else [Grid("parameters", "Of the law, SI.", _parameters(fit))]),
            *_planes(found.rows, "Each plane by a fit to the other runs.", predicted),
        ],
        notes=found.notes,
        pictures=[Picture("law", "R and X over |v|", partial(studies.draw_identification, found), lambda: curve)],
        more=_about(fit),
    )

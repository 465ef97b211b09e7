"""The answers of fits: calibrations, identified laws, and the validation of every rule."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import torch

from torchliner.report.answer import Answer, Grid, Picture
from torchliner.report.studies import draw_identification, draw_predictions
from torchliner.report.table import Row, Table, rows_of, table_of
from torchliner.studies.fit import Fit
from torchliner.studies.validation import DEFAULT, errors_by_rule
from torchliner.studies.variants import Study

SPEEDS = (0.0, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0)  # of the last knot, at which a curve is shown
TRUTH = (
    "case,height,drive,mean,phase,averaging,educed,true,in_situ,low,high,error,level_check,speed,velocity_rms,mach,"
    "incident_level,periods"
)


def parameter_table(found: Fit) -> Table:
    """A row a parameter: value, spread, bounds, interval; SI."""
    numbers, names = found.runs[0].liner.numbers(), found.law.names
    lower, upper = found.interval
    rows = rows_of(
        parameter=names,
        unit=[numbers[name].unit for name in names],
        on_bound=[name in found.on_bound for name in names],
        value=found.values,
        standard=found.standard,
        lower_95=lower,
        upper_95=upper,
        lowest=found.law.low,
        highest=found.law.high,
    )
    return table_of(rows, "parameter,value,unit,standard,lower_95,upper_95,lowest,highest")


def prediction_table(rows: Sequence[Any]) -> Table:
    """Of rows of ``Fit.predict``, ``Fit.rows`` or those of runs left out; misses: in standard deviations."""
    shown = "label,frequency,height,before,impedance,standard,fitted,level_check,true,misses,outside"
    return table_of(rows, shown)


def of_fit(
    several: Sequence[Fit], source: Path | None = None, predicted: Sequence[Any] = (), words: str = ""
) -> Answer:
    """Parameters, correlations, misfit; predictions of other planes; ``words``: how the law was found."""
    (found,) = several
    names, spread = found.law.names, found.standard
    pairs = [
        f"{names[i]} and {names[j]} {float(found.covariance[i, j] / (spread[i] * spread[j])):+.2f}"
        for i in range(len(names))
        for j in range(i)
        if spread[i] * spread[j] > 0
    ]
    noise = "stated noise" if found.stated else "noise from the residual"
    title, drawn = f"averaging: {found.choices.averaging}", list(predicted or found.rows)
    draw = partial(draw_predictions, {title: drawn}, "")
    return Answer(
        title=f"Calibration: {found.law.label}",
        lines=[*filter(None, [words]), *([f"correlations: {', '.join(pairs)}"] if pairs else [])],
        table=parameter_table(found),
        caption="The parameters that were fitted, SI.",
        grids=_planes_of(found.rows, "The planes that were fitted.", predicted),
        remarks=[
            f"{found.data} data, {len(names)} parameters, sum of squares {float(found.residuals.square().sum()):.4g} "
            f"({noise}); {title}"
        ],
        notes=found.notes,
        step="predict other planes: --predict PLANE ..." if not predicted else "",
        pictures=[Picture("predictions", title, draw, lambda: drawn)],
        more=_about(found),
        source=source,
    )


def _planes_of(rows: Sequence[Any], caption: str, predicted: Sequence[Any]) -> list[Grid]:
    return [
        Grid("fitted", caption, prediction_table(rows)),
        Grid("predictions", "Other planes, by the fit.", prediction_table(predicted)),
    ]


def _about(found: Fit) -> Row:
    """Of a fit, for JSON."""
    return {
        "law": found.law.label,
        "covariance": found.covariance,
        "unseen": found.unseen,
        "sum_of_squares": float(found.residuals.square().sum()),
        "degrees_of_freedom": found.freedom,
        "averaging": found.choices.averaging,
        "seen_speeds": found.seen_speeds,
    }


def of_identification(several: Sequence[Study], source: Path | None = None, predicted: Sequence[Any] = ()) -> Answer:
    """Laws, the one that predicts best first; its curve; what the planes see of it."""
    (found,) = several
    fit, (slowest, fastest) = found.fit, found.fit.seen_speeds
    seen = f"Seen: |v| of about {slowest:.3g} to {fastest:.3g} m/s"
    if fit.law.frequencies:
        seen += f"; the data determine {fit.determined:.1f} of {len(fit.values)} parameters"
    rows, curve = list[Row](), _curve(fit)
    for each in found.candidates:
        spread = each.fit.standard.tolist()
        both = zip(each.fit.numbers.items(), spread, strict=True)
        values = ", ".join(f"{name} {value:.4g} +- {u:.2g}" for (name, value), u in both)
        row = {"model": each.label, "error": each.error, "misfit": each.fit.misfit, "lowest": each.lowest}
        rows.append(row | {"values": "" if each.fit.law.frequencies else values})
    return Answer(
        title=f"Identified law: {fit.law.label}",
        lines=[f"{fit.law.label} predicts best what it has not seen.", f"{seen}."],
        table=table_of(rows, "model,error,misfit,values"),
        caption="Laws, the one that predicts best first; error: of planes left out.",
        grids=[
            Grid("curve", "The law at a few speeds, with its 95 % interval.", curve),
            *([] if fit.law.frequencies else [Grid("parameters", "Of the law, SI.", parameter_table(fit))]),
            *_planes_of(found.rows, "Each plane by a fit to the other runs.", predicted),
        ],
        notes=found.notes,
        pictures=[Picture("law", "R and X over |v|", partial(draw_identification, found), lambda: curve.rows)],
        more=_about(fit),
        source=source,
    )


def _curve(found: Fit) -> Table:
    """The curve at a few speeds of every frequency, with its 95 % interval."""
    speed, (slowest, fastest) = found.knots.top * torch.tensor(SPEEDS, dtype=torch.float64), found.seen_speeds
    rows = list[Row]()
    for frequency in sorted({f for run in found.runs for f in run.frequency.tolist()}):
        z, low, high = found.band(frequency, speed)
        seen = (slowest <= speed) & (speed <= fastest)
        rows += rows_of(frequency=frequency, speed=speed, impedance=z, low=low, high=high, seen=seen)
    return table_of(rows, "frequency,speed,impedance,interval,seen")


def table_of_rules(rows: Sequence[Any]) -> Table:
    """Every rule of every plane."""
    return table_of(rows, "case,height,drive,mean,phase,averaging,educed,true,error", TRUTH)


def of_validation(several: Sequence[Any], source: Path | None = None) -> Answer:
    """Every rule beside the reference impedance of resolved cases; on the screen the default rules."""
    rules = sorted(errors_by_rule(several), key=lambda each: abs(each.median))
    default = [row for row in several if row.rule == DEFAULT]
    return Answer(
        title="Validation: |Z - Z_true| of the default rules",
        lines=[],
        table=table_of_rules(several),
        brief=table_of(default, "case,height,averaging,educed,true,error"),
        caption="Every rule of every plane.",
        grids=[
            Grid(
                "rules",
                f"Median |dR| + j |dX| of each rule over {rules[0].planes} planes.",
                table_of(rules, "drive,mean,phase,averaging,median"),
            )
        ],
        remarks=[
            "Default: phase averaged, instantaneous |v|, mean kept. 'given' is the phase of the reference wave, which "
            "only a simulation knows."
        ],
        source=source,
    )

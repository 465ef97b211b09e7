"""The answers of fits: calibrations, identified laws, and the validation of every rule."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import torch

from torchliner.names import AVERAGINGS, PHASES
from torchliner.report.answer import Answer, Grid, Picture
from torchliner.report.planes import draw_predictions
from torchliner.report.studies import draw_identification
from torchliner.report.table import Column, Table, format_complex, format_pair, if_known, table_of
from torchliner.studies.fit import Fit
from torchliner.studies.rows import Row, Study
from torchliner.studies.validation import DEFAULT, errors_by_rule

SPEEDS = (0.0, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0)  # of the last knot, at which a curve is shown
MOST = 0.05, 0.95  # shares of a plane's weight between which its speeds are stated
TOLERABLE = 0.1  # share of |Z_true| beyond which a rule fails
TRUTH = (
    "case,height,drive,mean,phase,averaging,educed,true,in_situ,low,high,error,level_check,speed,velocity_rms,mach,"
    "incident_level,periods"
)


def parameter_table(found: Fit) -> Table:
    """A row a parameter: value, spread, bounds, interval; SI."""
    numbers, law = found.runs[0].liner.numbers(), found.law
    columns = zip(law.names, found.values, found.standard, *found.interval, law.low, law.high, strict=True)
    names = ("value", "standard", "lower_95", "upper_95", "lowest", "highest")
    rows = []
    for name, *each in columns:
        about = {"parameter": name, "unit": numbers[name].unit, "on_bound": name in found.on_bound}
        rows.append(Row(about, **dict(zip(names, map(float, each), strict=True))))
    return table_of(rows, "parameter,value,unit,u(p),range,bounds")


def prediction_table(rows: Sequence[Row]) -> Table:
    """Of rows of ``Fit.predict``, ``Fit.rows`` or those of runs left out."""
    names = ("fitted", "level_check", "true", "misses", "outside")
    return table_of(rows, "label,frequency,height,before,impedance,standard" + if_known(rows, *names))


def of_fit(
    several: Sequence[Fit], source: Path | None = None, predicted: Sequence[Row] = (), words: str = ""
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
    grids = [Grid("fitted", "The planes that were fitted.", prediction_table(found.rows))]
    drawn = list(predicted or found.rows)
    if predicted:
        grids.append(Grid("predicted", "Other planes, by the fit.", prediction_table(predicted)))
    title = f"averaging: {found.choices.averaging}"
    picture = Picture(
        "predictions", title, lambda path: draw_predictions({title: drawn}, "", path), lambda: prediction_table(drawn)
    )
    return Answer(
        title=f"Calibration: {found.law.label}",
        lines=[*filter(None, [words]), *([f"correlations: {', '.join(pairs)}"] if pairs else [])],
        table=parameter_table(found),
        caption="The parameters that were fitted, SI.",
        plain={**plain_fit(found), "predictions": list(predicted)},
        grids=grids,
        remarks=[
            f"{found.data} data, {len(names)} parameters, sum of squares {float(found.residuals.square().sum()):.4g} "
            f"({noise}); {title}"
        ],
        notes=found.notes,
        step="--predict other planes" if not predicted else "",
        pictures=[picture],
        source=source,
    )


def plain_fit(found: Fit) -> dict[str, Any]:
    """For JSON."""
    return {
        "law": found.law.label,
        "parameters": None if found.law.frequencies else parameter_table(found).as_rows(),
        "covariance": found.covariance.tolist(),
        "unseen": [list(group) for group in found.unseen],
        "sum_of_squares": float(found.residuals.square().sum()),
        "degrees_of_freedom": found.freedom,
        "noise_is_stated": found.stated,
        "averaging": found.choices.averaging,
        "seen_speeds": list(found.seen_speeds),
        "fitted": found.rows,
        "notes": list(found.notes),
    }


def of_identification(several: Sequence[Study], source: Path | None = None, predicted: Sequence[Row] = ()) -> Answer:
    """Laws, the one that predicts best first; its curve; what the planes see of it."""
    (found,) = several
    fit, (slowest, fastest) = found.fit, found.fit.seen_speeds
    seen = f"Seen: |v| of about {slowest:.3g} to {fastest:.3g} m/s"
    if fit.law.frequencies:
        seen += f"; the data determine {fit.determined:.1f} of {len(fit.values)} parameters"
    grids = [
        Grid("curve", "The law at a few speeds, with its 95 % band.", _curve(fit)),
        Grid("seen", "The |v| between which the Z of each plane is made.", _seen(fit)),
        Grid("left-out", "Each plane by a fit to the other runs.", prediction_table(found.rows)),
    ]
    if predicted:
        grids.append(Grid("predicted", "Other planes, by the fit.", prediction_table(predicted)))
    candidates = _candidates(found)
    return Answer(
        title=f"Identified law: {fit.law.label}",
        lines=[f"{fit.law.label} predicts best what it has not seen.", f"{seen}."],
        table=candidates,
        caption="Laws, the one that predicts best first.",
        plain={
            **plain_fit(fit),
            "models": candidates.as_rows(),
            "curve": grids[0].table.as_rows(),
            "seen": grids[1].table.as_rows(),
            "left_out": {each.label: each.rows for each in found.candidates},
            "predictions": list(predicted),
            "notes": list(found.notes),
        },
        grids=grids,
        notes=found.notes,
        pictures=[Picture("law", "R and X over |v|", partial(draw_identification, found), lambda: grids[0].table)],
        source=source,
    )


def _candidates(found: Study) -> Table:
    rows = []
    for each in found.candidates:
        spread = each.fit.standard.tolist()
        both = zip(each.fit.numbers.items(), spread, strict=True)
        values = ", ".join(f"{name} {value:.4g} +- {u:.2g}" for (name, value), u in both)
        values = "" if each.fit.law.frequencies else values
        about = {name: each[name] for name in ("label", "error", "lowest")}
        rows.append(Row(about, model=each.label, misfit=each.fit.misfit, values=values))
    return table_of(rows, "model,error,misfit,lowest,values")


def _seen(found: Fit) -> Table:
    """Of each plane: rms |v|, and the |v| between which its Z is made."""
    places, rows = iter(found.weights(found.runs)), []
    for run in found.runs:
        for frequency in run.frequency.tolist():
            below = next(places).cumsum(0)
            slowest, fastest = (float(found.knots.speeds[int((below < share).sum())]) for share in MOST)
            about = {"label": run.group, "frequency": frequency, "height": run.plane.height}
            rows.append(Row(about, rms=run.speed, slowest=slowest, fastest=fastest))
    return table_of(rows, "label,frequency,height,rms,slowest,fastest")


def _curve(found: Fit) -> Table:
    """The curve at a few speeds of every frequency, with its 95 % band."""
    speed, (slowest, fastest) = found.knots.top * torch.tensor(SPEEDS, dtype=torch.float64), found.seen_speeds
    rows = [
        Row(frequency=f, speed=v, impedance=z, low=low, high=high, seen=slowest <= v <= fastest)
        for f in sorted({f for run in found.runs for f in run.frequency.tolist()})
        for v, z, low, high in zip(speed.tolist(), *found.band(f, speed).tolist(), strict=True)
    ]
    return table_of(rows, "frequency,speed,impedance,band,seen")


# Validation


def drive_label(drive: str, mean: str) -> str:
    """'instantaneous' or 'instantaneous, mean removed'."""
    return drive + (", mean removed" if mean == "removed" else "")


def truth_table(rows: Sequence[Row]) -> Table:
    """For CSV and JSON."""
    return table_of(rows, "", TRUTH)


def of_validation(several: Sequence[Row], source: Path | None = None) -> Answer:
    """Every rule beside the reference impedance of resolved cases, and how far the default rules are off."""
    rows = list(several)
    cases = [[row for row in rows if row.case == case] for case in dict.fromkeys(row.case for row in rows)]
    grids = [
        Grid(
            f"case-{i}",
            f"{mine[0].case}: reference Z = {format_complex(mine[0].true)}.",
            by_phase(((row, row.educed) for row in mine), format_complex),
        )
        for i, mine in enumerate(cases)
    ]
    rules = errors_by_rule(rows)
    caption = f"Median |dR|, |dX| of each rule over {rules[0].planes} planes."
    grids.append(Grid("rules", caption, by_phase(((each, each.median) for each in rules), format_pair)))
    summary = [_summary(mine) for mine in cases]
    columns = [Column(name, heading=name, text=".3f" if isinstance(v, float) else "") for name, v in summary[0].items()]
    return Answer(
        title="Validation: |Z - Z_true| over all heights (ρc)",
        lines=[],
        table=truth_table(rows),
        brief=Table(summary, columns),
        plain=truth_table(rows).as_rows(),
        grids=[Grid("summary", "By case.", Table(summary, columns)), *grids],
        remarks=[
            f"Fails: off by more than {100 * TOLERABLE:g} % of |Z_true|. Default: phase averaged, instantaneous |v|, "
            "mean kept; every averaging at every height is counted. 'given' is the phase of the reference wave, which "
            "only a simulation knows."
        ],
        source=source,
    )


def by_phase(cells: Iterable[tuple[Row, complex]], written: Callable[[Any], str]) -> Table:
    """One row per height (if the cells have one), drive and averaging; one column per phase rule."""
    lines: dict[tuple[Any, ...], dict[str, Any]] = {}
    for cell, value in cells:
        key = (cell.get("height"), drive_label(cell.drive, cell.mean), cell.averaging)
        line = lines.setdefault(key, dict(zip(("height", "drive", "averaging"), key, strict=True)))
        line[cell.phase] = value
    shown = [Column("", name, name) for name in ("drive", "averaging")]
    if any(height is not None for height, *_ in lines):
        shown.insert(0, Column("", "height", "y (mm)", ".1f", 1e3))
    return Table(list(lines.values()), [*shown, *(Column("", phase, phase, written) for phase in PHASES)])


def _summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Of one case: errors of the default rules over the heights, of the best and worst rule."""
    true, within = abs(rows[0].true), []
    summary: dict[str, Any] = {"case": rows[0].case, "|Z_true|": true}
    for averaging in AVERAGINGS:
        errors = [row.error for row in rows if row.rule == DEFAULT and row.averaging == averaging]
        summary[f"default, {averaging}"] = f"{min(errors):.3f} to {max(errors):.3f}"
        within += [error < TOLERABLE * true for error in errors]
    best, worst = (choose(row.error for row in rows) for choose in (min, max))
    failed = f"fails in {within.count(False)} of {len(within)}"
    return summary | {"best": best, "worst": worst, "default": "holds" if all(within) else failed}

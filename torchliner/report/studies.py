"""Studies as text, and their tables for CSV and JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import torch

from torchliner.report.study_table import ends_of, if_known, table_of
from torchliner.report.table import Table, format_bounds, format_complex, format_references
from torchliner.studies.fit import Fit
from torchliner.studies.rows import Row, Study
from torchliner.studies.sensitivities import Sensitivities, correlation_of

SPEEDS = (0.0, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0)  # of the last knot, at which a curve is shown
MOST = 0.05, 0.95  # shares of a plane's weight between which its speeds are stated
JUDGED = "averaging,height,name,judged,limit,passed"
COMBINED = "combined"  # the row of the sum of a budget


# Audits, and maps and models beside each other


def audit_table(found: Study, *, everything: bool = False) -> Table:
    """A row a variant; with ``everything`` the base, its interval and what does not apply are rows too."""
    rows, base = [*found.rows], found.base
    if everything:
        ends = {"low": found.low, "high": found.high}
        first = [Row(factor="base", variant=found.averaging, impedance=base, level_check=found.level_check)]
        first += [Row(factor="interval", variant=name, impedance=z) for name, z in ends.items() if z is not None]
        left_out = [Row(factor=key, variant="does not apply", note=why) for key, why in found.skipped.items()]
        rows = [*(Row(row, change=row.impedance - base) for row in first), *rows, *left_out]
    return table_of(rows, "factor,variant,impedance,change of R,change of X" + if_known(found.rows, "level_check"))


def format_audit(found: Study) -> str:
    """Factors by how far they move Z; the base and its interval on top."""
    bounds = (
        "" if found.low is None else f"; {100 * found.level:g} % statistical interval {format_bounds(ends_of(found))}"
    )
    level = "" if found.level_check is None else f" {found.level_check:+.2f} dB"
    skipped = [f"  {factor}: {reason}" for factor, reason in found.skipped.items()]
    lines = [
        f"{found.title}, {found.frequency:g} Hz, whole liner, averaging {found.averaging}",
        f"base {format_complex(found.base)}{bounds}",
        f"level check{level or ':'} {found.level_check_words}\n",
        audit_table(found).as_text(),
        *(["\ndoes not apply to these data:", *skipped] if skipped else []),
        *([f"\n{found.nearest_case}"] if found.nearest_case else []),
        f"\nthe velocity was read through {found.readings} times for {len(found.rows)} variants",
    ]
    return "\n".join(lines)


def comparison_table(found: Study) -> Table:
    """A row a place and frequency."""
    return table_of(found.rows, "place,x,z,frequency,first,second,difference,interval,differs_in")


def models_table(found: Study) -> Table:
    """A row a frequency and model, the nearest first."""
    shown = "model" + (",frequency" if len({row.frequency for row in found.rows}) > 1 else "") + ",impedance"
    shown += "" if found.level is None else ",interval"
    shown += "".join(f",averagings.{name}" for name in found.rows[0].averagings if name != found.averaging)
    shown += if_known(found.rows, "level_check")
    return table_of(found.rows, shown + "".join(f",distance.{name}" for name in found.references) + ",model_error")


def format_models(found: Study) -> str:
    """The table, what it is sorted by, the references."""
    frequencies = dict.fromkeys(row.frequency for row in found.rows)
    at = f", {next(iter(frequencies)):g} Hz" if len(frequencies) == 1 else ""
    sorted_by = "models as given" if found.sorted_by == "as given" else f"by {found.sorted_by}"
    interval = "" if found.level is None else f"; {100 * found.level:g} % statistical interval"
    return "\n".join(
        [
            f"{found.title}{at}, whole liner, averaging {found.averaging}; {sorted_by}{interval}",
            models_table(found).as_text(),
            *format_references(found.references),
            f"level check: {found.level_check_words}",
        ]
    )


# Sensitivities


def slope_table(found: Sensitivities, averaging: str) -> Table:
    """A row a frequency and parameter: dZ per SI unit (slope) and per 1 % (step), largest first."""
    slopes, steps = found.liner[averaging], found.per_percent().liner[averaging]
    numbers = [*found.numbers.items()]
    rows = [
        Row(
            frequency=frequency,
            parameter=numbers[j][0],
            value=numbers[j][1].value,
            unit=numbers[j][1].unit,
            slope=complex(slopes[j, i]),
            step=complex(steps[j, i]),
        )
        for i, frequency in enumerate(found.found.frequency.tolist())
        for j in steps[:, i].abs().argsort(descending=True).tolist()
    ]
    return table_of(rows, "frequency,parameter,value,unit,slope of R,slope of X,step of R,step of X")


def budget_table(budget: Study, found: Sensitivities, averaging: str) -> Table:
    """A row a frequency and parameter, largest first, and one of the sum."""
    rows: list[Row] = []
    for i, frequency in enumerate(found.found.frequency.tolist()):
        rows += budget.of(averaging=averaging, frequency=frequency)
        nothing = dict.fromkeys(("value", "unit", "half_width", "standard"))
        total = complex(budget.combined[averaging][i])
        rows.append(Row(nothing, averaging=averaging, frequency=frequency, parameter=COMBINED, impedance=total))
    return table_of(rows, "frequency,parameter,value,unit,half_width,u(p),R,X")


def budget_notes(budget: Study, found: Sensitivities, averaging: str) -> list[str]:
    """The impedance at each frequency, and its correlation of R and X."""
    nominal = found.found.liner[averaging].impedance.tolist()
    return [
        f"{frequency:.1f} Hz: Z = {format_complex(nominal[i])}, correlation of R and X "
        f"{correlation_of(budget.covariance[averaging][i]):+.2f}; dR, dX: standard uncertainty, combined and by "
        "parameter"
        for i, frequency in enumerate(found.found.frequency.tolist())
    ]


# Fits


def parameter_table(found: Fit) -> Table:
    """A row a parameter: value, spread, bounds, interval; SI."""
    numbers, law = found.runs[0].liner.numbers(), found.law
    columns = zip(law.names, found.values, found.standard, *found.interval, law.low, law.high, strict=True)
    names = ("value", "standard", "lower_95", "upper_95", "lowest", "highest")
    rows = [
        Row(
            dict(zip(names, map(float, each), strict=True)),
            parameter=name,
            unit=numbers[name].unit,
            on_bound=name in found.on_bound,
        )
        for name, *each in columns
    ]
    return table_of(rows, "parameter,value,unit,u(p),range,bounds")


def prediction_table(rows: Sequence[Row]) -> Table:
    """Of rows of ``Fit.predict``, ``Fit.rows`` or those of runs left out."""
    names = ("fitted", "level_check", "true", "misses", "outside")
    return table_of(rows, "label,frequency,height,before,impedance,standard" + if_known(rows, *names))


def format_calibration(found: Fit) -> str:
    """Parameters, correlations, misfit."""
    names, spread = found.law.names, found.standard
    pairs = [
        f"{names[i]} and {names[j]} {float(found.covariance[i, j] / (spread[i] * spread[j])):+.2f}"
        for i in range(len(names))
        for j in range(i)
    ]
    effective = "none" if found.posterior is None else f"{found.posterior.effective:.0f}"
    noise = "stated noise" if found.stated else "noise from the residual"
    return "\n".join(
        [
            parameter_table(found).as_text(),
            *([f"correlations: {', '.join(pairs)}"] if pairs else []),
            prediction_table(found.rows).as_text(),
            f"{found.data} data, {len(names)} parameters, sum of squares {float(found.residuals.square().sum()):.4g} "
            f"({noise}); averaging: {found.choices.averaging}; independent draws: {effective}",
        ]
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


def candidate_table(found: Study) -> Table:
    """Laws, the one that predicts best first."""
    rows = []
    for each in found.candidates:
        spread = each.fit.widened.diagonal().sqrt().tolist()
        both = zip(each.fit.numbers.items(), spread, strict=True)
        values = ", ".join(f"{name} {value:.4g} +- {u:.2g}" for (name, value), u in both)
        values = "" if each.fit.law.frequencies else values
        about = {name: each[name] for name in ("label", "error", "lowest")}
        rows.append(Row(about, model=each.label, misfit=each.fit.misfit, values=values))
    return table_of(rows, "model,error,misfit,lowest,values")


def seen_table(found: Fit) -> Table:
    """Of each plane: rms |v|, and the |v| between which its Z is made."""
    places, rows = iter(found.weights(found.runs)), []
    for run in found.runs:
        for frequency in run.frequency.tolist():
            below = next(places).cumsum(0)
            slowest, fastest = (float(found.knots.speeds[int((below < share).sum())]) for share in MOST)
            about = {"label": run.group, "frequency": frequency, "height": run.plane.height}
            rows.append(Row(about, rms=run.speed, slowest=slowest, fastest=fastest))
    return table_of(rows, "label,frequency,height,rms,slowest,fastest")


def curve_table(found: Fit) -> Table:
    """The curve at a few speeds of every frequency, with its 95 % band."""
    speed, (slowest, fastest) = found.knots.top * torch.tensor(SPEEDS, dtype=torch.float64), found.seen_speeds
    rows = [
        Row(frequency=f, speed=v, impedance=z, low=low, high=high, seen=slowest <= v <= fastest)
        for f in sorted({f for run in found.runs for f in run.frequency.tolist()})
        for v, z, low, high in zip(speed.tolist(), *found.band(f, speed).tolist(), strict=True)
    ]
    return table_of(rows, "frequency,speed,impedance,band,seen")


def format_identification(found: Study) -> str:
    """All tables."""
    fit, (slowest, fastest) = found.fit, found.fit.seen_speeds
    seen = f"seen: |v| of about {slowest:.3g} to {fastest:.3g} m/s"
    if fit.law.frequencies:
        seen += f"; the data determine {fit.determined:.1f} of {len(fit.values)} parameters"
    parts = [
        candidate_table(found).as_text(),
        f"chosen, for it predicts best what it has not seen: {fit.law.label}",
        curve_table(fit).as_text(),
        seen_table(fit).as_text(),
        seen,
        f"each plane by a fit to the other runs\n{prediction_table(found.rows).as_text()}",
    ]
    return "\n\n".join(parts)


# Heights


def height_table(study: Study) -> Table:
    """A row a height: Z by averaging, and what else speaks of the height."""
    shown = "height" + "".join(f",impedance.{name}" for name in study.rows[0].impedance)
    shown += "".join(f",level_check.{name}" for name in study.rows[0].level_check)
    return table_of(study.rows, shown + ",coherence,velocity_rms,modulation,between" + if_known(study.rows, "drift"))


def format_heights(study: Study, found: Study) -> str:
    """Rows, decay, and which height."""
    sound = "" if study.pitch is None else f" (sound: {1e3 * study.pitch / (2 * math.pi):.3g} mm)"
    lines = [
        f"{study.title}, {study.frequency:g} Hz; Z is p/(rho c v), exp(+jwt), of the whole plane",
        height_table(study).as_text(),
    ]
    for name, words in (("decay", "cell-periodic modulation"), ("first_decay", "first harmonic of v_rms")):
        if study[name] is not None:
            length, scatter = 1e3 * study[name].length, study[name].scatter
            lines.append(
                f"{words}: exp(-y/l), l = {length:.3g} mm{sound}; heights stray from it by a factor {scatter:.3g}"
            )
    lines += [f"\nlevel check in dB, all else a share of 1\n{table_of(found.rows, JUDGED).as_text()}\n"]
    for name, height in found.heights.items():
        where = "no height of these qualifies" if height is None else f"y = {1e3 * height:.3g} mm is the lowest"
        lines.append(f"{name}: {where} where it holds")
    return "\n".join([*lines, *format_references(study.reference, "not used above: ")])

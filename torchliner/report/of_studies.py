"""The answers of studies: audit, comparison, models, sensitivities, heights."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from torchliner.report.answer import Answer, Grid, Picture, impedance_words, plain_of
from torchliner.report.curves import draw_comparison
from torchliner.report.studies import draw_audit, draw_contributions, draw_heights, draw_models, draw_modulation
from torchliner.report.table import bounds_of, format_complex, if_known, table_of
from torchliner.studies.rows import Row, Study
from torchliner.studies.sensitivities import Sensitivities, correlation_of

JUDGED = "averaging,height,name,judged,limit,passed"


def of_audit(several: Sequence[Study], source: Path | None = None) -> Answer:
    """What each open choice moves, the largest first; the base and its interval are rows of the CSV too."""
    (found,) = several
    shown = f"factor,variant,impedance,change of R,change of X{if_known(found.rows, 'level_check')}"
    bounds = bounds_of(found)
    level = "" if found.level_check is None else f" {found.level_check:+.2f} dB"
    base = Row(factor="base", variant=found.averaging, impedance=found.base, level_check=found.level_check)
    ends = {"low": found.low, "high": found.high}
    first = [base, *(Row(factor="interval", variant=name, impedance=z) for name, z in ends.items() if z is not None)]
    left_out = [Row(factor=key, variant="does not apply", note=why) for key, why in found.skipped.items()]
    rows = [*(Row(row, change=row.impedance - found.base) for row in first), *found.rows, *left_out]
    largest = found.rows[0] if found.rows else None
    lines = [
        f"{impedance_words(found.base, bounds, found.level)}, whole liner, averaging {found.averaging}, "
        f"{found.frequency:g} Hz.",
        f"Level check{level or ':'} {found.level_check_words}.",
    ]
    if largest is not None:
        lines.append(f"{largest.factor} moves Z most: {largest.variant}, by {format_complex(largest.change)}.")
    skipped = [f"{factor} does not apply: {reason}" for factor, reason in found.skipped.items()]
    worst = {row.factor: row for row in reversed(found.rows)}
    brief = [row for row in found.rows if row is worst[row.factor]]
    return Answer(
        title=f"Audit: {found.title}",
        lines=lines,
        table=table_of(rows, shown),
        brief=table_of(brief, shown),
        caption="Every variant and how far it moves Z.",
        plain=plain_of(found),
        remarks=[*skipped, *([found.nearest_case] if found.nearest_case else [])],
        notes=found.notes,
        step="" if largest is None else f"say why {largest.factor} is as it is: no other choice moves Z as far",
        pictures=[_picture("audit", f"{found.title}: what each choice moves", draw_audit, found, found.rows)],
        choices=found.choices,
        source=source,
    )


def _picture(name: str, caption: str, draw: Any, found: Any, rows: Sequence[Mapping[str, Any]]) -> Picture:
    return Picture(name, caption, partial(draw, found), lambda: table_of(rows))


def of_comparison(several: Sequence[Study], source: Path | None = None) -> Answer:
    """A row a place and frequency."""
    (found,) = several
    whole = [row for row in found.rows if row.place == "liner"]
    row = max(whole, key=lambda each: abs(each.difference))
    differs = f"differs in {row.differs_in}" if row.differs_in else "no difference is shown"
    words = impedance_words(row.difference, bounds_of(row), found.level).removeprefix("Z = ")
    shown = "place,frequency,first,second,difference,interval,differs_in"
    return Answer(
        title="Second map minus the first",
        lines=[f"Whole liner at {row.frequency:g} Hz: {words}; {differs}."],
        table=table_of(found.rows, shown),
        plain=plain_of(found),
        remarks=[found.words],
        pictures=[_picture("difference", "Second minus first", draw_comparison, found, found.rows)],
        source=source,
    )


def of_models(several: Sequence[Study], source: Path | None = None) -> Answer:
    """A row a frequency and model, the nearest first."""
    (found,) = several
    shown = "model" + ",frequency" * (len({row.frequency for row in found.rows}) > 1) + ",impedance"
    shown += ",interval" * (found.level is not None) + if_known(found.rows, "level_check")
    brief = shown + "".join(f",distance.{name}" for name in found.references)
    at = f", {found.rows[0].frequency:g} Hz" if len({row.frequency for row in found.rows}) == 1 else ""
    known = [f"{name}: {format_complex(value)}" for name, value in found.references.items()]
    known.append(f"Level check: {found.level_check_words}.")
    return Answer(
        title=f"Models: {found.title}",
        lines=[f"Whole liner{at}, averaging {found.averaging}; models by {found.sorted_by}.", *known],
        table=table_of(found.rows, f"{brief},model_error"),
        brief=table_of(found.rows, brief),
        caption="Z by each model.",
        plain=plain_of(found),
        notes=found.notes,
        pictures=[_picture("models", f"{found.title}: models", draw_models, found, found.rows)],
        source=source,
    )


def of_sensitivities(
    several: Sequence[Sensitivities],
    source: Path | None = None,
    averaging: str | None = None,
    budget: Study | None = None,
    limits: str = "rectangular",
) -> Answer:
    """dZ of each parameter per SI unit and per 1 %, or its share of a ``budget`` of uncertainty; largest first."""
    (found,) = several
    averaging, frequency = averaging or found.found.averaging, found.found.frequency.tolist()
    nominal = found.found.liner[averaging].impedance.tolist()
    rows, lines, total, together = list[Row](), list[str](), None, None
    if budget is None:
        shown, meaning = "frequency,parameter,value,unit,slope of R,slope of X,step of R,step of X", "p in its unit"
        slopes, steps = found.liner[averaging], found.per_percent().liner[averaging]
        numbers = [*found.numbers.items()]
        for i, f in enumerate(frequency):
            for j in steps[:, i].abs().argsort(descending=True).tolist():
                about = {"frequency": f, "parameter": numbers[j][0], "value": numbers[j][1].value}
                about |= {"unit": numbers[j][1].unit, "slope": complex(slopes[j, i]), "step": complex(steps[j, i])}
                rows.append(Row(about))
        lines = [f"Z = {format_complex(z)} at {f:g} Hz" for f, z in zip(frequency, nominal, strict=True)]
    else:
        shown, meaning = "frequency,parameter,value,unit,half_width,u(p),R,X", f"tolerances are {limits}"
        together = [correlation_of(each) for each in budget.covariance[averaging]]
        for i, f in enumerate(frequency):
            total = complex(budget.combined[averaging][i])
            rows += budget.of(averaging=averaging, frequency=f)
            nothing = dict.fromkeys(("value", "unit", "half_width", "standard"))
            rows.append(Row(nothing, averaging=averaging, frequency=f, parameter="combined", impedance=total))
            lines.append(
                f"Z = {format_complex(nominal[i])} at {f:g} Hz, standard uncertainty of R {total.real:.2g} and of X "
                f"{total.imag:.2g}, their correlation {together[i]:+.2f}"
            )
    first = [row for row in rows if row.frequency == frequency[0] and row.parameter != "combined"]
    sum_ = complex(budget.combined[averaging][0]) if budget is not None else None
    title = f"{found.found.title}, {frequency[0]:g} Hz, {averaging}; {meaning}"
    picture = Picture(
        "contributions", title, lambda path: draw_contributions(first, title, path, sum_), lambda: table_of(rows)
    )
    return Answer(
        title=f"Sensitivities: {found.found.title}" if found.found.title else "Sensitivities",
        lines=lines[:3],
        table=table_of(rows, shown),
        plain={
            "averaging": averaging,
            "limits": limits if budget is not None else None,
            "frequency": frequency,
            "impedance": nominal,
            "correlation_of_R_and_X": together,
            "rows": table_of(rows).as_rows(),
            "notes": [str(note) for note in found.found.notes],
        },
        remarks=[
            *lines[3:],
            f"Z over ρc, averaging {averaging}; {meaning}; first order.",
        ],
        notes=found.found.notes,
        pictures=[picture],
        results=[found.found],
        source=source,
    )


def of_heights(several: Sequence[Study], source: Path | None = None) -> Answer:
    """Z over height by averaging, what else speaks of a height, and which one, if a recommendation follows."""
    study, found = several[0], several[1] if len(several) > 1 else None
    brief = "height" + "".join(f",impedance.{name}" for name in study.rows[0].impedance)
    checks = "".join(f",level_check.{name}" for name in study.rows[0].level_check)
    brief += checks or if_known(study.rows, "coherence", "velocity_rms", "modulation")
    more = checks and if_known(study.rows, "coherence", "velocity_rms", "modulation")
    more += ",between" + if_known(study.rows, "drift").replace("drift", "drift of height")
    lines, grids = list[str](), list[Grid]()
    for name, height in ({} if found is None else found.heights).items():
        where = "no height qualifies" if height is None else f"y = {1e3 * height:.3g} mm is the lowest that qualifies"
        lines.append(f"{name}: {where}")
    step = ""
    if found is not None:
        judges = "level check" if found.rows[0].name == "level check" else "change with height"
        lines.append(f"Judged by the {judges}; no reference impedance is used.")
        step = "no plane of these will do: calibrate the liner, give a run without sound, or take other heights"
        if found.height is not None:
            step = f"torchliner educe with the plane at y = {1e3 * found.height:.3g} mm"
        grids.append(Grid("judged", "Level check in dB, all else a share of 1.", table_of(found.rows, JUDGED)))
    sound = "" if study.pitch is None else f" (sound: {1e3 * study.pitch / (2 * math.pi):.3g} mm)"
    remarks = [
        f"{words}: exp(-y/l), l = {1e3 * study[name].length:.3g} mm{sound}; heights stray from it by a factor "
        f"{study[name].scatter:.3g}"
        for name, words in (("decay", "cell-periodic modulation"), ("first_decay", "first harmonic of v_rms"))
        if study[name] is not None
    ]
    remarks += [f"not used above: {name}: {format_complex(z)}" for name, z in study.reference.items()]
    pictures = [_picture("heights", f"{study.title}: Z over height", draw_heights, study, study.rows)]
    if any(row.modulation is not None for row in study.rows):
        words = "Cell-periodic modulation over height"
        pictures.append(_picture("modulation", words, draw_modulation, study, study.rows))
    judged = {} if found is None else {"heights": found.heights, "height": found.height, "judged": plain_of(found.rows)}
    return Answer(
        title=f"Heights: {study.title}, {study.frequency:g} Hz",
        lines=lines,
        table=table_of(study.rows, brief + more),
        brief=table_of(study.rows, brief),
        caption="Each height, whole plane.",
        plain=plain_of(study) | judged,
        grids=grids,
        remarks=remarks,
        notes=study.notes,
        step=step,
        pictures=pictures,
        choices=study.choices,
        source=source,
    )

"""The answers of studies: audit, comparison, models, sensitivities, heights, impedance over level."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from torchliner.report import studies
from torchliner.report.answer import Answer, Grid, Picture, impedance_words
from torchliner.report.curves import draw_comparison
from torchliner.report.table import bounds_of, format_complex, rows_of, table_of
from torchliner.studies.sensitivities import Sensitivities, correlation_of
from torchliner.studies.variants import Row, Study
from torchliner.velocity.ir_tdibc_wall import LevelCurve


def of_audit(several: Sequence[Study], source: Path | None = None) -> Answer:
    """What each open choice moves, the largest first; the base and its interval are rows of the CSV too."""
    (found,) = several
    shown, level = "factor,variant,impedance,change.real,change.imag,level_check", found.level_check
    first = [Row(factor="base", variant=found.averaging, impedance=found.base, level_check=level)]
    ends = {"low": found.low, "high": found.high}
    first += [Row(factor="interval", variant=name, impedance=z) for name, z in ends.items() if z is not None]
    rows = [Row(row, change=row.impedance - found.base) for row in first] + list(found.rows)
    rows += [Row(factor=key, variant="does not apply", note=why) for key, why in found.skipped.items()]
    worst = {row.factor: row for row in reversed(found.rows)}  # the first of each, which moves Z most
    lines = [
        f"{impedance_words(found.base, bounds_of(found), found.level)}, whole liner, averaging {found.averaging}, "
        f"{found.frequency:g} Hz.",
        f"Level check{':' if level is None else f' {level:+.2f} dB'} {found.level_check_words}.",
    ]
    most = found.rows[0] if found.rows else None
    if most is not None:
        lines.append(f"{most.factor} moves Z most: {most.variant}, by {format_complex(most.change)}.")
    skipped = [f"{factor} does not apply: {reason}" for factor, reason in found.skipped.items()]
    words = f"{found.title}: what each choice moves"
    return Answer(
        title=f"Audit: {found.title}",
        lines=lines,
        table=table_of(rows, shown),
        brief=table_of([row for row in found.rows if row is worst[row.factor]], shown),
        caption="Every variant and how far it moves Z.",
        remarks=[*skipped, *([found.nearest_case] if found.nearest_case else [])],
        notes=found.notes,
        step="" if most is None else f"state which {most.factor} you take, and why: it moves Z most",
        pictures=[Picture("audit", words, partial(studies.draw_audit, found), lambda: found.rows)],
        results=[found],
        more=found,
        source=source,
    )


def of_comparison(several: Sequence[Study], source: Path | None = None) -> Answer:
    """A row a place and frequency."""
    (found,) = several
    row = max((row for row in found.rows if row.place == "liner"), key=lambda each: abs(each.difference))
    differs = f"differs in {row.differs_in}" if row.differs_in else "no difference is shown"
    words = impedance_words(row.difference, bounds_of(row), found.level).removeprefix("Z = ")
    return Answer(
        title="Second map minus the first",
        lines=[f"Whole liner at {row.frequency:g} Hz: {words}; {differs}."],
        table=table_of(found.rows, "place,frequency,first,second,difference,interval,differs_in"),
        remarks=[found.words],
        pictures=[Picture("difference", "Second minus first", partial(draw_comparison, found), lambda: found.rows)],
        more=found,
        source=source,
    )


def of_models(several: Sequence[Study], source: Path | None = None) -> Answer:
    """A row a frequency and model, the nearest first."""
    (found,) = several
    brief = "model,frequency,impedance,interval,level_check"
    brief += "".join(f",distance.{name}" for name in found.references)
    known = [f"{name}: {format_complex(value)}" for name, value in found.references.items()]
    check = f"Level check: {found.level_check_words}."
    return Answer(
        title=f"Models: {found.title}",
        lines=[f"Whole liner, averaging {found.averaging}; models by {found.sorted_by}.", *known, check],
        table=table_of(found.rows, f"{brief},model_error"),
        brief=table_of(found.rows, brief),
        caption="Z by each model.",
        notes=found.notes,
        pictures=[Picture("models", f"{found.title}: models", partial(studies.draw_models, found), lambda: found.rows)],
        more=found,
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
    nominal, rows, together, combined = found.found.liner[averaging].impedance.tolist(), list[Row](), [], None
    lines = [f"Z = {format_complex(z)} at {f:g} Hz" for f, z in zip(frequency, nominal, strict=True)]
    if budget is None:
        shown, meaning = "slope.real,slope.imag,step.real,step.imag", "p in its unit"
        columns = rows_of(
            frequency=found.found.frequency,
            parameter=[[name] for name in found.numbers],
            value=[[number.value] for number in found.numbers.values()],
            unit=[[number.unit] for number in found.numbers.values()],
            slope=found.liner[averaging],
            step=found.per_percent().liner[averaging],
        )
        rows = sorted(map(Row, columns), key=lambda row: (frequency.index(row.frequency), -abs(row.step)))
    else:
        shown, meaning = "half_width,standard,impedance.real,impedance.imag", f"tolerances are {limits}"
        together = [correlation_of(each) for each in budget.covariance[averaging]]
        for i, f in enumerate(frequency):
            total = complex(budget.combined[averaging][i])
            rows += budget.of(averaging=averaging, frequency=f)
            rows.append(Row(averaging=averaging, frequency=f, parameter="combined", impedance=total))
            combined = total if i == 0 else combined
            lines[i] += (
                f", standard uncertainty of R {total.real:.2g} and of X {total.imag:.2g}, "
                f"their correlation {together[i]:+.2f}"
            )
    first = [row for row in rows if row.frequency == frequency[0] and row.parameter != "combined"]
    title = f"{found.found.title}, {frequency[0]:g} Hz, {averaging}; {meaning}"
    draw = partial(studies.draw_contributions, first, title, total=combined)
    return Answer(
        title=f"Sensitivities: {found.found.title}",
        lines=lines[:3],
        table=table_of(rows, f"frequency,parameter,value,unit,{shown}"),
        remarks=[*lines[3:], f"Z over ρc, averaging {averaging}; {meaning}; first order."],
        notes=found.found.notes,
        pictures=[Picture("contributions", title, draw, lambda: rows)],
        results=[found.found],
        more={"averaging": averaging, "impedance": nominal, "correlation_of_R_and_X": together},
        source=source,
    )


def of_heights(several: Sequence[Study], source: Path | None = None) -> Answer:
    """Z over height by averaging, what else speaks of a height, and which one to take."""
    (study,) = several
    brief = "height" + "".join(f",impedance.{name}" for name in study.rows[0].impedance)
    checks = "".join(f",level_check.{name}" for name in study.rows[0].level_check)
    more, lines, remarks = ",coherence,velocity_rms,modulation", list[str](), list[str]()
    for name, height in study.heights.items():
        at = "no height qualifies" if height is None else f"y = {1e3 * height:.3g} mm is the lowest that qualifies"
        lines.append(f"{name}: {at}")
    judges = "level check" if study.judged[0].name == "level check" else "change with height"
    lines.append(f"Judged by the {judges}; no reference impedance is used.")
    step = "no plane of these will do: calibrate the liner, give a run without sound, or take other heights"
    if study.height is not None:
        step = f"torchliner educe with the plane at y = {1e3 * study.height:.3g} mm"
    if study.decay is not None:
        sound = "" if study.pitch is None else f" (sound: {1e3 * study.pitch / (2 * math.pi):.3g} mm)"
        remarks.append(f"cell-periodic modulation: exp(-y/l), l = {1e3 * study.decay:.3g} mm{sound}")
    drawn = [
        Row(height=row.height, averaging=name, impedance=z) for row in study.rows for name, z in row.impedance.items()
    ]
    hard = " (null test)" if study.choices.get("surface") == "hard wall" else ""
    title = f"{study.title}{hard}, {study.frequency:g} Hz"
    known = {"reference": study.reference["true"]} if "true" in study.reference else {}
    draw = partial(studies.draw_over_height, drawn, title, references=known)
    judged = table_of(study.judged, "averaging,height,name,value,limit,passed")
    return Answer(
        title=f"Heights: {study.title}, {study.frequency:g} Hz",
        lines=lines,
        table=table_of(study.rows, f"{brief}{checks}{more},between,drift"),
        brief=table_of(study.rows, brief + (checks or more)),
        caption="Each height, whole plane.",
        grids=[Grid("judged", "Level check in dB, all else a share of 1.", judged)],
        remarks=[*remarks, *(f"not used above: {name}: {format_complex(z)}" for name, z in study.reference.items())],
        notes=study.notes,
        step=step,
        pictures=[Picture("heights", f"{study.title}: Z over height", draw, lambda: study.rows)],
        results=[study],
        more=study,
        source=source,
    )


def of_curve(curves: Sequence[LevelCurve], source: Path | None = None) -> Answer:
    """One row per level and frequency; ``fixed_point`` is that of the lowest speed."""
    (curve,) = curves
    chosen, roots = curve.choices, curve.fixed_points
    rows = rows_of(
        level=curve.level[:, None],
        frequency=curve.frequency,
        impedance=curve.impedance,
        frozen=curve.frozen,
        **{name: getattr(curve, name)[:, None] for name in ("rms_speed", "peak_speed", "drift", "residual")},
        fixed_points=[[len(each)] for each in roots],
        fixed_point=[each[0].impedance.tolist() if each else [None] * len(curve.frequency) for each in roots],
    )
    kernel = f"kernel {chosen['kernel']}"
    if chosen["kernel"] != "periodic":
        low, high = chosen["kernel_band"]
        kernel += f", error in R {chosen['kernel_error']:.1e} on {low:g}-{high:g} Hz"
    line = f"A record of {1e3 * chosen['duration']:.4g} ms at {chosen['sampling_rate']:g} Hz, {kernel}."
    words = "Resistance and reactance over the level of the incident wave"
    return Answer(
        title=f"{chosen['liner']}: {chosen['incident']}",
        lines=[line],
        table=table_of(rows, "level,frequency,impedance,rms_speed,peak_speed,fixed_point,frozen,drift,residual"),
        brief=table_of(rows, "level,frequency,impedance,rms_speed,fixed_point"),
        remarks=["Z over ρc; fixed point: Z(rms v); frozen: what the kernel changes with |v| frozen at its rms."],
        pictures=[Picture("levels", words, partial(studies.draw_levels, curve), lambda: rows)],
        results=[curve],
        source=source,
    )

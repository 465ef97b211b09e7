"""Parameters, or the whole response Z(|v|), of a liner fitted to runs whose impedance is known.

``calibrate`` fits parameters within bounds, ``identify`` also curves over |v|; what it compares is how well each law
predicts the runs that it has not seen.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import torch

from torchliner.checks import require_choice, tell
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.liners.sdof import AdjustedSDoFLiner, EndLossSDoFLiner, FlowSDoFLiner, SDoFLiner
from torchliner.records import VelocityPlane
from torchliner.studies.fit import Fit, fit_law
from torchliner.studies.laws import Knots, Law, bounds_for, curve_law, parameter_law
from torchliner.studies.runs import Run, choices_of_fit, held, knots_for, read_runs
from torchliner.studies.variants import Records, Row, Study
from torchliner.velocity.choices import Choices

AVERAGING = "phase-locked"  # without flow
NOISE = 0.005 + 0.05j  # of R and X: two ways of measuring one run differ by 0.002 to 0.015 in X, the model by more
LEFT_OUT = 1e3  # u(X) with which a reactance does not count
QUIET = 0.02  # Mach number that counts as no flow
CURVE = "curve"
FREEDOMS = (0.1, 0.3, 1.0, 3.0)  # of which leaving out chooses
CHECKED = 400  # |v| at which a fit must be passive


def calibrate(
    planes: VelocityPlane | Moments | Sequence[VelocityPlane | Moments],
    liners: Liner | Sequence[Liner],
    references: Any,
    parameters: Mapping[str, tuple[float, float]],
    *,
    averaging: str = "velocity",
    noise: complex | None = None,
    frequency: Any = None,
    **choices: Any,
) -> Fit:
    """Fit parameters to reference impedances, phase ``averaged``.

    Args:
        planes: one or several, or their moments.
        liners: that state ``numbers``, one for all planes, or one each, which share the free parameters.
        references: normalised Z by plane, complex, (F,) each, or the name of a reference that every plane holds.
        parameters: bounds, SI, by name of ``liner.numbers()``; ``offset`` is both parts.
        averaging: one of ``names.AVERAGINGS``.
        noise: standard uncertainty of R and X of the references, one number or u(R) + j u(X); default 2 % of |Z|.
            Misfits above it widen every uncertainty.
        frequency: Hz; default each plane's tone.
        choices: as for ``educe``; float64 unless ``dtype`` says otherwise.
    Source: Gauss-Newton covariance: Seber & Wild, Nonlinear Regression (1989), section 2.1.
    """
    chosen = choices_of_fit(averaging=averaging, **choices)
    runs = read_runs(planes, liners, frequency, chosen)
    law = parameter_law(parameters, runs[0].liner)
    return _told(fit_law(law, held(runs, references, noise), chosen, knots_for(runs)))


def _told(fit: Fit) -> Fit:
    """With the warnings of its planes too."""
    tell(notes := (*(note for run in fit.runs for note in run.notes), *fit.notes))
    return replace(fit, notes=notes)


def calibrate_without_flow(
    planes: Sequence[Records], liner: Any, references: Any = "true", *, noise: complex = NOISE, **choices: Any
) -> tuple[Fit, Mapping[str, float]]:
    """Fit a liner to runs without flow at one or several levels, with the law of lost mass that predicts them best.

    Free are the contraction coefficient and, with two levels or more, both parts of the linear offset. The law is that
    of the liner, or ``EndLossSDoFLiner`` if it predicts reactances better that it was not fitted to: each but that of
    the lowest level is left out in turn (of a single run its own).

    Arguments are as of ``calibrate``; averaging ``phase-locked`` by default. Returns the fit, and by law the rms error
    of the reactances that were left out.
    """
    model, chosen = as_liner(liner), choices_of_fit(**{"averaging": AVERAGING, **choices})
    if not isinstance(model, SDoFLiner):
        raise TypeError(f"liner is {type(model).__name__}; an SDoFLiner is calibrated without flow, others with --free")
    runs = held(read_runs(planes, model, None, chosen), references, noise)
    for plane in (run.plane for run in runs if (run.plane.mach or 0.0) > QUIET):
        raise ValueError(f"{plane.name} states Mach number {plane.mach:g}; give runs without flow, or --free")
    levels, free = [run.plane.incident_level or 0.0 for run in runs], {"vena_contracta": (0.2, 1.0)}
    if len(set(levels)) > 1:
        for name in model.groups["offset"]:
            value = model.numbers()[name].value
            free[name] = value - 0.5, value + 0.5
    laws, found = {"as given": model}, dict[str, tuple[float, Fit]]()
    if not isinstance(model, EndLossSDoFLiner):
        laws["end loss"] = EndLossSDoFLiner.of(model)
    for name, made in laws.items():
        own, errors = [replace(run, liner=made) for run in runs], list[float]()
        law, knots = parameter_law(free, made), knots_for(own)
        for level in sorted(set(levels))[1:] or levels[:1]:
            out = [each == level for each in levels]
            blind = (replace(run, noise=complex(run.noise.real, LEFT_OUT)) for run in own)
            mixed = [other if left else run for run, other, left in zip(own, blind, out, strict=True)]
            rows = zip(fit_law(law, mixed, chosen, knots).rows, out, strict=True)
            errors += [(row.impedance - row.true).imag for row, left in rows if left]
        score = float(torch.tensor(errors).square().mean().sqrt())
        found[name] = score, fit_law(law, own, chosen, knots)
    _, best = min(found.values(), key=lambda each: each[0])
    return _told(best), {name: score for name, (score, _) in found.items()}


def identify(
    planes: VelocityPlane | Moments | Sequence[VelocityPlane | Moments],
    liner: Liner,
    references: Any = "true",
    *,
    models: Sequence[str | Sequence[str] | Mapping[str, tuple[float, float]]] = (CURVE,),
    averaging: str = "phase-locked",
    noise: complex | None = None,
    rest: complex | None = None,
    freedom: float | None = None,
    frequency: Any = None,
    **choices: Any,
) -> Study:
    """The response Z(f, |v|) of a liner, found from runs whose impedance is known.

    Args:
        planes, references, averaging, noise, frequency, choices: as for ``calibrate``. Planes of one case (heights,
            cells) share one reference and are left out together.
        liner: cells, gas, the prior shape of the curve, the law whose parameters are freed. SDoF liners take factors
            (``AdjustedSDoFLiner``) and the Mach number of each plane.
        models: "curve", names of parameters (with usual bounds), or bounds in SI by name. Which of them predicts best
            what it has not seen is found by leaving out each run.
        rest: standard uncertainty u(R) + j u(X) of the liner's own Z at rest, where that was measured; by default R is
            free within factors of e and X within 0.5.
        freedom: of a curve, see ``studies.laws``; default that of 0.1, 0.3, 1 and 3 which predicts best.
    Returns:
        fit (of the best law to all runs), rows (as of ``Fit.predict`` by a fit to the other runs; fitted: Z by the fit
        to all), notes, candidates (all laws, the best first: label, fit, rows; error: rms over the runs of ``off``;
        lowest: least resistance over 0 to the largest |v| of the data).
    Source: Roncen et al. (2026), section 3, inverted; monotone splines by sums of B-splines after Ramsay, Statistical
        Science 3 (1988) 425, the logarithms of whose coefficients are free.
    """
    chosen, model, laws = choices_of_fit(averaging=averaging, **choices), with_flow(as_liner(liner)), list[Law]()
    for names in (names for names in models if names != CURVE):
        if isinstance(names, str):
            require_choice("model", names, [CURVE])
        bounds = dict(names) if isinstance(names, Mapping) else bounds_for(names, model)
        laws.append(parameter_law(bounds, model))
    runs = held(read_runs(planes, model, frequency, chosen), references, noise)
    fewest, seen = (3 if CURVE in models else 2), list(dict.fromkeys(run.case for run in runs))
    if len(seen) < fewest:  # where one is left out, the others are still to say something
        raise ValueError(
            f"{len(seen)} run(s) ({', '.join(seen)}) cannot tell: each is left out in turn, and at least {fewest} are "
            "needed; planes of one case count as one run: add levels or flows"
        )
    knots = knots_for(runs)
    if CURVE in models:
        lines = torch.cat([run.frequency for run in runs]).unique().tolist()
        walks = FREEDOMS if freedom is None else (freedom,)
        laws += [curve_law(runs[0].in_flow, lines, knots, walk, rest) for walk in walks]
    candidates = sorted((_leave_out(law, runs, chosen, knots) for law in laws), key=lambda c: (c.lowest < 0, c.error))
    if not candidates or candidates[0].lowest < 0:
        why = f"R falls to {candidates[0].lowest:.3g} with {candidates[0].label}" if candidates else "no model is named"
        raise ValueError(f"no fit is passive: {why}; fit a curve, which is, or narrow the bounds")
    best = candidates[0]
    notes = [*(note for run in runs for note in run.notes), *best.fit.notes]
    active = [each for each in candidates if each.lowest < 0]
    notes += [f"{each.label} is not passive: R falls to {each.lowest:.3g}; it was not chosen" for each in active]
    tell(notes)
    return Study(fit=best.fit, rows=best.rows, candidates=tuple(candidates), notes=tuple(notes))


def with_flow(liner: LinerModel) -> LinerModel:
    """An SDoF liner takes the Mach number of each plane, and factors unless its own law takes one; others stay."""
    if isinstance(liner, FlowSDoFLiner):
        return liner.replace(mach=None)
    return AdjustedSDoFLiner.of(liner) if isinstance(liner, SDoFLiner) else liner


def _leave_out(law: Law, runs: Sequence[Run], choices: Choices, knots: Knots) -> Row:
    """Fit to all runs, then without the planes of each case."""
    fit, found, errors = fit_law(law, runs, choices, knots), dict[int, list[Row]](), list[float]()
    for case in dict.fromkeys(run.case for run in runs):
        left = fit_law(law, [run for run in runs if run.case != case], choices, knots)
        mine = {id(run): left.rows_of(run) for run in runs if run.case == case}
        off = [row.off for rows in mine.values() for row in rows]
        errors.append(sum(each**2 for each in off) / len(off))
        found |= mine
    both = zip((row for run in runs for row in found[id(run)]), fit.rows, strict=True)
    speeds = torch.linspace(0, knots.top**0.5, CHECKED, dtype=torch.float64).square()
    lowest = min(float(law.curve(fit.values, run.in_flow, run.frequency, speeds).real.min()) for run in runs)
    rows, error = tuple(Row(row, fitted=own.impedance) for row, own in both), (sum(errors) / len(errors)) ** 0.5
    return Row(label=law.label, fit=fit, rows=rows, error=error, lowest=lowest)

"""Parameters, or the whole response Z(|v|), of a liner fitted to runs whose impedance or level is known.

``calibrate`` fits parameters within bounds, ``identify`` also curves over |v|; what it compares is how well each law
predicts the runs that it has not seen.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import torch

from torchliner.checks import SAME_FREQUENCY, require_choice, tell
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, LinerModel, as_liner, named_numbers
from torchliner.liners.sdof import EndLossSDoFLiner, SDoFLiner
from torchliner.records import VelocityPlane
from torchliner.studies.fit import Fit, fit_law, with_flow
from torchliner.studies.laws import Knots, Law, bounds_for, curve_law, parameter_law, place_of
from torchliner.studies.runs import LEVEL_CHECK, Run, choices_of_fit, held, knots_for, one_each, read_runs
from torchliner.studies.variants import Records, Row, Study, plane_of
from torchliner.velocity.choices import Choices
from torchliner.velocity.educe import moments

AVERAGING = "phase-locked"  # without flow
NOISE = 0.005 + 0.05j  # of R and X: two ways of measuring one run differ by 0.002 to 0.015 in X, the model by more
LEFT_OUT = 1e3  # u(X) with which a reactance does not count
QUIET = 0.02  # Mach number that counts as no flow
CURVE = "curve"
FREEDOMS = (0.1, 0.3, 1.0, 3.0)  # of which leaving out chooses
SPREAD = 1.25  # ratio of the rms |v| of the fastest and the slowest run
SHARE, LEVEL_NOISE = 0.02, 0.2  # of |Z|, and dB: noise of references for which none is stated
CHECKED = 400  # |v| at which a fit must be passive
WIDE = 3.0  # standard deviations, beyond which a prediction is not covered


def calibrate(
    planes: VelocityPlane | Moments | Sequence[VelocityPlane | Moments],
    liners: Liner | Sequence[Liner],
    references: Any,
    parameters: Mapping[str, tuple[float, float]],
    *,
    averaging: str = "velocity",
    noise: Any = None,
    frequency: Any = None,
    **choices: Any,
) -> Fit:
    """Fit parameters to reference impedances, or to known levels, phase ``averaged``.

    Args:
        planes: one or several, or their moments.
        liners: that state ``numbers``, one for all planes, or one each, which share the free parameters.
        references: normalised Z by plane, complex, (F,) each; the name of a reference that every plane holds, such as
            "true"; or "level-check", the stated level alone: one datum a plane and frequency.
        parameters: bounds, SI, by name of ``liner.numbers()``; ``offset`` is both parts.
        averaging: one of ``names.AVERAGINGS``.
        noise: standard uncertainty of R and X of each reference: one number, a complex number u(R) + j u(X), or one by
            plane; of levels dB. None: equal and unknown, taken from the residual.
        frequency: Hz; default each plane's tone.
        choices: as for ``educe``; float64 unless ``dtype`` says otherwise.
    Raises:
        TypeError: a liner without numbers.
        ValueError: fewer data (R and X of each plane and frequency) than parameters, bounds that no liner can have,
            references that are missing.
        RuntimeError: the least squares do not converge.
    Warns:
        DataWarning: a parameter on a bound, parameters that cannot be told apart, a misfit beyond the stated noise;
            also kept in ``notes``.
    Source: Gauss-Newton covariance and Student's t for unknown noise: Seber & Wild, Nonlinear Regression (1989),
        section 2.1. Trust-region reflective steps of scipy.
    """
    chosen = choices_of_fit(averaging=averaging, **choices)
    first = liners[0] if isinstance(liners, list | tuple) and liners else liners
    law = parameter_law(parameters, as_liner(first))
    runs = held(read_runs(planes, liners, frequency, chosen), references, noise)
    for run in runs[1:]:
        named_numbers(run.liner, law.names)
    fit = fit_law(law, runs, chosen, knots_for(runs), stated=noise is not None)
    tell(notes := (*(note for run in runs for note in run.notes), *fit.notes))
    return dataclasses.replace(fit, notes=notes)


def calibrate_without_flow(
    planes: Sequence[Records], liner: Any, references: Any = "true", *, noise: complex | None = None, **choices: Any
) -> tuple[Fit, Mapping[str, float]]:
    """Fit a liner to runs without flow at one or several levels, with the law of lost mass that predicts them best.

    Free are the contraction coefficient and, with two levels or more, both parts of the linear offset. The law is that
    of the liner, or ``EndLossSDoFLiner`` with its usual coefficients if it predicts reactances better that it was not
    fitted to: each but that of the lowest level is left out in turn (of a single run its own).

    Args:
        planes, references, choices: as of ``calibrate``, without flow; averaging ``phase-locked`` by default.
        liner: geometry, and the linear offset where there is one level alone.
        noise: standard uncertainty, u(R) + j u(X); default 0.005 + 0.05j, mostly of the model.
    Returns:
        The fit, and by law the rms error of the reactances that were left out.
    Raises:
        ValueError: a plane with flow; as ``calibrate``.
        TypeError: the liner is no ``SDoFLiner``.
    """
    model, several = as_liner(liner), [planes] if isinstance(planes, Records) else list(planes)
    if not isinstance(model, SDoFLiner):
        raise TypeError(f"liner is {type(model).__name__}; an SDoFLiner is calibrated without flow, others with --free")
    for plane in map(plane_of, several):
        if (plane.mach or 0.0) > QUIET:
            raise ValueError(f"{plane.name} states Mach number {plane.mach:g}; give runs without flow, or --free")
    chosen = {"averaging": AVERAGING, **choices}
    read = {"cell_pitch": model.cell_pitch, **chosen}
    known = [each if isinstance(each, Moments) else moments(each, **read) for each in several]
    levels = [plane_of(each).incident_level or 0.0 for each in known]
    free, usual = {"vena_contracta": (0.2, 1.0)}, complex(NOISE if noise is None else noise)
    if len(set(levels)) > 1:
        offset = complex(torch.as_tensor(model.impedance_offset))
        free["offset_resistance"] = offset.real - 0.5, offset.real + 0.5
        free["offset_reactance"] = offset.imag - 0.5, offset.imag + 0.5
    laws: dict[str, LinerModel] = {"as given": model}
    if not isinstance(model, EndLossSDoFLiner):
        laws["end loss"] = EndLossSDoFLiner.of(model)
    scores = {}
    for name, law in laws.items():
        errors = []
        for level in sorted(set(levels))[1:] or levels[:1]:
            spread = [complex(usual.real, LEFT_OUT) if each == level else usual for each in levels]
            rows = zip(calibrate(known, law, references, free, noise=spread, **chosen).rows, levels, strict=True)
            errors += [(row.impedance - row.true).imag for row, each in rows if each == level]
        scores[name] = float(torch.tensor(errors).square().mean().sqrt())
    best = laws[min(scores, key=lambda name: scores[name])]
    return calibrate(known, best, references, free, noise=usual, **chosen), scores


def identify(
    planes: VelocityPlane | Moments | Sequence[VelocityPlane | Moments],
    liners: Liner | Sequence[Liner],
    references: Any = "true",
    *,
    models: Sequence[str | Sequence[str] | Mapping[str, tuple[float, float]]] = (CURVE,),
    groups: Sequence[str] | None = None,
    averaging: str = "phase-locked",
    noise: Any = None,
    rest: complex | None = None,
    freedom: float | None = None,
    frequency: Any = None,
    **choices: Any,
) -> Study:
    """The response Z(f, |v|) of a liner, found from runs whose impedance is known.

    Args:
        planes, references, averaging, frequency, choices: as for ``calibrate``.
        liners: one for all planes, or one each: cells, gas, the prior shape of the curve (that of the first;
            differences of Z at rest stay), the law whose parameters are freed. SDoF liners take factors
            (``AdjustedSDoFLiner``) and the Mach number of each plane.
        models: "curve", names of parameters (with usual bounds), or bounds in SI by name. Which of them predicts best
            what it has not seen is found by leaving out each run.
        groups: label of the run of each plane: planes of one run (heights, cells) share one reference and are left out
            together. Default the case of its provenance, else its name.
        noise: as for ``calibrate``; 2 % of |Z|, 0.2 dB by default. Misfits above it widen every uncertainty.
        rest: standard uncertainty u(R) + j u(X) of the liner's own Z at rest, where that was measured; by default R is
            free within factors of e and X within 0.5.
        freedom: of a curve, see ``studies.laws``; default that of 0.1, 0.3, 1 and 3 which predicts best.
    Returns:
        fit (of the law that predicts runs it has not seen best, to all runs), rows (as of ``Fit.predict`` by a fit to
        the other runs; fitted: Z by the fit to all), notes, candidates (all laws, the best first: label, fit, rows;
        error: rms over the runs of ``off``; lowest: least resistance over 0 to the largest |v| of the data).
    Raises:
        ValueError: too few runs, runs at one speed, references that are missing or that no passive liner can give,
            unknown parameters, fits none of which is passive.
        TypeError: parameters of a liner without numbers.
    Warns:
        DataWarning: predictions at speeds that no other run saw, misfits above the noise, predictions that their
            uncertainty does not cover; also kept in ``notes``.
    Source: Roncen et al. (2026), section 3, inverted; monotone splines by sums of B-splines after Ramsay, Statistical
        Science 3 (1988) 425, the logarithms of whose coefficients are free.
    """
    chosen = choices_of_fit(averaging=averaging, **choices)
    several = list(liners) if isinstance(liners, list | tuple) else [liners]
    made = {id(each): with_flow(as_liner(each)) for each in several}  # planes of one liner share one object
    given = [made[id(each)] for each in several]
    laws = list[Law]()
    for names in (names for names in models if names != CURVE):
        if isinstance(names, str):
            require_choice("model", names, [CURVE])
        bounds = dict(names) if isinstance(names, Mapping) else bounds_for(names, given[0])
        if "mach" in bounds:
            raise ValueError("mach is that of each plane and cannot be free; free mach_resistance or mach_mass_loss")
        laws.append(parameter_law(bounds, given[0]))
    runs = read_runs(planes, given if isinstance(liners, list | tuple) else given[0], frequency, chosen, any_curve=True)
    own = [str(run.plane.provenance.get("case") or run.plane.name) for run in runs]
    named = one_each("groups", own if groups is None else groups, runs)
    fewest, seen = (3 if CURVE in models else 2), list(dict.fromkeys(map(str, named)))
    if len(seen) < fewest:  # where one is left out, the others are still to say something
        raise ValueError(
            f"{len(seen)} run(s) ({', '.join(seen)}) cannot tell: each is left out in turn, and at least {fewest} are "
            "needed; planes of one case count as one run: add levels or flows, or name groups"
        )
    runs = held(runs, references, LEVEL_NOISE if noise is None and str(references) == LEVEL_CHECK else noise)
    runs = [_passive(run, str(group), noise is None) for run, group in zip(runs, named, strict=True)]
    knots = knots_for(runs)
    if CURVE in models:
        speeds = [run.speed for run in runs]
        if not max(speeds) >= SPREAD * min(speeds):
            raise ValueError(
                f"all runs are at one speed: rms |v| is {min(speeds):.3g} to {max(speeds):.3g} m/s (a ratio of "
                f"{SPREAD:g} is needed to tell a curve over |v|); add runs at other levels, or fit one parameter"
            )
        lines: list[float] = []
        for f in sorted(f for run in runs for f in run.frequency.tolist()):
            lines += [f] if not lines or f > lines[-1] * (1 + SAME_FREQUENCY) else []
        walks = FREEDOMS if freedom is None else (freedom,)
        laws += [curve_law(runs[0].in_flow, lines, knots, walk, rest) for walk in walks]
    candidates = sorted((_leave_out(law, runs, chosen, knots) for law in laws), key=lambda c: (c.lowest < 0, c.error))
    if not candidates or candidates[0].lowest < 0:
        why = f"R falls to {candidates[0].lowest:.3g} with {candidates[0].label}" if candidates else "no model is named"
        raise ValueError(f"no fit is passive: {why}; fit a curve, which is, or narrow the bounds")
    best = candidates[0]
    notes = [*(note for run in runs for note in run.notes), *best.fit.notes]
    notes += [f"without it, {text}" for text in best.beyond]
    far = [row.label for row in best.rows if row.misses and max(abs(row.misses.real), abs(row.misses.imag)) > WIDE]
    if far:
        notes.append(
            f"{', '.join(dict.fromkeys(far))}: predicted by the other runs, off by more than {WIDE:g} standard "
            "deviations; the uncertainty of the fit does not cover what its law misses"
        )
    active = [each for each in candidates if each.lowest < 0]
    notes += [f"{each.label} is not passive: R falls to {each.lowest:.3g}; it was not chosen" for each in active]
    tell(notes)
    return Study(fit=best.fit, rows=best.rows, candidates=tuple(candidates), notes=tuple(notes))


def _leave_out(law: Law, runs: Sequence[Run], choices: Choices, knots: Knots) -> Row:
    """Fit to all runs, then without each group of planes that share one run."""
    fit, found, errors = fit_law(law, runs, choices, knots, stated=True), dict[int, list[Row]](), list[float]()
    beyond: list[str] = []
    for group in dict.fromkeys(run.group for run in runs):
        others = [run for run in runs if run.group != group]
        left = fit_law(law, others, choices, knots, stated=True)
        mine = {i: run for i, run in enumerate(runs) if run.group == group}
        for i, run in mine.items():
            for f in run.frequency.tolist() if law.frequencies else ():
                place_of([g for other in others for g in other.frequency.tolist()], f)
            found[i] = left.rows_of(run)
            beyond += [text for row in found[i] for text in left.beyond(row.label, row.outside)]
        off = [row.off for i in mine for row in found[i]]
        errors.append(sum(each**2 for each in off) / len(off))
    both = zip((row for i in range(len(runs)) for row in found[i]), fit.rows, strict=True)
    rows = tuple(Row(row, fitted=own.impedance) for row, own in both)
    speeds = torch.linspace(0, knots.top**0.5, CHECKED, dtype=torch.float64).square()
    lowest = min(float(law.curve(fit.values, run.in_flow, run.frequency, speeds).real.min()) for run in runs)
    error = (sum(errors) / len(errors)) ** 0.5
    return Row(label=law.label, fit=fit, rows=rows, error=error, lowest=lowest, beyond=beyond)


def _passive(run: Run, group: str, own_noise: bool) -> Run:
    """The run, whose reference a passive liner can give, with the usual noise where none is stated."""
    run = dataclasses.replace(run, group=group)
    if run.wanted is None:
        return run
    if (lowest := float(run.wanted.real.min())) < 0:
        raise ValueError(
            f"{run.plane.name}: its reference has a resistance of {lowest:.3g}; the response of a passive liner cannot "
            "give it: leave that plane out"
        )
    usual = SHARE * run.wanted.abs()
    return dataclasses.replace(run, noise=torch.complex(usual, usual)) if own_noise else run

"""The response of a liner found from runs whose impedance, or level, is known.

What is fitted is a curve Z(|v|) at each frequency, or parameters of the liner's law, as ``calibrate`` fits them; what
is compared is how well each of them predicts the runs that it has not seen.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import torch

from torchliner.checks import SAME_FREQUENCY, require_choice, tell
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.records import VelocityPlane
from torchliner.studies.fit import fit_law, with_flow
from torchliner.studies.laws import Curves, Knots, Law, bounds_for, parameter_law, place_of
from torchliner.studies.runs import LEVEL_CHECK, Run, choices_of_fit, held, one_each, read_runs
from torchliner.studies.solve import knots_for
from torchliner.studies.variants import Row, Study
from torchliner.velocity.choices import Choices

CURVE = "curve"
FREEDOMS = (0.1, 0.3, 1.0, 3.0)  # of which leaving out chooses
SPREAD = 1.25  # ratio of the rms |v| of the fastest and the slowest run
SHARE, LEVEL_NOISE = 0.02, 0.2  # of |Z|, and dB: noise of references for which none is stated
CHECKED = 400  # |v| at which a fit must be passive
WIDE = 3.0  # standard deviations, beyond which a prediction is not covered


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
    chosen, given = choices_of_fit(averaging=averaging, **choices), liners
    if isinstance(given, list | tuple):
        made = {id(each): with_flow(as_liner(each)) for each in given}  # planes of one liner share one object
        given = [made[id(each)] for each in given]
    else:
        given = with_flow(as_liner(given))
    laws = [law for names in models for law in _parameter_law(names, given[0] if isinstance(given, list) else given)]
    runs = read_runs(planes, given, frequency, chosen, any_curve=True)
    own = [str(run.plane.provenance.get("case") or run.plane.name) for run in runs]
    named = one_each("groups", own if groups is None else groups, runs)
    runs = [dataclasses.replace(run, group=str(name)) for run, name in zip(runs, named, strict=True)]
    fewest, seen = (3 if CURVE in models else 2), list(dict.fromkeys(run.group for run in runs))
    if len(seen) < fewest:  # where one is left out, the others are still to say something
        raise ValueError(
            f"{len(seen)} run(s) ({', '.join(seen)}) cannot tell: each is left out in turn, and at least {fewest} are "
            "needed; planes of one case count as one run: add levels or flows, or name groups"
        )
    runs = held(runs, references, LEVEL_NOISE if noise is None and str(references) == LEVEL_CHECK else noise)
    runs = [_passive(run, own_noise=noise is None) for run in runs]
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
        laws += [Curves(runs[0].in_flow, lines, knots, walk, rest).law() for walk in walks]
    candidates = sorted((candidate_of(law, runs, chosen, knots) for law in laws), key=lambda c: (c.lowest < 0, c.error))
    if not candidates or candidates[0].lowest < 0:
        why = f"R falls to {candidates[0].lowest:.3g} with {candidates[0].label}" if candidates else "no model is named"
        raise ValueError(f"no fit is passive: {why}; fit a curve, which is, or narrow the bounds")
    best = candidates[0]
    notes = [*(note.text for run in runs for note in run.notes), *best.fit.notes]
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


def candidate_of(law: Law, runs: Sequence[Run], choices: Choices, knots: Knots) -> Row:
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


def _parameter_law(names: Any, liner: LinerModel) -> list[Law]:
    """That of a model of parameters; none of a curve, whose knots are not known yet."""
    if isinstance(names, str):
        require_choice("model", names, [CURVE])
        return []
    bounds = dict(names) if isinstance(names, Mapping) else bounds_for(names, liner)
    if "mach" in bounds:
        raise ValueError("mach is that of each plane and cannot be free; free mach_resistance or mach_mass_loss")
    return [parameter_law(bounds, liner)]


def _passive(run: Run, own_noise: bool) -> Run:
    """The run, whose reference a passive liner can give, with the usual noise where none is stated."""
    if run.wanted is None:
        return run
    if (lowest := float(run.wanted.real.min())) < 0:
        raise ValueError(
            f"{run.plane.name}: its reference has a resistance of {lowest:.3g}; the response of a passive liner cannot "
            "give it: leave that plane out"
        )
    usual = SHARE * run.wanted.abs()
    return dataclasses.replace(run, noise=torch.complex(usual, usual)) if own_noise else run

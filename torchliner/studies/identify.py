"""The response of a liner found from runs whose impedance, or level, is known.

What is fitted is a curve Z(|v|) at each frequency, or parameters of the liner's law, as ``calibrate`` fits them; what
is compared is how well each of them predicts the runs that it has not seen.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import torch

from torchliner.checks import SAME_FREQUENCY, require_choice, tell
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, LinerModel, named_numbers
from torchliner.names import AVERAGINGS
from torchliner.pressure.dean import in_situ
from torchliner.records import PressureRecord, VelocityPlane
from torchliner.records.same_case import require_same_run
from torchliner.studies.calibrate import planes_and_liners
from torchliner.studies.curves import SHAPES, SIGNS, CurveShape
from torchliner.studies.identification import Identification, warnings_of, with_flow
from torchliner.studies.laws import parameter_law
from torchliner.studies.leave_out import Model, candidate_of, knots_for
from torchliner.studies.runs import (
    Run,
    held_reference,
    held_to_levels,
    held_to_references,
    read_run,
    require_plain_tones,
)
from torchliner.studies.variants import plane_of
from torchliner.velocity.choices import Choices
from torchliner.velocity.review import texts

CURVE = "curve"
FREEDOMS = (0.1, 0.3, 1.0, 3.0)  # of which leaving out chooses
FEWEST = {CURVE: 3, "parameters": 2}  # runs: two are left where one of three is left out
SPREAD = 1.25  # ratio of the rms |v| of the fastest and the slowest run
SHARE = 0.02  # of |Z|: noise of references for which none is stated
LEVEL_NOISE = 0.2  # dB, of levels
LEVEL_CHECK, IN_SITU = "level-check", "in-situ"
AROUND = 0.5  # bounds that are not stated: so much of a value, or about one that may be negative
BOUNDS = {  # of factors, whose neutral value says nothing of how far they go
    "vena_contracta": (0.2, 1.0),
    "end_correction": (0.0, 4.0),
    "mass_loss": (0.0, 10.0),
    "mass_loss_speed": (0.05, 10.0),
    "mach_resistance": (-5.0, 5.0),
    "mach_mass_loss": (-10.0, 10.0),
}


def identify(
    planes: VelocityPlane | Moments | Sequence[VelocityPlane | Moments],
    liners: Liner | Sequence[Liner],
    references: Any = "true",
    *,
    models: Sequence[str | Sequence[str] | Mapping[str, tuple[float, float]]] = (CURVE,),
    groups: Sequence[str] | None = None,
    averaging: str = "phase-locked",
    pressure: Any = None,
    noise: Any = None,
    rest: complex | None = None,
    freedom: float | None = None,
    prior: str = "law",
    reactance: str = "falling",
    frequency: Any = None,
    **choices: Any,
) -> Identification:
    """The response Z(f, |v|) of a liner, found from runs whose impedance is known.

    Args:
        planes: velocity planes, or their moments.
        liners: one for all planes, or one each: cells, gas, the prior shape of the curve (that of the first;
            differences of Z at rest stay), the law whose parameters are freed. An ``SDoFLiner`` is taken as an
            ``AdjustedSDoFLiner``; that and an ``EndLossSDoFLiner`` take the Mach number of each plane.
        references: name of an impedance that every plane holds, values by plane, (F,) each, "in-situ" (by Dean's
            method from ``pressure``, else what the plane holds as "in situ"), or "level-check" (the level alone).
        models: "curve", and names of parameters (with usual bounds) or bounds in SI by name. Which of them predicts
            best what it has not seen is found by leaving out each run.
        groups: label of the run of each plane: planes of one run (heights, cells) share one reference and are left out
            together. Default the case of its provenance, else its name.
        averaging: one of ``names.AVERAGINGS``.
        pressure: records, for "in-situ" and "level-check": each plane has that of its case, tone, level and flow;
            where the records tell no runs apart they are in the order of the planes.
        noise: standard uncertainty of R and X, as for ``calibrate``, 2 % of |Z| by default; with "level-check" dB, 0.2
            by default. Misfits above it widen every uncertainty.
        rest: standard uncertainty u(R) + j u(X) of the liner's own Z at rest, where that was measured; by default R is
            free within factors of e and X within 0.5.
        freedom: standard deviation, from rest to the last knot, of the logarithm of the ratio of the curve's steps to
            those of its prior shape; default the best of ``FREEDOMS``.
        prior: shape of the curve where nothing is known, one of ``names.CURVE_SHAPES``: the liner's own "law", or
            "smooth", in proportion to |v|.
        reactance: "falling" over |v|, as where mass is lost, or "rising".
        frequency: Hz; default each plane's tone. Curves are found at each frequency apart.
        choices: as for ``educe``; float64 unless ``dtype`` says otherwise.
    Raises:
        ValueError: too few runs, runs at one speed, references that are missing or that no passive liner can give,
            unknown parameters, fits none of which is passive.
        TypeError: parameters of a liner without numbers.
        RuntimeError: a fit that does not settle.
    Warns:
        DataWarning: predictions at speeds that no other run saw, misfits above the noise, predictions that their
            uncertainty does not cover; also kept in ``notes``.
    Source: Roncen et al. (2026), section 3, inverted; monotone splines by sums of B-splines after Ramsay, Statistical
        Science 3 (1988) 425, the logarithms of whose coefficients are free.
    """
    several, given = planes_and_liners(planes, liners)
    chosen = Choices(**{"dtype": "float64", "interval": None, **choices, "averaging": averaging})
    require_choice("averaging", averaging, AVERAGINGS)
    require_choice("prior shape", prior, SHAPES)
    require_choice("direction of the reactance", reactance, SIGNS)
    require_plain_tones(chosen)
    if pressure is not None and references not in (IN_SITU, LEVEL_CHECK):
        raise ValueError(
            "pressures are for references 'in-situ' and 'level-check'; name one of these, or leave pressure out"
        )
    facts = [plane_of(each) for each in several]
    names = _groups(facts, groups, CURVE in models)
    made: dict[Any, LinerModel] = {}  # planes of one liner and flow share one object, which a fit asks once
    for each, plane in zip(given, facts, strict=True):
        made.setdefault((id(each), plane.mach), with_flow(each, plane.mach))
    bases = [made[id(each), plane.mach] for each, plane in zip(given, facts, strict=True)]
    tried = _parameter_models(models, bases[0], facts)
    runs = [
        dataclasses.replace(read_run(plane, liner, frequency, chosen, any_curve=True), group=name)
        for plane, liner, name in zip(several, bases, names, strict=True)
    ]
    runs = _held(runs, references, pressure, noise)
    knots = knots_for(runs)
    if CURVE in models:
        _require_spread(runs)
        lines = torch.cat([run.frequency for run in runs]).unique()
        lines = lines[torch.cat([lines[:1] > 0, lines[1:] > lines[:-1] * (1 + SAME_FREQUENCY)])]
        for walk in FREEDOMS if freedom is None else (freedom,):
            laws = [CurveShape(bases[0], f, knots, prior, reactance, walk, rest).law() for f in lines.tolist()]
            tried.append(Model(f"curve, freedom {walk:g}", tuple(laws)))
    candidates = sorted(
        (candidate_of(model, runs, knots) for model in tried), key=lambda each: (each.lowest < 0, each.error)
    )
    if candidates[0].lowest < 0:
        raise ValueError(
            f"no fit is passive: R falls to {candidates[0].lowest:.3g} with {candidates[0].label}; fit a curve, which "
            "cannot, or narrow the bounds"
        )
    result = Identification(tuple(runs), tuple(candidates), knots, averaging, chosen, ())
    notes = (*texts(note for run in runs for note in run.notes), *warnings_of(result))
    tell(notes)
    return dataclasses.replace(result, notes=notes)


def bounds_for(names: Sequence[str], liner: LinerModel) -> dict[str, tuple[float, float]]:
    """Usual bounds, SI, of parameters by name."""
    found = {}
    for name, number in named_numbers(liner, names).items():
        reach = AROUND * number.value if number.low >= 0 else AROUND
        around = number.value - reach, min(number.value + reach, number.high)
        found[name] = BOUNDS.get(name, around)
    return found


def _groups(planes: Sequence[VelocityPlane], groups: Sequence[str] | None, curve: bool) -> list[str]:
    if groups is None:
        groups = [plane.provenance.get("case") or plane.name for plane in planes]
    if len(groups) != len(planes):
        raise ValueError(f"{len(groups)} groups for {len(planes)} planes; one each")
    found = list(map(str, groups))
    fewest = FEWEST[CURVE if curve else "parameters"]
    if len(set(found)) < fewest:
        raise ValueError(
            f"{len(set(found))} run(s) ({', '.join(dict.fromkeys(found))}) cannot tell: each is "
            f"left out in turn, and {'a curve' if curve else 'a parameter'} needs at least "
            f"{fewest}; planes of one case count as one run: add levels or flows, or name groups"
        )
    return found


def _parameter_models(models: Sequence[Any], liner: LinerModel, planes: Sequence[VelocityPlane]) -> list[Model]:
    if not models:
        raise ValueError("no model is named; leave models out for a curve")
    found = []
    for names in models:
        if isinstance(names, str):
            require_choice("model", names, [CURVE])
            continue
        bounds = dict(names) if isinstance(names, Mapping) else bounds_for(names, liner)
        if "mach" in bounds:
            raise ValueError(
                "mach is that of each plane, as its file states it, and cannot be free; free "
                "mach_resistance or mach_mass_loss"
            )
        still = [plane.name for plane in planes if plane.mach is None]
        flow = [name for name in bounds if name.startswith("mach")]
        if flow and (still or not any(plane.mach for plane in planes)):
            fault = f"{still[0]} states no Mach number" if still else "no plane has a flow"
            raise ValueError(
                f"{', '.join(flow)} cannot be told: {fault}; state --mach in the files, or free another parameter"
            )
        found.append(Model(", ".join(bounds), (parameter_law(bounds, liner),)))
    return found


def _held(runs: Sequence[Run], references: Any, pressure: Any, noise: Any) -> list[Run]:
    """Runs with what they are held to.

    Raises:
        ValueError: something is missing, or no passive liner can give it.
    """
    if isinstance(references, str) and references == LEVEL_CHECK:
        records = _by_case(runs, pressure, all_of_them=True)
        return held_to_levels(runs, records, LEVEL_NOISE if noise is None else noise)
    if isinstance(references, str) and references == IN_SITU:
        references = _in_situ(runs, pressure)
    found = held_to_references(runs, references, noise)
    if noise is None:
        spread = [SHARE * run.wanted.abs() for run in found]
        found = [dataclasses.replace(run, noise=torch.complex(u, u)) for run, u in zip(found, spread, strict=True)]
    for run in found:
        if bool((run.wanted.real < 0).any()):
            raise ValueError(
                f"{run.plane.name}: its reference has a resistance of "
                f"{float(run.wanted.real.min()):.3g}; the response of a passive liner, R at least "
                "0 at every |v|, cannot give it: leave that plane out"
            )
    return found


def _by_case(runs: Sequence[Run], given: Any, *, all_of_them: bool = False) -> list[Any]:
    """The pressure record of each plane, found by its case, tone, level and flow, or None; records that do not tell
    runs apart, and what is none (a line of microphones, None), are taken in the order of the planes.

    Raises:
        ValueError: records that could be of several runs; ``all_of_them`` are to have one, and a plane has none.
    """
    records = [given] if isinstance(given, PressureRecord) else list(given or [None] * len(runs))
    if not all(isinstance(each, PressureRecord) for each in records):
        return records
    fits = [[not _fault(run.plane, record) for record in records] for run in runs]
    in_order = len(records) == len(runs) and all(row[i] for i, row in enumerate(fits))
    found: list[PressureRecord | None] = []
    for i, (run, row) in enumerate(zip(runs, fits, strict=True)):
        fitting = [k for k, fit in enumerate(row) if fit]
        if len(fitting) > 1 or any(all(each[k] for each in fits) for k in fitting):
            if not in_order:
                raise ValueError(
                    f"nothing tells which of the runs {', '.join(records[k].name for k in fitting)} is of: "
                    f"{run.plane.name} and others fit; state case, level or Mach number in the files, or give a "
                    "record for each plane, in their order"
                )
            fitting = [i]
        if all_of_them and not fitting:
            raise ValueError(f"{_fault(run.plane, given)}; give the pressure record of the same run")
        found.append(records[fitting[0]] if fitting else None)
    return found


def _fault(plane: VelocityPlane, given: Any) -> str:
    """Why a record, or the last of some, is of another run than a plane; nothing if it may be of the same."""
    record = given if isinstance(given, PressureRecord) else given[-1] if given else None
    if record is None:
        return "no pressure record is given"
    try:
        require_same_run(plane, record)
    except ValueError as error:
        return str(error).rpartition("; ")[0]
    return ""


def _in_situ(runs: Sequence[Run], given: Any) -> list[Any]:
    """In situ Z of each plane from the record of its case, or the one it holds."""
    found = []
    for run, record in zip(runs, _by_case(runs, given), strict=True):
        if record is not None:
            short = bool(run.known.settings["allow_short"])
            beside = in_situ(record, run.frequency, interval=None, allow_short=short)
            found.append(beside.liner_impedance_pressure_first)
        elif "in situ" in run.plane.reference:
            found.append(held_reference(run, "in situ"))
        else:
            raise ValueError(
                f"{run.plane.name} has no in situ impedance: {_fault(run.plane, given)}; give the pressure record of "
                "the same run, or leave the plane out"
            )
    return found


def _require_spread(runs: Sequence[Run]) -> None:
    """Runs at different speeds, by which a curve can be told.

    Raises:
        ValueError: the rms |v| of the fastest is less than ``SPREAD`` times the slowest's.
    """
    speeds = [run.speed for run in runs]
    low, high = min(speeds), max(speeds)
    if high < SPREAD * low or not math.isfinite(high):
        ratio = high / low if low > 0 else math.nan
        raise ValueError(
            f"all runs are at one speed: rms |v| is {low:.3g} to {high:.3g} m/s, a ratio of "
            f"{ratio:.3g} (at least {SPREAD:g} is needed to tell a curve over |v|); add runs at "
            "other levels, or fit one parameter instead (models=[('vena_contracta',)])"
        )

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

from torchliner.checks import require_choice, tell
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.names import AVERAGINGS
from torchliner.pressure.dean import in_situ
from torchliner.records import PressureRecord, VelocityPlane
from torchliner.records.same_case import require_same_run
from torchliner.studies.curves import SHAPES, SIGNS
from torchliner.studies.identification import Identification, warnings_of
from torchliner.studies.leave_out import CurveModel, Model, ParameterModel, bounds_for, candidate_of, knots_for
from torchliner.studies.runs import (
    Run,
    held_reference,
    held_to_levels,
    held_to_references,
    noise_of,
    read_for_any,
    require_plain_tones,
    with_flow,
)
from torchliner.studies.variants import Records, plane_of
from torchliner.velocity.choices import Choices
from torchliner.velocity.review import texts

CURVE = "curve"
FREEDOMS = (0.1, 0.3, 1.0, 3.0)  # of which leaving out chooses
FEWEST = {CURVE: 3, "parameters": 2}  # runs: two are left where one of three is left out
SPREAD = 1.25  # ratio of the rms |v| of the fastest and the slowest run
SHARE = 0.02  # of |Z|: noise of references for which none is stated
LEVEL_NOISE = 0.2  # dB, of levels
LEVEL_CHECK, IN_SITU = "level-check", "in-situ"


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
    several = [planes] if isinstance(planes, Records) else list(planes)
    given = list(liners) if isinstance(liners, list | tuple) else [liners] * len(several)
    if len(given) != len(several):
        raise ValueError(f"{len(several)} planes and {len(given)} liners; give one, or one a plane")
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
        made.setdefault((id(each), plane.mach), with_flow(as_liner(each), plane.mach))
    bases = [made[id(each), plane.mach] for each, plane in zip(given, facts, strict=True)]
    tried: list[Model] = [*_parameter_models(models, bases[0], facts)]
    runs = [
        dataclasses.replace(read_for_any(plane, liner, frequency, chosen), group=name)
        for plane, liner, name in zip(several, bases, names, strict=True)
    ]
    runs = _held(runs, references, pressure, noise)
    knots = knots_for(runs)
    if CURVE in models:
        _require_spread(runs)
        freedoms = FREEDOMS if freedom is None else (freedom,)
        tried += [CurveModel(bases[0], each, prior, reactance, knots, rest) for each in freedoms]
    found = [candidate_of(model, runs, knots) for model in tried]
    candidates = sorted(found, key=lambda each: (each.lowest < 0, each.error))
    if candidates[0].lowest < 0:
        raise ValueError(
            f"no fit is passive: R falls to {candidates[0].lowest:.3g} with "
            f"{candidates[0].label}; fit a curve, which cannot, or narrow the bounds"
        )
    result = Identification(tuple(runs), tuple(candidates), knots, averaging, chosen, ())
    notes = (*texts(note for run in runs for note in run.notes), *warnings_of(result))
    tell(notes)
    return dataclasses.replace(result, notes=notes)


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


def _parameter_models(
    models: Sequence[Any], liner: LinerModel, planes: Sequence[VelocityPlane]
) -> list[ParameterModel]:
    found = []
    if not models:
        raise ValueError("no model is named; leave models out for a curve")
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
        found.append(ParameterModel(bounds))
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
    noise_of(noise, runs)
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


def _by_case(runs: Sequence[Run], given: Any, *, all_of_them: bool) -> Any:
    """The pressure record of each plane, found by its case, tone, level and flow; records that do not tell runs apart
    are taken in the order of the planes. None where there is none.

    Args:
        runs: two at least.
        given: records; what is none (a line of microphones, None) stays in its order.
        all_of_them: whether a plane without a record is refused.
    Raises:
        ValueError: a plane without a record; records that could be of several runs.
    """
    records = _listed(given)
    if not records or not all(isinstance(each, PressureRecord) for each in records):
        return given
    faults = [[_fault(run.plane, record) for record in records] for run in runs]
    in_order = len(records) == len(runs) and not any(faults[i][i] for i in range(len(records)))
    found: list[PressureRecord | None] = []
    for i, (run, mine) in enumerate(zip(runs, faults, strict=True)):
        fitting = [k for k, fault in enumerate(mine) if not fault]
        if not fitting and all_of_them:
            raise ValueError(f"{mine[-1]}; give the pressure record of the same run")
        if any(len(fitting) > 1 or not any(row[k] for row in faults) for k in fitting):
            if not in_order:
                names = ", ".join(records[k].name for k in fitting)
                raise ValueError(
                    f"nothing tells which of the runs {names} is of: {run.plane.name} and others "
                    "fit; state case, level or Mach number in the files, or give a record for "
                    "each plane, in their order"
                )
            fitting = [i]
        found.append(records[fitting[0]] if fitting else None)
    return found


def _listed(given: Any) -> list[Any]:
    return [given] if isinstance(given, PressureRecord) else list(given or [])


def _fault(plane: VelocityPlane, record: PressureRecord) -> str:
    """Why a record is of another run than a plane; nothing if it may be of the same."""
    try:
        require_same_run(plane, record)
    except ValueError as error:
        return str(error).rpartition("; ")[0]
    return ""


def _in_situ(runs: Sequence[Run], given: Any) -> list[Any]:
    """In situ Z of each plane from the record of its case, or the one it holds."""
    records = _by_case(runs, given, all_of_them=False) or [None] * len(runs)
    found = []
    for run, record in zip(runs, records, strict=True):
        plane = run.plane
        if record is not None:
            short = bool(run.known.settings["allow_short"])
            beside = in_situ(record, run.frequency, interval=None, allow_short=short)
            found.append(beside.liner_impedance_pressure_first)
        elif "in situ" in plane.reference:
            found.append(held_reference(run, "in situ"))
        else:
            several = _listed(given)
            fault = _fault(plane, several[-1]) if several else "no pressure record is given"
            raise ValueError(
                f"{plane.name} has no in situ impedance: {fault}; give the pressure record of the same run, or leave "
                "the plane out"
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

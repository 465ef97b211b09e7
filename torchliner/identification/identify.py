"""The response of a liner found from runs whose impedance, or level, is known.

The data enter once, as moments of |v| (``calibration.misfit.speed_weights``); what is fitted is a
curve Z(|v|) at each frequency, or parameters of the liner's law, and what is compared is how well
each of them predicts the runs that it has not seen.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from torchliner.calibration.misfit import require_plain_tones
from torchliner.checks import require_choice, tell
from torchliner.engine.moments import Moments
from torchliner.identification.curve_model import CurveModel
from torchliner.identification.found import Identification
from torchliner.identification.leave_out import Model, candidate_of, knots_for
from torchliner.identification.parameter_model import ParameterModel, bounds_for
from torchliner.identification.runs import gather, read_weights, require_spread, with_flow
from torchliner.identification.speed_curve import SHAPES, SIGNS
from torchliner.identification.warnings_of import warnings_of
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.names import AVERAGINGS
from torchliner.records import VelocityPlane
from torchliner.velocity.choices import Choices
from torchliner.velocity.review import texts

CURVE = "curve"
FREEDOMS = (0.1, 0.3, 1.0, 3.0)  # of which leaving out chooses
FEWEST = {CURVE: 3, "parameters": 2}  # runs: two are left where one of three is left out
SPREAD = 1.25  # ratio of the rms |v| of the fastest and the slowest run


def identify(
    planes: VelocityPlane | Moments | Sequence[VelocityPlane | Moments],
    liners: Liner | Sequence[Liner], references: Any = "true", *,
    models: Sequence[str | Sequence[str] | Mapping[str, tuple[float, float]]] = (CURVE,),
    groups: Sequence[str] | None = None, averaging: str = "phase-locked", pressure: Any = None,
    noise: Any = None, rest: complex | None = None, freedom: float | None = None,
    prior: str = "law", reactance: str = "falling", frequency: Any = None, **choices: Any,
) -> Identification:  # fmt: skip
    """The response Z(f, |v|) of a liner, found from runs whose impedance is known.

    Args:
        planes: velocity planes, or their moments.
        liners: one for all planes, or one each: cells, gas, the prior shape of the curve (that of
            the first; differences of Z at rest stay), the law whose parameters are freed. An
            ``SDoFLiner`` is taken as an ``AdjustedSDoFLiner``; that and an ``EndLossSDoFLiner``
            take the Mach number of each plane.
        references: name of an impedance that every plane holds, values by plane, (F,) each,
            "in-situ" (by Dean's method from ``pressure``, else what the plane holds as "in situ"),
            or "level-check" (the level alone).
        models: "curve", and names of parameters (with usual bounds) or bounds in SI by name. Which
            of them predicts best what it has not seen is found by leaving out each run.
        groups: label of the run of each plane: planes of one run (heights, cells) share one
            reference and are left out together. Default the case of its provenance, else its name.
        averaging: one of ``names.AVERAGINGS``.
        pressure: records, for "in-situ" and "level-check": each plane has that of its case, tone, level
            and flow; where the records tell no runs apart they are in the order of the planes.
        noise: standard uncertainty of R and X, as for ``calibrate``, 2 % of |Z| by default; with
            "level-check" dB, 0.2 by default. Misfits above it widen every uncertainty.
        rest: standard uncertainty u(R) + j u(X) of the liner's own Z at rest, where that was
            measured; by default R is free within factors of e and X within 0.5.
        freedom: standard deviation, from rest to the last knot, of the logarithm of the ratio of
            the curve's steps to those of its prior shape; default the best of ``FREEDOMS``.
        prior: shape of the curve where nothing is known, one of ``names.CURVE_SHAPES``: the
            liner's own "law", or "smooth", in proportion to |v|.
        reactance: "falling" over |v|, as where mass is lost, or "rising".
        frequency: Hz; default each plane's tone. Curves are found at each frequency apart.
        choices: as for ``educe``; float64 unless ``dtype`` says otherwise.
    Raises:
        ValueError: too few runs, runs at one speed, references that are missing or that no passive
            liner can give, unknown parameters, fits none of which is passive.
        TypeError: parameters of a liner without numbers.
        RuntimeError: a fit that does not settle.
    Warns:
        DataWarning: predictions at speeds that no other run saw, misfits above the noise,
            predictions that their uncertainty does not cover; also kept in ``notes``.
    Source: Roncen et al. (2026), section 3, inverted; monotone splines by sums of B-splines after
        Ramsay, Statistical Science 3 (1988) 425, the logarithms of whose coefficients are free.
    """
    several = [planes] if isinstance(planes, (VelocityPlane, Moments)) else list(planes)
    given = list(liners) if isinstance(liners, (list, tuple)) else [liners] * len(several)
    if len(given) != len(several):
        raise ValueError(f"{len(several)} planes and {len(given)} liners; give one, or one a plane")
    chosen = Choices(**{"dtype": "float64", "interval": None, **choices, "averaging": averaging})
    require_choice("averaging", averaging, AVERAGINGS)
    require_choice("prior shape", prior, SHAPES)
    require_choice("direction of the reactance", reactance, SIGNS)
    require_plain_tones(chosen)
    if pressure is not None and references not in ("in-situ", "level-check"):
        raise ValueError(
            "pressures are for references 'in-situ' and 'level-check'; name one of these, or leave pressure out"
        )
    facts = [each.plane if isinstance(each, Moments) else each for each in several]
    names = _groups(facts, groups, CURVE in models)
    bases = [with_flow(as_liner(liner), plane.mach)
             for liner, plane in zip(given, facts, strict=True)]  # fmt: skip
    free = _parameters(models, bases, facts)
    weights = [read_weights(plane, liner, frequency, chosen)
               for plane, liner in zip(several, bases, strict=True)]  # fmt: skip
    runs = gather(weights, bases, names, references, pressure, noise)
    knots = knots_for(runs)
    tried: list[Model] = list(free)
    if CURVE in models:
        require_spread(runs, SPREAD)
        tried += [CurveModel(bases[0], each, prior, reactance, knots, rest)
                  for each in ([freedom] if freedom is not None else FREEDOMS)]  # fmt: skip
    candidates = sorted((candidate_of(model, runs, knots) for model in tried),
                        key=lambda each: (each.lowest < 0, each.error))  # fmt: skip
    if candidates[0].lowest < 0:
        raise ValueError(
            f"no fit is passive: R falls to {candidates[0].lowest:.3g} with "
            f"{candidates[0].label}; fit a curve, which cannot, or narrow the bounds"
        )
    prepared = texts(note for run in runs for note in run.weights.notes)
    found = Identification(tuple(runs), tuple(candidates), knots, averaging, chosen, ())
    found = dataclasses.replace(found, notes=(*prepared, *warnings_of(found)))
    tell(found.notes)
    return found


def _groups(planes: Sequence[VelocityPlane], groups: Sequence[str] | None, curve: bool) -> list[str]:
    if groups is not None and len(groups) != len(planes):
        raise ValueError(f"{len(groups)} groups for {len(planes)} planes; one each")
    found = [str(each) for each in groups] if groups is not None else [
        str(plane.provenance.get("case") or plane.name) for plane in planes
    ]  # fmt: skip
    fewest = FEWEST[CURVE if curve else "parameters"]
    if len(set(found)) < fewest:
        raise ValueError(
            f"{len(set(found))} run(s) ({', '.join(dict.fromkeys(found))}) cannot tell: each is "
            f"left out in turn, and {'a curve' if curve else 'a parameter'} needs at least "
            f"{fewest}; planes of one case count as one run: add levels or flows, or name groups"
        )
    return found


def _parameters(
    models: Sequence[Any], liners: Sequence[LinerModel], planes: Sequence[VelocityPlane]
) -> list[ParameterModel]:
    found = []
    if not models:
        raise ValueError("no model is named; leave models out for a curve")
    for names in models:
        if isinstance(names, str):
            require_choice("model", names, [CURVE])
            continue
        bounds = dict(names) if isinstance(names, Mapping) else bounds_for(names, liners[0])
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

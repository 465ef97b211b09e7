"""Calibration: parameters of a liner fitted, within bounds, to reference impedances or known levels."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import torch

from torchliner.checks import tell
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, LinerModel, as_liner, named_numbers
from torchliner.liners.sdof import EndLossSDoFLiner, SDoFLiner
from torchliner.records import VelocityPlane
from torchliner.studies.fit import Fit, fit_law
from torchliner.studies.laws import parameter_law
from torchliner.studies.runs import choices_of_fit, held, read_runs
from torchliner.studies.solve import knots_for
from torchliner.studies.variants import Records, plane_of
from torchliner.velocity.educe import moments

AVERAGING = "phase-locked"  # without flow
NOISE = 0.005 + 0.05j  # of R and X: two ways of measuring one run differ by 0.002 to 0.015 in X, the model by more
LEFT_OUT = 1e3  # u(X) with which a reactance does not count
QUIET = 0.02  # Mach number that counts as no flow


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
    notes = (*(note.text for run in runs for note in run.notes), *fit.notes)
    tell(notes)
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

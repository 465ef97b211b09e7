"""Calibration: parameters of a liner fitted, within bounds, to reference impedances or known levels."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import tell
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, named_numbers
from torchliner.records import VelocityPlane
from torchliner.studies.fit import Fit, fit_law
from torchliner.studies.laws import parameter_law
from torchliner.studies.posterior import Posterior, sample_posterior
from torchliner.studies.runs import choices_of_fit, held, planes_and_liners, read_run
from torchliner.studies.solve import drawn_impedances, knots_for

FEWEST_EFFECTIVE = 100.0
FAR = 2.0  # times the stated noise from which a misfit is one of the model


def calibrate(
    planes: VelocityPlane | Moments | Sequence[VelocityPlane | Moments],
    liners: Liner | Sequence[Liner],
    references: Any,
    parameters: Mapping[str, tuple[float, float]],
    *,
    averaging: str = "velocity",
    pressure: Any = None,
    noise: Any = None,
    frequency: Any = None,
    draws: int = 2000,
    seed: int = 0,
    **choices: Any,
) -> Fit:
    """Fit parameters to reference impedances, or to known levels, phase ``averaged``.

    Args:
        planes: one or several, or their moments.
        liners: that state ``numbers``, one for all planes, or one each; the free parameters are shared by all of them.
        references: normalised Z by plane, complex, (F,) each; the name of a reference that every plane holds, such as
            "true"; "in-situ", by Dean's method from ``pressure``, else what the plane holds as "in situ"; or
            "level-check", the pressure that is known alone, see ``velocity.level_check``: one datum, the level, a plane
            and frequency, or two where the phase is known.
        parameters: bounds, SI, by name of ``liner.numbers()``; ``offset`` is both parts.
        averaging: one of ``names.AVERAGINGS``.
        pressure: records for the last two, one a plane or None.
        noise: standard uncertainty of R and X of each reference: one number, a complex number u(R) + j u(X), or one by
            plane; of levels dB. None: equal and unknown, taken from the residual.
        frequency: Hz; default each plane's tone.
        draws, seed: of the posterior; 0 draws for none.
        choices: as for ``educe``; float64 unless ``dtype`` says otherwise.
    Raises:
        TypeError: a liner without numbers.
        ValueError: fewer data (R and X of each plane and frequency) than parameters, bounds that no liner can have,
            references that are missing.
        RuntimeError: the least squares do not converge.
    Warns:
        DataWarning: a parameter on a bound, parameters that cannot be told apart, a misfit beyond the stated noise, too
            few effective draws; also kept in ``notes``.
    Source: Gauss-Newton covariance and Student's t for unknown noise: Seber & Wild, Nonlinear Regression (1989),
        section 2.1. Trust-region reflective steps of scipy.
    """
    several, models = planes_and_liners(planes, liners)
    chosen = choices_of_fit(averaging=averaging, **choices)
    law = parameter_law(parameters, models[0])
    for liner in models[1:]:
        named_numbers(liner, law.names)
    runs = [read_run(plane, liner, frequency, chosen) for plane, liner in zip(several, models, strict=True)]
    runs = held(runs, references, pressure, noise)
    fit = fit_law(law, runs, chosen, knots_for(runs), stated=noise is not None)
    posterior, messages = _posterior(fit, draws, seed)
    notes = (*(note.text for run in runs for note in run.notes), *messages, *warnings_of(fit))
    tell(notes)
    return dataclasses.replace(fit, posterior=posterior, notes=notes)


def _posterior(fit: Fit, draws: int, seed: int) -> tuple[Posterior | None, list[str]]:
    """Draws in SI, and warnings about them; None without draws or where no noise is known."""
    if draws < 1 or fit.scale != fit.scale:
        return None, []
    law, width, square_of_fit = fit.law, fit.law.high - fit.law.low, float(fit.residuals.square().sum())
    lowest = [square_of_fit]

    def log_density(at: Tensor) -> Tensor:
        found = zip(fit.runs, drawn_impedances(law, law.low + at * width, fit.runs), strict=True)
        square = sum((run.residuals(z).square().sum(1) for run, z in found), torch.zeros(1, dtype=torch.float64))
        lowest.append(float(square.min()))
        # Unknown noise, equally likely on a logarithmic scale, is integrated out.
        return -square / 2 if fit.stated else -fit.data / 2 * torch.log(square.clamp(min=1e-300))

    boxed, share = fit.jacobian * width, (fit.values - law.low) / width
    found = sample_posterior(log_density, share, boxed.T @ boxed / max(fit.scale, 1e-300), draws, seed)
    notes = []
    if found.effective < FEWEST_EFFECTIVE:
        notes.append(
            f"the posterior's {draws} draws are worth {found.effective:.0f} independent ones; intervals are rough: "
            "raise draws, or narrow the bounds"
        )
    if min(lowest) < square_of_fit - 0.1 * fit.scale:
        notes.append(
            f"a draw fits better than the fit (misfit {min(lowest):.4g} against {square_of_fit:.4g}): there is "
            "another minimum; start the liner nearer to it"
        )
    return Posterior(law.low + found.draws * width, found.weights), notes


def warnings_of(fit: Fit) -> list[str]:
    """Parameters on bounds, undetermined directions, noise that does not fit; with remedies."""
    law, notes = fit.law, list[str]()
    if fit.on_bound and law.frequencies:
        notes.append(
            f"{len(fit.on_bound)} of {len(fit.values)} parameters of the curve end at a factor of 400 of the prior "
            "shape: the references ask for a step or the other direction; state more noise"
        )
    elif fit.on_bound:
        where = ", ".join(f"{name} on its bound, {fit.numbers[name]:.4g}" for name in fit.on_bound)
        notes.append(
            f"{where}: the data ask for more than the bounds allow; widen them if that is physical, else free another "
            "parameter"
        )
    for group in fit.unseen:
        what = f"tell {' and '.join(group)} apart" if len(group) > 1 else f"see {group[0]}"
        notes.append(f"the data do not {what} within the bounds; fix one, or add data at another frequency")
    if fit.stated and fit.freedom and fit.misfit > FAR * (1 + 2 / fit.freedom) ** 0.5:
        notes.append(
            f"{law.label}: the misfit is {fit.misfit:.3g} times the stated noise: no such law gives all references (or "
            "it is far from its prior); predictions to first order are widened by that factor, a posterior, which "
            "knows the noise alone, is too narrow"
        )
    if not fit.stated and fit.freedom == 0:
        notes.append(
            f"{fit.data} data fix {len(fit.values)} parameters with nothing left over: no residual says how uncertain "
            "they are; state noise"
        )
    return notes

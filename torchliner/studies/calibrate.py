"""Calibration: parameters of a liner fitted, within bounds, to reference impedances or known levels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_choice, tell
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import interpolation_error
from torchliner.liners.model import Liner, LinerModel, as_liner, named_numbers
from torchliner.names import AVERAGINGS
from torchliner.records import VelocityPlane
from torchliner.studies.calibration import Calibration
from torchliner.studies.fit import Fit, drawn_impedances, fit_law
from torchliner.studies.laws import parameter_law
from torchliner.studies.posterior import FEWEST_EFFECTIVE, Posterior, sample_posterior
from torchliner.studies.runs import (
    Run,
    held_to_levels,
    held_to_references,
    read_run,
    require_plain_tones,
)
from torchliner.velocity.choices import Choices
from torchliner.velocity.review import texts

QUANTILES = (0.025, 0.975)
LARGEST_MODEL_ERROR = 1e-4  # in R, of the interpolation over |v|, that goes without a note


def calibrate(
    planes: VelocityPlane | Moments | Sequence[VelocityPlane | Moments],
    liners: Liner | Sequence[Liner],
    references: Any,
    parameters: Mapping[str, tuple[float, float]],
    *,
    averaging: str = "velocity",
    level_check: bool = False,
    pressure: Any = None,
    noise: Any = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
    frequency: Any = None,
    draws: int = 2000,
    seed: int = 0,
    **choices: Any,
) -> Calibration:
    """Fit parameters to reference impedances, or to known levels, phase ``averaged``.

    Args:
        planes: one or several, or their moments.
        liners: that state ``numbers``, one for all planes, or one each; the free parameters are shared by all of them.
        references: normalised Z by plane, complex, (F,) each; or the name of a reference that every plane holds, such
            as "true". None with ``level_check``.
        parameters: bounds, SI, by name of ``liner.numbers()``; ``offset`` is both parts.
        averaging: one of ``names.AVERAGINGS``.
        level_check: fit to the pressures that are known, see ``velocity.level_check``: one datum, the level, a plane
            and frequency, or two where the phase is known.
        pressure: of the planes, one each or None, as for ``educe``; with ``level_check`` alone.
        noise: with ``level_check`` dB of the levels; else standard uncertainty of R and X of each reference: one
            number, a complex number u(R) + j u(X), or one by plane. None: equal and unknown, taken from the residual.
        prior: mean and standard deviation of parameters known beforehand; needs ``noise``.
        frequency: Hz; default each plane's tone.
        draws, seed: of the posterior; 0 draws for none.
        choices: as for ``educe``; float64 unless ``dtype`` says otherwise.
    Raises:
        TypeError: a liner without numbers.
        ValueError: fewer data (R and X of each plane and frequency) than parameters, bounds that no liner can have,
            references that are missing, a prior without noise.
        RuntimeError: the least squares do not converge.
    Warns:
        DataWarning: a parameter on a bound, parameters that cannot be told apart, a misfit beyond the stated noise, too
            few effective draws; also kept in ``notes``.
    Source: Gauss-Newton covariance and Student's t for unknown noise: Seber & Wild, Nonlinear Regression (1989),
        section 2.1. Trust-region reflective steps of scipy.
    """
    several = [planes] if isinstance(planes, VelocityPlane | Moments) else list(planes)
    given = list(liners) if isinstance(liners, list | tuple) else [liners] * len(several)
    if not several or len(given) != len(several):
        raise ValueError(f"{len(several)} planes and {len(given)} liners; give one liner, or one a plane")
    made = {id(each): as_liner(each) for each in given}
    models = [made[id(each)] for each in given]
    require_choice("averaging", averaging, AVERAGINGS)
    chosen = Choices(**{"dtype": "float64", "interval": None, **choices, "averaging": averaging})
    require_plain_tones(chosen)
    if prior and noise is None:
        raise ValueError("a prior weighs against data of known uncertainty; state noise too")
    law = parameter_law(parameters, models[0], prior)
    for liner in models[1:]:
        named_numbers(liner, law.names)
    runs = [read_run(plane, liner, frequency, chosen) for plane, liner in zip(several, models, strict=True)]
    if level_check:
        if references is not None:
            raise ValueError("a fit to levels needs no references; leave them out, or leave level_check out")
        runs = held_to_levels(runs, pressure, noise)
    else:
        runs = held_to_references(runs, references, noise)
    data = sum(run.data for run in runs)
    if data + len(law.prior) < len(law.names):
        count = sum(len(run.frequency) for run in runs)
        what = "levels and phases" if level_check else f"R and X of {count} impedances"
        raise ValueError(
            f"{data} data ({what}) and {len(law.prior)} priors cannot fix {len(law.names)} parameters "
            f"({', '.join(law.names)}); add planes or frequencies, or free fewer"
        )
    fit = fit_law(law, runs, noise is not None)
    posterior, messages = posterior_of(fit, draws, seed)
    best = dict(zip(law.names, fit.values.tolist(), strict=True))
    error = max(model_error(run, run.liner.with_numbers(best)) for run in runs)
    if error > LARGEST_MODEL_ERROR:
        messages.append(
            f"R of the calibrated liner is known to {error:.2g} only (limit "
            f"{LARGEST_MODEL_ERROR:g}) between the speeds at which a fit reads it; compare with "
            "educe of that liner, and narrow the bounds if its values are far from any liner's"
        )
    interval = torch.full((2, len(law.names)), torch.nan, dtype=torch.float64)
    if posterior is not None:
        interval = posterior.quantiles(posterior.draws, QUANTILES)
    notes = (*texts(note for run in runs for note in run.notes), *messages, *fit.warnings())
    tell(notes)
    about = {each.name: getattr(fit, each.name) for each in fields(fit)}
    return Calibration(
        **about,
        posterior=posterior,
        interval=interval,
        model_error=error,
        averaging=averaging,
        choices=chosen,
        notes=notes,
    )


def model_error(run: Run, liner: LinerModel) -> float:
    """Largest error in R of the interpolation over |v|, up to the largest of the data."""
    model = liner.in_flow(run.plane.mach)
    return interpolation_error(run.nodes, model, run.frequency, run.known.top_speed(model))[0]


def posterior_of(fit: Fit, draws: int, seed: int) -> tuple[Posterior | None, list[str]]:
    """Draws in SI, and warnings about them; None without draws or where no noise is known."""
    if draws < 1 or fit.scale != fit.scale:
        return None, []
    law, lowest = fit.law, [fit.chi_square]

    def log_density(at: Tensor) -> Tensor:
        values = law.low + at * fit.width
        found = zip(fit.runs, drawn_impedances(law, values, fit.runs), strict=True)
        left = [run.residuals(z).square().sum(1) for run, z in found]
        square = sum(left) + ((values - law.centre) @ law.prior.T).square().sum(1)
        lowest.append(float(square.min()))
        if fit.stated:
            return -square / 2
        # Unknown noise, equally likely on a logarithmic scale, is integrated out.
        return -fit.data / 2 * torch.log(square.clamp(min=1e-300))

    precision = fit.boxed.T @ fit.boxed / max(fit.scale, 1e-300)
    found = sample_posterior(log_density, fit.share, precision, draws, seed)
    notes = []
    if found.effective < FEWEST_EFFECTIVE:
        notes.append(
            f"the posterior's {draws} draws are worth {found.effective:.0f} independent ones; "
            "intervals are rough: raise draws, or narrow the bounds"
        )
    if min(lowest) < fit.chi_square - 0.1 * fit.scale:
        notes.append(
            f"a draw fits better than the fit (misfit {min(lowest):.4g} against "
            f"{fit.chi_square:.4g}): there is another minimum; start the liner nearer to it"
        )
    return Posterior(law.low + found.draws * fit.width, found.weights), notes

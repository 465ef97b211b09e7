"""Calibration: parameters of a liner fitted, within bounds, to reference impedances.

The data enter once, as moments of |v| (``speed_weights``); what is then varied is the liner alone,
so that the fit, its exact Jacobian and thousands of posterior draws cost no further pass.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.calibration.budget import values_of
from torchliner.calibration.fit import Fit, fit_misfit
from torchliner.calibration.misfit import (
    FreeLiners,
    LevelMisfit,
    Misfit,
    SpeedWeights,
    driving_speed,
    require_plain_tones,
    responses_of,
    speed_weights,
)
from torchliner.calibration.posterior import Posterior, Prediction
from torchliner.calibration.targets import (
    bounds_of,
    nepers_of,
    noise_of,
    prior_of,
    references_of,
    ties_of,
)
from torchliner.checks import require_choice, tell
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, LinerModel, as_liner, named_numbers
from torchliner.names import AVERAGINGS
from torchliner.records import VelocityPlane
from torchliner.velocity.choices import Choices
from torchliner.velocity.review import texts

QUANTILES = (0.025, 0.975)
BEYOND = 1.1  # times the |v| fitted from which a prediction is warned of
LARGEST_MODEL_ERROR = 1e-4  # in R, of the interpolation over |v|, that goes without a note
START = (0.02, 0.98)  # of the box: a start on a bound could not leave it


@dataclass(frozen=True, eq=False)
class Calibration:
    """Fitted parameters, how sure they are, and what they predict.

    Args:
        parameters: names, n of them.  values: best, SI, (n,).  low, high: bounds, (n,).
        liners: calibrated, one a plane.
        covariance: Gauss-Newton, (n, n), scaled as ``scaling`` says; nan for unknown noise.
        scaling: ``stated noise``, or ``residual``: the noise is what the fit leaves.
        degrees_of_freedom: data and priors less parameters.
        chi_square: sum of squared residuals over their uncertainties; with ``residual`` the plain
            sum of squares.
        posterior: draws in SI; None without draws, or where the noise is unknown.
        interval: 95 % of the posterior, (2, n).
        singular_values: of the Jacobian per box width and standard uncertainty, falling, (n,).
        unseen: sets of parameters that the data cannot tell apart.
        on_bound: parameters that end on a bound.
        wanted, found: impedances of all planes and frequencies, (D,).
        model_error: largest error in R, with the values found and at any |v| of the data, of the
            interpolation over |v|; that of the mean over a record is far less.
        averaging, choices, notes: as chosen; all warnings.
        data: real numbers that the parameters were fitted to.
        speeds: least and greatest rms |v| of the planes fitted, m/s, of what drives the model.
        level_check: dB that the fit leaves of each known pressure, (D,); None for fits to references,
            whose ``wanted`` it lacks.
    """

    parameters: tuple[str, ...]
    values: Tensor
    low: Tensor
    high: Tensor
    liners: tuple[LinerModel, ...]
    covariance: Tensor
    scaling: str
    degrees_of_freedom: int
    chi_square: float
    posterior: Posterior | None
    interval: Tensor
    singular_values: Tensor
    unseen: tuple[tuple[str, ...], ...]
    on_bound: tuple[str, ...]
    wanted: Tensor
    found: Tensor
    model_error: float
    averaging: str
    choices: Choices
    notes: tuple[str, ...]
    data: int = 0
    speeds: tuple[float, float] = (0.0, math.inf)
    level_check: Tensor | None = None

    @property
    def standard(self) -> Tensor:
        """Gauss-Newton standard uncertainty, (n,)."""
        return self.covariance.diagonal().sqrt()

    @property
    def correlation(self) -> Tensor:
        """(n, n)."""
        return self.covariance / torch.outer(self.standard, self.standard)

    @property
    def liner(self) -> LinerModel:
        """The calibrated liner of the first plane."""
        return self.liners[0]

    def predict(self, plane: VelocityPlane | Moments, liner: Liner | None = None, frequency: Any = None) -> Prediction:
        """Z of another plane with the spread of the posterior.

        Args:
            plane: wall-normal velocity, or its moments.
            liner: its liner, whose other numbers are kept; default that of the fit.
            frequency: Hz; default the plane's tone.
        Warns:
            DataWarning: its |v| lies more than 10 % outside that of the planes fitted.
        """
        base = self.liner if liner is None else as_liner(liner)
        named_numbers(base, self.parameters)
        best = base.with_numbers(dict(zip(self.parameters, self.values.tolist(), strict=True)))
        weights = _weights([plane], [best], frequency, self.choices)
        free, one = FreeLiners(weights, [base], self.parameters), weights[0]
        before = weights[0].impedance(responses_of(base.in_flow(one.plane.mach), weights)[0])
        draws = None if self.posterior is None else free.impedances(self.posterior.draws)
        notes = self._beyond(one.plane, driving_speed(one))
        tell(notes, depth=2)
        return Prediction(
            one.frequency, free.impedance(self.values), before, draws, self.posterior,
            tuple(notes),
        )  # fmt: skip

    def _beyond(self, plane: VelocityPlane, speed: float) -> list[str]:
        """Whether the plane is faster or slower than all that was fitted."""
        low, high = self.speeds
        if low / BEYOND <= speed <= high * BEYOND:
            return []
        side, times = ("fastest", speed / high) if speed > high else ("slowest", speed / low)
        return [
            f"{plane.name}: rms |v| is {speed:.3g} m/s, {times:.2g} times that of the {side} plane "
            f"fitted (fitted: {low:.3g} to {high:.3g} m/s); the spread of the fit does not cover "
            "what the model misses out there: fit a plane at this level too"
        ]


def calibrate(
    planes: VelocityPlane | Moments | Sequence[VelocityPlane | Moments],
    liners: Liner | Sequence[Liner], references: Any, parameters: Mapping[str, tuple[float, float]],
    *, averaging: str = "velocity", level_check: bool = False, pressure: Any = None,
    noise: Any = None, prior: Mapping[str, tuple[float, float]] | None = None,
    frequency: Any = None, draws: int = 2000, seed: int = 0, **choices: Any,
) -> Calibration:  # fmt: skip
    """Fit parameters to reference impedances, or to known levels, phase ``averaged``.

    Args:
        planes: one or several, or their moments.
        liners: that state ``numbers``, one for all planes, or one each; the free parameters are
            shared by all of them.
        references: normalised Z by plane, complex, (F,) each; or the name of a reference that every
            plane holds, such as "true". None with ``level_check``.
        parameters: bounds, SI, by name of ``liner.numbers()``; ``offset`` is both parts.
        averaging: one of ``names.AVERAGINGS``.
        level_check: fit to the pressures that are known, see ``velocity.level_check``: one datum,
            the level, a plane and frequency, or two where the phase is known.
        pressure: of the planes, one each or None, as for ``educe``; with ``level_check`` alone.
        noise: with ``level_check`` dB of the levels; else standard uncertainty of R and X of each
            reference: one number, a complex number
            u(R) + j u(X), or one by plane. None: equal and unknown, taken from the residual.
        prior: mean and standard deviation of parameters known beforehand; needs ``noise``.
        frequency: Hz; default each plane's tone.  draws, seed: of the posterior; 0 draws for none.
        choices: as for ``educe``; float64 unless ``dtype`` says otherwise.
    Raises:
        TypeError: a liner without numbers.
        ValueError: fewer data (R and X of each plane and frequency) than parameters, bounds that
            no liner can have, references that are missing, a prior without noise.
        RuntimeError: the least squares do not converge.
    Warns:
        DataWarning: a parameter on a bound, parameters that cannot be told apart, a misfit beyond
            the stated noise, too few effective draws; also kept in ``notes``.
    Source: Gauss-Newton covariance and Student's t for unknown noise: Seber & Wild, Nonlinear
        Regression (1989), section 2.1. Trust-region reflective steps of scipy.
    """
    several, models = _pairs(planes, liners)
    require_choice("averaging", averaging, AVERAGINGS)
    chosen = Choices(**{"dtype": "float64", "interval": None, **choices, "averaging": averaging})
    require_plain_tones(chosen)
    names, low, high = bounds_of(parameters, models[0])
    for liner in models[1:]:
        named_numbers(liner, names)
    known = prior_of(prior, names, noise is not None)
    weights = _weights(several, models, frequency, chosen)
    counts = [len(one.frequency) for one in weights]
    if level_check:
        ties = ties_of(weights, references, pressure)
        wanted = torch.full((sum(counts),), complex(torch.nan, torch.nan), dtype=torch.complex128)
        spread = noise_of(None if noise is None else nepers_of(noise), counts)
    else:
        wanted = references_of(weights, references)
        spread = noise_of(noise, counts)
    about = (weights, models, names, low, high, wanted, spread, known)
    misfit = LevelMisfit(*about, *ties) if level_check else Misfit(*about)
    if misfit.data + len(known) < len(names):
        what = "levels and phases" if level_check else f"R and X of {len(wanted)} impedances"
        raise ValueError(
            f"{misfit.data} data ({what}) and {len(known)} priors "
            f"cannot fix {len(names)} parameters ({', '.join(names)}); add planes or frequencies, "
            "or free fewer"
        )
    start = values_of(named_numbers(models[0], names))
    share = ((start - low) / (high - low)).clamp(*START)
    fit = fit_misfit(misfit, share, noise is not None)
    notes = texts(note for one in weights for note in one.notes)
    result = _result(fit, chosen, draws, seed, notes)
    tell(result.notes)
    return result


def _pairs(planes: Any, liners: Any) -> tuple[list[VelocityPlane | Moments], list[LinerModel]]:
    """Planes, and the liner of each."""
    several = [planes] if isinstance(planes, (VelocityPlane, Moments)) else list(planes)
    models = list(liners) if isinstance(liners, (list, tuple)) else [liners] * len(several)
    if not several or len(models) != len(several):
        raise ValueError(f"{len(several)} planes and {len(models)} liners; give one liner, or one a plane")
    return several, [as_liner(liner) for liner in models]


def _weights(
    planes: Sequence[VelocityPlane | Moments], liners: Sequence[LinerModel], frequency: Any,
    chosen: Choices,
) -> list[SpeedWeights]:  # fmt: skip
    """Each plane read once, for its liner with any numbers; tables have their own speeds."""
    both = zip(planes, liners, strict=True)
    return [speed_weights(plane, liner, frequency, chosen) for plane, liner in both]


def _result(fit: Fit, chosen: Choices, draws: int, seed: int, notes: list[str]) -> Calibration:
    misfit = fit.misfit
    values = misfit.values(fit.share)
    posterior, messages = fit.posterior(draws, seed)
    error = misfit.model_error(values.tolist())
    if error > LARGEST_MODEL_ERROR:
        messages.append(
            f"R of the calibrated liner is known to {error:.2g} only (limit "
            f"{LARGEST_MODEL_ERROR:g}) between the speeds at which a fit reads it; compare with "
            "educe of that liner, and narrow the bounds if its values are far from any liner's"
        )
    interval = torch.full((2, len(values)), torch.nan, dtype=torch.float64)
    speeds = [driving_speed(plane) for plane in misfit.planes]
    found = misfit.impedance(values)
    left = None
    if isinstance(misfit, LevelMisfit):
        left = 20 / math.log(10) * torch.cat([each.real for each in misfit.logarithms(found)])
    if posterior is not None:
        interval = posterior.quantiles(posterior.draws, QUANTILES)
    return Calibration(
        parameters=misfit.names, values=values, low=misfit.low, high=misfit.high,
        liners=tuple(misfit.moved(values.tolist())), covariance=fit.covariance,
        scaling="stated noise" if fit.stated else "residual", degrees_of_freedom=fit.freedom,
        chi_square=fit.chi_square, posterior=posterior, interval=interval,
        singular_values=fit.singular_values, unseen=fit.unseen, on_bound=fit.on_bound,
        wanted=misfit.wanted, found=found, model_error=error, averaging=chosen.averaging, choices=chosen,
        notes=(*notes, *messages, *fit.warnings()), data=misfit.data,
        speeds=(min(speeds), max(speeds)), level_check=left,
    )  # fmt: skip

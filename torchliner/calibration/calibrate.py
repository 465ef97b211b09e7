"""Calibration: parameters of a liner fitted, within bounds, to reference impedances.

The data enter once (``level_weights``); what is then varied is the liner alone, so that the fit,
its exact Jacobian and thousands of posterior draws cost no further pass. Whole replays at the
values found make the fit exact: they are repeated until the values settle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.calibration.budget import values_of
from torchliner.calibration.fit import Fit, fit_misfit
from torchliner.calibration.level_weights import level_weights
from torchliner.calibration.misfit import FreeLiners, Misfit
from torchliner.calibration.posterior import Posterior, Prediction
from torchliner.calibration.targets import bounds_of, noise_of, prior_of, references_of
from torchliner.checks import require_choice, tell
from torchliner.liners.model import Liner, LinerModel, as_liner, named_numbers
from torchliner.names import ORDERS
from torchliner.records import VelocityPlane
from torchliner.replay.phase_rule import phase_rule
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.prepare import prepare

QUANTILES = (0.025, 0.975)
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
        anchor_error: change of Z from the last whole replay: error of the sum over levels.
        order, choices, notes: as chosen; all warnings.
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
    anchor_error: float
    order: str
    choices: Choices
    notes: tuple[str, ...]

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

    def predict(
        self, plane: VelocityPlane, liner: Liner | None = None, frequency: Any = None
    ) -> Prediction:
        """Z of another plane with the spread of the posterior.

        Args:
            plane: wall-normal velocity.
            liner: its liner, whose other numbers are kept; default that of the fit.
            frequency: Hz; default the plane's tone.
        """
        base = self.liner if liner is None else as_liner(liner)
        named_numbers(base, self.parameters)
        best = base.with_numbers(dict(zip(self.parameters, self.values.tolist(), strict=True)))
        ready = prepare([plane], best, frequency, self.choices)[0]
        free = FreeLiners([level_weights(ready, self.order)], [base], self.parameters)
        free = free.anchored(self.values)
        draws = None if self.posterior is None else free.impedances(self.posterior.draws)
        return Prediction(ready.frequency, free.impedance(self.values), draws, self.posterior)


def calibrate(
    planes: VelocityPlane | Sequence[VelocityPlane],
    liners: Liner | Sequence[Liner],
    references: Any,
    parameters: Mapping[str, tuple[float, float]],
    *,
    order: str = "velocity first",
    noise: Any = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
    frequency: Any = None,
    draws: int = 2000,
    seed: int = 0,
    **choices: Any,
) -> Calibration:
    """Fit parameters to reference impedances, phase ``averaged``.

    Args:
        planes: one or several.
        liners: that state ``numbers``, one for all planes, or one each; the free parameters are
            shared by all of them.
        references: normalised Z by plane, complex, (F,) each; or the name of a reference that every
            plane holds, such as "true".
        parameters: bounds, SI, by name of ``liner.numbers()``; ``offset`` is both parts.
        order: of averaging, one of ``names.ORDERS``.
        noise: standard uncertainty of R and X of each reference: one number, a complex number
            u(R) + j u(X), or one by plane. None: equal and unknown, taken from the residual.
        prior: mean and standard deviation of parameters known beforehand; needs ``noise``.
        frequency: Hz; default each plane's tone.
        draws, seed: of the posterior; 0 draws for none.
        choices: as for ``educe``, engine ``spectral``; float64 unless ``dtype`` says otherwise.
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
    require_choice("order of averaging", order, ORDERS)
    chosen = Choices(**{"dtype": "float64", "interval": None, **choices, "order": order})
    if chosen.engine != "spectral" or phase_rule(chosen.phase).needs_backward:
        raise ValueError(
            "a calibration replays tones with engine 'spectral', phase 'averaged', not "
            f"{chosen.engine!r}, {chosen.phase!r}"
        )
    names, low, high = bounds_of(parameters, models[0])
    for liner in models[1:]:
        named_numbers(liner, names)
    known = prior_of(prior, names, noise is not None)
    ready = [
        prepare([plane], liner, frequency, chosen)[0]
        for plane, liner in zip(several, models, strict=True)
    ]
    counts = [len(one.frequency) for one in ready]
    wanted, spread = references_of(several, references, counts), noise_of(noise, counts)
    if 2 * len(wanted) + len(known) < len(names):
        raise ValueError(
            f"{2 * len(wanted)} data (R and X of {len(wanted)} impedances) and {len(known)} priors "
            f"cannot fix {len(names)} parameters ({', '.join(names)}); add planes or frequencies, "
            "or free fewer"
        )
    weights = [level_weights(one, order) for one in ready]
    misfit = Misfit(weights, models, names, low, high, wanted, spread, known)
    start = values_of(named_numbers(models[0], names))
    share = ((start - low) / (high - low)).clamp(*START)
    fit = fit_misfit(misfit, share, noise is not None)
    notes = [note for one in ready for note in one.notes]
    result = _result(fit, order, chosen, draws, seed, notes)
    tell(result.notes)
    return result


def _pairs(planes: Any, liners: Any) -> tuple[list[VelocityPlane], list[LinerModel]]:
    """Planes, and the liner of each."""
    several = [planes] if isinstance(planes, VelocityPlane) else list(planes)
    models = list(liners) if isinstance(liners, (list, tuple)) else [liners] * len(several)
    if not several or len(models) != len(several):
        raise ValueError(
            f"{len(several)} planes and {len(models)} liners; give one liner, or one a plane"
        )
    return several, [as_liner(liner) for liner in models]


def _result(
    fit: Fit, order: str, chosen: Choices, draws: int, seed: int, notes: list[str]
) -> Calibration:
    misfit = fit.misfit
    values = misfit.values(fit.share)
    posterior, messages = fit.posterior(draws, seed)
    interval = torch.full((2, len(values)), torch.nan, dtype=torch.float64)
    if posterior is not None:
        interval = posterior.quantiles(posterior.draws, QUANTILES)
    return Calibration(
        parameters=misfit.names,
        values=values,
        low=misfit.low,
        high=misfit.high,
        liners=tuple(misfit.moved(values.tolist())),
        covariance=fit.covariance,
        scaling="stated noise" if fit.stated else "residual",
        degrees_of_freedom=fit.freedom,
        chi_square=fit.chi_square,
        posterior=posterior,
        interval=interval,
        singular_values=fit.singular_values,
        unseen=fit.unseen,
        on_bound=fit.on_bound,
        wanted=misfit.wanted,
        found=misfit.impedance(values),
        anchor_error=fit.anchor_error,
        order=order,
        choices=chosen,
        notes=(*notes, *messages, *fit.warnings()),
    )

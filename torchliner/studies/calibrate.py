"""Calibration: parameters of a liner fitted, within bounds, to reference impedances or known levels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_choice, tell
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import interpolation_error
from torchliner.liners.model import Liner, LinerModel, as_liner, named_numbers
from torchliner.names import AVERAGINGS
from torchliner.records import VelocityPlane
from torchliner.studies.budget import correlation_of
from torchliner.studies.fit import (
    Fit,
    Prediction,
    drawn_impedances,
    fit_law,
    impedances,
)
from torchliner.studies.laws import parameter_law
from torchliner.studies.posterior import FEWEST_EFFECTIVE, Posterior, sample_posterior
from torchliner.studies.rows import Row
from torchliner.studies.runs import (
    NEPER,
    Run,
    held_to_levels,
    held_to_references,
    read_run,
    require_plain_tones,
)
from torchliner.studies.variants import Records, plane_of
from torchliner.velocity.choices import Choices
from torchliner.velocity.review import texts

QUANTILES = (0.025, 0.975)
LARGEST_MODEL_ERROR = 1e-4  # in R, of the interpolation over |v|, that goes without a note
BEYOND = 1.1  # times the |v| fitted from which a prediction is warned of


@dataclass(frozen=True, eq=False)
class Calibration(Fit):
    """Fitted parameters, how sure they are, and what they predict; SI throughout.

    Args:
        posterior: draws in SI; None without draws, or where the noise is unknown.
        interval: 95 % of the posterior, (2, n); nan without one.
        model_error: largest error in R, with the values found and at any |v| of the data, of the interpolation over
            |v|; that of the mean over a record is far less.
        averaging, choices, notes: as chosen; all warnings.
    """

    posterior: Posterior | None
    interval: Tensor
    model_error: float
    averaging: str
    choices: Choices
    notes: tuple[str, ...]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names, n of them."""
        return self.law.names

    @property
    def scaling(self) -> str:
        """``stated noise``, or ``residual``: the noise is what the fit leaves."""
        return "stated noise" if self.stated else "residual"

    @property
    def wanted(self) -> Tensor:
        """References of all planes and frequencies, (D,); nan for a fit to levels."""
        return torch.cat([run.wanted for run in self.runs])

    @property
    def found(self) -> Tensor:
        """Impedances of all planes and frequencies, (D,)."""
        return torch.cat(impedances(self.law, self.values, self.runs))

    @property
    def level_check(self) -> Tensor | None:
        """dB that the fit leaves of each known pressure, (D,); None for fits to references."""
        if self.runs[0].ratio is None:
            return None
        parts = self.found.split([len(run.frequency) for run in self.runs])
        return torch.cat([run.errors(z).real / NEPER for run, z in zip(self.runs, parts, strict=True)])

    @property
    def speeds(self) -> tuple[float, float]:
        """Least and greatest rms |v| of the planes fitted, m/s, of what drives the model."""
        speeds = [run.speed for run in self.runs]
        return min(speeds), max(speeds)

    @property
    def widened(self) -> Tensor:
        """Of predictions without draws: as the posterior, it knows the noise alone."""
        return self.covariance

    @property
    def correlation(self) -> Tensor:
        """(n, n)."""
        return self.covariance / torch.outer(self.standard, self.standard)

    @property
    def liners(self) -> tuple[LinerModel, ...]:
        """Calibrated, one a plane."""
        best = dict(zip(self.parameters, self.values.tolist(), strict=True))
        return tuple(run.liner.with_numbers(best) for run in self.runs)

    @property
    def liner(self) -> LinerModel:
        """The calibrated liner of the first plane."""
        return self.liners[0]

    def predict(self, plane: Records, liner: Liner | None = None, frequency: Any = None) -> Prediction:
        """Z of another plane with the spread of the posterior; without one that of Gauss and Newton.

        Args:
            plane: wall-normal velocity, or its moments.
            liner: its liner, whose other numbers are kept; default that of the fit.
            frequency: Hz; default the plane's tone.
        Warns:
            DataWarning: its |v| lies more than 10 % outside that of the planes fitted.
        """
        base, law = self.liner if liner is None else as_liner(liner), self.law
        own = torch.tensor([n.value for n in named_numbers(base, self.parameters).values()], dtype=torch.float64)
        run = read_run(plane, base, frequency, self.choices)
        (before,) = impedances(law, own, [run])
        after, spread = self.of_run(run)
        if self.posterior is not None:
            parts = torch.view_as_real(drawn_impedances(law, self.posterior.draws, [run])[0])
            spread = torch.stack([self.posterior.covariance(each) for each in parts.unbind(1)])
        notes = self._beyond(run.plane.name, run.speed)
        tell(notes)
        return Prediction(run.frequency, after, spread, notes, before)

    def rows(
        self, plane: Records, liner: Liner, *, label: str | None = None, reference: str = "true", noise: complex = 0j
    ) -> list[Row]:
        """``predict`` beside a reference that the plane holds, a row a frequency.

        Args:
            plane: wall-normal velocity, or its moments.
            liner: as it was, whose other numbers the prediction keeps.
            label: of the plane; default its case.
            reference: name of the impedance beside which it is put, if the plane has it.
            noise: standard uncertainty of that, u(R) + j u(X), part of the misses.
        Returns:
            label, frequency (Hz), height (m), before and after the calibration, standard (u(R) + j u(X)), correlation
            of R and X, true (the reference, or None), misses (see ``Prediction.misses``), notes.
        """
        found, facts = self.predict(plane, liner), plane_of(plane)
        true = facts.reference.get(reference)
        return [
            Row(
                label=label or str(facts.provenance.get("case", facts.title)),
                frequency=frequency,
                height=facts.height,
                before=complex(found.before[i]),
                after=complex(found.impedance[i]),
                standard=complex(found.standard[i]),
                correlation=correlation_of(found.covariance[i]),
                true=true,
                misses=None if true is None else found.misses(complex(true), noise, i),
                notes=found.notes,
            )
            for i, frequency in enumerate(found.frequency.tolist())
        ]

    def _beyond(self, name: str, speed: float) -> tuple[str, ...]:
        """Whether a plane is faster or slower than all that was fitted."""
        low, high = self.speeds
        if low / BEYOND <= speed <= high * BEYOND:
            return ()
        side, times = ("fastest", speed / high) if speed > high else ("slowest", speed / low)
        return (
            f"{name}: rms |v| is {speed:.3g} m/s, {times:.2g} times that of the {side} plane fitted (fitted: {low:.3g} "
            f"to {high:.3g} m/s); the spread of the fit does not cover what the model misses out there: fit a plane at "
            "this level too",
        )


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
    several, models = planes_and_liners(planes, liners)
    require_choice("averaging", averaging, AVERAGINGS)
    chosen = Choices(**{"dtype": "float64", "interval": None, **choices, "averaging": averaging})
    require_plain_tones(chosen)
    if prior and noise is None:
        raise ValueError("a prior weighs against data of known uncertainty; state noise too")
    law = parameter_law(parameters, models[0], prior)
    for liner in models[1:]:
        named_numbers(liner, law.names)
    runs = [read_run(plane, liner, frequency, chosen) for plane, liner in zip(several, models, strict=True)]
    if level_check and references is not None:
        raise ValueError("a fit to levels needs no references; leave them out, or leave level_check out")
    runs = held_to_levels(runs, pressure, noise) if level_check else held_to_references(runs, references, noise)
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
    error = max(model_error(run, run.liner.with_numbers(best).in_flow(run.plane.mach)) for run in runs)
    if error > LARGEST_MODEL_ERROR:
        messages.append(
            f"R of the calibrated liner is known to {error:.2g} only (limit {LARGEST_MODEL_ERROR:g}) between the "
            "speeds at which a fit reads it; compare with educe of that liner, and narrow the bounds if its values are "
            "far from any liner's"
        )
    interval = torch.full((2, len(law.names)), torch.nan, dtype=torch.float64)
    if posterior is not None:
        interval = posterior.quantiles(posterior.draws, QUANTILES)
    notes = (*texts(note for run in runs for note in run.notes), *messages, *fit.warnings())
    tell(notes)
    return Calibration(
        **{each.name: getattr(fit, each.name) for each in fields(fit)},
        posterior=posterior,
        interval=interval,
        model_error=error,
        averaging=averaging,
        choices=chosen,
        notes=notes,
    )


def planes_and_liners(planes: Any, liners: Any) -> tuple[list[Records], list[LinerModel]]:
    """Several planes and the liner of each; one liner is one object, which a fit asks once.

    Raises:
        ValueError: not one liner, nor one a plane.
    """
    several = [planes] if isinstance(planes, Records) else list(planes)
    given = list(liners) if isinstance(liners, list | tuple) else [liners] * len(several)
    if not several or len(given) != len(several):
        raise ValueError(f"{len(several)} planes and {len(given)} liners; give one liner, or one a plane")
    made = {id(each): as_liner(each) for each in given}
    return several, [made[id(each)] for each in given]


def model_error(run: Run, liner: LinerModel) -> float:
    """Largest error in R of the interpolation over |v|, up to the largest of the data."""
    return interpolation_error(run.nodes, liner, run.frequency, run.known.top_speed(liner))[0]


def posterior_of(fit: Fit, draws: int, seed: int) -> tuple[Posterior | None, list[str]]:
    """Draws in SI, and warnings about them; None without draws or where no noise is known."""
    if draws < 1 or fit.scale != fit.scale:
        return None, []
    law, lowest = fit.law, [fit.chi_square]

    def log_density(at: Tensor) -> Tensor:
        values = law.low + at * fit.width
        found = zip(fit.runs, drawn_impedances(law, values, fit.runs), strict=True)
        square = sum(run.residuals(z).square().sum(1) for run, z in found)
        square = square + ((values - law.centre) @ law.prior.T).square().sum(1)
        lowest.append(float(square.min()))
        # Unknown noise, equally likely on a logarithmic scale, is integrated out.
        return -square / 2 if fit.stated else -fit.data / 2 * torch.log(square.clamp(min=1e-300))

    boxed = fit.jacobian * fit.width
    found = sample_posterior(log_density, fit.share, boxed.T @ boxed / max(fit.scale, 1e-300), draws, seed)
    notes = []
    if found.effective < FEWEST_EFFECTIVE:
        notes.append(
            f"the posterior's {draws} draws are worth {found.effective:.0f} independent ones; intervals are rough: "
            "raise draws, or narrow the bounds"
        )
    if min(lowest) < fit.chi_square - 0.1 * fit.scale:
        notes.append(
            f"a draw fits better than the fit (misfit {min(lowest):.4g} against {fit.chi_square:.4g}): there is "
            "another minimum; start the liner nearer to it"
        )
    return Posterior(law.low + found.draws * fit.width, found.weights), notes

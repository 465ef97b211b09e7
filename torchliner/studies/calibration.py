"""What a calibration found: parameters, how sure they are, and what they predict."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import tell
from torchliner.liners.model import Liner, LinerModel, as_liner, named_numbers
from torchliner.studies.budget import correlation_of, standard_of
from torchliner.studies.fit import Fit, curves_at_nodes, drawn_impedances, impedances
from torchliner.studies.posterior import Posterior
from torchliner.studies.runs import NEPER, read_run
from torchliner.studies.variants import Records, plane_of
from torchliner.velocity.choices import Choices

BEYOND = 1.1  # times the |v| fitted from which a prediction is warned of


@dataclass(frozen=True, eq=False)
class Prediction:
    """Whole-liner impedance with its posterior spread.

    Args:
        frequency: Hz, (F,).
        impedance: at the best values, complex, (F,).
        before: with the liner's own numbers, (F,).
        draws: at each draw of the posterior, (M, F); None without one.
        posterior: the weights of the draws.
        notes: warnings, with numbers.
    """

    frequency: Tensor
    impedance: Tensor
    before: Tensor
    draws: Tensor | None
    posterior: Posterior | None
    notes: tuple[str, ...] = ()

    @property
    def mean(self) -> Tensor:
        """Posterior mean of Z, (F,); nan without a posterior."""
        if self.draws is None or self.posterior is None:
            return torch.full_like(self.impedance, complex(torch.nan, torch.nan))
        return self.posterior.mean(self.draws)

    @property
    def covariance(self) -> Tensor:
        """Of R and X, (F, 2, 2); nan without a posterior."""
        if self.draws is None or self.posterior is None:
            return torch.full((len(self.frequency), 2, 2), torch.nan, dtype=torch.float64)
        parts = torch.view_as_real(self.draws)
        return torch.stack([self.posterior.covariance(parts[:, i]) for i in range(parts.shape[1])])

    @property
    def standard(self) -> Tensor:
        """u(R) + j u(X) from the parameters' spread, (F,)."""
        return standard_of(self.covariance)

    def misses(self, reference: complex, noise: complex = 0j, index: int = 0) -> complex:
        """By how many standard deviations R and X lie off a known impedance, signed; its own
        uncertainty ``noise``, u(R) + j u(X), is added in quadrature."""
        away, spread = complex(self.impedance[index]) - reference, complex(self.standard[index])

        def over(off: float, first: float, second: float) -> float:
            return off / max(math.hypot(first, second), 1e-300) if first == first else first

        return complex(over(away.real, spread.real, noise.real), over(away.imag, spread.imag, noise.imag))


@dataclass(frozen=True)
class PredictionRow:
    """One predicted impedance beside what is known of it, all normalised.

    Args:
        label: of the plane.
        frequency: Hz.
        height: m, or None.
        before, after: with the liner as it was, and calibrated.
        standard: u(R) + j u(X) of ``after``, from the parameters' spread.
        correlation: of R and X.
        true: reference, or None.
        misses: by how many standard deviations R and X lie off it, signed; None without one.
        notes: warnings, as of a |v| beyond what was fitted.
    """

    label: str
    frequency: float
    height: float | None
    before: complex
    after: complex
    standard: complex
    correlation: float
    true: complex | None
    misses: complex | None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Calibration(Fit):
    """Fitted parameters, how sure they are, and what they predict; SI throughout.

    Args:
        posterior: draws in SI; None without draws, or where the noise is unknown.
        interval: 95 % of the posterior, (2, n).
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
        return torch.cat([z for z, _ in impedances(self.law, self.values, self.runs)])

    @property
    def level_check(self) -> Tensor | None:
        """dB that the fit leaves of each known pressure, (D,); None for fits to references."""
        runs = self.runs
        if runs[0].ratio is None:
            return None
        parts = self.found.split([len(run.frequency) for run in runs])
        return torch.cat([run.errors(z).real / NEPER for run, z in zip(runs, parts, strict=True)])

    @property
    def speeds(self) -> tuple[float, float]:
        """Least and greatest rms |v| of the planes fitted, m/s, of what drives the model."""
        speeds = [run.speed for run in self.runs]
        return min(speeds), max(speeds)

    @property
    def standard(self) -> Tensor:
        """Gauss-Newton standard uncertainty, (n,)."""
        return self.covariance.diagonal().sqrt()

    @property
    def correlation(self) -> Tensor:
        """(n, n)."""
        return self.covariance / torch.outer(self.standard, self.standard)

    @property
    def liners(self) -> tuple[LinerModel, ...]:
        """Calibrated, one a plane."""
        return tuple(self._moved(run.liner) for run in self.runs)

    @property
    def liner(self) -> LinerModel:
        """The calibrated liner of the first plane."""
        return self.liners[0]

    def _moved(self, liner: LinerModel) -> LinerModel:
        return liner.with_numbers(dict(zip(self.parameters, self.values.tolist(), strict=True)))

    def predict(self, plane: Records, liner: Liner | None = None, frequency: Any = None) -> Prediction:
        """Z of another plane with the spread of the posterior.

        Args:
            plane: wall-normal velocity, or its moments.
            liner: its liner, whose other numbers are kept; default that of the fit.
            frequency: Hz; default the plane's tone.
        Warns:
            DataWarning: its |v| lies more than 10 % outside that of the planes fitted.
        """
        prediction = self._predicted(plane, liner, frequency)
        tell(prediction.notes, depth=1)
        return prediction

    def rows(
        self, plane: Records, liner: Liner, *, label: str | None = None, reference: str = "true", noise: complex = 0j
    ) -> list[PredictionRow]:
        """``predict`` beside a reference that the plane holds.

        Args:
            plane: wall-normal velocity, or its moments.
            liner: as it was, whose other numbers the prediction keeps.
            label: of the plane; default its case.
            reference: name of the impedance beside which it is put, if the plane has it.
            noise: standard uncertainty of that, u(R) + j u(X), part of the misses.
        """
        found, facts = self.predict(plane, liner), plane_of(plane)
        true = facts.reference.get(reference)
        return [
            PredictionRow(
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

    def _predicted(self, plane: Records, liner: Liner | None, frequency: Any) -> Prediction:
        base = self.liner if liner is None else as_liner(liner)
        named_numbers(base, self.parameters)
        run, law = read_run(plane, base, frequency, self.choices), self.law
        own = torch.tensor([base.numbers()[name].value for name in self.parameters], dtype=torch.float64)
        (after,), (before,) = (curves_at_nodes(law, each, [run], slopes=False) for each in (self.values, own))
        draws = None if self.posterior is None else drawn_impedances(law, self.posterior.draws, [run])[0]
        return Prediction(
            run.frequency,
            run.impedance(after[0]),
            run.impedance(before[0]),
            draws,
            self.posterior,
            self._beyond(run.plane.name, run.speed),
        )

    def _beyond(self, name: str, speed: float) -> tuple[str, ...]:
        """Whether a plane is faster or slower than all that was fitted."""
        low, high = self.speeds
        if low / BEYOND <= speed <= high * BEYOND:
            return ()
        side, times = ("fastest", speed / high) if speed > high else ("slowest", speed / low)
        return (
            f"{name}: rms |v| is {speed:.3g} m/s, {times:.2g} times that of the {side} plane "
            f"fitted (fitted: {low:.3g} to {high:.3g} m/s); the spread of the fit does not cover "
            "what the model misses out there: fit a plane at this level too",
        )

"""Curves Z(|v|) as a model that is fitted to runs: best curve and Laplace posterior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.identification.curve_problem import BOUNDS, CurveProblem, Datum
from torchliner.identification.parameter_model import WIDTH
from torchliner.identification.runs import Run
from torchliner.identification.speed_curve import Knots, prior_shape
from torchliner.liners.model import LinerModel

ON_BOUND = 1e-3  # of ``BOUNDS``


@dataclass(frozen=True, eq=False)
class CurveFit:
    """Best curve of one frequency, and its posterior.

    Args:
        problem: whose answer it is.
        parameters: best, (n,).  covariance: Laplace, (n, n), 0 for those on a bound.
        singular_values: of the Jacobian over noise and prior spread, falling; above 1 the data say
            more than the prior.
        misfit: rms of what is left over the noise; above 1 the covariance is widened by it.
        on_bound: how many parameters end on one.
    """

    problem: CurveProblem
    parameters: Tensor
    covariance: Tensor
    singular_values: Tensor
    misfit: float
    on_bound: int

    @property
    def frequency(self) -> float:
        """Hz."""
        return self.problem.frequency

    @property
    def determined(self) -> float:
        """How many parameters the data determine."""
        square = self.singular_values.square()
        return float((square / (1 + square)).sum())

    def curve(self, speed: Tensor) -> Tensor:
        """Z at |v|, complex, (V,)."""
        return self.problem.shape.curve(self.parameters, self.problem.knots.rising(speed))

    def predict(self, datum: Datum) -> tuple[Tensor, Tensor]:
        """Z of a plane and covariance of R and X, (2, 2), to first order."""
        rising = self.problem.knots.rising(datum.speeds)
        shape = self.problem.shape
        found, slopes = datum.impedance(shape.curve(self.parameters, rising) + datum.offset)
        rows = slopes @ shape.slopes(self.parameters, rising)
        parts = torch.stack([rows.real, rows.imag])
        return found, parts @ self.covariance @ parts.T

    def band(self, speed: Tensor) -> Tensor:
        """Z at |v|, and the ends of the 95 % bands of R, above 0, and X apart, (3, V)."""
        rising = self.problem.knots.rising(speed)
        slopes = self.problem.shape.slopes(self.parameters, rising)
        best = self.curve(speed)
        up, across = (
            WIDTH * torch.einsum("vi,ij,vj->v", each, self.covariance, each).clamp(min=0).sqrt()
            for each in (slopes.real, slopes.imag)
        )
        factor = (up / best.real).exp()
        low = torch.complex(best.real / factor, best.imag - across)
        return torch.stack([best, low, torch.complex(best.real * factor, best.imag + across)])


def fit_curve(problem: CurveProblem) -> CurveFit:
    """Bounded least squares with the exact Jacobian, and what it says of the parameters."""
    best = problem.solve()
    left, by = problem.slopes(best)
    free = best.abs() < BOUNDS * (1 - ON_BOUND)
    own, by = problem.prior[:, free], by[:, free]
    factor = torch.linalg.cholesky(own.T @ own)
    singular = torch.linalg.svdvals(torch.linalg.solve_triangular(factor, by.T, upper=False))
    used = float((singular**2 / (1 + singular**2)).sum())
    misfit = float(left.square().sum() / max(len(left) - used, 1.0)) ** 0.5
    inverse = torch.linalg.inv(by.T @ by / max(1.0, misfit) ** 2 + own.T @ own)
    covariance = torch.zeros(len(best), len(best), dtype=torch.float64)
    covariance[torch.outer(free, free)] = inverse.flatten()
    return CurveFit(problem, best, covariance, singular, misfit, int((~free).sum()))


@dataclass(frozen=True)
class CurveModel:
    """A curve at each frequency, of so much freedom."""

    base: LinerModel
    freedom: float
    shape: str
    reactance: str
    knots: Knots
    rest: complex | None = None

    @property
    def label(self) -> str:
        """Of tables."""
        return f"curve, freedom {self.freedom:g}"

    def fit(self, runs: Sequence[Run]) -> FittedCurves:
        """To these runs."""
        found: list[CurveFit] = []
        for frequency in sorted({f for run in runs for f in run.frequency.tolist()}):
            if found and frequency < found[-1].frequency * (1 + SAME_FREQUENCY):
                continue
            data = [
                self.datum(run, i)
                for run in runs
                for i, f in enumerate(run.frequency.tolist())
                if abs(f / frequency - 1) < SAME_FREQUENCY
            ]
            shape = prior_shape(self.shape, self.base, frequency, self.knots, self.reactance, self.rest)
            problem = CurveProblem(data, self.knots, shape, frequency, self.freedom)
            found.append(fit_curve(problem))
        return FittedCurves(self, tuple(found))

    def datum(self, run: Run, index: int) -> Datum:
        """A plane at one of its frequencies, with the linear part of its own liner."""
        f, still = run.frequency[index], torch.zeros(1, dtype=torch.float64)
        own, base = (complex(each.impedance(f, still)[0]) for each in (run.liner, self.base))
        return Datum(run, index, own - base)


@dataclass(frozen=True, eq=False)
class FittedCurves:
    """Curves of all frequencies of the runs they were fitted to."""

    model: CurveModel
    fits: tuple[CurveFit, ...]

    def at(self, frequency: float) -> CurveFit:
        """Of one frequency.

        Raises:
            ValueError: no run has it.
        """
        for fit in self.fits:
            if abs(fit.frequency / frequency - 1) < SAME_FREQUENCY:
                return fit
        there = ", ".join(f"{fit.frequency:g}" for fit in self.fits)
        raise ValueError(
            f"no curve is known at {frequency:g} Hz: the runs that are left have {there} Hz; a "
            "table over |v| says nothing of other frequencies (a parameter does: "
            "models=[('vena_contracta',)])"
        )

    def predict(self, run: Run) -> tuple[Tensor, Tensor]:
        """Z of a plane, (F,), and covariances of R and X, (F, 2, 2)."""
        rows = [self.at(f).predict(self.model.datum(run, i))
                for i, f in enumerate(run.frequency.tolist())]  # fmt: skip
        values, spreads = zip(*rows, strict=True)
        return torch.stack(values), torch.stack(spreads)

    def band(self, liner: LinerModel, frequency: float, speed: Tensor) -> Tensor:
        """See ``FittedParameters``."""
        return self.at(frequency).band(speed)

    def law(self, run: Run, index: int, speed: Tensor) -> Tensor:
        """Z at |v|, (V,), at one frequency of a plane."""
        found = self.at(float(run.frequency[index])).curve(speed)
        return found + self.model.datum(run, index).offset

    @property
    def misfit(self) -> float:
        """The largest of all frequencies, over the noise."""
        return max(fit.misfit for fit in self.fits)

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings."""
        return tuple(
            f"{fit.on_bound} of {len(fit.parameters)} parameters of the curve at "
            f"{fit.frequency:g} Hz end at a factor of {np.exp(BOUNDS):.0f} of the prior shape: the "
            "references ask for a step or the other direction; see reactance, or state more noise"
            for fit in self.fits
            if fit.on_bound
        )

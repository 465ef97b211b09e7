"""Laws fitted within bounds to what runs are held to; slopes are exact."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.least_squares import with_slopes
from torchliner.liners.model import LinerModel
from torchliner.studies.budget import standard_of
from torchliner.studies.laws import Law
from torchliner.studies.runs import NOTHING, Run

ON_BOUND = 1e-3  # of the box
UNSEEN = 1e-6  # singular value, relative to the largest, of a direction the data do not see
NAMED = 0.2  # share in such a direction from which a parameter is named
FAR = 2.0  # times the stated noise from which a misfit is one of the model
START = (0.02, 0.98)  # of the box: a start on a bound could not leave it
WIDTH = 1.959964  # standard deviations of a 95 % interval


def curves_at_nodes(law: Law, values: Tensor, runs: Sequence[Run]) -> list[Tensor]:
    """Z at the frequencies and node speeds of each run, (F, K), differentiable; each liner is asked once."""
    every = torch.cat([run.frequency for run in runs]).unique()
    made: dict[Any, Tensor] = {}
    found = []
    for run in runs:
        key = (id(run.liner), run.plane.mach, run.nodes)
        if key not in made:
            made[key] = law.curve(values, run.liner.in_flow(run.plane.mach), every, run.nodes.speeds)
        found.append(made[key][torch.searchsorted(every, run.frequency)])
    return found


def impedances(law: Law, values: Tensor, runs: Sequence[Run]) -> list[Tensor]:
    """Z of each run, (F,), differentiable in the values."""
    return [run.impedance(z) for run, z in zip(runs, curves_at_nodes(law, values, runs), strict=True)]


def drawn_impedances(law: Law, draws: Tensor, runs: Sequence[Run]) -> list[Tensor]:
    """Z of each run for many values, (M, n) to (M, F) each."""
    rows = [curves_at_nodes(law, values, runs) for values in draws]
    return [run.impedance(torch.stack(each)) for run, each in zip(runs, zip(*rows, strict=True), strict=True)]


def residuals_of(law: Law, values: Tensor, runs: Sequence[Run]) -> tuple[Tensor, Tensor]:
    """Residuals of the data and then of the prior, (m,), and their derivatives in the values, (m, n)."""

    def made(at: Tensor) -> Tensor:
        return torch.cat([run.residuals(z) for run, z in zip(runs, impedances(law, at, runs), strict=True)])

    left, by = with_slopes(made, values)
    return torch.cat([left, law.prior @ (values - law.centre)]), torch.cat([by, law.prior])


@dataclass(frozen=True, eq=False)
class Prediction:
    """Z of the whole liner by a fit.

    Args:
        frequency: Hz, (F,).
        impedance: complex, (F,).
        covariance: of R and X, (F, 2, 2): that of the posterior, else to first order.
        notes: warnings, with numbers.
        before: with the liner's own numbers, (F,); empty for a curve.
        outside: share of the plane's weight at speeds that no run saw, (F,), see ``identify``.
    """

    frequency: Tensor
    impedance: Tensor
    covariance: Tensor
    notes: tuple[str, ...] = ()
    before: Tensor = NOTHING
    outside: Tensor = NOTHING

    @property
    def standard(self) -> Tensor:
        """u(R) + j u(X), (F,)."""
        return standard_of(self.covariance)

    def misses(self, reference: complex, noise: complex = 0j, index: int = 0) -> complex:
        """By how many standard deviations R and X lie off a known impedance, signed; its own uncertainty ``noise``,
        u(R) + j u(X), is added in quadrature."""
        away, own = complex(self.impedance[index]) - reference, complex(self.standard[index])
        spread = complex(math.hypot(own.real, noise.real), math.hypot(own.imag, noise.imag))
        return complex(away.real / max(spread.real, 1e-300), away.imag / max(spread.imag, 1e-300))


@dataclass(frozen=True, eq=False)
class Fit:
    """The best place in the box of the bounds.

    Args:
        law, runs: what was fitted to what.
        values: best, SI, (n,).
        stated: whether the noise is known; else the residual stands for it.
        residuals, jacobian: there, of the data and then of the prior, (m,) and (m, n).
    """

    law: Law
    runs: Sequence[Run]
    values: Tensor
    stated: bool
    residuals: Tensor
    jacobian: Tensor

    @property
    def width(self) -> Tensor:
        """Of the box, (n,)."""
        return self.law.high - self.law.low

    @property
    def share(self) -> Tensor:
        """Place in the box, 0 to 1, (n,)."""
        return (self.values - self.law.low) / self.width

    @property
    def data(self) -> int:
        """Real numbers that the runs are held to, priors apart."""
        return sum(run.data for run in self.runs)

    @property
    def chi_square(self) -> float:
        """Sum of squared residuals."""
        return float(self.residuals.square().sum())

    @property
    def freedom(self) -> int:
        """Data and priors less parameters."""
        return len(self.residuals) - len(self.values)

    @property
    def scale(self) -> float:
        """Variance of a residual: 1, or that of the residuals; nan without a degree of freedom."""
        if self.stated:
            return 1.0
        return self.chi_square / self.freedom if self.freedom else math.nan

    @property
    def free(self) -> Tensor:
        """Parameters that end on no bound, bool, (n,)."""
        return (self.share >= ON_BOUND) & (self.share <= 1 - ON_BOUND)

    @property
    def on_bound(self) -> tuple[str, ...]:
        """Parameters that end on a bound."""
        return tuple(name for name, free in zip(self.law.names, self.free.tolist(), strict=True) if not free)

    @functools.cached_property
    def _svd(self) -> tuple[Tensor, Tensor]:
        """Of the slopes over what is known beforehand: the prior of a curve, else the box."""
        if self.law.frequency is None:
            return torch.linalg.svd(self.jacobian * self.width, full_matrices=False)[1:]
        prior = self.law.prior[:, self.free]
        factor = torch.linalg.cholesky(prior.T @ prior)
        by = torch.linalg.solve_triangular(factor, self.jacobian[: self.data, self.free].T, upper=False)
        return torch.linalg.svd(by.T, full_matrices=False)[1:]

    @property
    def singular_values(self) -> Tensor:
        """Of the Jacobian over the noise, in units of the box, of a curve of the spread of its prior, falling."""
        return self._svd[0] / (self.scale**0.5 if self.scale > 0 else 1.0)

    @property
    def determined(self) -> float:
        """How many parameters the data determine: without a prior all."""
        square = self.singular_values.square()
        return float(len(self.values) if self.law.frequency is None else (square / (1 + square)).sum())

    @property
    def misfit(self) -> float:
        """rms of what is left of the data over the noise, by degrees of freedom."""
        return float(self.residuals[: self.data].square().sum() / max(self.data - self.determined, 1.0)) ** 0.5

    @property
    def covariance(self) -> Tensor:
        """Gauss-Newton, (n, n); huge along what the data do not see."""
        return self.scale * _inverse(self.jacobian, self.width)

    @property
    def standard(self) -> Tensor:
        """Gauss-Newton standard uncertainty, (n,)."""
        return self.covariance.diagonal().sqrt()

    @property
    def widened(self) -> Tensor:
        """Covariance (n, n), widened where the misfit is above the noise; 0 on a bound."""
        kept, rows = self.free, self.jacobian.clone()
        rows[: self.data] /= max(1.0, self.misfit)
        found = torch.zeros(len(kept), len(kept), dtype=torch.float64)
        if bool(kept.any()):
            found[torch.outer(kept, kept)] = _inverse(rows[:, kept], self.width[kept]).flatten()
        return found

    @property
    def unseen(self) -> tuple[tuple[str, ...], ...]:
        """Parameters of directions that the data do not determine, or less than the bounds do."""
        singular, axes = self._svd
        limit = UNSEEN * float(singular[0])
        if self.scale == self.scale:
            # Wider than the box itself, whose values, all equally likely, scatter by 1/sqrt 12.
            limit = max(limit, (12 * self.scale) ** 0.5)
        return tuple(
            tuple(n for n, part in zip(self.law.names, axis.abs().tolist(), strict=True) if part > NAMED)
            for value, axis in zip(singular.tolist(), axes, strict=True)
            if value <= limit
        )

    def of_run(self, run: Run) -> tuple[Tensor, Tensor]:
        """Z of a plane, (F,), and covariances of R and X, (F, 2, 2), to first order."""
        z, by = with_slopes(lambda at: impedances(self.law, at, [run])[0], self.values)
        return z, _spread(by, self.widened)

    def curve(self, liner: LinerModel, frequency: float, speed: Tensor) -> Tensor:
        """Z of a liner at |v|, complex, (V,)."""
        return self.law.curve(self.values, liner, torch.tensor([frequency], dtype=torch.float64), speed)[0]

    def band(self, liner: LinerModel, frequency: float, speed: Tensor) -> Tensor:
        """Z of a liner at |v|, and the ends of the 95 % bands of R and X apart, (3, V); R of a curve stays above 0."""
        lines = torch.tensor([frequency], dtype=torch.float64)
        z, by = with_slopes(lambda at: self.law.curve(at, liner, lines, speed)[0], self.values)
        spread = WIDTH * standard_of(_spread(by, self.widened))
        low, high = z - spread, z + spread
        if self.law.frequency is not None:
            factor = (spread.real / z.real).exp()
            low, high = torch.complex(z.real / factor, low.imag), torch.complex(z.real * factor, high.imag)
        return torch.stack([z, low, high])

    def warnings(self) -> list[str]:
        """Parameters on bounds, undetermined directions, noise that does not fit; with remedies."""
        notes, law = [], self.law
        for name in self.on_bound:
            i = law.names.index(name)
            label, at = ("lower", law.low[i]) if self.share[i] < 0.5 else ("upper", law.high[i])
            unit = self.runs[0].liner.numbers()[name].unit
            notes.append(
                f"{name} ends on its {label} bound, {float(at):.6g}{'' if unit == '1' else f' {unit}'}: the data ask "
                "for more than the bounds allow, and its uncertainty means little; widen the bound if that is "
                "physical, else free another parameter"
            )
        for group in self.unseen:
            notes.append(
                f"the data do not tell {' and '.join(group)} apart within the bounds; fix one of them, give a prior, "
                "or add data at another frequency or level"
                if len(group) > 1
                else f"the data do not see {group[0]} within the bounds; fix it or give a prior"
            )
        if self.stated and self.freedom and self.chi_square > FAR**2 * (self.freedom + 2):
            notes.append(
                f"the misfit is {(self.chi_square / self.freedom) ** 0.5:.3g} times the stated noise: the model cannot "
                "give all references (or is far from its prior), and the posterior, which knows the noise alone, is "
                "too narrow"
            )
        if not self.stated and self.freedom == 0:
            notes.append(
                f"{self.data} data fix {len(self.values)} parameters with nothing left over: no residual says how "
                "uncertain they are; state noise"
            )
        return notes


def _inverse(rows: Tensor, width: Tensor) -> Tensor:
    """(rows^T rows)^-1, (n, n), from (m, n); huge along what they do not see."""
    _, singular, axes = torch.linalg.svd(rows * width, full_matrices=False)
    floored = singular.clamp(min=1e-12 * float(singular[0]) + 1e-300)
    return (axes.T / floored**2) @ axes * torch.outer(width, width)


def _spread(by: Tensor, covariance: Tensor) -> Tensor:
    """Covariance of real and imaginary parts, (..., 2, 2), from complex slopes (..., n)."""
    parts = torch.stack([by.real, by.imag], -2)
    return parts @ covariance @ parts.mT


def fit_law(law: Law, runs: Sequence[Run], stated: bool) -> Fit:
    """Least squares by trust-region reflective steps (scipy), with the exact Jacobian; ``stated``: the noise is known.

    Raises:
        RuntimeError: the least squares do not converge.
    """
    from scipy.optimize import least_squares

    width = law.high - law.low
    start = law.low + width * ((law.start - law.low) / width).clamp(*START)

    @functools.lru_cache(maxsize=1)
    def both(place: bytes) -> tuple[Tensor, Tensor]:
        return residuals_of(law, start + width * torch.from_numpy(np.frombuffer(place).copy()), runs)

    def residuals(at: np.ndarray) -> np.ndarray:
        return both(at.tobytes())[0].numpy()

    def jacobian(at: np.ndarray) -> np.ndarray:
        return (both(at.tobytes())[1] * width).numpy()

    low, high = (((end - start) / width).numpy() for end in (law.low, law.high))
    found = least_squares(
        residuals,
        np.zeros(len(width)),
        jacobian,
        bounds=(low, high),
        x_scale="jac",
        xtol=law.tolerance,
        ftol=law.tolerance,
        gtol=law.tolerance,
        max_nfev=1000,
    )
    if not found.success:
        raise RuntimeError(
            f"the least squares do not settle in {found.nfev} evaluations ({found.message}), sum of squares "
            f"{2 * found.cost:.3g}; narrow the bounds, state a larger noise, or free fewer parameters"
        )
    place = np.asarray(found.x, dtype=np.float64)
    return Fit(law, runs, start + width * torch.from_numpy(place), stated, *both(place.tobytes()))

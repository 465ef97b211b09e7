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

from torchliner.liners.model import LinerModel
from torchliner.studies.laws import Law
from torchliner.studies.runs import Run

ON_BOUND = 1e-3  # of the box
UNSEEN = 1e-6  # singular value, relative to the largest, of a direction the data do not see
NAMED = 0.2  # share in such a direction from which a parameter is named
FAR = 2.0  # times the stated noise from which a misfit is one of the model
START = (0.02, 0.98)  # of the box: a start on a bound could not leave it
WIDTH = 1.959964  # standard deviations of a 95 % interval


def curves_at_nodes(law: Law, values: Tensor, runs: Sequence[Run], slopes: bool = True) -> list[tuple[Tensor, Tensor]]:
    """Z at the frequencies and node speeds of each run, (F, K), and dZ/dvalues, (F, K, n); each liner is asked once."""
    shared: dict[Any, list[int]] = {}
    for i, run in enumerate(runs):
        shared.setdefault((id(run.liner), run.plane.mach, run.nodes), []).append(i)
    found: dict[int, tuple[Tensor, Tensor]] = {}
    for members in shared.values():
        first, lines = runs[members[0]], [runs[i].frequency for i in members]
        every, place = torch.cat(lines).unique(return_inverse=True)
        z, by = law.curve(values, first.liner.in_flow(first.plane.mach), every, first.nodes.speeds, slopes)
        for i, rows in zip(members, place.split([len(each) for each in lines]), strict=True):
            found[i] = z[rows], by[rows]
    return [found[i] for i in range(len(runs))]


def impedances(law: Law, values: Tensor, runs: Sequence[Run]) -> list[tuple[Tensor, Tensor]]:
    """Z of each run, (F,), and dZ/dvalues, (F, n)."""
    both = zip(runs, curves_at_nodes(law, values, runs), strict=True)
    return [(run.impedance(z), torch.einsum("fk,fkn->fn", run.slopes(z), by)) for run, (z, by) in both]


def drawn_impedances(law: Law, draws: Tensor, runs: Sequence[Run]) -> list[Tensor]:
    """Z of each run for many values, (M, n) to (M, F) each."""
    rows = [[z for z, _ in curves_at_nodes(law, values, runs, slopes=False)] for values in draws]
    return [run.impedance(torch.stack(each)) for run, each in zip(runs, zip(*rows, strict=True), strict=True)]


def residuals_of(law: Law, values: Tensor, runs: Sequence[Run]) -> tuple[Tensor, Tensor]:
    """Residuals of the data and then of the prior, (m,), and their derivatives in the values, (m, n)."""
    found = impedances(law, values, runs)
    left = [run.residuals(z) for run, (z, _) in zip(runs, found, strict=True)]
    by = [run.residual_slopes(*each) for run, each in zip(runs, found, strict=True)]
    return torch.cat([*left, law.prior @ (values - law.centre)]), torch.cat([*by, law.prior])


@dataclass(frozen=True, eq=False)
class Fit:
    """The best place in the box of the bounds.

    Args:
        law, runs: what was fitted to what.
        values: best, (n,).
        stated: whether the noise is known; else the residual stands for it.
        residuals, jacobian: there, (m,) and (m, n).
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
    def boxed(self) -> Tensor:
        """Jacobian per box width, (m, n)."""
        return self.jacobian * self.width

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
        return len(self.residuals) - len(self.share)

    @property
    def scale(self) -> float:
        """Variance of a residual: 1, or that of the residuals; nan without a degree of freedom."""
        if self.stated:
            return 1.0
        return self.chi_square / self.freedom if self.freedom else math.nan

    @property
    def determined(self) -> float:
        """How many parameters the data determine: without a prior all."""
        return float(len(self.share))

    @property
    def misfit(self) -> float:
        """rms of what is left over the noise, by degrees of freedom."""
        return float((self.chi_square / max(self.freedom, 1)) ** 0.5)

    @functools.cached_property
    def _svd(self) -> tuple[Tensor, Tensor]:
        _, singular, axes = torch.linalg.svd(self.boxed, full_matrices=False)
        return singular, axes

    @property
    def singular_values(self) -> Tensor:
        """Of the Jacobian over the noise, falling, (n,)."""
        return self._svd[0] / (self.scale**0.5 if self.scale > 0 else 1.0)

    @property
    def covariance(self) -> Tensor:
        """Gauss-Newton, (n, n); huge along what the data do not see."""
        singular, axes = self._svd
        floored = singular.clamp(min=1e-12 * float(singular[0]) + 1e-300)
        return self.scale * (axes.T / floored**2) @ axes * torch.outer(self.width, self.width)

    @property
    def widened(self) -> Tensor:
        """Covariance of predictions, (n, n): widened where the misfit is above the noise; 0 on a bound."""
        kept = torch.tensor([name not in self.on_bound for name in self.law.names])
        return self.covariance * torch.outer(kept, kept) * max(1.0, self.misfit) ** 2

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

    @property
    def on_bound(self) -> tuple[str, ...]:
        """Parameters that end there."""
        both = zip(self.law.names, self.share.tolist(), strict=True)
        return tuple(name for name, u in both if not ON_BOUND <= u <= 1 - ON_BOUND)

    def of_run(self, run: Run) -> tuple[Tensor, Tensor]:
        """Z of a plane, (F,), and covariances of R and X, (F, 2, 2), to first order."""
        ((z, by),) = impedances(self.law, self.values, [run])
        return z, self._spread(by)

    def curve(self, liner: LinerModel, frequency: float, speed: Tensor) -> Tensor:
        """Z of a liner at |v|, complex, (V,)."""
        lines = torch.tensor([frequency], dtype=torch.float64)
        return self.law.curve(self.values, liner, lines, speed, False)[0][0]

    def band(self, liner: LinerModel, frequency: float, speed: Tensor) -> Tensor:
        """Z of a liner at |v|, and the ends of the 95 % bands of R and X apart, (3, V)."""
        lines = torch.tensor([frequency], dtype=torch.float64)
        z, by = (each[0] for each in self.law.curve(self.values, liner, lines, speed, True))
        spread = WIDTH * torch.complex(*self._spread(by).diagonal(dim1=1, dim2=2).clamp(min=0).sqrt().T.contiguous())
        return torch.stack([z, z - spread, z + spread])

    def _spread(self, by: Tensor) -> Tensor:
        """Covariance of real and imaginary parts, (..., 2, 2), from slopes (..., n)."""
        parts = torch.stack([by.real, by.imag], -2)
        return parts @ self.widened @ parts.mT

    def warnings(self) -> list[str]:
        """Parameters on bounds, undetermined directions, noise that does not fit; with remedies."""
        notes, law = [], self.law
        for name in self.on_bound:
            i = law.names.index(name)
            label, at = ("lower", law.low[i]) if self.share[i] < 0.5 else ("upper", law.high[i])
            unit = self.runs[0].liner.numbers()[name].unit
            end = "" if unit == "1" else f" {unit}"
            notes.append(
                f"{name} ends on its {label} bound, {float(at):.6g}{end}: the data ask for more "
                "than the bounds allow, and its uncertainty means little; widen the bound if that "
                "is physical, else free another parameter"
            )
        for group in self.unseen:
            notes.append(
                f"the data do not tell {' and '.join(group)} apart within the bounds; fix one of "
                "them, give a prior, or add data at another frequency or level"
                if len(group) > 1
                else f"the data do not see {group[0]} within the bounds; fix it or give a prior"
            )
        if self.stated and self.freedom and self.chi_square > FAR**2 * (self.freedom + 2):
            notes.append(
                f"the misfit is {self.misfit:.3g} times the stated noise: the model cannot give all references, and "
                "the posterior, which knows the noise alone, is too narrow"
            )
        if not self.stated and self.freedom == 0:
            notes.append(
                f"{self.data} data fix {len(self.share)} parameters with nothing "
                "left over: no residual says how uncertain they are; state noise"
            )
        return notes


def fit_law(law: Law, runs: Sequence[Run], stated: bool, kind: type[Fit] = Fit) -> Fit:
    """Least squares by trust-region reflective steps (scipy), with the exact Jacobian; ``stated``: the noise is known.

    Raises:
        RuntimeError: the least squares do not converge.
    """
    from scipy.optimize import least_squares

    @functools.lru_cache(maxsize=1)
    def both(place: bytes) -> tuple[Tensor, Tensor]:
        return residuals_of(law, law.origin + law.unit * torch.from_numpy(np.frombuffer(place).copy()), runs)

    def residuals(at: np.ndarray) -> np.ndarray:
        return both(at.tobytes())[0].numpy()

    def jacobian(at: np.ndarray) -> np.ndarray:
        return (both(at.tobytes())[1] * law.unit).numpy()

    width = law.high - law.low
    start = law.low + width * ((law.start - law.low) / width).clamp(*START)
    first, low, high = (((each - law.origin) / law.unit).numpy() for each in (start, law.low, law.high))
    found = least_squares(residuals, first, jacobian, bounds=(low, high), **law.search)
    if not found.success:
        raise RuntimeError(
            f"the least squares do not settle in {found.nfev} evaluations ({found.message}), sum of squares "
            f"{2 * found.cost:.3g}; narrow the bounds, state a larger noise, or free fewer parameters"
        )
    place = np.asarray(found.x, dtype=np.float64)
    return kind(law, runs, law.origin + law.unit * torch.from_numpy(place), stated, *both(place.tobytes()))

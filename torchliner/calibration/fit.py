"""Bounded least squares on a misfit, and what its Jacobian says of the parameters."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.calibration.misfit import Misfit
from torchliner.calibration.posterior import FEWEST_EFFECTIVE, Posterior, sample_posterior

ON_BOUND = 1e-3  # of the box
UNSEEN = 1e-6  # singular value, relative to the largest, of a direction the data do not see
NAMED = 0.2  # share in such a direction from which a parameter is named
FAR = 2.0  # times the stated noise from which a misfit is one of the model


@dataclass(frozen=True, eq=False)
class Fit:
    """The best place in the box of the bounds.

    Args:
        misfit: of the planes.  share: place, 0 to 1, (n,).
        stated: whether the noise is known; else the residual stands for it.
        residuals, jacobian: there, (m,) and (m, n), per box width.
    """

    misfit: Misfit
    share: Tensor
    stated: bool
    residuals: Tensor
    jacobian: Tensor

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
        return self.chi_square / self.freedom if self.freedom else float("nan")

    @functools.cached_property
    def _svd(self) -> tuple[Tensor, Tensor]:
        _, singular, axes = torch.linalg.svd(self.jacobian, full_matrices=False)
        return singular, axes

    @property
    def singular_values(self) -> Tensor:
        """Of the Jacobian over the noise, falling, (n,)."""
        return self._svd[0] / (self.scale**0.5 if self.scale > 0 else 1.0)

    @property
    def covariance(self) -> Tensor:
        """Gauss-Newton, SI, (n, n); huge along what the data do not see."""
        singular, axes = self._svd
        floored = singular.clamp(min=1e-12 * float(singular[0]) + 1e-300)
        width = self.misfit.high - self.misfit.low
        return self.scale * (axes.T / floored**2) @ axes * torch.outer(width, width)

    @property
    def unseen(self) -> tuple[tuple[str, ...], ...]:
        """Parameters of directions that the data do not determine, or less than the bounds do."""
        singular, axes = self._svd
        limit = UNSEEN * float(singular[0])
        if self.scale == self.scale:
            # Wider than the box itself, whose values, all equally likely, scatter by 1/sqrt 12.
            limit = max(limit, (12 * self.scale) ** 0.5)
        names = self.misfit.names
        return tuple(
            tuple(n for n, part in zip(names, axis.abs().tolist(), strict=True) if part > NAMED)
            for value, axis in zip(singular.tolist(), axes, strict=True)
            if value <= limit
        )

    @property
    def on_bound(self) -> tuple[str, ...]:
        """Parameters that end there."""
        return tuple(
            name
            for name, u in zip(self.misfit.names, self.share.tolist(), strict=True)
            if not ON_BOUND <= u <= 1 - ON_BOUND
        )

    def posterior(self, draws: int, seed: int) -> tuple[Posterior | None, list[str]]:
        """Draws in SI, and warnings about them; None without draws or where no noise is known."""
        if draws < 1 or self.scale != self.scale:
            return None, []
        misfit, count, lowest = self.misfit, self.misfit.data, [self.chi_square]

        def log_density(at: Tensor) -> Tensor:
            values = misfit.values(at)
            square = misfit.residuals(values, misfit.impedances(values)).square().sum(1)
            lowest.append(float(square.min()))
            if self.stated:
                return -square / 2
            # Unknown noise, equally likely on a logarithmic scale, is integrated out.
            return -count / 2 * torch.log(square.clamp(min=1e-300))

        precision = self.jacobian.T @ self.jacobian / max(self.scale, 1e-300)
        found = sample_posterior(log_density, self.share, precision, draws, seed)
        notes = []
        if found.effective < FEWEST_EFFECTIVE:
            notes.append(
                f"the posterior's {draws} draws are worth {found.effective:.0f} independent ones; "
                "intervals are rough: raise draws, or narrow the bounds"
            )
        if min(lowest) < self.chi_square - 0.1 * self.scale:
            notes.append(
                f"a draw fits better than the fit (misfit {min(lowest):.4g} against "
                f"{self.chi_square:.4g}): there is another minimum; start the liner nearer to it"
            )
        return Posterior(misfit.values(found.draws), found.weights), notes

    def warnings(self) -> list[str]:
        """Parameters on bounds, undetermined directions, noise that does not fit; with remedies."""
        notes = []
        for name in self.on_bound:
            i = self.misfit.names.index(name)
            side, bound = ("lower", self.misfit.low[i]), ("upper", self.misfit.high[i])
            label, at = side if self.share[i] < 0.5 else bound
            unit = self.misfit.liners[0].numbers()[name].unit
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
                f"the misfit is {(self.chi_square / self.freedom) ** 0.5:.3g} times the stated "
                "noise: the model cannot give all references, and the posterior, which knows the "
                "noise alone, is too narrow"
            )
        if not self.stated and self.freedom == 0:
            notes.append(
                f"{self.misfit.data} data fix {len(self.share)} parameters with nothing "
                "left over: no residual says how uncertain they are; state noise"
            )
        return notes


def fit_misfit(misfit: Misfit, share: Tensor, stated: bool) -> Fit:
    """Least squares by trust-region reflective steps, with the exact Jacobian, from a place in the
    box, 0 to 1, (n,); ``stated``: whether the noise is known.

    Raises:
        RuntimeError: the least squares do not converge.
    """
    from scipy.optimize import least_squares

    kept: dict[bytes, tuple[Tensor, Tensor]] = {}

    def slopes(at: Any) -> tuple[Tensor, Tensor]:
        key = at.tobytes()
        if key not in kept:
            kept.clear()
            kept[key] = misfit.slopes(torch.from_numpy(np.array(at, dtype=np.float64)))
        return kept[key]

    def residuals(at: Any) -> Any:
        return slopes(at)[0].numpy()

    def jacobian(at: Any) -> Any:
        return slopes(at)[1].numpy()

    # Strictly inside, as the reflective steps ask.
    start: Any = share.clamp(1e-6, 1 - 1e-6).numpy()
    found = least_squares(
        residuals, start, jacobian,
        bounds=(0.0, 1.0), xtol=1e-12, ftol=1e-12, gtol=1e-12, max_nfev=300,
    )  # fmt: skip
    if not found.success:
        raise RuntimeError(
            f"least squares stopped after {found.nfev} evaluations ({found.message}), sum of "
            f"squares {2 * found.cost:.3g}; narrow the bounds or free fewer parameters"
        )
    share = torch.from_numpy(np.asarray(found.x, dtype=np.float64))
    return Fit(misfit, share, stated, *misfit.slopes(share))

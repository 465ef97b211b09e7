"""Fits: how sure the values are, what they predict, and what is doubtful."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY, tell
from torchliner.conversions import reflection_from_impedance
from torchliner.engine.nodes import checked_speeds
from torchliner.least_squares import with_slopes
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.liners.sdof import AdjustedSDoFLiner, FlowSDoFLiner, SDoFLiner
from torchliner.liners.tabulated import TabulatedLiner
from torchliner.studies.laws import Knots, Law, impedance_at
from torchliner.studies.rows import Row
from torchliner.studies.runs import NEPER, Run, read_run
from torchliner.studies.sensitivities import correlation_of, covariance_of, standard_of
from torchliner.studies.solve import Posterior, curves_at_nodes, drawn_impedances, impedances, solve, weights_of
from torchliner.studies.variants import Records
from torchliner.velocity.choices import Choices

ON_BOUND = 1e-3  # of the box
UNSEEN = 1e-6  # singular value, relative to the largest, of a direction the data do not see
NAMED = 0.2  # share in such a direction from which a parameter is named
WIDTH = 1.959964  # standard deviations of a 95 % interval
SEEN = 0.02  # of a plane's weight: a spline that no plane gives as much is not seen
OUTSIDE = 0.1  # of a plane's weight, at speeds beyond those that others saw, that is warned of
MARGIN = 1.25  # times the last knot, to which a table reaches
ROWS = 120  # speeds of a table, uniform in sqrt |v|


@dataclass(frozen=True, eq=False)
class Fit:
    """The best place in the box of the bounds, how sure it is, and what it predicts; SI throughout.

    Args:
        law, runs, choices: what was fitted to what, and how planes are read.
        knots: of splines, by whose weights speeds count as seen.
        stated: whether the noise is known; else the residual stands for it.
        values, residuals, jacobian: best, (n,); there, of the data and then of the prior, (m,) and (m, n).
        data, freedom: numbers that the runs are held to; these and priors less parameters.
        scale: variance of a residual: 1, or that of the residuals; nan without a degree of freedom.
        on_bound, unseen: parameters that end on a bound, and those of directions that the data do not determine.
        singular_values: of the Jacobian over the noise, in units of the box, of a curve of the spread of its prior.
        determined, misfit: how many parameters the data determine; rms of what is left of them over the noise.
        covariance, widened: Gauss-Newton, (n, n); and where the misfit is above stated noise by that, 0 on a bound.
        posterior, notes: draws, None where the noise is unknown; warnings, with numbers.
    """

    law: Law
    runs: tuple[Run, ...]
    choices: Choices
    knots: Knots
    stated: bool
    values: Tensor
    residuals: Tensor
    jacobian: Tensor
    data: int
    freedom: int
    scale: float
    on_bound: tuple[str, ...]
    unseen: tuple[tuple[str, ...], ...]
    singular_values: Tensor
    determined: float
    misfit: float
    covariance: Tensor
    widened: Tensor
    posterior: Posterior | None = None
    notes: tuple[str, ...] = ()

    @property
    def numbers(self) -> dict[str, float]:
        """Values by name."""
        return dict(zip(self.law.names, self.values.tolist(), strict=True))

    @property
    def standard(self) -> Tensor:
        """Gauss-Newton standard uncertainty, (n,)."""
        return self.covariance.diagonal().sqrt()

    @property
    def interval(self) -> Tensor:
        """95 % of the posterior, (2, n); nan without one."""
        if self.posterior is None:
            return torch.full((2, len(self.values)), torch.nan, dtype=torch.float64)
        return self.posterior.quantiles(self.posterior.draws, (0.025, 0.975))

    @property
    def liner(self) -> LinerModel:
        """That of the first plane with the values found, or the table of a curve."""
        return self.table() if self.law.frequencies else self.runs[0].liner.with_numbers(self.numbers)

    def table(self, reach: float = 0.0) -> TabulatedLiner:
        """A curve as a liner, linear between 120 speeds up to 1.25 times the largest |v| of the runs, or to ``reach``,
        m/s, if that is more; TypeError where parameters were found."""
        if not self.law.frequencies:
            raise TypeError(f"parameters were found ({self.law.label}), not a curve; take the liner")
        top, first = self.knots.top, self.runs[0].liner
        if reach > MARGIN * top:
            tell(
                f"the table reaches to {reach:.4g} m/s, {reach / top:.3g} times the largest |v| of the runs "
                f"({top:.4g} m/s): R goes on along its tangent there and X stays, which no data support"
            )
        speed = torch.linspace(0, max(MARGIN * top, reach) ** 0.5, ROWS, dtype=torch.float64).square()
        lines, name = torch.tensor(self.law.frequencies, dtype=torch.float64), f"{first.name} identified"
        values = self.law.curve(self.values, self.runs[0].in_flow, lines, speed)
        return TabulatedLiner(self.law.frequencies, values, speed, first.cell_pitch, name)

    @functools.cached_property
    def rows(self) -> list[Row]:
        """Of the runs themselves, see ``predict``."""
        return [row for run in self.runs for row in self.rows_of(run)]

    @functools.cached_property
    def model_error(self) -> float:
        """Largest error in R of the interpolation over |v|, at any |v| of the data; that of a mean is far less."""
        worst = 0.0
        for run in self.runs:
            speed = checked_speeds(self.knots.top if self.law.frequencies else run.known.top_speed(run.liner))
            at_nodes, wanted = (
                reflection_from_impedance(self.law.curve(self.values, run.in_flow, run.frequency, each))
                for each in (run.nodes.speeds, speed)
            )
            between = run.nodes.coefficients(at_nodes) @ run.nodes.functions(speed).T.to(wanted)
            worst = max(worst, float((between - wanted).abs().max()))
        return worst

    def band(self, frequency: float, speed: Any) -> Tensor:
        """Z of the first liner at |v|, m/s, (V,), and the ends of the 95 % bands of R and X apart, (3, V).

        ``frequency`` in Hz, of a curve one of the runs. R of a curve stays above 0.
        """
        lines, at = (torch.as_tensor(each, dtype=torch.float64) for each in ([frequency], speed))
        liner = self.runs[0].in_flow
        z, by = with_slopes(lambda values: self.law.curve(values, liner, lines, at)[0], self.values)
        spread = WIDTH * standard_of(covariance_of(by.movedim(-1, 0), self.widened))
        low, high = z - spread, z + spread
        if self.law.frequencies:
            factor = (spread.real / z.real).exp()
            low, high = torch.complex(z.real / factor, low.imag), torch.complex(z.real * factor, high.imag)
        return torch.stack([z, low, high])

    def weights(self, runs: Sequence[Run]) -> Tensor:
        """Share of each spline of ``knots`` in Z of each plane and frequency, (D, n)."""
        curves = curves_at_nodes(self.law, self.values, runs)
        return torch.cat([weights_of(run, z, self.knots) for run, z in zip(runs, curves, strict=True)])

    @functools.cached_property
    def seen(self) -> tuple[int, int]:
        """The first and the last spline that the runs see."""
        known = (self.weights(self.runs).amax(0) >= SEEN).nonzero()[:, 0]
        return int(known[0]), int(known[-1])

    @property
    def seen_speeds(self) -> tuple[float, float]:
        """Least and greatest |v| about which the runs say something, m/s."""
        first, last = self.seen
        # A spline reaches two steps to either side, and at rest nothing is slower.
        return float(self.knots.speeds[max(first - 2, 0)]), float(self.knots.speeds[last])

    def rows_of(self, run: Run, noise: complex = 0j) -> list[Row]:
        """A row a frequency of what the fit makes of a run, see ``predict``."""
        z, by = with_slopes(lambda at: impedances(self.law, at, [run])[0], self.values)
        spread = covariance_of(by.movedim(-1, 0), self.widened)
        if self.posterior is not None:
            parts = torch.view_as_real(drawn_impedances(self.law, self.posterior.draws, [run])[0])
            spread = torch.stack([self.posterior.covariance(each) for each in parts.unbind(1)])
        before = torch.stack([impedance_at(run.in_flow, f, run.nodes.speeds) for f in run.frequency])
        standard, weights, (first, last), plane = standard_of(spread), self.weights([run]), self.seen, run.plane
        columns: dict[str, list[Any]] = {
            "frequency": run.frequency.tolist(),
            "before": run.impedance(before).tolist(),
            "impedance": z.tolist(),
            "standard": standard.tolist(),
            "correlation": [correlation_of(each) for each in spread],
            "outside": (weights[:, :first].sum(1) + weights[:, last + 1 :].sum(1)).tolist(),
        }
        if run.ratio is not None:
            columns |= {"level_check": (run.errors(z).real / NEPER).tolist(), "off": run.off(z).tolist()}
        elif len(run.wanted):
            own = torch.tensor([noise.real, noise.imag], dtype=torch.float64)
            total = torch.view_as_real(standard).hypot(own)
            misses = torch.view_as_complex(torch.view_as_real(z - run.wanted) / total)
            columns |= {"true": run.wanted.tolist(), "misses": misses.tolist(), "off": run.off(z).tolist()}
        about = {"label": str(plane.provenance.get("case") or plane.name), "group": run.group, "height": plane.height}
        about |= dict.fromkeys(("true", "misses", "off", "level_check"))
        return [Row(about, **dict(zip(columns, each, strict=True))) for each in zip(*columns.values(), strict=True)]

    def predict(
        self,
        plane: Records,
        liner: Liner | None = None,
        frequency: Any = None,
        *,
        reference: str = "true",
        noise: complex = 0j,
    ) -> list[Row]:
        """Z of another plane.

        Args:
            plane: wall-normal velocity, or its moments.
            liner: its liner, whose other numbers are kept; default that of the first run.
            frequency: Hz; default the plane's tone.
            reference: name of the impedance beside which it is put, if the plane has it.
            noise: standard uncertainty of that, u(R) + j u(X), part of the misses.
        Returns:
            A row a frequency: label (the case, else the name of the plane), frequency (Hz), height (m), before (Z of
            the liner as it was), impedance, standard (u(R) + j u(X): of the posterior, else to first order, widened),
            correlation of R and X, outside (share of the plane's weight at |v| beyond those that the runs saw), true
            (the reference, or None), misses (by how many standard deviations R and X are off it), off (error of the
            reflection coefficient), and of runs held to levels level_check (dB).
        Raises:
            ValueError: a frequency that no run had, for a curve.
        Warns:
            DataWarning: more than 10 % of the weight is outside.
        """
        base = self.runs[0].liner if liner is None else as_liner(liner)
        if isinstance(self.runs[0].liner, FlowSDoFLiner):
            base = with_flow(base)
        run = read_run(plane, base, frequency, self.choices, any_curve=bool(self.law.frequencies))
        true = run.plane.reference.get(reference)
        if true is not None:
            at_tone = (run.frequency / (run.plane.frequency or run.frequency) - 1).abs() < SAME_FREQUENCY
            value, unknown = torch.tensor([complex(true), complex(math.nan, math.nan)], dtype=torch.complex128)
            run = dataclasses.replace(run, wanted=torch.where(at_tone, value, unknown))
        rows = self.rows_of(run, noise)
        tell(self.beyond(run.plane.name, max(row.outside for row in rows)))
        return rows

    def beyond(self, name: str, outside: float) -> list[str]:
        """Whether a plane leaves the speeds that the runs saw."""
        if outside <= OUTSIDE:
            return []
        low, high = self.seen_speeds
        return [
            f"{name}: {100 * outside:.0f} % of its weight lies at |v| that no other run saw (seen: about {low:.3g} to "
            f"{high:.3g} m/s); what the law misses there is not in the uncertainty: add a run at its level"
        ]


def with_flow(liner: LinerModel) -> LinerModel:
    """An SDoF liner that takes the Mach number of each plane, and with factors unless its own law takes one; any other
    as it is."""
    if isinstance(liner, FlowSDoFLiner):
        return liner.replace(mach=None)
    return AdjustedSDoFLiner.of(liner) if isinstance(liner, SDoFLiner) else liner


def fit_law(law: Law, runs: Sequence[Run], choices: Choices, knots: Knots, *, stated: bool) -> Fit:
    """Least squares, and what they say; ``stated``: the noise is known.

    Raises:
        ValueError, RuntimeError: as ``solve``.
    """
    values, residuals, jacobian = solve(law, runs)
    width, data, freedom = law.high - law.low, sum(run.data for run in runs), len(residuals) - len(values)
    share, square = (values - law.low) / width, float(residuals.square().sum())
    free = (share >= ON_BOUND) & (share <= 1 - ON_BOUND)
    scale = 1.0 if stated else square / freedom if freedom else math.nan
    over = jacobian * width  # slopes over what is known beforehand: the box, or the prior of a curve
    if law.frequencies:
        factor = torch.linalg.cholesky(law.prior[:, free].T @ law.prior[:, free])
        over = torch.linalg.solve_triangular(factor, jacobian[:data, free].T, upper=False).T
    _, singular, axes = torch.linalg.svd(over, full_matrices=False)
    sharp = singular / (scale**0.5 if scale > 0 else 1.0)
    determined = float((sharp**2 / (1 + sharp**2)).sum()) if law.frequencies else float(len(values))
    misfit = float(residuals[:data].square().sum() / max(data - determined, 1.0)) ** 0.5
    # Wider than the box itself, whose values, all equally likely, scatter by 1/sqrt 12.
    limit = max(UNSEEN * float(singular[0]), 0.0 if math.isnan(scale) else (12 * scale) ** 0.5)
    dark = [] if law.frequencies else [axis for value, axis in zip(singular, axes, strict=True) if value <= limit]
    covariance = widened = scale * _inverse(jacobian, width)
    if stated:
        rows, widened = jacobian.clone(), torch.zeros_like(covariance)
        rows[:data] /= max(1.0, misfit)
        if bool(free.any()):
            widened[torch.outer(free, free)] = _inverse(rows[:, free], width[free]).flatten()
    return Fit(
        *(law, tuple(runs), choices, knots, stated, values, residuals, jacobian, data, freedom, scale),
        on_bound=tuple(name for name, inside in zip(law.names, free.tolist(), strict=True) if not inside),
        unseen=tuple(tuple(law.names[int(i)] for i in (axis.abs() > NAMED).nonzero()) for axis in dark),
        singular_values=sharp,
        determined=determined,
        misfit=misfit,
        covariance=covariance,
        widened=widened,
    )


def _inverse(rows: Tensor, width: Tensor) -> Tensor:
    """(rows^T rows)^-1, (n, n), from (m, n); huge along what they do not see."""
    _, singular, axes = torch.linalg.svd(rows * width, full_matrices=False)
    floored = singular.clamp(min=1e-12 * float(singular[0]) + 1e-300)
    return (axes.T / floored**2) @ axes * torch.outer(width, width)

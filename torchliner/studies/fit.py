"""Least squares of a law and runs: the values, how sure they are, what they predict, and what is doubtful."""

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
from torchliner.least_squares import with_slopes
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.liners.sdof import AdjustedSDoFLiner, FlowSDoFLiner, SDoFLiner
from torchliner.liners.tabulated import TabulatedLiner
from torchliner.studies.laws import Knots, Law, impedance_at
from torchliner.studies.rows import Row
from torchliner.studies.runs import NEPER, Run, read_run
from torchliner.studies.sensitivities import correlation_of, covariance_of, standard_of
from torchliner.studies.solve import curves_at_nodes, impedances, solve, weights_of
from torchliner.studies.variants import Records
from torchliner.velocity.choices import Choices

ON_BOUND = 1e-3  # of the box
UNSEEN, NAMED = 1e-6, 0.2  # of the largest singular value, a direction not seen; share in it of a parameter named
WIDTH = 1.959964  # standard deviations of a 95 % interval
SEEN = 0.02  # of a plane's weight: a spline that no plane gives as much is not seen
OUTSIDE = 0.1  # of a plane's weight, at speeds beyond those that others saw, that is warned of
FAR = 2.0  # times the stated noise from which a misfit is one of the model
MARGIN, ROWS = 1.25, 120  # times the last knot, to which a table reaches; its speeds, uniform in sqrt |v|


@dataclass(frozen=True, eq=False)
class Fit:
    """The best place in the box of the bounds, how sure it is, and what it predicts; SI throughout.

    Args:
        law, runs, choices: what was fitted to what, and how planes are read.
        knots: of splines, by whose weights speeds count as seen.
        stated: whether the noise is known; else the residual stands for it.
        values, residuals, jacobian: best, (n,); there, of the data and then of the prior, (m,) and (m, n).
        notes: warnings, with numbers.
    """

    law: Law
    runs: tuple[Run, ...]
    choices: Choices
    knots: Knots
    stated: bool
    values: Tensor
    residuals: Tensor
    jacobian: Tensor
    notes: tuple[str, ...] = ()

    @property
    def width(self) -> Tensor:
        """Of the box, (n,)."""
        return self.law.high - self.law.low

    @property
    def data(self) -> int:
        """Numbers that the runs are held to."""
        return sum(run.data for run in self.runs)

    @property
    def freedom(self) -> int:
        """Data and priors less parameters."""
        return len(self.residuals) - len(self.values)

    @property
    def scale(self) -> float:
        """Variance of a residual: 1, or that of the residuals; nan without a degree of freedom."""
        square = float(self.residuals.square().sum())
        return 1.0 if self.stated else square / self.freedom if self.freedom else math.nan

    @property
    def _inside(self) -> Tensor:
        share = (self.values - self.law.low) / self.width
        return (share >= ON_BOUND) & (share <= 1 - ON_BOUND)

    @property
    def on_bound(self) -> tuple[str, ...]:
        """Parameters that end on a bound."""
        return tuple(name for name, inside in zip(self.law.names, self._inside.tolist(), strict=True) if not inside)

    @property
    def unseen(self) -> tuple[tuple[str, ...], ...]:
        """Parameters in each direction of the box that the data do not determine; none of a curve."""
        if self.law.frequencies:
            return ()
        _, singular, axes = torch.linalg.svd(self.jacobian * self.width, full_matrices=False)
        # Wider than the box itself, whose values, all equally likely, scatter by 1/sqrt 12.
        limit = max(UNSEEN * float(singular[0]), 0.0 if math.isnan(self.scale) else (12 * self.scale) ** 0.5)
        dark = axes[singular <= limit]
        return tuple(tuple(self.law.names[int(i)] for i in (axis.abs() > NAMED).nonzero()) for axis in dark)

    @functools.cached_property
    def determined(self) -> float:
        """How many parameters the data determine: all, but of a curve, which its prior holds too."""
        if not self.law.frequencies:
            return float(len(self.values))
        own = self.jacobian[:, self._inside]
        return float(torch.linalg.solve(own.T @ own, own[: self.data].T @ own[: self.data]).trace())

    @functools.cached_property
    def misfit(self) -> float:
        """rms of what is left of the data over the noise."""
        return float(self.residuals[: self.data].square().sum() / max(self.data - self.determined, 1.0)) ** 0.5

    @functools.cached_property
    def covariance(self) -> Tensor:
        """Gauss-Newton, (n, n); stated noise is widened by a misfit above it; 0 for what is on a bound."""
        free, rows, found = self._inside, self.jacobian.clone(), torch.zeros(self.jacobian.shape[1:] * 2).double()
        rows[: self.data] /= max(1.0, self.misfit) if self.stated else 1.0
        if bool(free.any()):
            found[torch.outer(free, free)] = self.scale * _inverse(rows[:, free], self.width[free]).flatten()
        return found

    @property
    def numbers(self) -> dict[str, float]:
        """Values by name."""
        return dict(zip(self.law.names, self.values.tolist(), strict=True))

    @property
    def standard(self) -> Tensor:
        """Standard uncertainty, (n,)."""
        return self.covariance.diagonal().sqrt()

    @property
    def interval(self) -> Tensor:
        """95 % about the values, inside the bounds, (2, n); Student's t where the residual stands for the noise."""
        from scipy.special import stdtrit

        factor = WIDTH if self.stated else float(stdtrit(max(self.freedom, 1), 0.975))
        ends = torch.stack([self.values - factor * self.standard, self.values + factor * self.standard])
        return ends.clamp(self.law.low, self.law.high)

    @property
    def liner(self) -> LinerModel:
        """That of the first plane with the values found, or the table of a curve."""
        return self.table() if self.law.frequencies else self.runs[0].liner.with_numbers(self.numbers)

    def table(self) -> TabulatedLiner:
        """A curve as a liner, linear between 120 speeds up to 1.25 times the largest |v| of the runs."""
        top, first = MARGIN * self.knots.top, self.runs[0]
        speed = torch.linspace(0, top**0.5, ROWS, dtype=torch.float64).square()
        lines = torch.tensor(self.law.frequencies, dtype=torch.float64)
        values, name = self.law.curve(self.values, first.in_flow, lines, speed), f"{first.liner.name} identified"
        return TabulatedLiner(self.law.frequencies, values, speed, first.liner.cell_pitch, name)

    def band(self, frequency: float, speed: Any) -> Tensor:
        """Z of the first liner at |v|, m/s, (V,), and the ends of the 95 % bands of R and X apart, (3, V).

        ``frequency`` in Hz, of a curve one of the runs. R of a curve stays above 0.
        """
        lines, at = (torch.as_tensor(each, dtype=torch.float64) for each in ([frequency], speed))
        liner = self.runs[0].in_flow
        z, by = with_slopes(lambda values: self.law.curve(values, liner, lines, at)[0], self.values)
        spread = WIDTH * standard_of(covariance_of(by.movedim(-1, 0), self.covariance))
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

    @functools.cached_property
    def rows(self) -> list[Row]:
        """Of the runs themselves, see ``predict``."""
        return [row for run in self.runs for row in self.rows_of(run)]

    def rows_of(self, run: Run, noise: complex = 0j) -> list[Row]:
        """A row a frequency of what the fit makes of a run, see ``predict``."""
        z, by = with_slopes(lambda at: impedances(self.law, at, [run])[0], self.values)
        spread = covariance_of(by.movedim(-1, 0), self.covariance)
        law = torch.stack([impedance_at(run.in_flow, f, run.nodes.speeds) for f in run.frequency])
        before, standard, weights, (first, last) = (
            run.impedance(law),
            standard_of(spread),
            self.weights([run]),
            self.seen,
        )
        rows, plane = list[Row](), run.plane
        for i, f in enumerate(run.frequency.tolist()):
            row = Row(label=str(plane.provenance.get("case") or plane.name), group=run.group, frequency=f)
            row |= {"height": plane.height, "before": complex(before[i]), "impedance": complex(z[i])}
            row |= {"standard": complex(standard[i]), "correlation": correlation_of(spread[i])}
            row |= {"outside": float(weights[i, :first].sum() + weights[i, last + 1 :].sum())}
            row |= dict.fromkeys(("true", "misses", "off", "level_check"))
            if run.ratio is not None:
                row |= {"level_check": float(run.level(z)[i]) / NEPER, "off": float(run.off(z)[i])}
            elif run.wanted is not None:
                miss, u = z[i] - run.wanted[i], row["standard"]
                total = math.hypot(u.real, noise.real), math.hypot(u.imag, noise.imag)
                misses = complex(
                    *(float(part / size) for part, size in zip((miss.real, miss.imag), total, strict=True))
                )
                row |= {"true": complex(run.wanted[i]), "misses": misses, "off": float(run.off(z)[i])}
            rows.append(row)
        return rows

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
            the liner as it was), impedance, standard (u(R) + j u(X), to first order), correlation of R and X, outside
            (share of the plane's weight at |v| beyond those that the runs saw), true (the reference, or None), misses
            (by how many standard deviations R and X are off it), off (error of the reflection coefficient), and of runs
            held to levels level_check (dB).
        Raises:
            ValueError: a frequency that no run had, for a curve.
        Warns:
            DataWarning: more than 10 % of the weight is outside.
        """
        base = self.runs[0].liner if liner is None else as_liner(liner)
        if isinstance(self.runs[0].liner, FlowSDoFLiner):
            base = with_flow(base)
        run = read_run(plane, base, frequency, self.choices, any_curve=bool(self.law.frequencies))
        if (true := run.plane.reference.get(reference)) is not None:
            at_tone = (run.frequency / (run.plane.frequency or run.frequency) - 1).abs() < SAME_FREQUENCY
            wanted = torch.where(at_tone, torch.tensor(complex(true), dtype=torch.complex128), torch.nan)
            run = dataclasses.replace(run, wanted=wanted)
        rows = self.rows_of(run, noise)
        tell(self.beyond(run.plane.name, max(row.outside for row in rows)))
        return rows

    def beyond(self, name: str, outside: float) -> list[str]:
        """Whether a plane leaves the speeds that the runs saw."""
        low, high = self.seen_speeds
        text = (
            f"{name}: {100 * outside:.0f} % of its weight lies at |v| that no other run saw (seen: about {low:.3g} to "
            f"{high:.3g} m/s); what the law misses there is not in the uncertainty: add a run at its level"
        )
        return [text] if outside > OUTSIDE else []

    def warnings(self) -> list[str]:
        """Parameters on bounds, undetermined directions, noise that does not fit; with remedies."""
        notes = list[str]()
        if self.on_bound:
            where = ", ".join(f"{name} on its bound, {self.numbers[name]:.4g}" for name in self.on_bound)
            where = f"{len(self.on_bound)} parameters of the curve on their bounds" if self.law.frequencies else where
            notes.append(f"{where}: the data ask for more than the bounds allow; widen them, or free another parameter")
        for group in self.unseen:
            what = f"tell {' and '.join(group)} apart" if len(group) > 1 else f"see {group[0]}"
            notes.append(f"the data do not {what} within the bounds; fix one, or add data at another frequency")
        if self.stated and self.freedom and self.misfit > FAR * (1 + 2 / self.freedom) ** 0.5:
            notes.append(
                f"{self.law.label}: the misfit is {self.misfit:.3g} times the stated noise: no such law gives all "
                "references; uncertainties are widened by that factor"
            )
        if not self.stated and self.freedom == 0:
            notes.append(
                f"{self.data} data fix {len(self.values)} parameters with nothing left over: no residual says how "
                "uncertain they are; state noise"
            )
        return notes


def with_flow(liner: LinerModel) -> LinerModel:
    """An SDoF liner that takes the Mach number of each plane, and with factors unless its own law takes one; any other
    as it is."""
    if isinstance(liner, FlowSDoFLiner):
        return liner.replace(mach=None)
    return AdjustedSDoFLiner.of(liner) if isinstance(liner, SDoFLiner) else liner


def fit_law(law: Law, runs: Sequence[Run], choices: Choices, knots: Knots, *, stated: bool) -> Fit:
    """The least squares, see ``solve``; ``stated``: the noise is known."""
    return Fit(law, tuple(runs), choices, knots, stated, *solve(law, runs))


def _inverse(rows: Tensor, width: Tensor) -> Tensor:
    """(rows^T rows)^-1, (n, n), from (m, n); huge along what they do not see."""
    _, singular, axes = torch.linalg.svd(rows * width, full_matrices=False)
    floored = singular.clamp(min=1e-12 * float(singular[0]) + 1e-300)
    return (axes.T / floored**2) @ axes * torch.outer(width, width)

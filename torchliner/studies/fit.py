"""A fit of a law to runs: the values, how sure they are, what they predict, and what is doubtful."""

import dataclasses
import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY, tell
from torchliner.conversions import reflection_from_impedance
from torchliner.liners.model import LinerModel
from torchliner.liners.tabulated import TabulatedLiner
from torchliner.studies.laws import Knots, Law, impedances_at
from torchliner.studies.runs import Run, curves_at_nodes, impedances, read_runs, residuals_of, with_slopes
from torchliner.studies.sensitivities import covariance_of, standard_of
from torchliner.studies.variants import Records, Row, rows_of
from torchliner.velocity.choices import Choices

START = (0.02, 0.98)  # of the box: a start on a bound could not leave it
ON_BOUND = 1e-3  # of the box
WIDTH = 1.959964  # standard deviations of a 95 % interval
SEEN = 0.02  # of a plane's weight: a spline that no plane gives as much is not seen
OUTSIDE = 0.1  # of a plane's weight, at speeds beyond those that others saw, that is warned of
FAR = 2.5  # times the noise from which a misfit is one of the model
MARGIN, ROWS = 1.25, 120  # times the last knot, to which a table reaches; its speeds, uniform in sqrt |v|


@dataclass(frozen=True, eq=False)
class Fit:
    """The best place in the box of the bounds, how sure it is, and what it predicts; SI throughout.

    Args:
        law, runs, choices: what was fitted to what, and how planes are read.
        knots: of splines, by whose weights speeds count as seen.
        values, residuals: best, (n,); what is left of the data and then of the prior there, (m,).
        determined: how many parameters the data determine: all, but of a curve.
        misfit: rms of what is left of the data over the noise.
        covariance: Gauss-Newton, (n, n), wider by a misfit above the noise; 0 for what is on a bound.
        on_bound: parameters that end there.
        notes: warnings, with numbers.
    """

    law: Law
    runs: tuple[Run, ...]
    choices: Choices
    knots: Knots
    values: Tensor
    residuals: Tensor
    determined: float
    misfit: float
    covariance: Tensor
    on_bound: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def data(self) -> int:
        """How many numbers the runs are held to."""
        return len(self.residuals) - len(self.law.prior)

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
        """95 % about the values, inside the bounds, (2, n)."""
        ends = torch.stack([self.values - WIDTH * self.standard, self.values + WIDTH * self.standard])
        return ends.clamp(self.law.low, self.law.high)

    @property
    def unseen(self) -> tuple[str, ...]:
        """Parameters whose interval is all of their bounds: the data do not determine them, or not apart."""
        low, high = (self.interval - torch.stack([self.law.low, self.law.high])).abs()
        return tuple(name for name, a, b in zip(self.law.names, low, high, strict=True) if not (a or b))

    @property
    def liner(self) -> LinerModel:
        """That of the first plane with the values found; of a curve a table, up to 1.25 times the fastest run."""
        first, lines = self.runs[0], self.law.frequencies
        if not lines:
            return first.liner.with_numbers(self.numbers)
        speed = torch.linspace(0, (MARGIN * self.knots.top) ** 0.5, ROWS, dtype=torch.float64).square()
        values = self.law.curve(self.values, first.in_flow, torch.tensor(lines, dtype=torch.float64), speed)
        return TabulatedLiner(lines, values, speed, first.liner.cell_pitch, f"{first.liner.name} identified")

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

    def weights(self, *runs: Run) -> Tensor:
        """Share of each spline of ``knots`` in Z of each plane and frequency, (D, n)."""
        curves = curves_at_nodes(self.law, self.values, runs)
        return torch.cat([run.splines(z, self.knots) for run, z in zip(runs, curves, strict=True)])

    @functools.cached_property
    def seen(self) -> Tensor:
        """The splines that the runs see, from the first to the last, (n,)."""
        known = self.weights(*self.runs).amax(0) >= SEEN
        return (known.cumsum(0) > 0) & (known.flip(0).cumsum(0).flip(0) > 0)

    @property
    def seen_speeds(self) -> tuple[float, float]:
        """Least and greatest |v| about which the runs say something, m/s."""
        first, last = self.seen.nonzero()[[0, -1], 0].tolist()
        # A spline reaches two steps to either side, and at rest nothing is slower.
        return float(self.knots.speeds[max(first - 2, 0)]), float(self.knots.speeds[last])

    @functools.cached_property
    def rows(self) -> list[Row]:
        """Of the runs themselves, see ``predict``."""
        return [row for run in self.runs for row in self.rows_of(run)]

    def rows_of(self, run: Run, noise: complex = 0j) -> list[Row]:
        """A row a frequency of what the fit makes of a run, see ``predict``."""
        z, by = with_slopes(lambda at: impedances(self.law, at, [run])[0], self.values)
        standard = standard_of(covariance_of(by.movedim(-1, 0), self.covariance))
        misses = off = None
        if run.wanted is not None:
            spread = torch.view_as_real(standard).hypot(torch.tensor([noise.real, noise.imag], dtype=torch.float64))
            misses = torch.view_as_complex(torch.view_as_real(z - run.wanted) / spread)
            off = (reflection_from_impedance(run.wanted) - reflection_from_impedance(z)).abs()
        return rows_of(
            label=run.case,
            frequency=run.frequency,
            height=run.plane.height,
            before=run.impedance(impedances_at(run.in_flow, run.frequency, run.speeds)),
            impedance=z,
            standard=standard,
            outside=self.weights(run)[:, ~self.seen].sum(1),
            true=run.wanted,
            misses=misses,
            off=off,
        )

    def predict(
        self, plane: Records, frequency: Any = None, *, reference: str = "true", noise: complex = 0j
    ) -> list[Row]:
        """Z of another plane above the liner of the first run.

        Args:
            plane: wall-normal velocity, or its moments.
            frequency: Hz; default the plane's tone.
            reference: name of the impedance beside which it is put, if the plane has it.
            noise: standard uncertainty of that, u(R) + j u(X), part of the misses.
        Returns:
            A row a frequency: label (the case, else the name of the plane), frequency (Hz), height (m), before (Z of
            the liner as it was), impedance, standard (u(R) + j u(X), to first order), outside (share of the plane's
            weight at |v| beyond those that the runs saw), true (the reference, or None), misses (by how many standard
            deviations R and X are off it), off (error of the reflection coefficient).
        """
        (run,) = read_runs(plane, self.runs[0].liner, frequency, self.choices)
        true, tone = run.plane.reference.get(reference), run.plane.frequency
        if true is not None and bool(((run.frequency / (tone or run.frequency) - 1).abs() < SAME_FREQUENCY).all()):
            wanted = torch.full(run.frequency.shape, complex(true), dtype=torch.complex128)
            run = dataclasses.replace(run, wanted=wanted)
        rows, (low, high) = self.rows_of(run, noise), self.seen_speeds
        if (outside := max(row.outside for row in rows)) > OUTSIDE:
            tell(
                f"{run.plane.name}: {100 * outside:.0f} % of its weight lies at |v| that no run saw (seen: about "
                f"{low:.3g} to {high:.3g} m/s); what the law misses there is not in the uncertainty: add a run there"
            )
        return rows


def fit_law(law: Law, runs: Sequence[Run], choices: Choices, knots: Knots) -> Fit:
    """Least squares by trust-region reflective steps with the exact Jacobian."""
    from scipy.optimize import least_squares

    data, width, count = 2 * sum(len(run.frequency) for run in runs), law.high - law.low, len(law.names)
    if data + len(law.prior) < count:
        raise ValueError(
            f"{data} data of {len(runs)} planes cannot fix {count} parameters ({', '.join(law.names)}); add planes or "
            "frequencies, or free fewer"
        )

    @functools.lru_cache(maxsize=1)
    def system(*place: float) -> tuple[Tensor, Tensor]:
        return residuals_of(law, torch.tensor(place, dtype=torch.float64), runs)

    start = law.low.lerp(law.high, ((law.start - law.low) / width).clamp(*START))
    how: Any = dict.fromkeys(("xtol", "ftol", "gtol"), 1e-9 if law.frequencies else 1e-12)
    how |= {"bounds": (law.low.numpy(), law.high.numpy()), "x_scale": "jac", "max_nfev": 1000}
    value, slope = (lambda place, i=i: system(*place)[i].numpy() for i in (0, 1))
    found = least_squares(value, start.numpy(), slope, **how)
    if not found.success:
        raise RuntimeError(
            f"the least squares do not settle in {found.nfev} evaluations; narrow the bounds, state a larger noise, or "
            "free fewer parameters"
        )
    values, (residuals, jacobian) = torch.from_numpy(found.x), system(*found.x)
    share, determined = (values - law.low) / width, float(count)
    inside = (share >= ON_BOUND) & (share <= 1 - ON_BOUND)
    free, covariance = jacobian[:, inside], torch.zeros(count, count, dtype=torch.float64)
    if law.frequencies:  # which the prior holds too
        determined = float(torch.linalg.solve(free.T @ free, free[:data].T @ free[:data]).trace())
    misfit = float(residuals[:data].square().sum() / max(data - determined, 1.0)) ** 0.5
    if bool(inside.any()):
        free[:data] /= max(1.0, misfit)
        _, singular, axes = torch.linalg.svd(free * width[inside], full_matrices=False)
        floored = singular.clamp(min=1e-12 * float(singular[0]) + 1e-300)  # huge along what they do not see
        inverse = (axes.T / floored**2) @ axes * torch.outer(width[inside], width[inside])
        covariance[torch.outer(inside, inside)] = inverse.flatten()
    on_bound = tuple(name for name, within in zip(law.names, inside.tolist(), strict=True) if not within)
    about = (law, tuple(runs), choices, knots, values, residuals, determined, misfit, covariance, on_bound)
    return dataclasses.replace(fit := Fit(*about), notes=_warnings(fit))


def _warnings(fit: Fit) -> tuple[str, ...]:
    """Parameters on bounds, undetermined directions, noise that does not fit; with remedies."""
    notes = list[str]()
    if fit.on_bound:
        where = ", ".join(f"{name} on its bound, {fit.numbers[name]:.4g}" for name in fit.on_bound)
        where = f"{len(fit.on_bound)} parameters of the curve on their bounds" if fit.law.frequencies else where
        notes.append(f"{where}: the data ask for more than the bounds allow; widen them, or free another parameter")
    if fit.unseen and not fit.law.frequencies:
        notes.append(
            f"the data do not tell {' and '.join(fit.unseen)} {'apart ' * (len(fit.unseen) > 1)}within the bounds; fix "
            "one, or add data at another frequency"
        )
    if fit.misfit > FAR:
        notes.append(
            f"{fit.law.label}: the misfit is {fit.misfit:.3g} times the noise: no such law gives all references; "
            "uncertainties are widened by that factor"
        )
    return tuple(notes)

"""Models that are fitted to all runs, then without each run, and what they then predict of that run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.liners.model import LinerModel, named_numbers
from torchliner.studies.budget import standard_of
from torchliner.studies.curves import CurveFit, CurveShape, Knots, law_of
from torchliner.studies.fit import Fit, fit_law
from torchliner.studies.laws import parameter_law
from torchliner.studies.runs import NEPER, Run

SEEN = 0.02  # of a plane's weight: a spline that no plane gives as much is not seen
WITHIN = 0.995  # of a plane's weight lies below the last knot
CREST = 4.0  # times the rms of the fastest column: no |v| that matters is larger
FINE = 60  # steps in sqrt |v| by which the last knot is found
CHECKED = 400  # |v| at which a fit must be passive
AROUND = 0.5  # bounds that are not stated: so much of a value, or about one that may be negative
BOUNDS = {  # of factors, whose neutral value says nothing of how far they go
    "vena_contracta": (0.2, 1.0),
    "end_correction": (0.0, 4.0),
    "mass_loss": (0.0, 10.0),
    "mass_loss_speed": (0.05, 10.0),
    "mach_resistance": (-5.0, 5.0),
    "mach_mass_loss": (-10.0, 10.0),
}


def bounds_for(names: Sequence[str], liner: LinerModel) -> dict[str, tuple[float, float]]:
    """Usual bounds, SI, of parameters by name."""
    found = {}
    for name, number in named_numbers(liner, names).items():
        reach = AROUND * number.value if number.low >= 0 else AROUND
        around = number.value - reach, min(number.value + reach, number.high)
        found[name] = BOUNDS.get(name, around)
    return found


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model fitted to some runs.

    Args:
        fits: of parameters one, which holds at every frequency; of a curve one a frequency.
    """

    fits: tuple[Fit, ...]

    @property
    def is_curve(self) -> bool:
        """Whether curves were fitted, not parameters."""
        return bool(self.frequencies)

    @property
    def frequencies(self) -> list[float]:
        """Hz, of curves."""
        return [fit.law.frequency for fit in self.fits if fit.law.frequency is not None]

    def at(self, frequency: float) -> Fit:
        """That of one frequency, Hz.

        Raises:
            ValueError: a curve, and no run has it.
        """
        if not self.is_curve:
            return self.fits[0]
        for known, fit in zip(self.frequencies, self.fits, strict=True):
            if abs(known / frequency - 1) < SAME_FREQUENCY:
                return fit
        there = ", ".join(f"{known:g}" for known in self.frequencies)
        raise ValueError(
            f"no curve is known at {frequency:g} Hz: the runs that are left have {there} Hz; a table over |v| says "
            "nothing of other frequencies (a parameter does: models=[('vena_contracta',)])"
        )

    @property
    def values(self) -> dict[str, float]:
        """Parameters found, SI, by name."""
        return dict(zip(self.fits[0].law.names, self.fits[0].values.tolist(), strict=True))

    @property
    def standard(self) -> dict[str, float]:
        """Their standard uncertainty, SI, by name, widened where the misfit is above the noise; 0 on a bound."""
        spread = self.fits[0].widened.diagonal().sqrt().tolist()
        return dict(zip(self.fits[0].law.names, spread, strict=True))

    @property
    def misfit(self) -> float:
        """rms of what is left over the noise, the largest of all frequencies."""
        return max(fit.misfit for fit in self.fits)

    def predict(self, run: Run) -> tuple[Tensor, Tensor]:
        """Z of a plane, (F,), and covariances of R and X, (F, 2, 2)."""
        if not self.is_curve:
            return self.fits[0].of_run(run)
        rows = [self.at(f).of_run(run.at(i)) for i, f in enumerate(run.frequency.tolist())]
        values, spreads = zip(*rows, strict=True)
        return torch.cat(values), torch.cat(spreads)

    def curve(self, liner: LinerModel, frequency: float, speed: Tensor) -> Tensor:
        """Z of a liner at |v|, (V,)."""
        return self.at(frequency).curve(liner, frequency, speed)


class Model(Protocol):
    """What can be fitted."""

    @property
    def label(self) -> str:
        """Of tables."""

    def fit(self, runs: Sequence[Run]) -> Fitted:
        """To these runs."""


@dataclass(frozen=True, eq=False)
class ParameterModel:
    """Parameters of the liner's own law, with bounds in SI."""

    bounds: Mapping[str, tuple[float, float]]

    @property
    def label(self) -> str:
        """Of tables."""
        return ", ".join(self.bounds)

    def fit(self, runs: Sequence[Run]) -> Fitted:
        """To these runs.

        Raises:
            ValueError: bounds that no liner can have, fewer data than parameters.
        """
        law, data = parameter_law(self.bounds, runs[0].liner), sum(run.data for run in runs)
        if data < len(law.names):
            raise ValueError(
                f"{data} data of {len(runs)} planes cannot fix {len(law.names)} parameters ({self.label}); add runs, "
                "or free fewer"
            )
        return Fitted((fit_law(law, runs, stated=True),))


@dataclass(frozen=True)
class CurveModel:
    """A curve at each frequency, of so much freedom; the rest as of ``CurveShape``."""

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

    def shape_at(self, frequency: float) -> CurveShape:
        """Curves at a frequency, Hz."""
        return CurveShape(self.base, frequency, self.knots, self.shape, self.reactance, self.freedom, self.rest)

    def fit(self, runs: Sequence[Run]) -> Fitted:
        """To these runs."""
        fits: list[Fit] = []
        known: list[float] = []
        for frequency in sorted({f for run in runs for f in run.frequency.tolist()}):
            if known and frequency < known[-1] * (1 + SAME_FREQUENCY):
                continue
            known.append(frequency)
            own = [
                run.at(i)
                for run in runs
                for i, f in enumerate(run.frequency.tolist())
                if abs(f / frequency - 1) < SAME_FREQUENCY
            ]
            fits.append(fit_law(self.shape_at(frequency).law(), own, stated=True, kind=CurveFit))
        return Fitted(tuple(fits))


@dataclass(frozen=True)
class RunRow:
    """One plane and frequency, predicted by a fit to the other runs.

    Args:
        label: of the plane.
        group: its run.
        frequency: Hz.
        height: m, or None.
        true: reference; None where a level alone is known.
        fitted: by the fit to all runs.
        predicted: by that to the others.
        standard: u(R) + j u(X) of ``predicted``.
        off: error of ``predicted``: of the reflection coefficient or, with known levels, relative of the pressure.
        level_check: dB by which the pressure is off; None with references.
        outside: share of the plane's weight at speeds that no other run saw.
    """

    label: str
    group: str
    frequency: float
    height: float | None
    true: complex | None
    fitted: complex
    predicted: complex
    standard: complex
    off: float
    level_check: float | None
    outside: float

    @property
    def misses(self) -> complex | None:
        """By how many standard deviations R and X of ``predicted`` are off, signed."""
        if self.true is None:
            return None
        away, spread = self.predicted - self.true, self.standard
        return complex(away.real / max(spread.real, 1e-300), away.imag / max(spread.imag, 1e-300))


@dataclass(frozen=True, eq=False)
class Candidate:
    """A model, its fit to all runs, and its predictions of each run by the others.

    Args:
        error: rms over the runs of ``RunRow.off``, by which models are compared.
        lowest: least resistance over 0 to the largest |v| of the data.
    """

    model: Model
    fitted: Fitted
    rows: tuple[RunRow, ...]
    error: float
    lowest: float

    @property
    def label(self) -> str:
        """Of the model."""
        return self.model.label


def candidate_of(model: Model, runs: Sequence[Run], knots: Knots) -> Candidate:
    """Fit to all runs, then without each group of planes that share one run."""
    fitted, rows = model.fit(runs), []
    for group in dict.fromkeys(run.group for run in runs):
        others = [run for run in runs if run.group != group]
        left = model.fit(others)
        seen = seen_by(others, left, knots)
        for run in (run for run in runs if run.group == group):
            rows += _rows(run, fitted, left, seen, knots)
    speeds = torch.linspace(0, knots.top**0.5, CHECKED, dtype=torch.float64).square()
    pairs = [(run, f) for run in runs for f in run.frequency.tolist()]
    lowest = min(float(fitted.curve(run.liner, f, speeds).real.min()) for run, f in pairs)
    return Candidate(model, fitted, tuple(rows), error_of(rows), lowest)


def knots_for(runs: Sequence[Run]) -> Knots:
    """Up to the |v| below which nearly all of every plane's weight lies."""
    square = max(float(run.squares.max()) for run in runs)
    fine, top = Knots(CREST * square**0.5, FINE), 0.0
    for run in runs:
        for i, frequency in enumerate(run.frequency):
            below = _weight(run.at(i), law_of(run.liner, frequency, run.nodes.speeds), fine).cumsum(0)
            top = max(top, float(fine.speeds[int((below < WITHIN).sum())]))
    return Knots(top)


def _weight(run: Run, values: Tensor, knots: Knots) -> Tensor:
    """Share of each spline of a curve in Z of a plane at one frequency, (n,), which sum to 1."""
    slopes = run.slopes(values[None])[0]
    found = (slopes @ knots.splines(run.nodes.speeds).to(slopes)).abs()
    return found / found.sum()


def seen_by(runs: Sequence[Run], fitted: Fitted, knots: Knots) -> Tensor:
    """Weight of each spline in the Z of each plane and frequency, (D, n)."""
    pairs = [(run, i, f) for run in runs for i, f in enumerate(run.frequency.tolist())]
    return torch.stack([_weight(run.at(i), fitted.curve(run.liner, f, run.nodes.speeds), knots) for run, i, f in pairs])


def outside_of(weight: Tensor, others: Tensor) -> float:
    """Share of a weight (n,) on splines that none of the others, (D, n), saw."""
    return float(weight[others.amax(0) < SEEN].sum())


def error_of(rows: Sequence[RunRow]) -> float:
    """rms over the runs, the planes of one of which count as one."""
    groups = [[row.off**2 for row in rows if row.group == name] for name in {r.group for r in rows}]
    return float((sum(sum(each) / len(each) for each in groups) / len(groups)) ** 0.5)


def _rows(run: Run, fitted: Fitted, left: Fitted, seen: Tensor, knots: Knots) -> list[RunRow]:
    weights = seen_by([run], left, knots)
    whole, (predicted, spread) = fitted.predict(run)[0], left.predict(run)
    off, standard, plane, level = run.off(predicted), standard_of(spread), run.plane, run.ratio is not None
    decibels = run.errors(predicted).real / NEPER
    return [
        RunRow(
            label=str(plane.provenance.get("case") or plane.name),
            group=run.group,
            frequency=frequency,
            height=plane.height,
            true=None if level else complex(run.wanted[i]),
            fitted=complex(whole[i]),
            predicted=complex(predicted[i]),
            standard=complex(standard[i]),
            off=float(off[i]),
            level_check=float(decibels[i]) if level else None,
            outside=outside_of(weights[i], seen),
        )
        for i, frequency in enumerate(run.frequency.tolist())
    ]

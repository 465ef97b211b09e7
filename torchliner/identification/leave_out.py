"""Every model refitted without each run, and what it then predicts of that run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from torchliner.calibration.budget import standard_of
from torchliner.calibration.misfit import driving_squares
from torchliner.identification.curve_problem import Datum
from torchliner.identification.runs import Run
from torchliner.identification.speed_curve import Knots, law_of
from torchliner.liners.model import LinerModel

SEEN = 0.02  # of a plane's weight: a spline that no plane gives as much is not seen
OUTSIDE = 0.1  # of a plane's weight, at speeds that no other run saw, that is warned of
WITHIN = 0.995  # of a plane's weight lies below the last knot
CREST = 4.0  # times the rms of the fastest column: no |v| that matters is larger
FINE = 60  # steps in sqrt |v| by which the last knot is found
CHECKED = 400  # |v| at which a fit must be passive


class Fitted(Protocol):
    """What a model's fit gives."""

    @property
    def misfit(self) -> float:
        """rms of what is left over the noise."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings."""

    def predict(self, run: Run) -> tuple[Tensor, Tensor]:
        """Z of a plane, (F,), and covariances of R and X, (F, 2, 2)."""

    def law(self, run: Run, index: int, speed: Tensor) -> Tensor:
        """Z at |v|, (V,), at one frequency of a plane."""

    def band(self, liner: LinerModel, frequency: float, speed: Tensor) -> Tensor:
        """Z of a liner at |v|, and the ends of the 95 % bands of R and X apart, (3, V)."""


class Model(Protocol):
    """What can be fitted."""

    @property
    def label(self) -> str:
        """Of tables."""

    def fit(self, runs: Sequence[Run]) -> Fitted:
        """To these runs."""


@dataclass(frozen=True)
class RunRow:
    """One plane and frequency, predicted by a fit to the other runs.

    Args:
        label: of the plane.  group: its run.  frequency: Hz.  height: m, or None.
        true: reference; None where a level alone is known.
        fitted: by the fit to all runs.  predicted: by that to the others.
        standard: u(R) + j u(X) of ``predicted``.
        off: error of ``predicted``: of the reflection coefficient or, with known levels, relative of
            the pressure.
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
        for run in (run for run in runs if run.group == group):
            rows += _rows(run, fitted, left, others, knots)
    speeds = torch.linspace(0, knots.top**0.5, CHECKED, dtype=torch.float64).square()
    lowest = min(float(fitted.law(run, i, speeds).real.min()) for run in runs for i in range(len(run.frequency)))
    return Candidate(model, fitted, tuple(rows), error_of(rows), lowest)


def knots_for(runs: Sequence[Run]) -> Knots:
    """Up to the |v| below which nearly all of every plane's weight lies."""
    square = max(float(driving_squares(run.weights.known, run.weights.averaging).max()) for run in runs)
    fine, top = Knots(CREST * square**0.5, FINE), 0.0
    for run in runs:
        for i, frequency in enumerate(run.frequency):
            datum = Datum(run, i)
            below = datum.seen(law_of(run.liner, frequency, datum.speeds), fine).cumsum(0)
            top = max(top, float(fine.speeds[int((below < WITHIN).sum())]))
    return Knots(top)


def error_of(rows: Sequence[RunRow]) -> float:
    """rms over the runs, the planes of one of which count as one."""
    groups = [[row.off**2 for row in rows if row.group == name] for name in {r.group for r in rows}]
    return float((sum(sum(each) / len(each) for each in groups) / len(groups)) ** 0.5)


def seen_by(runs: Sequence[Run], fitted: Fitted, knots: Knots) -> Tensor:
    """Weight of each spline in the Z of each plane and frequency, (D, n)."""
    return torch.stack([
        Datum(run, i).seen(fitted.law(run, i, Datum(run, i).speeds), knots)
        for run in runs
        for i in range(len(run.frequency))
    ])  # fmt: skip


def outside_of(weight: Tensor, others: Tensor) -> float:
    """Share of a weight (n,) on splines that none of the others, (D, n), saw."""
    return float(weight[others.amax(0) < SEEN].sum())


def _rows(run: Run, fitted: Fitted, left: Fitted, others: Sequence[Run], knots: Knots) -> list[RunRow]:
    known, weights = seen_by(others, left, knots), seen_by([run], left, knots)
    whole, (predicted, spread) = fitted.predict(run)[0], left.predict(run)
    off, standard = run.off(predicted), standard_of(spread)
    plane = run.plane
    return [
        RunRow(
            str(plane.provenance.get("case") or plane.name), run.group, frequency, plane.height,
            None if run.ratio is not None else complex(run.wanted[i]), complex(whole[i]),
            complex(predicted[i]), complex(standard[i]), float(off[i]),
            None if run.ratio is None else decibels(run, predicted, i),
            outside_of(weights[i], known),
        )
        for i, frequency in enumerate(run.frequency.tolist())
    ]  # fmt: skip


def decibels(run: Run, impedance: Tensor, index: int) -> float:
    """Closure of a plane, dB."""
    return float(run.misses(impedance)[index].real) * 20 / 2.302585092994046

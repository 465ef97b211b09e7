"""What was identified: the models beside each other, the best one's curve, table, predictions."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.calibration.budget import standard_of
from torchliner.checks import tell
from torchliner.conversions import reflection_from_impedance
from torchliner.engine.moments import Moments
from torchliner.identification.curve_model import FittedCurves
from torchliner.identification.leave_out import (
    OUTSIDE,
    SEEN,
    Candidate,
    outside_of,
    seen_by,
)
from torchliner.identification.parameter_model import FittedParameters
from torchliner.identification.runs import Run, read_weights, with_flow
from torchliner.identification.speed_curve import Knots
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.liners.tabulated import TabulatedLiner
from torchliner.records import VelocityPlane
from torchliner.velocity.choices import Choices

MARGIN = 1.25  # times the last knot, to which a table reaches
ROWS = 120  # speeds of a table, uniform in sqrt |v|


@dataclass(frozen=True, eq=False)
class PlanePrediction:
    """Z of a plane by what was identified.

    Args:
        frequency: Hz, (F,).  impedance: complex, (F,).
        standard: u(R) + j u(X) from the fit, (F,).
        outside: share of the plane's weight at speeds that no run saw, (F,).
        notes: warnings.
    """

    frequency: Tensor
    impedance: Tensor
    standard: Tensor
    outside: Tensor
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Identification:
    """What the runs say of the liner's response.

    Args:
        runs: as given, prepared.
        candidates: the models, the least error of leaving out first.
        knots: of curves.
        averaging, choices: as chosen.
        notes: warnings, with numbers.
    """

    runs: tuple[Run, ...]
    candidates: tuple[Candidate, ...]
    knots: Knots
    averaging: str
    choices: Choices
    notes: tuple[str, ...]

    @property
    def best(self) -> Candidate:
        """The model that predicts runs it has not seen best."""
        return self.candidates[0]

    @functools.cached_property
    def seen(self) -> Tensor:
        """Share of each spline of ``knots`` in Z of each plane and frequency, (D, n)."""
        return seen_by(self.runs, self.best.fitted, self.knots)

    @property
    def seen_speeds(self) -> tuple[float, ...]:
        """Least and greatest |v| about which the runs say something, m/s."""
        known = (self.seen.amax(0) >= SEEN).nonzero()[:, 0].tolist()
        # A spline reaches two steps to either side, and at rest nothing is slower.
        return tuple(float(self.knots.speeds[i]) for i in (max(known[0] - 2, 0), known[-1]))

    @property
    def frequencies(self) -> list[float]:
        """Hz, of all runs."""
        fitted = self.best.fitted
        if isinstance(fitted, FittedCurves):
            return [fit.frequency for fit in fitted.fits]
        return sorted({f for run in self.runs for f in run.frequency.tolist()})

    @property
    def doubtful(self) -> bool:
        """Whether a parameter ends on a bound or is not seen."""
        fitted = self.best.fitted
        if isinstance(fitted, FittedCurves):
            return any(fit.on_bound for fit in fitted.fits)
        assert isinstance(fitted, FittedParameters)
        return bool(fitted.found.on_bound or fitted.found.unseen)

    def curve(self, frequency: float, speed: Any) -> Tensor:
        """Z at |v|, and the ends of the 95 % bands of R and of X, complex, (3, V).

        Args:
            frequency: Hz; for a curve one of the runs.  speed: m/s, (V,).
        """
        at = torch.as_tensor(speed, dtype=torch.float64)
        return self.best.fitted.band(self.runs[0].liner, frequency, at)

    def table(self, reach: float | None = None) -> TabulatedLiner:
        """The curve as a liner, linear between ``ROWS`` speeds.

        Args:
            reach: m/s, of the last speed; default 1.25 times the largest |v| of the runs.
        Warns:
            DataWarning: it reaches beyond that; there R goes on along its tangent, X stays.
        """
        usual = MARGIN * self.knots.top
        if reach is not None and reach > usual:
            tell(
                f"the table reaches to {reach:.4g} m/s, {reach / self.knots.top:.3g} times the "
                f"largest |v| of the runs ({self.knots.top:.4g} m/s): R goes on along its tangent "
                "there and X stays, which no data support"
            )
        end = max(usual, reach or 0.0)
        speed = torch.linspace(0, end**0.5, ROWS, dtype=torch.float64).square()
        values = torch.stack([fit.curve(speed) for fit in self._curves().fits])
        base = self.runs[0].liner
        return TabulatedLiner(self.frequencies, values, speed, base.cell_pitch, self._name)

    @functools.cached_property
    def table_error(self) -> float:
        """Largest error in R of the table's lines between its speeds, up to the runs' |v|."""
        speed = torch.linspace(0, self.knots.top**0.5, 4 * ROWS, dtype=torch.float64).square()
        drawn, worst = self.table(), 0.0
        for fit in self._curves().fits:
            values = torch.stack([fit.curve(speed), drawn.impedance(fit.frequency, speed)])
            worst = max(worst, float(reflection_from_impedance(values).diff(dim=0).abs().max()))
        return worst

    @property
    def liner(self) -> LinerModel:
        """A table, or the law with the parameters found and the flow of the first plane."""
        fitted = self.best.fitted
        if isinstance(fitted, FittedParameters):
            return fitted.liner_of(self.runs[0].liner).replace(name=self._name)
        return self.table()

    def predict(
        self, plane: VelocityPlane | Moments, liner: Liner | None = None, frequency: Any = None
    ) -> PlanePrediction:
        """Z of another plane, and how much of it rests on speeds that no run saw.

        Args:
            plane: wall-normal velocity, or its moments.
            liner: its liner, whose other numbers are kept; default that of the runs.
            frequency: Hz; default the plane's tone.
        Raises:
            ValueError: a frequency that no run had, for a curve.
        Warns:
            DataWarning: more than 10 % of its weight lies at speeds that no run saw.
        """
        base = self.runs[0].liner if liner is None else as_liner(liner)
        weights = read_weights(plane, base, frequency, self.choices)
        facts = weights.plane
        unknown = torch.full_like(weights.frequency, torch.nan).to(torch.complex128)
        run = Run(weights, with_flow(base, facts.mach), facts.name, unknown, unknown)
        fitted = self.best.fitted
        found, spread = fitted.predict(run)
        weight = seen_by([run], fitted, self.knots)
        outside = torch.tensor([outside_of(row, self.seen) for row in weight])
        notes = beyond(facts.name, float(outside.max()), self.seen_speeds)
        tell(notes, depth=2)
        return PlanePrediction(run.frequency, found, standard_of(spread), outside, notes)

    @property
    def _name(self) -> str:
        base = self.runs[0].liner
        return f"{getattr(base, 'name', type(base).__name__)} identified"

    def _curves(self) -> FittedCurves:
        fitted = self.best.fitted
        if not isinstance(fitted, FittedCurves):
            raise TypeError(
                f"parameters were found ({self.best.label}), not a curve; take the liner, whose "
                "impedance(frequency, speed) holds at any frequency"
            )
        return fitted


def beyond(name: str, outside: float, seen: tuple[float, ...]) -> tuple[str, ...]:
    """Whether a prediction leaves the speeds that runs saw."""
    if outside <= OUTSIDE:
        return ()
    return (
        f"{name}: {100 * outside:.0f} % of its weight lies at |v| that no other run saw (seen: "
        f"about {seen[0]:.3g} to {seen[1]:.3g} m/s); the prediction rests on the prior there: add "
        "a run at its level",
    )

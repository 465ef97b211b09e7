"""What was identified: the models beside each other, the best one's curve, table, predictions, and what is doubtful."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import tell
from torchliner.conversions import reflection_from_impedance
from torchliner.engine.nodes import checked_speeds
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.liners.sdof import AdjustedSDoFLiner, FlowSDoFLiner, SDoFLiner
from torchliner.liners.tabulated import TabulatedLiner
from torchliner.studies.calibrate import LARGEST_MODEL_ERROR
from torchliner.studies.curves import BOUNDS, Knots
from torchliner.studies.fit import FAR, Prediction
from torchliner.studies.leave_out import SEEN, Candidate, outside_of, seen_by
from torchliner.studies.runs import Run, read_run
from torchliner.studies.variants import Records
from torchliner.velocity.choices import Choices

MARGIN = 1.25  # times the last knot, to which a table reaches
ROWS = 120  # speeds of a table, uniform in sqrt |v|
OUTSIDE = 0.1  # of a plane's weight, at speeds that no other run saw, that is warned of
WIDE = 3.0  # standard deviations, beyond which a prediction is not covered


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
        return self.best.fitted.frequencies or sorted({f for run in self.runs for f in run.frequency.tolist()})

    @property
    def doubtful(self) -> bool:
        """Whether a parameter ends on a bound or is not seen."""
        fitted = self.best.fitted
        return any(fit.on_bound or (not fitted.is_curve and fit.unseen) for fit in fitted.fits)

    def curve(self, frequency: float, speed: Any) -> Tensor:
        """Z at |v|, and the ends of the 95 % bands of R and of X, complex, (3, V).

        Args:
            frequency: Hz; for a curve one of the runs.
            speed: m/s, (V,).
        """
        at = torch.as_tensor(speed, dtype=torch.float64)
        return self.best.fitted.at(frequency).band(self.runs[0].liner, frequency, at)

    def table(self, reach: float | None = None) -> TabulatedLiner:
        """The curve as a liner, linear between ``ROWS`` speeds.

        Args:
            reach: m/s, of the last speed; default 1.25 times the largest |v| of the runs.
        Raises:
            TypeError: parameters were found, not a curve.
        Warns:
            DataWarning: it reaches beyond that; there R goes on along its tangent, X stays.
        """
        usual = MARGIN * self.knots.top
        if reach is not None and reach > usual:
            tell(
                f"the table reaches to {reach:.4g} m/s, {reach / self.knots.top:.3g} times the largest |v| of the "
                f"runs ({self.knots.top:.4g} m/s): R goes on along its tangent there and X stays, which no data support"
            )
        speed = torch.linspace(0, max(usual, reach or 0.0) ** 0.5, ROWS, dtype=torch.float64).square()
        return TabulatedLiner(self.frequencies, self._values(speed), speed, self.runs[0].liner.cell_pitch, self._name)

    @functools.cached_property
    def table_error(self) -> float:
        """Largest error in R of the table's lines between its speeds, up to the runs' |v|."""
        speed = torch.linspace(0, self.knots.top**0.5, 4 * ROWS, dtype=torch.float64).square()
        drawn = self.table().impedance(torch.tensor(self.frequencies)[:, None], speed)
        return float(reflection_from_impedance(torch.stack([self._values(speed), drawn])).diff(dim=0).abs().max())

    @property
    def liner(self) -> LinerModel:
        """A table, or the law with the parameters found, which takes the Mach number of the data it is used on."""
        if self.best.fitted.is_curve:
            return self.table()
        found = self.runs[0].liner.with_numbers(self.best.fitted.values)
        flow = {"mach": None} if isinstance(found, FlowSDoFLiner) else {}
        return found.replace(name=self._name, **flow)

    def predict(self, plane: Records, liner: Liner | None = None, frequency: Any = None) -> Prediction:
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
        run = read_run(plane, base, frequency, self.choices, any_curve=True)
        run = dataclasses.replace(run, liner=with_flow(base, run.plane.mach))
        found, spread = self.best.fitted.predict(run)
        outside = outside_of(seen_by([run], self.best.fitted, self.knots), self.seen)
        notes = beyond(run.plane.name, float(outside.max()), self.seen_speeds)
        tell(notes)
        return Prediction(run.frequency, found, spread, notes, outside=outside)

    @property
    def _name(self) -> str:
        base = self.runs[0].liner
        return f"{getattr(base, 'name', type(base).__name__)} identified"

    def _values(self, speed: Tensor) -> Tensor:
        """Z of the curves, (F, V)."""
        fitted, base = self.best.fitted, self.runs[0].liner
        if not fitted.is_curve:
            raise TypeError(
                f"parameters were found ({self.best.label}), not a curve; take the liner, whose impedance(frequency, "
                "speed) holds at any frequency"
            )
        return torch.stack([fitted.at(f).curve(base, f, speed) for f in self.frequencies])


def with_flow(liner: LinerModel, mach: float | None = None) -> LinerModel:
    """An SDoF liner with the Mach number of a plane, and with factors unless its own law takes one; any other as it
    is."""
    if not isinstance(liner, SDoFLiner):
        return liner
    if isinstance(liner, FlowSDoFLiner):
        return liner.replace(mach=mach or 0.0)
    return AdjustedSDoFLiner.of(liner, mach=mach or 0.0)


def beyond(name: str, outside: float, seen: tuple[float, ...]) -> tuple[str, ...]:
    """Whether a prediction leaves the speeds that runs saw."""
    if outside <= OUTSIDE:
        return ()
    return (
        f"{name}: {100 * outside:.0f} % of its weight lies at |v| that no other run saw (seen: about {seen[0]:.3g} to "
        f"{seen[1]:.3g} m/s); the prediction rests on the prior there: add a run at its level",
    )


def warnings_of(found: Identification) -> list[str]:
    """Of the best model, and of those that were not chosen because they are not passive."""
    best, fitted = found.best, found.best.fitted
    notes = [
        f"{len(fit.on_bound)} of {len(fit.values)} parameters of the curve at {fit.law.frequency:g} Hz end at a factor "
        f"of {math.exp(BOUNDS):.0f} of the prior shape: the references ask for a step or the other direction; see "
        "reactance, or state more noise"
        for fit in fitted.fits
        if fitted.is_curve and fit.on_bound
    ]
    if not fitted.is_curve:
        notes += [f"{best.label}: {note}" for note in fitted.fits[0].warnings() if "times the stated" not in note]
    for row in best.rows:
        notes += [f"without it, {text}" for text in beyond(row.label, row.outside, found.seen_speeds)]
    if fitted.misfit > FAR:
        notes.append(
            f"{best.label}: the misfit is {fitted.misfit:.3g} times the noise: no such law gives all references, and "
            "uncertainties are widened by that factor"
        )
    far = [row.label for row in best.rows if row.misses and max(abs(row.misses.real), abs(row.misses.imag)) > WIDE]
    if far:
        notes.append(
            f"{', '.join(dict.fromkeys(far))}: predicted by the other runs, off by more than {WIDE:g} standard "
            "deviations; the uncertainty of the fit does not cover what its law misses"
        )
    notes += [
        f"{each.label} is not passive: R falls to {each.lowest:.3g}; it was not chosen"
        for each in found.candidates
        if each.lowest < 0
    ]
    if fitted.is_curve and (error := _model_error(found)) > LARGEST_MODEL_ERROR:
        notes.append(
            f"R of the curve is known to {error:.2g} only (limit {LARGEST_MODEL_ERROR:g}) between the speeds at which "
            "the moments read it; compare with educe of the table"
        )
    return notes


def _model_error(found: Identification) -> float:
    """Largest error in R of the interpolation over |v|, at any |v| of the runs."""
    fitted, liner, speed, worst = found.best.fitted, found.runs[0].liner, checked_speeds(found.knots.top), 0.0
    for f, nodes in itertools.product(fitted.frequencies, {run.nodes for run in found.runs}):
        curves = [fitted.at(f).curve(liner, f, at) for at in (nodes.speeds, speed)]
        at_nodes, wanted = map(reflection_from_impedance, curves)
        between = nodes.coefficients(at_nodes) @ nodes.functions(speed).T.to(wanted)
        worst = max(worst, float((between - wanted).abs().max()))
    return worst

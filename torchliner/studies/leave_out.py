"""Models that are fitted to all runs, then without each run, and what they then predict of that run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.studies.budget import standard_of
from torchliner.studies.curves import Knots, law_of
from torchliner.studies.fit import Fit, fit_law
from torchliner.studies.laws import Law
from torchliner.studies.rows import Row
from torchliner.studies.runs import NEPER, Run

SEEN = 0.02  # of a plane's weight: a spline that no plane gives as much is not seen
WITHIN = 0.995  # of a plane's weight lies below the last knot
CREST = 4.0  # times the rms of the fastest column: no |v| that matters is larger
FINE = 60  # steps in sqrt |v| by which the last knot is found
CHECKED = 400  # |v| at which a fit must be passive


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
        for fit in self.fits:
            if fit.law.frequency is None or abs(fit.law.frequency / frequency - 1) < SAME_FREQUENCY:
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
        return dict(zip(self.values, self.fits[0].widened.diagonal().sqrt().tolist(), strict=True))

    @property
    def misfit(self) -> float:
        """rms of what is left over the noise, the largest of all frequencies."""
        return max(fit.misfit for fit in self.fits)

    def predict(self, run: Run) -> tuple[Tensor, Tensor]:
        """Z of a plane, (F,), and covariances of R and X, (F, 2, 2)."""
        rows = [self.at(f).of_run(run.at(i)) for i, f in enumerate(run.frequency.tolist())]
        values, spreads = zip(*rows, strict=True)
        return torch.cat(values), torch.cat(spreads)


@dataclass(frozen=True, eq=False)
class Model:
    """What can be fitted.

    Args:
        label: of tables.
        laws: of parameters one, of a curve one a frequency.
    """

    label: str
    laws: tuple[Law, ...]

    def fit(self, runs: Sequence[Run]) -> Fitted:
        """To these runs.

        Raises:
            ValueError: fewer data than parameters, a prior counting as one datum each.
        """
        fits = []
        for law in self.laws:
            own = list(runs)
            if law.frequency is not None:
                places = [(run, i, f / law.frequency) for run in runs for i, f in enumerate(run.frequency.tolist())]
                own = [run.at(i) for run, i, ratio in places if abs(ratio - 1) < SAME_FREQUENCY]
            data = sum(run.data for run in own)
            if data + len(law.prior) < len(law.names):
                raise ValueError(
                    f"{data} data of {len(runs)} planes cannot fix {len(law.names)} parameters ({self.label}); add "
                    "runs, or free fewer"
                )
            if own:
                fits.append(fit_law(law, own, stated=True))
        return Fitted(tuple(fits))


@dataclass(frozen=True, eq=False)
class Candidate:
    """A model, its fit to all runs, and its predictions of each run by the others.

    Args:
        rows: each plane and frequency, predicted by a fit to the other runs: label of the plane, group (its run),
            frequency (Hz), height (m), true (the reference; None where a level alone is known), fitted (by the fit to
            all runs), predicted (by that to the others), standard (u(R) + j u(X) of it), misses (by how many standard
            deviations R and X are off; None without a reference), off (its error: of the reflection coefficient, with
            known levels relative of the pressure), level_check (dB by which the pressure is off; None with references),
            outside (share of the plane's weight at speeds that no other run saw).
        error: rms over the runs of ``off``, by which models are compared.
        lowest: least resistance over 0 to the largest |v| of the data.
    """

    model: Model
    fitted: Fitted
    rows: tuple[Row, ...]
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
    lowest = min(float(fitted.at(f).curve(run.liner, f, speeds).real.min()) for run, f in pairs)
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
    at = values.detach().requires_grad_()
    (slopes,) = torch.autograd.grad(run.impedance(at[None]).real.sum(), at)
    found = (slopes @ knots.splines(run.nodes.speeds).to(slopes)).abs()
    return found / found.sum()


def seen_by(runs: Sequence[Run], fitted: Fitted, knots: Knots) -> Tensor:
    """Weight of each spline in the Z of each plane and frequency, (D, n)."""
    pairs = [(run, i, f) for run in runs for i, f in enumerate(run.frequency.tolist())]
    curves = [fitted.at(f).curve(run.liner, f, run.nodes.speeds) for run, _, f in pairs]
    return torch.stack([_weight(run.at(i), curve, knots) for (run, i, _), curve in zip(pairs, curves, strict=True)])


def outside_of(weights: Tensor, others: Tensor) -> Tensor:
    """Share of each weight, (D, n), on splines that none of the others, (E, n), saw, (D,)."""
    return weights[:, others.amax(0) < SEEN].sum(1)


def error_of(rows: Sequence[Row]) -> float:
    """rms over the runs, the planes of one of which count as one."""
    groups = [[row.off**2 for row in rows if row.group == name] for name in {r.group for r in rows}]
    return float((sum(sum(each) / len(each) for each in groups) / len(groups)) ** 0.5)


def _rows(run: Run, fitted: Fitted, left: Fitted, seen: Tensor, knots: Knots) -> list[Row]:
    whole, (predicted, spread) = fitted.predict(run)[0], left.predict(run)
    standard, plane, level = standard_of(spread), run.plane, run.ratio is not None
    away = predicted - run.wanted
    misses = torch.complex(away.real / standard.real.clamp(1e-300), away.imag / standard.imag.clamp(1e-300))
    columns = {
        "frequency": run.frequency.tolist(),
        "true": [None] * len(away) if level else run.wanted.tolist(),
        "fitted": whole.tolist(),
        "predicted": predicted.tolist(),
        "standard": standard.tolist(),
        "misses": [None] * len(away) if level else misses.tolist(),
        "off": run.off(predicted).tolist(),
        "level_check": (run.errors(predicted).real / NEPER).tolist() if level else [None] * len(away),
        "outside": outside_of(seen_by([run], left, knots), seen).tolist(),
    }
    about = {"label": str(plane.provenance.get("case") or plane.name), "group": run.group, "height": plane.height}
    return [Row(about, **dict(zip(columns, each, strict=True))) for each in zip(*columns.values(), strict=True)]

"""Parameters of the liner's own law, shared by all runs: the same door as the curve's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.calibration.budget import standard_of
from torchliner.calibration.fit import Fit, fit_misfit
from torchliner.calibration.misfit import FreeLiners
from torchliner.calibration.targets import bounds_of
from torchliner.forward_mode import slopes_of
from torchliner.identification.runs import Run, misfit_of
from torchliner.liners.model import LinerModel, named_numbers

AROUND = 0.5  # bounds that are not stated: so much of a value, or about one that may be negative
BOUNDS = {  # of factors, whose neutral value says nothing of how far they go
    "vena_contracta": (0.2, 1.0),
    "end_correction": (0.0, 4.0),
    "mass_loss": (0.0, 10.0),
    "mass_loss_speed": (0.05, 10.0),
    "mach_resistance": (-5.0, 5.0),
    "mach_mass_loss": (-10.0, 10.0),
}
WIDTH = 1.959964  # standard deviations of a 95 % interval
START = (0.02, 0.98)  # of the box


def bounds_for(names: Sequence[str], liner: LinerModel) -> dict[str, tuple[float, float]]:
    """Usual bounds, SI, of parameters by name."""
    found = {}
    for name, number in named_numbers(liner, names).items():
        reach = AROUND * number.value if number.low >= 0 else AROUND
        around = number.value - reach, min(number.value + reach, number.high)
        found[name] = BOUNDS.get(name, around)
    return found


@dataclass(frozen=True, eq=False)
class ParameterModel:
    """Parameters, with bounds in SI."""

    bounds: Mapping[str, tuple[float, float]]

    @property
    def label(self) -> str:
        """Of tables."""
        return ", ".join(self.bounds)

    def fit(self, runs: Sequence[Run]) -> FittedParameters:
        """To these runs.

        Raises:
            ValueError: bounds that no liner can have, a parameter of the flow where no plane has
                one, fewer data than parameters.
        """
        names, low, high = bounds_of(self.bounds, runs[0].liner)
        misfit = misfit_of(runs, names, low, high)
        if misfit.data < len(names):
            raise ValueError(
                f"{misfit.data} data of {len(runs)} planes cannot fix {len(names)} parameters "
                f"({self.label}); add runs, or free fewer"
            )
        numbers = runs[0].liner.numbers()
        start = torch.tensor([numbers[name].value for name in names], dtype=torch.float64)
        share = ((start - low) / (high - low)).clamp(*START)
        return FittedParameters(self, fit_misfit(misfit, share, stated=True))


@dataclass(frozen=True, eq=False)
class FittedParameters:
    """Parameters found, and what they predict."""

    model: ParameterModel
    found: Fit

    @property
    def values(self) -> dict[str, float]:
        """Best, SI, by name."""
        values = self.found.misfit.values(self.found.share).tolist()
        return dict(zip(self.found.misfit.names, values, strict=True))

    @property
    def misfit(self) -> float:
        """rms of what is left over the noise, by degrees of freedom."""
        return float((self.found.chi_square / max(self.found.freedom, 1)) ** 0.5)

    @property
    def covariance(self) -> Tensor:
        """SI, (n, n), widened where the misfit is above the noise; 0 for those on a bound."""
        kept = torch.tensor([name not in self.found.on_bound for name in self.values])
        return self.found.covariance * torch.outer(kept, kept) * max(1.0, self.misfit) ** 2

    @property
    def standard(self) -> dict[str, float]:
        """SI, by name."""
        spread = self.covariance.diagonal().sqrt().tolist()
        return dict(zip(self.values, spread, strict=True))

    def predict(self, run: Run) -> tuple[Tensor, Tensor]:
        """Z of a plane, (F,), and covariances of R and X, (F, 2, 2), to first order."""
        free = FreeLiners([run.weights], [run.liner], tuple(self.values))
        at = [torch.tensor(v, dtype=torch.float64, requires_grad=True)
              for v in self.values.values()]  # fmt: skip
        values = free.impedance(torch.stack(at))
        slopes = [torch.zeros_like(values) if each is None else each
                  for each in slopes_of(values, at)]  # fmt: skip
        rows = torch.view_as_real(torch.stack(slopes, dim=-1).resolve_conj()).transpose(-1, -2)
        return values.detach(), rows @ self.covariance @ rows.transpose(-1, -2)

    def law(self, run: Run, index: int, speed: Tensor) -> Tensor:
        """Z at |v|, (V,), at one frequency of a plane."""
        found: Tensor = self.liner_of(run.liner).impedance(run.frequency[index], speed)
        return found.detach()

    def band(self, liner: LinerModel, frequency: float, speed: Tensor) -> Tensor:
        """Z of a liner at |v|, and the ends of the 95 % bands of R and X apart, (3, V)."""
        at = [torch.tensor(v, dtype=torch.float64, requires_grad=True)
              for v in self.values.values()]  # fmt: skip
        moved = liner.with_numbers(dict(zip(self.values, at, strict=True)))
        best = torch.as_tensor(moved.impedance(frequency, speed)).broadcast_to(speed.shape)
        slopes = torch.stack([torch.zeros_like(best) if each is None else each
                              for each in slopes_of(best, at)], dim=-1)  # fmt: skip
        spread = standard_of(torch.stack([
            parts @ self.covariance @ parts.T
            for parts in torch.view_as_real(slopes.detach().resolve_conj()).transpose(-1, -2)
        ]))  # fmt: skip
        return best.detach() + WIDTH * torch.stack([0 * spread, -spread, spread])

    def liner_of(self, liner: LinerModel) -> LinerModel:
        """A liner with the parameters found."""
        return liner.with_numbers(self.values)

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings."""
        return tuple(f"{self.model.label}: {note}" for note in self.found.warnings()
                     if "times the stated" not in note)  # fmt: skip

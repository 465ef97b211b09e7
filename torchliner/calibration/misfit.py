"""The misfit of several planes as a function of shared parameters of their liners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor
from torch.autograd import forward_ad

from torchliner.calibration.level_weights import LevelWeights, law_at
from torchliner.liners.parameters import with_values
from torchliner.liners.sdof import SDoFLiner


@dataclass(frozen=True, eq=False)
class Misfit:
    """Residuals over their uncertainties.

    Args:
        planes: level weights, with the liner of each.
        liners: SDoF liners, one a plane; the same object where they share one.
        names: of the free parameters, n of them.
        low, high: bounds, (n,).
        wanted: reference impedances of all planes and frequencies, (D,).
        noise: standard uncertainty of R (real part) and X (imaginary part), (D,).
        prior: mean and standard deviation by parameter.
    """

    planes: Sequence[LevelWeights]
    liners: Sequence[SDoFLiner]
    names: tuple[str, ...]
    low: Tensor
    high: Tensor
    wanted: Tensor
    noise: Tensor
    prior: Mapping[str, tuple[float, float]]

    def values(self, share: Tensor) -> Tensor:
        """SI, from the place in the box, 0 to 1, (..., n)."""
        return self.low + share * (self.high - self.low)

    def moved(self, values: Any) -> list[SDoFLiner]:
        """The liners with these values, the same object where they share one."""
        named = dict(zip(self.names, values, strict=True))
        made = {id(liner): with_values(liner, named) for liner in self.liners}
        return [made[id(liner)] for liner in self.liners]

    def laws(self, values: Any) -> list[Tensor]:
        """Coefficients of every plane, (L, 6) each; liners that are shared are asked once."""
        moved = self.moved(values)
        found: list[Tensor] = [torch.zeros(0)] * len(moved)
        for each in {id(liner): liner for liner in moved}.values():
            members = [i for i, liner in enumerate(moved) if liner is each]
            lines = [self.planes[i].lines for i in members]
            rows = law_at(each, torch.cat(lines)).split([len(part) for part in lines])
            for i, row in zip(members, rows, strict=True):
                found[i] = row
        return found

    def impedance(self, values: Tensor) -> Tensor:
        """Z of all planes and frequencies, (D,), differentiable in ``values`` (n,)."""
        laws = self.laws(values.unbind())
        return torch.cat([p.impedance(law) for p, law in zip(self.planes, laws, strict=True)])

    def impedances(self, values: Tensor) -> Tensor:
        """The same for many, (M, n) to (M, D)."""
        rows = [self.laws(each) for each in values.unbind()]
        return torch.cat(
            [
                plane.impedances(torch.stack([row[i] for row in rows]))
                for i, plane in enumerate(self.planes)
            ],
            dim=-1,
        )

    def residuals(self, values: Tensor, impedance: Tensor) -> Tensor:
        """(..., 2 D + priors) from values (..., n) and Z (..., D)."""
        away = impedance - self.wanted
        parts = [away.real / self.noise.real, away.imag / self.noise.imag]
        for i, name in enumerate(self.names):
            if name in self.prior:
                mean, spread = self.prior[name]
                parts.append((values[..., i : i + 1] - mean) / spread)
        return torch.cat(parts, dim=-1)

    def slopes(self, share: Tensor) -> tuple[Tensor, Tensor]:
        """Residuals (m,) and their derivatives in the place in the box, (m, n)."""
        rows, columns = torch.zeros(0), []
        for i in range(len(share)):
            with forward_ad.dual_level():
                along = torch.zeros_like(share)
                along[i] = 1
                values = self.values(forward_ad.make_dual(share, along))
                found = forward_ad.unpack_dual(self.residuals(values, self.impedance(values)))
                rows = found.primal
                slope = found.tangent
                columns.append(torch.zeros_like(rows) if slope is None else slope)
        return rows, torch.stack(columns, dim=1)

    def anchored(self, values: Tensor) -> Misfit:
        """The same, made exact at ``values`` by a whole replay of every plane."""
        moved = self.moved(values.unbind())
        planes = [p.anchored(liner) for p, liner in zip(self.planes, moved, strict=True)]
        return replace(self, planes=planes)

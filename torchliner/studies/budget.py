"""First-order propagation of tolerances: contributions, covariance, standard uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_choice
from torchliner.liners.parameters import Number
from torchliner.names import LIMITS
from torchliner.units import parse_tolerance


@dataclass(frozen=True, eq=False)
class Contribution:
    """One line of a budget: change of Z for one standard uncertainty of a parameter."""

    parameter: str
    value: float
    unit: str
    half_width: float
    standard: float
    impedance: complex


@dataclass(frozen=True, eq=False)
class Budget:
    """Uncertainty of an educed impedance from the tolerances of its liner, to first order.

    Args:
        numbers: parameters by name, n of them.
        half_widths, standard: SI, (n,).
        limits: how a half-width was read.
        correlation: (n, n).
        contributions: signed change of the liner's Z for one standard uncertainty of each parameter, by averaging,
            complex, (n, F).
        covariance: of R and X of the liner, by averaging, (F, 2, 2).
        places: standard uncertainty u(R) + j u(X) of the probes and of the cells, (..., F), by "probes" and by
            averaging.
    """

    numbers: Mapping[str, Number]
    half_widths: Tensor
    standard: Tensor
    limits: str
    correlation: Tensor
    contributions: Mapping[str, Tensor]
    covariance: Mapping[str, Tensor]
    places: Mapping[str, Tensor]

    def combined(self, averaging: str) -> Tensor:
        """u(R) + j u(X) of the liner, (F,)."""
        return standard_of(self.covariance[averaging])

    def sorted(self, averaging: str, frequency_index: int = 0) -> list[Contribution]:
        """Contributions, the largest |dZ| first."""
        amounts = self.contributions[averaging][:, frequency_index].tolist()
        widths, spreads = self.half_widths.tolist(), self.standard.tolist()
        rows = [
            Contribution(name, number.value, number.unit, *each)
            for (name, number), *each in zip(self.numbers.items(), widths, spreads, amounts, strict=True)
        ]
        return sorted(rows, key=lambda row: -abs(row.impedance))


def values_of(numbers: Mapping[str, Number]) -> Tensor:
    """SI, float64, (n,)."""
    return torch.tensor([number.value for number in numbers.values()], dtype=torch.float64)


def standard_of(covariance: Tensor) -> Tensor:
    """u(R) + j u(X) from (..., 2, 2)."""
    root = covariance.diagonal(dim1=-2, dim2=-1).clamp(min=0).sqrt()
    return torch.complex(root[..., 0], root[..., 1])


def correlation_of(covariance: Tensor) -> float:
    """Of R and X, -1 to 1, from (2, 2); 0 where one of them has no uncertainty."""
    product = float((covariance[0, 0] * covariance[1, 1]).sqrt())
    return float(covariance[0, 1]) / product if product else 0.0


def covariance_of(changes: Tensor, correlation: Tensor) -> Tensor:
    """Covariance of R and X, (..., 2, 2), from signed changes of Z, complex, (n, ...)."""
    parts = torch.stack([changes.real, changes.imag], dim=-1)
    return torch.einsum("i...a,ij,j...b->...ab", parts, correlation, parts)


def budget_of(
    numbers: Mapping[str, Number],
    liner: Mapping[str, Tensor],
    places: Mapping[str, Tensor],
    tolerances: Mapping[str, Any],
    limits: str,
    correlation: Mapping[tuple[str, str], float],
) -> Budget:
    """First-order budget of anything whose slopes in some parameters are known.

    Args:
        numbers: parameters by name, n of them.
        liner, places: dZ/dp, complex, (n, ...): of the liner by averaging, and of the places of ``Budget``.
        tolerances, limits, correlation: as ``Sensitivities.propagate`` takes them.
    Raises:
        ValueError: a half-width that reaches below what the parameter can be.
    """
    factor = LIMITS[require_choice("reading of the limits", limits, LIMITS)]
    if not tolerances:
        raise ValueError("no tolerance is stated; name at least one, e.g. orifice_diameter")
    for name in tolerances:
        require_choice("parameter of a tolerance", name, numbers)
    kept = [i for i, name in enumerate(numbers) if name in tolerances]
    stated = {name: number for name, number in numbers.items() if name in tolerances}
    widths = []
    for name, number in stated.items():
        width = parse_tolerance(tolerances[name], name, number.quantity, number.value)
        if number.low >= 0 and width > abs(number.value) > 0:
            raise ValueError(
                f"tolerance of {name} is {tolerances[name]!r}, a half-width of {width:g}, more "
                f"than its value, {number.value:.6g}, which is never below {number.low:g}; write "
                "'2 %' where per cent are meant"
            )
        widths.append(width)
    half_widths = torch.tensor(widths, dtype=torch.float64)
    standard, matrix = factor * half_widths, _correlation_matrix(tuple(stated), correlation)

    def changes(slopes: Tensor) -> Tensor:
        return slopes[kept] * standard.reshape(-1, *(1,) * (slopes.ndim - 1))

    of_liner = {name: changes(slopes) for name, slopes in liner.items()}
    covariance = {name: covariance_of(change, matrix) for name, change in of_liner.items()}
    of_places = {name: standard_of(covariance_of(changes(slopes), matrix)) for name, slopes in places.items()}
    return Budget(stated, half_widths, standard, limits, matrix, of_liner, covariance, of_places)


def _correlation_matrix(names: tuple[str, ...], pairs: Mapping[tuple[str, str], float]) -> Tensor:
    matrix = torch.eye(len(names), dtype=torch.float64)
    for (first, second), coefficient in pairs.items():
        for name in (first, second):
            require_choice("parameter of a correlation", name, names)
        if first == second or not -1 <= coefficient <= 1:
            raise ValueError(
                f"correlation of {first} and {second} is {coefficient:g}; it is -1 to 1, between two different "
                "parameters"
            )
        i, j = names.index(first), names.index(second)
        matrix[i, j] = matrix[j, i] = coefficient
    lowest = float(torch.linalg.eigvalsh(matrix)[0])
    if lowest < -1e-12:
        raise ValueError(
            f"these correlations contradict each other: their matrix has the eigenvalue {lowest:.3g}, and none may be "
            "negative"
        )
    return matrix

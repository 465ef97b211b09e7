"""First-order propagation of tolerances: contributions, covariance, standard uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from torchliner.checks import require_choice
from torchliner.eduction.averaging import ORDERS
from torchliner.io.tolerances import parse_tolerance
from torchliner.liners.parameters import NUMBERS

if TYPE_CHECKING:
    from torchliner.eduction.sensitivity import Sensitivities

LIMITS = {"rectangular": 3**-0.5, "standard": 1.0}  # standard uncertainty per half-width


@dataclass(frozen=True, eq=False)
class Contribution:
    """One line of a budget: change of Z for one standard uncertainty of a parameter."""

    parameter: str
    value: float
    half_width: float
    standard: float
    impedance: complex


@dataclass(frozen=True, eq=False)
class Budget:
    """Uncertainty of an educed impedance from the tolerances of its liner, to first order.

    Args:
        parameters: names, n of them.
        values, half_widths, standard: SI, (n,).
        limits: how a half-width was read.
        correlation: (n, n).
        contributions: signed change of the liner's Z for one standard uncertainty of each
            parameter, by order of averaging, complex, (n, F).
        covariance: of R and X of the liner, by order, (F, 2, 2).
        probes, cells, cells_velocity_first: standard uncertainty u(R) + j u(X), (..., F).
    """

    parameters: tuple[str, ...]
    values: Tensor
    half_widths: Tensor
    standard: Tensor
    limits: str
    correlation: Tensor
    contributions: Mapping[str, Tensor]
    covariance: Mapping[str, Tensor]
    probes: Tensor
    cells: Tensor
    cells_velocity_first: Tensor

    def combined(self, order: str) -> Tensor:
        """u(R) + j u(X) of the liner, (F,)."""
        return standard_of(self.covariance[order])

    def sorted(self, order: str, frequency_index: int = 0) -> list[Contribution]:
        """Contributions, the largest |dZ| first."""
        amounts = self.contributions[order][:, frequency_index]
        return [
            Contribution(
                self.parameters[i], float(self.values[i]), float(self.half_widths[i]),
                float(self.standard[i]), complex(amounts[i]),
            )
            for i in amounts.abs().argsort(descending=True).tolist()
        ]  # fmt: skip


def standard_of(covariance: Tensor) -> Tensor:
    """u(R) + j u(X) from (..., 2, 2)."""
    root = covariance.diagonal(dim1=-2, dim2=-1).clamp(min=0).sqrt()
    return torch.complex(root[..., 0], root[..., 1])


def covariance_of(changes: Tensor, correlation: Tensor) -> Tensor:
    """Covariance of R and X, (..., 2, 2), from signed changes of Z, complex, (n, ...)."""
    parts = torch.stack([changes.real, changes.imag], dim=-1)
    return torch.einsum("i...a,ij,j...b->...ab", parts, correlation, parts)


def budget_of(
    found: Sensitivities,
    tolerances: Mapping[str, Any],
    limits: str,
    correlation: Mapping[tuple[str, str], float] | None,
) -> Budget:
    """See ``Sensitivities.propagate``."""
    factor = LIMITS[require_choice("reading of the limits", limits, LIMITS)]
    if not tolerances:
        raise ValueError("no tolerance is stated; name at least one, e.g. orifice_diameter")
    for name in tolerances:
        require_choice("parameter of a tolerance", name, found.parameters)
    kept = [i for i, name in enumerate(found.parameters) if name in tolerances]
    names = tuple(found.parameters[i] for i in kept)
    values = found.values[kept]
    half_widths = torch.tensor(
        [
            parse_tolerance(tolerances[name], name, NUMBERS[name].quantity, value)
            for name, value in zip(names, values.tolist(), strict=True)
        ],
        dtype=torch.float64,
    )
    standard = factor * half_widths
    matrix = _correlation_matrix(names, correlation or {})
    steps = torch.zeros(len(found.parameters), dtype=torch.float64)
    steps[kept] = standard
    moved = found.scaled(steps)
    contributions = {order: moved.of_liner(order)[kept] for order in ORDERS}

    def spread(changes: Tensor) -> Tensor:
        return standard_of(covariance_of(changes[kept], matrix))

    return Budget(
        names, values, half_widths, standard, limits, matrix, contributions,
        {order: covariance_of(part, matrix) for order, part in contributions.items()},
        spread(moved.probes), spread(moved.cells), spread(moved.cells_velocity_first),
    )  # fmt: skip


def _correlation_matrix(names: tuple[str, ...], pairs: Mapping[tuple[str, str], float]) -> Tensor:
    matrix = torch.eye(len(names), dtype=torch.float64)
    for (first, second), coefficient in pairs.items():
        for name in (first, second):
            require_choice("parameter of a correlation", name, names)
        if first == second or not -1 <= coefficient <= 1:
            raise ValueError(
                f"correlation of {first} and {second} is {coefficient:g}; it is -1 to 1, between "
                "two different parameters"
            )
        i, j = names.index(first), names.index(second)
        matrix[i, j] = matrix[j, i] = coefficient
    lowest = float(torch.linalg.eigvalsh(matrix)[0])
    if lowest < -1e-12:
        raise ValueError(
            f"these correlations contradict each other: their matrix has the eigenvalue "
            f"{lowest:.3g}, and none may be negative"
        )
    return matrix

"""First-order propagation of tolerances: contributions, covariance, standard uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_choice
from torchliner.liners.parameters import Number
from torchliner.names import LIMITS
from torchliner.studies.rows import Row, Study
from torchliner.units import parse_tolerance


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
    frequency: Tensor,
    liner: Mapping[str, Tensor],
    places: Mapping[str, Tensor],
    tolerances: Mapping[str, Any],
    limits: str,
    correlation: Mapping[tuple[str, str], float],
) -> Study:
    """First-order budget of anything whose slopes in some parameters are known.

    Args:
        numbers: parameters by name, n of them.
        frequency: Hz, (F,).
        liner, places: dZ/dp, complex, (n, ..., F): of the liner by averaging, and of other places by name.
        tolerances, limits, correlation, and what is returned: see ``Sensitivities.propagate``.
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
                f"tolerance of {name} is {tolerances[name]!r}, a half-width of {width:g}, more than its value, "
                f"{number.value:.6g}, which is never below {number.low:g}; write '2 %' where per cent are meant"
            )
        widths.append(width)
    half_widths = torch.tensor(widths, dtype=torch.float64)
    standard, matrix = factor * half_widths, _correlation_matrix(tuple(stated), correlation)

    def changes(slopes: Tensor) -> Tensor:
        return slopes[kept] * standard.reshape(-1, *(1,) * (slopes.ndim - 1))

    contributions = {name: changes(slopes) for name, slopes in liner.items()}
    covariance = {name: covariance_of(change, matrix) for name, change in contributions.items()}
    rows = []
    for averaging, change in contributions.items():
        for i, f in enumerate(frequency.tolist()):
            for j in change[:, i].abs().argsort(descending=True, stable=True).tolist():
                name, number = list(stated.items())[j]
                about = {"value": number.value, "unit": number.unit, "half_width": widths[j]}
                about |= {"standard": float(standard[j]), "impedance": complex(change[j, i])}
                rows.append(Row(averaging=averaging, frequency=f, parameter=name, **about))
    return Study(
        rows=rows,
        half_widths=half_widths,
        standard=standard,
        limits=limits,
        correlation=matrix,
        contributions=contributions,
        covariance=covariance,
        combined={name: standard_of(each) for name, each in covariance.items()},
        places={name: standard_of(covariance_of(changes(slopes), matrix)) for name, slopes in places.items()},
    )


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

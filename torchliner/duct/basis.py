"""Polynomials of one element, and the integrals across the duct that they need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from torchliner.duct.flow_profiles import Array, MeanFlow
from torchliner.duct.polynomials import derivative_matrix, gauss_points, interpolation_matrix

EXTRA_POINTS = 3  # of quadrature, over degree + 1: M(y) is no polynomial


@dataclass(frozen=True, eq=False)
class Basis:
    """n = degree + 1 Lagrange polynomials through the Gauss points of 0..1, float64.

    Args:
        nodes, weights: Gauss points and weights, (n,); the mass matrix is diag(weights).
        convection: integral of phi_i' phi_j, (n, n).  first, last: phi at 0 and at 1, (n,).
    """

    nodes: Tensor
    weights: Tensor
    convection: Tensor
    first: Tensor
    last: Tensor

    @classmethod
    def of_degree(cls, degree: int, device: torch.device | None = None) -> Basis:
        """Exact integrals: products of two polynomials are below the Gauss rule's degree."""
        nodes, weights = gauss_points(degree + 1)
        convection = (weights[:, None] * derivative_matrix(nodes)).T
        parts = (nodes, weights, convection, *interpolation_matrix(nodes, [0.0, 1.0]))
        return cls(*(torch.as_tensor(part, device=device) for part in parts))

    @property
    def count(self) -> int:
        """n."""
        return len(self.nodes)

    def values(self, places: ArrayLike) -> Tensor:
        """phi at places of 0..1, (P, n)."""
        return torch.as_tensor(interpolation_matrix(self.nodes.cpu().numpy(), places)).to(self.nodes)

    def quadrature(self) -> tuple[Array, Tensor, Tensor]:
        """Finer Gauss points, phi there (Q, n) and weights (Q,), for what is no polynomial."""
        places, weights = gauss_points(self.count + EXTRA_POINTS)
        return places, self.values(places), torch.as_tensor(weights).to(self.nodes)


@dataclass(frozen=True, eq=False)
class Rows:
    """The integrals across the duct, element by element; (E, n, n).

    Args:
        mass: of phi_i phi_j.  flow: of M phi_i phi_j.  shear: of dM/dy phi_i phi_j.
    """

    mass: Tensor
    flow: Tensor
    shear: Tensor

    @classmethod
    def of_flow(cls, basis: Basis, edges: ArrayLike, profile: MeanFlow) -> Rows:
        """Rows of elements between heights ``edges`` (m, (E + 1,))."""
        heights = np.asarray(edges, np.float64)
        sizes = torch.as_tensor(np.diff(heights)).to(basis.nodes)[:, None, None]
        places, values, weights = basis.quadrature()
        y = (heights[:-1, None] + np.diff(heights)[:, None] * places).clip(0, profile.duct_height)

        def weighted(function: Array) -> Tensor:
            at_points = torch.as_tensor(function).to(basis.nodes) * weights
            return sizes * torch.einsum("qi,eq,qj->eij", values, at_points, values)

        return cls(sizes * torch.diag(basis.weights), weighted(profile.mach(y)), weighted(profile.mach_slope(y)))

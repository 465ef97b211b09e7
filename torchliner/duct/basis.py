"""Polynomials of one element: Lagrange's through the Gauss points of 0 to 1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from torchliner.duct.flow_profiles import MeanFlow

EXTRA_POINTS = 3  # of quadrature, over degree + 1: M(y) is no polynomial


@dataclass(frozen=True, eq=False)
class Basis:
    """n = degree + 1 polynomials in one direction, on 0..1, float64.

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
        places, weights = np.polynomial.legendre.leggauss(degree + 1)
        nodes, weights = (1 + places) / 2, weights / 2
        slopes = _slopes(nodes)  # (point, polynomial)
        parts = (nodes, weights, (weights[:, None] * slopes).T)
        ends = _lagrange(nodes, np.array([0.0, 1.0]))
        return cls(*(torch.as_tensor(p, device=device) for p in (*parts, ends[0], ends[1])))

    @property
    def count(self) -> int:
        """n."""
        return len(self.nodes)

    def values(self, places: ArrayLike) -> Tensor:
        """phi at places of 0..1, (P, n)."""
        values = _lagrange(self.nodes.cpu().numpy(), np.asarray(places, np.float64))
        return torch.as_tensor(values, device=self.nodes.device)

    def quadrature(self) -> tuple[np.ndarray, Tensor, Tensor]:
        """Finer Gauss points, phi there (Q, n) and weights (Q,), for what is no polynomial."""
        places, weights = np.polynomial.legendre.leggauss(self.count + EXTRA_POINTS)
        places = (1 + places) / 2
        return places, self.values(places), torch.as_tensor(weights / 2).to(self.nodes)


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

        def weighted(function: np.ndarray) -> Tensor:
            at_points = torch.as_tensor(function).to(basis.nodes) * weights
            return sizes * torch.einsum("qi,eq,qj->eij", values, at_points, values)

        mass = sizes * torch.diag(basis.weights)
        return cls(mass, weighted(profile.mach(y)), weighted(profile.mach_slope(y)))


def _lagrange(nodes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Lagrange polynomials through ``nodes`` at ``places``, (P, n), as products."""
    apart = nodes[:, None] - nodes + np.eye(len(nodes))
    away = places[:, None] - nodes
    columns = [np.prod(np.delete(away, j, 1), 1) / np.prod(np.delete(apart[j], j)) for j in range(len(nodes))]
    return np.stack(columns, 1)


def _slopes(nodes: np.ndarray) -> np.ndarray:
    """Derivative of polynomial j at node i, (n, n)."""
    apart = nodes[:, None] - nodes + np.eye(len(nodes))
    weights = 1 / np.prod(apart, 1)
    slopes = weights / weights[:, None] / apart
    slopes -= np.diag(np.diag(slopes))
    return slopes - np.diag(slopes.sum(1))

r"""Least squares in which some unknowns are linear (Golub and Pereyra 1973).

The residual :math:`\Phi(\theta) c - p` is linear in the amplitudes c, which are solved for at every place theta. With Q
an orthonormal basis of the columns of Phi, what is left changes with theta by :math:`(1 - QQ^H)\,\Phi' c` to the order
that Kaufman (1975) keeps, which is analytic in theta where Phi is.
"""

from __future__ import annotations

import torch
from torch import Tensor

from torchliner.least_squares import System


def solve_linear(columns: Tensor, target: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The basis Q of columns (..., N, K), the best amplitudes (..., K) and what they leave of p, (..., N)."""
    basis, triangle = torch.linalg.qr(columns)
    inside = basis.mH @ target[..., None]
    amplitude = torch.linalg.solve_triangular(triangle, inside, upper=True)[..., 0]
    return basis, amplitude, target - (basis @ inside)[..., 0]


def project(columns: Tensor, slopes: Tensor, target: Tensor) -> System:
    """The problem at a place, with its amplitudes.

    Args:
        columns: Phi, (..., N, K).
        slopes: its derivative by each of U unknowns, (..., U, N, K).
        target: p, (..., N).
    """
    basis, amplitude, left = solve_linear(columns, target)
    change = (slopes @ amplitude[..., None, :, None])[..., 0].movedim(-2, -1)  # (..., N, U)
    return System(-left, change - basis @ (basis.mH @ change), amplitude)

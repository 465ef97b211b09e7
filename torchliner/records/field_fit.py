"""Impedance out: that of the duct model whose field fits wall pressures best."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from torchliner.conversions import spl_from_pressure_amplitude


@dataclass(frozen=True, eq=False)
class FieldFit:
    """Impedance of a liner by fitting the linearised Euler equations to microphones.

    Args:
        frequency: Hz, (F,).
        x: microphones, m, (N,).
        impedance: Z, normalised, (..., F).
        covariance: of (resistance, reactance) for the stated errors of the microphones, (..., F, 2,
            2): the Laplace approximation, inverse of the Hessian (Gauss-Newton's) with the
            amplitude fitted too.
        amplitude: peak of the incident wave where the case has its own, Pa, complex, (..., F).
        pressure: of the model at the microphones, Pa, (..., N, F).
        misfit: chi squared over its degrees of freedom, 2 N - 4, (..., F): 1 where the model is
            right and the errors are as stated.
        converged: whether the last step was below the tolerance, (..., F).
        draws: the same fit over draws of the errors, (D, ..., F); None without.
        choices: every option.  notes: doubts, with numbers.
    """

    frequency: Tensor
    x: Tensor
    impedance: Tensor
    covariance: Tensor
    amplitude: Tensor
    pressure: Tensor
    misfit: Tensor
    converged: Tensor
    draws: FieldFit | None = None
    choices: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def standard_error(self) -> Tensor:
        """Of resistance (real part) and reactance (imaginary part), (..., F)."""
        spread = self.covariance.diagonal(dim1=-2, dim2=-1).clamp(min=0).sqrt()
        return torch.complex(spread[..., 0], spread[..., 1])

    @property
    def level(self) -> Tensor:
        """SPL of the model at the microphones, dB re 20 uPa rms, (..., N, F)."""
        return spl_from_pressure_amplitude(self.pressure)

"""Impedance out: that of the duct model whose field fits wall pressures best."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.records.drawn_impedance import DrawnImpedance
from torchliner.records.microphone_line import MicrophoneLine
from torchliner.records.notes import Note


@dataclass(frozen=True, eq=False)
class FieldFit(DrawnImpedance):
    """Impedance of a liner by fitting the linearised Euler equations to microphones.

    Args:
        method: for tables and legends.
        frequency: Hz, (F,).
        x: microphones, m, (N,).
        impedance: Z, normalised, (..., F); its mean along the liner if it varies.
        covariance: of (resistance, reactance) for the errors of the microphones, as stated or as the misfit asks for
            (``error_scale``), (..., F, 2, 2): the Laplace approximation, inverse of Gauss-Newton's Hessian with the
            amplitudes fitted too; infinite where the microphones do not tell the liner from a rigid
            wall, and too small near that, where the error of 1/Z, |dZ|/|Z|^2, still holds.
        rise: Z at the liner's downstream edge less that at the upstream one, (..., F); 0 unless it
            was fitted.
        rise_error: standard error of its real and of its imaginary part, likewise.
        amplitude: peak of the source's wave where the case has its own, Pa, complex, (..., F).
        end_reflection: of the far end, stated or fitted, complex, (..., F): wall pressure of the
            plane-like mode that comes back over that of the one that goes out, both at that end.
        pressure: of the model at the microphones, Pa, (..., N, F).
        along: places from the first microphone to the last, m, (X,).
        pressure_along: of the model there, Pa, (..., X, F).
        residual: rms of what the model leaves over that of the pressures, (..., F).
        misfit: chi squared over its degrees of freedom, (..., F): 1 where the model is right and
            the errors are as stated.
        converged: whether the last step was below the tolerance, (..., F).
        source_side: ``upstream`` or ``downstream``.
        freedom: real degrees of freedom of the misfit.
        draws: the same fit over draws of the errors, (D, ..., F); None without.
        choices: every option.  notes: warnings, with numbers.
        line: microphones that were used; files and pages need them.
    """

    method: str
    frequency: Tensor
    x: Tensor
    impedance: Tensor
    covariance: Tensor
    rise: Tensor
    rise_error: Tensor
    amplitude: Tensor
    end_reflection: Tensor
    pressure: Tensor
    along: Tensor
    pressure_along: Tensor
    residual: Tensor
    misfit: Tensor
    converged: Tensor
    source_side: str
    draws: FieldFit | None = None
    choices: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[Note | str, ...] = ()
    line: MicrophoneLine | None = None
    freedom: int | None = None

    @property
    def estimated(self) -> Tensor:
        """Where the errors come from the misfit, not as they were stated, (..., F)."""
        return self.error_scale > 1

    @property
    def liner_impedance(self) -> Tensor:
        """1 over the mean of 1/Z along the liner, (..., F), as eq. (5.2) averages.

        Of Z = z (1 + r s), s from -1 to 1, this is z r/artanh r; ``impedance`` if Z is constant.
        """
        ratio = self.rise / (2 * self.impedance)
        small = ratio.abs() < 1e-4  # 1 - r^2/3 there, to rounding
        safe = torch.where(small, torch.ones_like(ratio) / 2, ratio)
        share = torch.where(small, 1 - ratio**2 / 3, safe / torch.atanh(safe))
        return self.impedance * share

    @property
    def level(self) -> Tensor:
        """SPL of the model at the microphones, dB re 20 uPa rms, (..., N, F)."""
        return spl_from_pressure_amplitude(self.pressure)

    def fitted_along(self) -> tuple[Tensor, Tensor]:
        """``along`` and the pressure of the model there, peak, Pa, (..., X, F)."""
        return self.along, self.pressure_along

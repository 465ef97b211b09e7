"""Impedance out: that of the duct model whose field fits wall pressures best."""

from __future__ import annotations

from dataclasses import KW_ONLY

import torch
from torch import Tensor

from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.records.declared import record, var
from torchliner.records.drawn_impedance import EACH, DrawnImpedance

MICROPHONES = ("draws", "microphone", "frequency")
PLACES = ("draws", "place", "frequency")


@record
class FieldFit(DrawnImpedance):
    """Impedance of a liner by fitting the linearised Euler equations to microphones.

    Of a Z that varies ``impedance`` is the mean along the liner. The covariance is the Laplace approximation: inverse
    of Gauss-Newton's Hessian with the amplitudes fitted too, for errors as stated or as the misfit asks for
    (``error_scale``). It is infinite where the microphones do not tell the liner from a rigid wall, and too small near
    that, where the error of 1/Z, abs(dZ)/abs(Z)^2, still holds.
    """

    _: KW_ONLY
    rise: Tensor = var(
        *EACH, name="rise_of_{}", text="at the liner's downstream edge less that upstream, 0 unless it was fitted"
    )
    rise_error: Tensor = var(*EACH, name="rise_of_{}_error", wide=True, text="standard error of the rise")
    amplitude: Tensor = var(
        *EACH, unit="Pa", kind="complex", text="peak amplitude of the source's wave where the case has its own"
    )
    end_reflection: Tensor = var(
        *EACH, kind="complex", text="reflection of the far end, stated or fitted, of the plane-like modes"
    )
    pressure: Tensor = var(
        *MICROPHONES, unit="Pa", kind="complex", name="fitted_pressure", text="peak of the fitted pressure"
    )
    along: Tensor = var("place", unit="m", text="places from the first microphone to the last")
    pressure_along: Tensor = var(
        *PLACES, unit="Pa", kind="complex", name="fitted_pressure_along", text="peak of the fitted pressure there"
    )
    misfit: Tensor = var(*EACH, text="chi squared over its degrees of freedom, 1 where all is right")
    converged: Tensor = var(*EACH, kind="flag", text="whether the last step was below the tolerance")

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

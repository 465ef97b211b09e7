"""Impedance out: that of the duct model whose field fits wall pressures best."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import ClassVar

from torch import Tensor

from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.records.declared import record, var
from torchliner.records.drawn_impedance import EACH, DrawnImpedance

MICROPHONES = ("draws", "microphone", "frequency")
PLACES = ("draws", "place", "frequency")


@record
class FieldFit(DrawnImpedance):
    """Impedance of a liner by fitting the linearised Euler equations to microphones.

    The covariance is the Laplace approximation: inverse
    of Gauss-Newton's Hessian with the amplitudes fitted too, for errors as stated or as the misfit asks for
    (``error_scale``). It is infinite where the microphones do not tell the liner from a rigid wall, and too small near
    that, where the error of 1/Z, abs(dZ)/abs(Z)^2, still holds.
    """

    _: KW_ONLY
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

    SCHEMA: ClassVar = "torchliner field fit 1"

    @property
    def estimated(self) -> Tensor:
        """Where the errors come from the misfit, not as they were stated, (..., F)."""
        return self.error_scale > 1

    @property
    def level(self) -> Tensor:
        """SPL of the model at the microphones, dB re 20 uPa rms, (..., N, F)."""
        return spl_from_pressure_amplitude(self.pressure)

    def fitted_along(self) -> tuple[Tensor, Tensor]:
        """``along`` and the pressure of the model there, peak, Pa, (..., X, F)."""
        return self.along, self.pressure_along

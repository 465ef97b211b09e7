"""Impedance out: from pressures along a wall, with the wavenumbers behind it."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import ClassVar

import torch
from torch import Tensor

from torchliner.records.declared import Variable, record, require_shapes, var
from torchliner.records.drawn_impedance import EACH, DrawnImpedance, fine_places

WAVES = ("draws", "wave", "frequency")
MICROPHONES = ("draws", "microphone", "frequency")
PLACES = ("draws", "place", "frequency")
SINGULAR = ("draws", "singular_value", "frequency")


@record
class WallEduction(DrawnImpedance):
    r"""Wavenumbers alpha above a liner, of :math:`e^{-j\alpha x}`, and the impedance that each stands for.

    The covariance is to first order, for errors as large as what the waves leave; None without a degree of freedom, or
    for lines with leading axes.
    """

    _: KW_ONLY
    wavenumber: Tensor = var(
        *EACH, unit="1/m", kind="complex", text="wavenumber alpha of the wave that runs with the source"
    )
    modes: Tensor = var(*WAVES, unit="1/m", kind="complex", name="mode_wavenumber", text="wavenumber of each wave")
    amplitudes: Tensor = var(
        *WAVES, unit="Pa", kind="complex", name="mode_amplitude", text="peak amplitude of each wave at the origin"
    )
    origin: float = var(unit="m", text="x of the microphone nearest the source")
    singular_values: Tensor | None = var(
        *SINGULAR, unit="Pa", default=None, text="singular values of the prediction matrix; None for fits"
    )
    rank: int | None = var(text="waves that were kept; None for fits", default=None)
    order: int | None = var(text="order of the prediction; None for fits", default=None)

    SCHEMA: ClassVar = "torchliner waves 1"
    DERIVED: ClassVar = (
        *DrawnImpedance.DERIVED,
        Variable("energy_share", dims=EACH, text="energy of the wave of the impedance over that of the strongest"),
    )

    def __post_init__(self) -> None:
        require_shapes(self, self.method)
        if self.singular_values is not None and self.singular_values.shape[-2] != self.order:
            raise ValueError(
                f"{self.method}: order is {self.order} of {self.singular_values.shape[-2]} singular values"
            )

    def pressure_at(self, x: Tensor) -> Tensor:
        """Sum of all waves, peak, Pa, (..., X, F), at places x, m, (X,)."""
        distance = (x - self.origin)[:, None]
        turns = torch.exp(-1j * self.modes[..., None, :] * distance)
        return (self.amplitudes[..., None, :] * turns).sum(-3)

    def fitted_along(self) -> tuple[Tensor, Tensor]:
        """Places from the first microphone to the last, m, (X,), and the sum of all waves there,
        peak, Pa, (..., X, F)."""
        places = fine_places(self.x)
        return places, self.pressure_at(places)

    @property
    def energies(self) -> Tensor:
        """Energy of each wave over the microphones, over that of the strongest, (..., K, F)."""
        along = (self.x - self.origin).to(self.modes.device)
        power = self.amplitudes.abs().log()[..., None] + self.modes.imag[..., None] * along
        total = (2 * power).logsumexp(-1)
        return (total - total.amax(-2, keepdim=True)).exp()

    @property
    def energy_share(self) -> Tensor:
        """``energies`` of the wave whose impedance is given, (..., F); nan where there is none."""
        mine = (self.modes - self.wavenumber[..., None, :]).abs().argmin(-2, keepdim=True)
        share = self.energies.gather(-2, mine)[..., 0, :]
        return torch.where(torch.isnan(self.wavenumber), torch.nan, share)


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

    def fitted_along(self) -> tuple[Tensor, Tensor]:
        """``along`` and the pressure of the model there, peak, Pa, (..., X, F)."""
        return self.along, self.pressure_along

"""Impedance out: from pressures along a wall, with the wavenumbers behind it."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import ClassVar

import torch
from torch import Tensor

from torchliner.records.declared import Variable, record, require_shapes, var
from torchliner.records.drawn_impedance import EACH, DrawnImpedance, deviation, fine_places

WAVES = ("draws", "wave", "frequency")
SINGULAR = ("draws", "singular_value", "frequency")


@record
class WallEduction(DrawnImpedance):
    r"""Wavenumbers alpha above a liner, of :math:`e^{-j\alpha x}`, and the impedance that each stands for.

    The covariance is to first order, for errors as large as what the waves leave; None without a degree of freedom, or
    for lines with leading axes.

    Raises:
        TypeError: wavenumber or impedance is not complex.
        ValueError: shapes disagree.
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

    @property
    def wavenumber_deviation(self) -> Tensor:
        """Standard deviation of Re alpha (real part) and Im alpha (imaginary part), (..., F)."""
        self._drawn()
        assert isinstance(self.draws, WallEduction)
        return deviation(self.draws.wavenumber)

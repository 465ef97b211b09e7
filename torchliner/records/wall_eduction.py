"""Impedance out: from pressures along a wall, with the wavenumbers behind it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_complex
from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.records.drawn_impedance import DrawnImpedance, deviation, fine_places
from torchliner.records.microphone_line import MicrophoneLine
from torchliner.records.notes import Note


@dataclass(frozen=True, eq=False)
class WallEduction(DrawnImpedance):
    r"""Wavenumbers above a liner and the impedance that each stands for.

    Args:
        method: for tables and legends.
        frequency: Hz, (F,).
        x: microphones that were used, m, (N,).
        wavenumber: alpha of the wave that runs with the source, of :math:`e^{-j\alpha x}`, 1/m,
            (..., F); nan where none was found.
        impedance: Z by the dispersion relation, normalised, (..., F).
        modes: alpha of all waves, (..., K, F).
        amplitudes: theirs at ``origin``, peak, Pa, complex, (..., K, F).
        origin: x of the microphone nearest the source, m.
        residual: rms of what the waves leave over that of the pressures, (..., F).
        source_side: ``upstream`` or ``downstream``.
        singular_values: of the prediction matrix, Pa, (..., L, F); None for fits.
        rank, order: K and L; None for fits.
        misfit: squared residual over that which the assumed errors of the microphones leave, (..., F): 1 where waves
            and errors are right; None or nan where it is not known.
        draws: the same eduction over draws of the microphones' errors, (D, ..., F) and so on.
        choices: every option; ``level_error`` and ``phase_error`` are those assumed.
        notes: warnings, with numbers.
        line: microphones that were used; files and pages need them.
        covariance: of (resistance, reactance), (F, 2, 2), for errors of the microphones as large
            as what the waves leave, to first order; None without a degree of freedom, or for lines
            with leading axes.
        freedom: real degrees of freedom behind it.
    Raises:
        TypeError: wavenumber or impedance is not complex.
        ValueError: shapes disagree.
    """

    method: str
    frequency: Tensor
    x: Tensor
    wavenumber: Tensor
    impedance: Tensor
    modes: Tensor
    amplitudes: Tensor
    origin: float
    residual: Tensor
    source_side: str
    singular_values: Tensor | None = None
    rank: int | None = None
    order: int | None = None
    misfit: Tensor | None = None
    draws: WallEduction | None = None
    choices: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[Note | str, ...] = ()
    line: MicrophoneLine | None = None
    covariance: Tensor | None = None
    freedom: int | None = None

    def __post_init__(self) -> None:
        shape = self.wavenumber.shape
        for label in ("wavenumber", "impedance", "modes", "amplitudes"):
            require_complex(f"{self.method}: {label}", getattr(self, label))
        if shape[-1:] != self.frequency.shape:
            raise ValueError(
                f"{self.method}: wavenumber has shape {tuple(shape)} for {len(self.frequency)} frequencies"
            )
        for label, wanted in (("impedance", shape), ("residual", shape), ("amplitudes", self.modes.shape)):
            if getattr(self, label).shape != wanted:
                raise ValueError(
                    f"{self.method}: {label} has shape {tuple(getattr(self, label).shape)}; {tuple(wanted)} is needed"
                )

    def pressure_at(self, x: Tensor) -> Tensor:
        """Sum of all waves, peak, Pa, (..., X, F), at places x, m, (X,)."""
        distance = (x - self.origin)[:, None]
        turns = torch.exp(-1j * self.modes[..., None, :] * distance)
        return (self.amplitudes[..., None, :] * turns).sum(-3)

    def level_at(self, x: Tensor) -> Tensor:
        """SPL of all waves, dB, (..., X, F)."""
        return spl_from_pressure_amplitude(self.pressure_at(x))

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
        assert self.draws is not None
        return deviation(self.draws.wavenumber)

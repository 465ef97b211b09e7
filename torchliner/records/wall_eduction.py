"""Impedance out: from microphones along a duct, by waves or by a fit of the field, and what draws of the measurement
error say of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from scipy.special import ndtri, stdtrit
from torch import Tensor

from torchliner.checks import require_complex
from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.records.microphone_line import MicrophoneLine
from torchliner.records.notes import Note
from torchliner.records.outlets import Written, outlet

FINE = 201  # places of a level along the microphones


@dataclass(frozen=True, eq=False, kw_only=True)
class DrawnImpedance(Written):
    """What all eductions from microphones share, with statistics over ``draws``.

    Args:
        method: for tables and legends.
        frequency: Hz, (F,).
        x: microphones that were used, m, (N,).
        impedance: Z, normalised, (..., F).
        residual: rms of what waves or model leave over that of the pressures, (..., F).
        source_side: ``upstream`` or ``downstream``.
        misfit: squared residual over that which the assumed errors of the microphones leave, (..., F): 1 where the
            model and the errors are right; None or nan where it is not known.
        covariance: of (resistance, reactance), (..., F, 2, 2), to first order; None if unknown.
        freedom: real degrees of freedom of the residuals that it may be estimated from.
        draws: the same eduction over draws of the microphones' errors, (D, ..., F) and so on; None without.
        choices: every option; ``level_error`` and ``phase_error`` are the errors that were assumed.
        notes: warnings, with numbers.
        line: microphones that were used; None where the method does not keep them, which files and pages need.
    """

    method: str
    frequency: Tensor
    x: Tensor
    impedance: Tensor
    residual: Tensor
    source_side: str
    misfit: Tensor | None = None
    covariance: Tensor | None = None
    freedom: int | None = None
    draws: Any = None
    choices: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[Note | str, ...] = ()
    line: MicrophoneLine | None = None

    @property
    def source_line(self) -> MicrophoneLine:
        """``line``, of one case, for files and pages.

        Raises:
            ValueError: none was kept; it has leading axes, as lines of draws do.
        """
        if self.line is None:
            raise ValueError(
                f"{self.method}: the line of microphones was not kept; a file or a page of an eduction needs it"
            )
        if self.impedance.ndim != 1:
            raise ValueError(
                f"{self.line.name} holds {tuple(self.impedance.shape[:-1])} lines; a file or a "
                "page of an eduction has one"
            )
        return self.line

    def write(self, path: str | Path, *others: DrawnImpedance) -> None:
        """Write one netCDF-4 file (.h5, .hdf5, .nc) that ``read_wall`` and a report take.

        Args:
            path: of the file; one that is there is replaced when the new one is whole.
            others: eductions that go along, as of the source on the other side, in this order.
        Raises:
            ValueError: another ending; an eduction without its line, or of several lines.
        """
        outlet(type(self), "write")(self, path, *others)

    def report(self, path: str | Path, *others: DrawnImpedance) -> None:
        """Write one self-contained HTML page: answer, warnings, figures, provenance.

        Args:
            path: of the page, .html; one that is there is replaced.
            others: eductions beside it, which are compared with it.
        Raises:
            ImportError: jinja2 or matplotlib is not installed (extra ``report``).
            ValueError: another ending; an eduction without its line, or of several lines.
        """
        outlet(type(self), "report")(self, path, *others)

    def fitted_along(self) -> tuple[Tensor, Tensor]:
        """Places along the microphones, m, (X,), and the fitted pressure, peak, Pa, (..., X, F)."""
        raise NotImplementedError

    def level_along(self) -> tuple[Tensor, Tensor]:
        """Places along the microphones, m, (X,), and the fitted SPL, dB, (..., X, F)."""
        places, pressure = self.fitted_along()
        return places, spl_from_pressure_amplitude(pressure)

    @property
    def error_scale(self) -> Tensor:
        """Of the errors used over those assumed, (..., F): the root of the misfit where that is above
        ``choices["largest_misfit"]``, else 1."""
        if self.misfit is None:
            return torch.ones_like(self.impedance.real)
        return torch.where(self.misfit > self.choices.get("largest_misfit", 1.0), self.misfit, 1.0).sqrt()

    @property
    def used_errors(self) -> tuple[Tensor, Tensor]:
        """Standard deviations in level, dB, and in phase, degrees, that the draws have, (..., F)."""
        level, phase = (self.choices.get(name, torch.nan) for name in ("level_error", "phase_error"))
        return level * self.error_scale, phase * self.error_scale

    @property
    def estimated(self) -> Tensor:
        """Where ``covariance`` comes from residuals, not from errors that were stated, (..., F)."""
        return torch.ones_like(self.impedance.real, dtype=torch.bool)

    @property
    def mean(self) -> Tensor:
        """Mean impedance of the draws that have one, (..., F)."""
        return _mean(self._drawn())

    @property
    def standard_deviation(self) -> Tensor:
        """Of the drawn resistances (real part) and reactances (imaginary part), (..., F)."""
        return deviation(self._drawn())

    @property
    def failed(self) -> Tensor:
        """How many draws have no impedance, (..., F)."""
        return (~torch.isfinite(self._drawn())).sum(0)

    @property
    def standard_error(self) -> Tensor:
        """Of resistance (real part) and reactance (imaginary part), (..., F); without draws.

        Raises:
            ValueError: no covariance is known.
        """
        if self.covariance is None:
            raise ValueError(f"{self.method}: no covariance is known; educe with draws=500")
        return torch.complex(*self.covariance.diagonal(dim1=-2, dim2=-1).clamp(min=0).sqrt().unbind(-1))

    def interval(self, level: float = 0.95) -> tuple[Tensor, Tensor]:
        """Bounds of a statistical interval: real parts bound R, imaginary parts X.

        The middle ``level`` of the draws; without draws Student's interval, or the normal one of
        stated errors, to first order.
        """
        if not 0 < level < 1:
            raise ValueError(f"level is {level:g}; it must be between 0 and 1 (95 % is 0.95)")
        share = (1 + level) / 2
        if self.draws is None:
            student = float(ndtri(share) if self.freedom is None else stdtrit(self.freedom, share))
            away = torch.where(self.estimated, student, float(ndtri(share))) * self.standard_error
            return self.impedance - away, self.impedance + away
        parts = torch.view_as_real(self._drawn())
        finite = torch.where(torch.isfinite(parts), parts, torch.nan)
        low, high = (torch.view_as_complex(torch.nanquantile(finite, each, dim=0)) for each in (1 - share, share))
        return low, high

    def _drawn(self) -> Tensor:
        if self.draws is None:
            raise ValueError(f"{self.method}: no draws were made; educe with draws=500")
        found: Tensor = self.draws.impedance
        return found


@dataclass(frozen=True, eq=False, kw_only=True)
class WallEduction(DrawnImpedance):
    r"""Wavenumbers above a liner and the impedance that each stands for, by the dispersion relation.

    Args:
        wavenumber: alpha of the wave that runs with the source, of :math:`e^{-j\alpha x}`, 1/m,
            (..., F); nan where none was found.
        modes: alpha of all waves, (..., K, F).
        amplitudes: theirs at ``origin``, peak, Pa, complex, (..., K, F).
        origin: x of the microphone nearest the source, m.
        singular_values: of the prediction matrix, Pa, (..., L, F); None for fits.
        rank, order: K and L; None for fits.
        covariance: for errors of the microphones as large as what the waves leave; None without a degree of freedom, or
            for lines with leading axes.
        and those of ``DrawnImpedance``.
    Raises:
        TypeError: wavenumber or impedance is not complex.
        ValueError: shapes disagree.
    """

    wavenumber: Tensor
    modes: Tensor
    amplitudes: Tensor
    origin: float
    singular_values: Tensor | None = None
    rank: int | None = None
    order: int | None = None

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
        """See ``DrawnImpedance``."""
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
        return deviation(self.draws.wavenumber)


@dataclass(frozen=True, eq=False, kw_only=True)
class FieldFit(DrawnImpedance):
    """Impedance of a liner by fitting the linearised Euler equations to microphones; its mean along the liner if it
    varies.

    Args:
        covariance: for the errors of the microphones, as stated or as the misfit asks for (``error_scale``): the
            Laplace approximation, inverse of Gauss-Newton's Hessian with the amplitudes fitted too; infinite where the
            microphones do not tell the liner from a rigid wall, and too small near that, where the error of 1/Z,
            |dZ|/|Z|^2, still holds.
        rise: Z at the liner's downstream edge less that at the upstream one, (..., F); 0 unless it
            was fitted.
        rise_error: standard error of its real and of its imaginary part, likewise.
        amplitude: peak of the source's wave where the case has its own, Pa, complex, (..., F).
        end_reflection: of the far end, stated or fitted, complex, (..., F): wall pressure of the
            plane-like mode that comes back over that of the one that goes out, both at that end.
        pressure: of the model at the microphones, Pa, (..., N, F).
        along: places from the first microphone to the last, m, (X,).
        pressure_along: of the model there, Pa, (..., X, F).
        converged: whether the last step was below the tolerance, (..., F).
        and those of ``DrawnImpedance``.
    """

    covariance: Tensor
    misfit: Tensor
    rise: Tensor
    rise_error: Tensor
    amplitude: Tensor
    end_reflection: Tensor
    pressure: Tensor
    along: Tensor
    pressure_along: Tensor
    converged: Tensor

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

    def fitted_along(self) -> tuple[Tensor, Tensor]:
        """See ``DrawnImpedance``."""
        return self.along, self.pressure_along


def _mean(values: Tensor) -> Tensor:
    good = torch.isfinite(values)
    return torch.where(good, values, 0).sum(0) / good.sum(0)


def deviation(values: Tensor) -> Tensor:
    """Standard deviation over the first axis, real and imaginary parts each by itself; what is not
    finite is left out, and of fewer than two there is none (nan)."""
    good = torch.isfinite(values)
    off = torch.view_as_real(torch.where(good, values - _mean(values), 0))
    count = torch.where(good.sum(0) > 1, good.sum(0) - 1, torch.nan)
    return torch.view_as_complex((off.square().sum(0) / count[..., None]).sqrt())


def fine_places(x: Tensor) -> Tensor:
    """Places from the first microphone to the last, m, (FINE,)."""
    return torch.linspace(float(x[0]), float(x[-1]), FINE, dtype=torch.float64)

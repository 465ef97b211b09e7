"""Impedance out: from pressures along a wall, with the waves behind it, and what draws of the errors say of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, field
from pathlib import Path
from typing import Any, ClassVar

import torch
from scipy.special import ndtri, stdtrit
from torch import Tensor

from torchliner.names import resolve
from torchliner.records.checked import require_shapes
from torchliner.records.declared import Variable, flat, part, record, var
from torchliner.records.microphone_line import DRAWN, MicrophoneLine
from torchliner.records.notes import Note
from torchliner.records.outlets import Reported, Written

FINE = 201  # places of a level along the microphones
LEVEL = 0.95  # of the interval in the file
INTERVAL = f"{100 * LEVEL:g} % statistical interval"
EACH, WAVES, ALONG = ("draws", "frequency"), ("draws", "wave", "frequency"), ("draws", "place", "frequency")


@record
class DrawnImpedance(Written, Reported):
    """Statistics over ``draws``, which all eductions from microphones share; nan where nothing was found or is known.

    Args:
        method: for tables and legends.
        source_side: ``upstream`` or ``downstream``.
        draws: the same eduction over draws of the microphones' errors, (D, ..., F); None without.
        choices: every option; ``level_error`` and ``phase_error`` are the errors that were assumed.
        notes: warnings, with numbers.
        line: microphones that were used; None where the method does not keep them, which files and pages need.
    """

    _: KW_ONLY
    method: str
    frequency: Tensor = var("frequency", unit="Hz", text="frequency of the tone")
    x: Tensor = var("microphone", unit="m", text="microphones that were used")
    impedance: Tensor = var(*EACH, name="{}", text="v into the liner")
    residual: Tensor = var(*EACH, text="rms of what is left over that of the pressures")
    source_side: str
    draws: DrawnImpedance | None = part("draws", by="groups", default=None)
    choices: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[Note | str, ...] = ()
    line: MicrophoneLine | None = part("microphones", by="groups", default=None)
    covariance: Tensor | None = var(
        *EACH, "part", "with_part", wide=True, default=None, text="covariance of resistance and reactance"
    )
    freedom: int | None = var(text="real degrees of freedom of the residuals", default=None)
    misfit: Tensor | None = var(*EACH, default=None, text="squared residual over that of the assumed errors")

    DERIVED: ClassVar[tuple[Variable, ...]] = (
        Variable("low", dims=EACH, name="{}_low", text=f"lower bound, {INTERVAL}"),
        Variable("high", dims=EACH, name="{}_high", text=f"upper bound, {INTERVAL}"),
        Variable("deviation", dims=EACH, name="{}_deviation", text="standard deviation"),
    )
    GROUPS: ClassVar = ("torchliner wall 1", "eduction")  # schema of a file of several, name of each

    def __post_init__(self) -> None:
        require_shapes(flat(self, derived=False), self.method)

    @property
    def axes(self) -> dict[str, tuple[str, ...]]:
        """Dimensions of its file."""
        return {"draws": ("draw",) * (self.impedance.ndim - 1)}

    @property
    def source_line(self) -> MicrophoneLine:
        """``line``, of one case, for files and pages; a ValueError where none was kept, or several, as of draws."""
        if self.line is None or self.impedance.ndim != 1:
            raise ValueError(f"{self.method}: a file or a page needs one line of microphones, not none or several")
        return self.line

    def write(self, path: str | Path, *others: DrawnImpedance) -> None:
        """Write one netCDF-4 file (.h5, .hdf5, .nc) that ``read_wall`` and a report take, ``others`` behind it; errors
        as of ``Written.write`` and ``source_line``."""
        _ = [one.source_line for one in (self, *others)]
        resolve("torchliner.io.own_writer:write_several")((self, *others), path)

    def report(self, path: str | Path, *others: DrawnImpedance) -> None:
        """Write one self-contained HTML page, ``others`` beside it; as ``Reported.report``."""
        resolve(self.PAGE)(self, path, *others)

    def _answer(self) -> Any:
        return (self.impedance, None, None) if self.impedance.ndim == 1 else None

    def fitted_along(self) -> tuple[Tensor, Tensor]:
        """Places along the microphones, m, (X,), and the fitted pressure, peak, Pa, (..., X, F)."""
        raise NotImplementedError

    @property
    def error_scale(self) -> Tensor:
        """Of the errors used over those assumed, (..., F): the root of the misfit where that is above
        ``choices["largest_misfit"]``, else 1."""
        if self.misfit is None:
            return torch.ones_like(self.impedance.real)
        return torch.where(self.misfit > self.choices.get("largest_misfit", 1.0), self.misfit, 1.0).sqrt()

    @property
    def estimated(self) -> Tensor:
        """Where ``covariance`` comes from residuals, not from errors that were stated, (..., F)."""
        return torch.ones_like(self.impedance.real, dtype=torch.bool)

    @property
    def drawn(self) -> Tensor:
        """Impedances of the draws, (D, ..., F), nan where there is none; a ValueError without draws."""
        if self.draws is None:
            raise ValueError(f"{self.method}: no draws were made; educe with draws=500")
        found = self.draws.impedance
        return torch.where(torch.isfinite(found), found, complex(torch.nan, torch.nan))

    @property
    def failed(self) -> Tensor:
        """How many draws have no impedance, (..., F)."""
        return torch.isnan(self.drawn.real).sum(0)

    @property
    def deviation(self) -> Tensor | None:
        """Standard deviation of resistance (real part) and reactance (imaginary part), (..., F): over the draws, nan of
        fewer than two; to first order without draws; None where no covariance is known."""
        if self.draws is not None:
            return deviation(self.drawn)
        if self.covariance is None:
            return None
        return torch.view_as_complex(self.covariance.diagonal(dim1=-2, dim2=-1).clamp(min=0).sqrt().contiguous())

    def interval(self) -> tuple[Tensor, Tensor]:
        """Bounds of the statistical interval of ``LEVEL``: real parts bound R, imaginary parts X. The middle of the
        draws; without draws, to first order, Student's, or the normal one of stated errors. A ValueError without a
        covariance."""
        share = (1 + LEVEL) / 2
        if self.draws is None:
            if self.deviation is None:
                raise ValueError(f"{self.method}: no covariance is known; educe with draws=500")
            student = float(ndtri(share) if self.freedom is None else stdtrit(self.freedom, share))
            away = torch.where(self.estimated, student, float(ndtri(share))) * self.deviation
            return self.impedance - away, self.impedance + away
        parts = (self.drawn.real, self.drawn.imag)
        low, high = (torch.complex(*(part.nanquantile(end, 0) for part in parts)) for end in (1 - share, share))
        return low, high

    @property
    def low(self) -> Tensor | None:
        """Lower bound of the interval of one line, (F,), for its file; None where none is known."""
        return None if self.impedance.ndim > 1 or self.deviation is None else self.interval()[0]

    @property
    def high(self) -> Tensor | None:
        """Upper bound, likewise."""
        return None if self.impedance.ndim > 1 or self.deviation is None else self.interval()[1]


def deviation(values: Tensor) -> Tensor:
    """Standard deviation over the first axis, real and imaginary parts each by itself; what is not finite is left out,
    and of fewer than two there is none (nan)."""
    good = torch.isfinite(values)
    off = torch.where(good, values - torch.where(good, values, 0).sum(0) / good.sum(0), 0)
    count = torch.where(good.sum(0) > 1, good.sum(0) - 1, torch.nan)
    return torch.complex(*((part.square().sum(0) / count).sqrt() for part in (off.real, off.imag)))


def fine_places(x: Tensor) -> Tensor:
    """Places from the first microphone to the last, m, (FINE,)."""
    return torch.linspace(float(x[0]), float(x[-1]), FINE, dtype=torch.float64)


@record
class WallEduction(DrawnImpedance):
    r"""Wavenumbers alpha above a liner, of :math:`e^{-j\alpha x}`, and the impedance that each stands for.

    The covariance is to first order, for errors as large as what the waves leave; None without a degree of freedom, or
    for lines with leading axes.
    """

    _: KW_ONLY
    wavenumber: Tensor = var(*EACH, unit="1/m", kind="complex", text="alpha of the wave that is educed")
    modes: Tensor = var(*WAVES, unit="1/m", kind="complex", name="mode_wavenumber", text="wavenumber of each wave")
    amplitudes: Tensor = var(*WAVES, unit="Pa", kind="complex", name="mode_amplitude", text="peak at the origin")
    origin: float = var(unit="m", text="x of the microphone nearest the source")
    singular_values: Tensor | None = var(
        "draws", "singular_value", "frequency", unit="Pa", default=None, text="of the prediction matrix; None for fits"
    )

    SCHEMA: ClassVar = "torchliner waves 1"
    DERIVED: ClassVar = (
        *DrawnImpedance.DERIVED,
        Variable("energy_share", dims=EACH, text="energy of the wave of the impedance over that of the strongest"),
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
    def energy_share(self) -> Tensor:
        """Energy over the microphones of the wave whose impedance is given, over that of the strongest wave, (..., F);
        nan where there is none."""
        along = (self.x - self.origin).to(self.modes.device)
        power = self.amplitudes.abs().log()[..., None] + self.modes.imag[..., None] * along
        total = (2 * power).logsumexp(-1)
        mine = (self.modes - self.wavenumber[..., None, :]).abs().argmin(-2, keepdim=True)
        share = (total - total.amax(-2, keepdim=True)).exp().gather(-2, mine)[..., 0, :]
        return torch.where(torch.isnan(self.wavenumber), torch.nan, share)


@record
class FieldFit(DrawnImpedance):
    """Impedance of a liner by fitting the linearised Euler equations to microphones.

    The covariance is the Laplace approximation: inverse of Gauss-Newton's Hessian with the amplitudes fitted too, for
    errors as stated or as the misfit asks for (``error_scale``). It is infinite where the microphones do not tell the
    liner from a rigid wall, and too small near that, where the error of 1/Z, abs(dZ)/abs(Z)^2, still holds.
    """

    _: KW_ONLY
    amplitude: Tensor = var(*EACH, unit="Pa", kind="complex", text="peak of the source's wave, if it has one")
    end_reflection: Tensor = var(*EACH, kind="complex", text="reflection of the far end, stated or fitted")
    pressure: Tensor = var(*DRAWN, unit="Pa", kind="complex", name="fitted_pressure", text="peak of the fit")
    along: Tensor = var("place", unit="m", text="places from the first microphone to the last")
    pressure_along: Tensor = var(
        *ALONG, unit="Pa", kind="complex", name="fitted_pressure_along", text="peak of the fit there"
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

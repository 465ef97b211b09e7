"""Pressure in: complex amplitudes at microphones along a duct."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, replace
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, index_of_frequency, plain_array, plain_number, real_tensor, tell
from torchliner.conversions import pressure_amplitude_from_spl, spl_from_pressure_amplitude
from torchliner.records.case import LOUDEST, Case, finite_places
from torchliner.records.declared import ANY, check, record, var
from torchliner.records.notes import unit_warnings
from torchliner.records.outlets import Reported, Written
from torchliner.units import require_plausible

EQUAL_SPACING = 5e-3  # of the mean spacing
QUIETEST = 1.0  # dB, that a microphone measures
DRAWN = ("draws", "microphone", "frequency")
ONE_ATMOSPHERE = "(0, 1.5e5]"  # Pa, of an amplitude: 194 dB; what is no pressure in Pa overflows in sums of squares


@record
class MicrophoneLine(Written, Reported, Case):
    r"""Complex PEAK amplitudes p of tones :math:`Re(p e^{j\omega t})` along a straight duct with a lined wall.

    N microphones, F frequencies; leading axes of the pressure are cases of one line, as draws. A Mach number that is
    not stated is taken for 0 by no method. Where the sound comes from is ``unknown`` until it is needed.

    Args:
        notes: warnings, with numbers.
    Raises:
        TypeError: the pressure is not complex, as levels in dB are not.
        ValueError: fewer than two microphones, places that do not increase, a shape or a value that no line has.
    """

    x: Any = var("microphone", unit="m", text="places along the flow, increasing")
    pressure: Any = var(
        *DRAWN,
        unit="Pa",
        kind="complex",
        range=ONE_ATMOSPHERE,
        text="peak amplitude",
        amplitude="peak, exp(+j omega t)",
    )
    frequency: Any = var("frequency", unit="Hz", text="frequency of the tone")
    _: KW_ONLY
    duct_height: float = var(unit="m", range="(0, inf)", text="from the liner to the opposite wall")
    duct_width: float | None = var(unit="m", range="(0, inf)", text="across, for spanwise modes", default=None)
    liner_start: float | None = var(unit="m", range=ANY, text="x of the liner's end upstream", default=None)
    liner_end: float | None = var(unit="m", range=ANY, text="x of the liner's end downstream", default=None)
    wall_impedance: Any = var("frequency", name="wall_{}", default=None, text="of the liner, nan where unknown")
    coherence: Any = var("microphone", "frequency", text="squared, with the reference channel", default=None)
    notes: tuple[str, ...] = ()
    name: str = "microphones"

    SCHEMA: ClassVar = "torchliner microphones 1"

    def __post_init__(self) -> None:
        frequency, x, p = frequency_tensor(self.frequency), finite_places(self.x, "x", self.name), self.pressure
        p = p if isinstance(p, Tensor) else torch.as_tensor(plain_array(p, f"{self.name}: pressure"))
        if not p.is_complex():
            raise TypeError(
                f"{self.name}: pressure is {p.dtype}; complex amplitudes in Pa are needed. For SPL in dB and phases in "
                "degrees use MicrophoneLine.from_levels"
            )
        single = len(frequency) == 1 and p.shape[-1:] == x.shape
        wall, coherence = self.wall_impedance, self.coherence
        found = {
            "frequency": frequency,
            "x": x,
            "pressure": p[..., None] if single else p,
            "wall_impedance": None if wall is None else torch.as_tensor(wall, dtype=torch.complex128),
            "coherence": None if coherence is None else real_tensor(coherence),
        }
        for label, value in found.items():
            object.__setattr__(self, label, value)
        back = (x.diff() <= 0).nonzero()
        if len(x) < 2 or len(back):
            where = f", but {1e3 * float(x[back[0]]):g} mm is not below the next" if len(back) else ""
            raise ValueError(f"{self.name}: x has {len(x)} microphones{where}; two or more, sorted by x, make a line")
        check(self, tensors=True)
        start, end = self.liner_start, self.liner_end
        if (start is None) != (end is None) or (start is not None and end is not None and start >= end):
            raise ValueError(f"{self.name}: liner_start is {start} m and liner_end {end} m; give both, start < end")

    @classmethod
    def from_levels(cls, x: Any, level: Any, phase: Any, frequency: Any, **about: Any) -> MicrophoneLine:
        """A line from levels and phases, as measurements are tabulated.

        Args:
            x: m, (N,).
            level: SPL, dB re 20 uPa rms, (..., N, F) or (..., N).
            phase: of the pressure in exp(+j omega t), DEGREES, of the same shape.
            frequency: Hz.
            about: further fields of the record.
        Raises:
            ValueError: shapes differ; a level beyond 1 to 194 dB, a phase beyond 1e6 degrees.
        Warns:
            DataWarning: levels that look like pascals, phases that look like radians.
        """
        levels, phases = real_tensor(level), real_tensor(phase)
        name = about.get("name", "microphones")
        if levels.shape != phases.shape:
            raise ValueError(f"{name}: level has shape {tuple(levels.shape)}, phase {tuple(phases.shape)}")
        far = levels[(levels > LOUDEST) | (levels < QUIETEST)]
        if len(far):
            raise ValueError(
                f"{name}: a level is {float(far[0]):g} dB; SPL in dB re 20 uPa rms within {QUIETEST:g} and "
                f"{LOUDEST:g} dB is needed"
            )
        require_plausible(phases.detach().cpu().numpy(), "phase", f"{name}: phase")
        line = cls(x, torch.polar(pressure_amplitude_from_spl(levels), torch.deg2rad(phases)), frequency, **about)
        span = float(line.x[-1] - line.x[0])
        notes = unit_warnings(name, levels, phases, line.frequency / line.fluid.sound_speed, span)
        tell(notes)
        return replace(line, notes=line.notes + notes)

    @property
    def axes(self) -> dict[str, tuple[str, ...]]:
        """Dimensions of its file."""
        return {"draws": tuple(f"draw_{axis}" if axis else "draw" for axis in range(self.pressure.ndim - 2))}

    @property
    def microphones(self) -> int:
        """N."""
        return len(self.x)

    @property
    def stated_mach(self) -> float:
        """``mach`` as a plain number; ValueError where none is stated."""
        if self.mach is None:
            raise ValueError(f"{self.name} states no Mach number; give mach=, --mach, or mach = ... in the file")
        return plain_number(self.mach)

    @property
    def level(self) -> Tensor:
        """SPL, dB re 20 uPa rms, (..., N, F)."""
        return spl_from_pressure_amplitude(self.pressure)

    @property
    def phase(self) -> Tensor:
        """Degrees, -180 to 180, (..., N, F)."""
        return torch.rad2deg(self.pressure.angle())

    def require_equal_spacing(self, method: str) -> float:
        """The mean spacing, m, for a method that needs equal ones.

        Raises:
            ValueError: a microphone is off the even grid by more than 0.5 % of it; the worst one is named.
        """
        number, x = np.arange(self.microphones), self.x.numpy()
        spacing = float(x[-1] - x[0]) / (self.microphones - 1)
        off = x - np.polyval(np.polyfit(number, x, 1), number)
        worst = int(np.abs(off).argmax())
        if abs(off[worst]) > EQUAL_SPACING * spacing:
            raise ValueError(
                f"{self.name}: {method} needs equal spacing, but microphone {worst} at x = "
                f"{1e3 * x[worst]:.6g} mm is {1e3 * off[worst]:+.3g} mm off an even grid of "
                f"{1e3 * spacing:.5g} mm (limit {100 * EQUAL_SPACING:g} % of it); leave microphones out, or use the "
                "two-wave fit"
            )
        return spacing

    def select(self, microphones: Sequence[int] | Tensor) -> MicrophoneLine:
        """The line with some of its microphones, by index from 0."""
        index = torch.as_tensor(microphones).reshape(-1)
        if index.is_floating_point() or not bool(((index >= 0) & (index < self.microphones)).all()):
            raise ValueError(f"{self.name} has microphones 0 to {self.microphones - 1}; {index.tolist()} asked")
        index = index.to(torch.int64)
        coherence = None if self.coherence is None else self.coherence[index]
        return replace(self, x=self.x[index], pressure=self.pressure[..., index, :], coherence=coherence)

    def at(self, frequency: Any) -> MicrophoneLine:
        """The line at some of its frequencies, Hz; a ValueError where it has no such."""
        wanted = frequency_tensor(frequency).tolist()
        index = [index_of_frequency(self.frequency, each) for each in wanted]
        if None in index:
            lost = wanted[index.index(None)]
            raise ValueError(f"{self.name} has no {lost:g} Hz; it holds {self.frequency.tolist()} Hz")
        fields = {n: v[..., index] for n in ("wall_impedance", "coherence") if (v := getattr(self, n)) is not None}
        return replace(self, frequency=self.frequency[index], pressure=self.pressure[..., index], **fields)

    def over_liner(self, margin: float = 0.0) -> MicrophoneLine:
        """The microphones over the liner, at least ``margin`` (m) from its ends; all where the line does not say where
        its liner is.

        Raises:
            ValueError: a margin below 0 or not finite; fewer than two microphones are left.
        """
        if not 0 <= margin < math.inf:
            raise ValueError(f"{self.name}: margin is {1e3 * margin:g} mm; it must be finite and at least 0")
        if self.liner_start is None or self.liner_end is None:
            return self
        inside = (self.x >= self.liner_start + margin) & (self.x <= self.liner_end - margin)
        if int(inside.sum()) < 2:
            raise ValueError(
                f"{self.name}: {int(inside.sum())} microphones lie over the liner, {1e3 * self.liner_start:g} to "
                f"{1e3 * self.liner_end:g} mm, with a margin of {1e3 * margin:g} mm; at least two are needed"
            )
        return self.select(inside.nonzero()[:, 0])

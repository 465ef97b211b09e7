"""Pressure in: complex amplitudes at microphones along a duct."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, replace
from typing import Any, ClassVar

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, index_of_frequency, plain_array, plain_number, real_tensor
from torchliner.conversions import pressure_amplitude_from_spl, spl_from_pressure_amplitude
from torchliner.records.case import LOUDEST, Case
from torchliner.records.checked import check
from torchliner.records.declared import ANY, record, var
from torchliner.records.outlets import Reported, Written

QUIETEST, LOUD = 1.0, 20.0  # dB, that microphones measure; of the loudest in a duct, unlike numbers in pascals
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

    x: Any = var("microphone", unit="m", kind="places", text="places along the flow, increasing")
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
        frequency, p = frequency_tensor(self.frequency), self.pressure
        p = p if isinstance(p, Tensor) else torch.as_tensor(plain_array(p, f"{self.name}: pressure"))
        if not p.is_complex():
            raise TypeError(
                f"{self.name}: pressure is {p.dtype}; complex amplitudes in Pa are needed. For SPL in dB and phases in "
                "degrees use MicrophoneLine.from_levels"
            )
        single = len(frequency) == 1 and p.shape[-1:] == (len(self.x),)
        found = {"frequency": frequency, "pressure": p[..., None] if single else p}
        if self.wall_impedance is not None:
            found["wall_impedance"] = torch.as_tensor(self.wall_impedance, dtype=torch.complex128)
        if self.coherence is not None:
            found["coherence"] = real_tensor(self.coherence)
        for label, value in found.items():
            object.__setattr__(self, label, value)
        check(self, tensors=True)
        if len(self.x) < 2 or bool((self.x.diff() <= 0).any()):
            raise ValueError(f"{self.name}: x is {self.x.tolist()} m; two or more places are needed, in rising order")
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
            ValueError: shapes differ; levels that are none of sound in dB.
        """
        levels, phases = real_tensor(level), real_tensor(phase)
        name = about.get("name", "microphones")
        if levels.shape != phases.shape:
            raise ValueError(f"{name}: level has shape {tuple(levels.shape)}, phase {tuple(phases.shape)}")
        low, high = float(levels.min()), float(levels.max())
        if not (low >= QUIETEST and LOUD <= high <= LOUDEST):
            raise ValueError(
                f"{name}: levels are {low:g} to {high:g} dB; SPL in dB re 20 uPa rms, {QUIETEST:g} to {LOUDEST:g} dB, "
                f"the highest at least {LOUD:g} dB, is needed: are these pascals?"
            )
        return cls(x, torch.polar(pressure_amplitude_from_spl(levels), torch.deg2rad(phases)), frequency, **about)

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

    def select(self, microphones: Sequence[int] | Tensor) -> MicrophoneLine:
        """The line with some of its microphones, by index from 0."""
        index = torch.as_tensor(microphones)
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
        its liner is. A ValueError where fewer than two are left."""
        if not margin >= 0:
            raise ValueError(f"{self.name}: margin is {1e3 * margin:g} mm; it must be at least 0")
        if self.liner_start is None or self.liner_end is None:
            return self
        inside = (self.x >= self.liner_start + margin) & (self.x <= self.liner_end - margin)
        return self.select(inside.nonzero()[:, 0])

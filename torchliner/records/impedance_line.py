"""Impedance out of stations that were measured one after another: a line of laser Doppler data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from torchliner.conversions import (
    admittance_from_reflection,
    impedance_from_reflection,
    reflection_from_admittance,
    spl_from_pressure_amplitude,
)
from torchliner.fluid import Fluid
from torchliner.records.level_check import LevelCheck, words_of
from torchliner.records.notes import Note
from torchliner.records.outlets import DrawnAtFrequency, Result
from torchliner.records.summaries import (
    Facts,
    Summarised,
    frequency_words,
    heading_of,
    impedance_facts,
    shape_words,
)
from torchliner.records.uncertainty import Interval


def mean_over_segments(values: Tensor, counts: Tensor) -> Tensor:
    """Mean of (N, S, F) over the first ``counts`` (N,) segments of each station, (N, F)."""
    there = (torch.arange(values.shape[1]) < counts[:, None])[..., None]
    return torch.where(there, values, 0).sum(1) / counts[:, None]


@dataclass(frozen=True, eq=False)
class LineAverage:
    """One impedance for all stations that count, eq. (5.2), and three different widths of it.

    Args:
        impedance: closed form: 1 over the mean of 1/Z over segments and stations, (F,).
        monte_carlo, monte_carlo_spread: mean and standard deviation (resistance and reactance) of
            the paper's draws, one segment a station, (F,). The spread shrinks as one over the root
            of the number of stations: it is neither how Z differs along the line nor how well
            ``impedance`` is known.
        spatial_spread: standard deviation of the stations' Z, (F,): how Z differs along the line.
        interval: statistical, because records are finite; None without any.
        stations: how many count.
    """

    impedance: Tensor
    monte_carlo: Tensor
    monte_carlo_spread: Tensor
    spatial_spread: Tensor
    interval: Interval | None
    stations: int


@dataclass(frozen=True, eq=False, repr=False)
class ImpedanceLine(DrawnAtFrequency, Result, Summarised):
    """Impedance of every segment of every station, with averages and all choices.

    All impedances are normalised by rho c, exp(+j omega t), v into the liner. N stations, S
    segments at most, F frequencies.

    Args:
        frequency: Hz, (F,).
        reflection: R of each segment, complex128, (N, S, F); nan beyond a station's segments.
        segment_start: of each segment, s on the clock of the arrivals, (N, S); nan likewise.
        x, y, z: of the stations, m, (N,); nan where unknown.
        mean_velocity, velocity_rms: m/s, (N,): of the bursts that count, positive away from the
            liner, weighted by transit time where it was recorded.
        velocity_amplitude: complex peak amplitude of v into the liner, m/s, (N, F): phase at time 0
            of the arrivals, or relative to the reference channel.
        coherence: squared coherence of v with a steady tone, or with the reference, (N, F).
        attenuation: factor of the reconstruction on a tone, complex, (N, F).
        corrected: whether that factor was taken off, bool, (N, F).
        phase_held: share of the segments where the phase rule held, (N, F).
        rate, grid_rate: arrivals a second; Hz of the uniform grid, (N,).
        longest_gap: between arrivals, s, (N,).
        received, bursts: bursts in the file, and of those that count, int64, (N,).
        used: whether a station counts in averages, bool, (N,).
        wall: stations that count there with admittance 0, bool, (N, F); None without a wall filter.
        interval: statistical, of the mean over segments (5.1), (N, F); None without any.
        names, flags, dropped, station_notes: of each station: title; warnings about the bursts;
            bursts left out, by reason; warnings about the eduction.
        average: over the stations; None before they are joined.
        goodrich, reference, fluid, ...: as in a map.
        level_check: of the average and of each station, as in a map; None where it is not checked.
    """

    frequency: Tensor
    reflection: Tensor
    segment_start: Tensor
    x: Tensor
    y: Tensor
    z: Tensor
    mean_velocity: Tensor
    velocity_rms: Tensor
    velocity_amplitude: Tensor
    coherence: Tensor
    attenuation: Tensor
    corrected: Tensor
    phase_held: Tensor
    rate: Tensor
    grid_rate: Tensor
    longest_gap: Tensor
    received: Tensor
    bursts: Tensor
    used: Tensor
    wall: Tensor | None
    interval: Interval | None
    names: tuple[str, ...]
    flags: tuple[tuple[str, ...], ...]
    dropped: tuple[Mapping[str, int], ...]
    station_notes: tuple[tuple[str, ...], ...]
    average: LineAverage | None = None
    fluid: Fluid = field(default_factory=Fluid)
    reference: Mapping[str, complex] = field(default_factory=dict)
    mach: float | None = None
    incident_level: float | None = None
    source_side: str = "unknown"
    goodrich: Tensor | None = None
    title: str = ""
    choices: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    level_check: LevelCheck | None = None

    @property
    def level_check_words(self) -> str:
        """What the average is compared with, or why it is not."""
        return words_of(self.level_check, self.choices)

    @property
    def answer(self) -> Tensor:
        """Z of the whole line, eq. (5.2), (F,): the value to quote.

        Raises:
            ValueError: the stations have not been joined.
        """
        if self.average is None:
            raise ValueError("the stations have no average; join them, or write .h5 or .csv")
        return self.average.impedance

    @property
    def stations(self) -> int:
        """N."""
        return len(self.names)

    @property
    def segments(self) -> Tensor:
        """Segments of each station, int64, (N,)."""
        return torch.isfinite(self.segment_start).sum(1)

    @property
    def segment_impedance(self) -> Tensor:
        """Z of each segment, (N, S, F); nan beyond a station's segments."""
        return impedance_from_reflection(self.reflection)

    @property
    def impedance(self) -> Tensor:
        """Mean of Z over the segments, eq. (5.1), (N, F)."""
        return self.over_segments(self.segment_impedance)

    @property
    def admittance(self) -> Tensor:
        """Mean of 1/Z over the segments, (N, F)."""
        return self.over_segments(admittance_from_reflection(self.reflection))

    @property
    def segment_spread(self) -> Tensor:
        """Standard deviation of resistance and reactance over the segments, (N, F).

        The paper's coloured areas are three of these. It does not shrink with a longer record.
        """
        away = self.segment_impedance - self.impedance[:, None]
        unbiased = self.segments / (self.segments - 1).clamp(min=1)
        parts = [(self.over_segments(part.square()) * unbiased[:, None]).sqrt() for part in (away.real, away.imag)]
        return torch.complex(*parts)

    def over_segments(self, values: Tensor) -> Tensor:
        """Mean of (N, S, F) over the segments that each station has, (N, F)."""
        return mean_over_segments(values, self.segments)

    @property
    def velocity_level(self) -> Tensor:
        """Peak of the coherent velocity, m/s, (N, F)."""
        return self.velocity_amplitude.abs()

    @property
    def inferred_incident_level(self) -> Tensor:
        """Level of the wave that gives the coherent v, dB re 20 uPa rms, (N, F); needs a tone."""
        reflected = reflection_from_admittance(self.admittance)
        wave = self.fluid.characteristic_impedance * self.velocity_amplitude / (1 - reflected)
        return spl_from_pressure_amplitude(wave)

    def _heading(self) -> str:
        bursts = f"{int(self.bursts.sum())} bursts"
        words = (shape_words((self.stations,), "station"), bursts, frequency_words(self.frequency))
        return heading_of(self, *words)

    def _facts(self) -> Facts:
        if self.average is None:
            return []
        level = self.choices.get("interval")
        return impedance_facts(self.frequency, self.answer, self.average.interval, level)

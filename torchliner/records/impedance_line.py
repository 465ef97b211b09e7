"""Impedance out of stations that were measured one after another: a line of laser Doppler data."""

from collections.abc import Mapping
from typing import Any, ClassVar

import torch
from torch import Tensor

from torchliner.conversions import (
    admittance_from_reflection,
    impedance_from_reflection,
    reflection_from_admittance,
    spl_from_pressure_amplitude,
)
from torchliner.records.case import Found
from torchliner.records.checked import require_shapes
from torchliner.records.declared import Variable, flat, part, record, var
from torchliner.records.educed import Interval
from torchliner.records.outlets import Drawn, Result


def mean_over_segments(values: Tensor, counts: Tensor) -> Tensor:
    """Mean of (N, S, F) over the first ``counts`` (N,) segments of each station, (N, F)."""
    there = (torch.arange(values.shape[1]) < counts[:, None])[..., None]
    return torch.where(there, values, 0).sum(1) / counts[:, None]


@record
class LineAverage:
    """One impedance for all stations that count, eq. (5.2), and three different widths of it.

    The spread of the paper's draws, one segment a station, shrinks as one over the root of the number of stations: it
    is neither how Z differs along the line nor how well ``impedance`` is known, which the interval says.
    """

    impedance: Tensor = var("frequency", name="{}", wide=True, text="1 over the mean of 1/Z, (5.2)")
    monte_carlo: Tensor = var("frequency", name="monte_carlo_{}", wide=True, text="mean of the draws of (5.2)")
    monte_carlo_spread: Tensor = var(
        "frequency", name="monte_carlo_spread_{}", wide=True, text="deviation over these draws"
    )
    spatial_spread: Tensor = var("frequency", name="spatial_spread_{}", wide=True, text="deviation over the stations")
    interval: Interval | None = part("", "frequency", text="segments resampled, stations independent")
    stations: int = var(text="stations that count")


SEGMENT, STATION = ("station", "segment", "frequency"), ("station", "frequency")


@record
class ImpedanceLine(Drawn, Result, Found):
    """Impedance of every segment of every station, with averages and all choices.

    Impedances are normalised by rho c, exp(+j omega t), v into the liner. N stations, S segments at most, F
    frequencies; nan beyond a station's segments. Phases are those at time 0 of the arrivals.

    Args:
        interval: statistical, of the mean over segments (5.1), (N, F); None without any.
        flags, dropped, station_notes: of each station: warnings about the bursts; bursts left out, by reason; warnings
            about the eduction.
        average: over the stations; None before they are joined.
    """

    frequency: Tensor = var("frequency", unit="Hz", text="frequency of the tone")
    reflection: Tensor = var(*SEGMENT, kind="complex", name="segment_reflection", text="R of a segment")
    segment_start: Tensor = var("station", "segment", unit="s", text="time at which a segment begins")
    x: Tensor = var("station", unit="m", text="streamwise coordinate, nan where unknown")
    y: Tensor = var("station", unit="m", text="distance from the liner, likewise")
    z: Tensor = var("station", unit="m", text="spanwise coordinate, likewise")
    mean_velocity: Tensor = var("station", unit="m/s", text="mean of v, positive away from the liner, by transit times")
    velocity_rms: Tensor = var("station", unit="m/s", text="rms of v about its mean, likewise")
    velocity_amplitude: Tensor = var(*STATION, unit="m/s", kind="complex", text="peak amplitude of v into the liner")
    coherence: Tensor = var(*STATION, text="squared coherence of v with the tone")
    attenuation: Tensor = var(*STATION, kind="complex", text="factor by which the grid attenuates the tone")
    corrected: Tensor = var(*STATION, kind="flag", text="whether that was taken off")
    rate: Tensor = var("station", unit="1/s", text="arrivals a second")
    grid_rate: Tensor = var("station", unit="Hz", text="sampling rate of the uniform grid")
    longest_gap: Tensor = var("station", unit="s", text="longest time without a burst")
    received: Tensor = var("station", text="bursts in the file")
    bursts: Tensor = var("station", text="bursts that count")
    used: Tensor = var("station", kind="flag", text="whether a station counts in averages")
    interval: Interval | None = part("", *STATION, text="moving blocks over segments", default=None)
    names: tuple[str, ...] = var("station", kind="text", name="station_name", text="title of the station", default=())
    flags: tuple[tuple[str, ...], ...] = ()
    dropped: tuple[Mapping[str, int], ...] = ()
    station_notes: tuple[tuple[str, ...], ...] = ()
    average: LineAverage | None = part("line_", text="of the line", default=None)

    DERIVED: ClassVar = (
        Variable("segment_impedance", dims=SEGMENT, name="segment_{}", text="of each segment"),
        Variable("impedance", dims=STATION, name="{}", text="mean over the segments, (5.1)"),
        Variable("segment_spread", dims=STATION, name="segment_spread_{}", text="standard deviation over the segments"),
        Variable("admittance", dims=STATION, kind="complex", text="mean of 1/Z over the segments"),
        Variable("inferred_incident_level", "dB", STATION, text="of the wave that gives the coherent v, re 20 uPa rms"),
    )
    SCHEMA: ClassVar = "torchliner line 1"
    PLACES: ClassVar = {"stations": ("station",)}
    PLOT: ClassVar = "torchliner.report.fields:draw_lines"

    def __post_init__(self) -> None:
        require_shapes(flat(self, derived=False), "line")
        for label in ("flags", "dropped", "station_notes"):
            if len(getattr(self, label)) != self.stations:
                raise ValueError(f"{label} has {len(getattr(self, label))} values for {self.stations} stations")

    @property
    def answer(self) -> Tensor:
        """Z of the whole line, eq. (5.2), (F,): the value to quote; a ValueError where the stations are not joined."""
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
        return mean_over_segments(self.segment_impedance, self.segments)

    @property
    def admittance(self) -> Tensor:
        """Mean of 1/Z over the segments, (N, F)."""
        return mean_over_segments(admittance_from_reflection(self.reflection), self.segments)

    @property
    def segment_spread(self) -> Tensor:
        """Standard deviation of resistance and reactance over the segments, (N, F): the paper's coloured areas are
        three of these."""
        away = self.segment_impedance - self.impedance[:, None]
        unbiased = self.segments / (self.segments - 1).clamp(min=1)
        squares = (mean_over_segments(part.square(), self.segments) for part in (away.real, away.imag))
        return torch.complex(*((each * unbiased[:, None]).sqrt() for each in squares))

    @property
    def inferred_incident_level(self) -> Tensor:
        """Level of the wave that gives the coherent v, dB re 20 uPa rms, (N, F); needs a tone."""
        reflected = reflection_from_admittance(self.admittance)
        wave = self.fluid.characteristic_impedance * self.velocity_amplitude / (1 - reflected)
        return spl_from_pressure_amplitude(wave)

    def _answer(self) -> Any:
        return None if (own := self.average) is None else (own.impedance, own.interval, self.choices.get("interval"))

"""Incident signals: what is sent at the liner, at any sample before, in and after the record.

All are pressures (or velocities: only ratios matter) of the incident wave at the liner. The engines
ask for values at sample indices that may lie outside the record: there tones go on, sweeps and
noise repeat the record's, a recorded signal is zero.

A new kind is a class like these: ``edge`` and ``window`` that suit it, ``label`` for messages,
``band`` (Hz, None if unknown), ``sampled`` on a record (float64, (n,)) and ``emission``, the same
with what it is before and after the record.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import (
    frequency_tensor,
    make_plain,
    real_tensor,
    require_choice,
    require_positive,
)
from torchliner.records import ImpedanceMap
from torchliner.replay.emissions import Emission, Sent, SteadyTones

SWEEPS = ("linear", "logarithmic")


def _below_nyquist(label: str, highest: float, sampling_rate: float) -> None:
    if highest >= sampling_rate / 2:
        raise ValueError(
            f"{label} reaches {highest:g} Hz, at or above Nyquist, {sampling_rate / 2:g} Hz for a "
            f"sampling rate of {sampling_rate:g} Hz; lower it or use finer data"
        )


@dataclass(frozen=True)
class Tones:
    """Several tones at once: sum of A cos(2 pi f t + phase).

    Args:
        frequency: Hz, one or several.
        amplitude: one or one each.
        phase: rad; default Schroeder's, which keep the peak of the sum low.
    """

    frequency: Any
    amplitude: Any = 1.0
    phase: Any = None
    edge: str = field(default="finite", init=False)
    window: str = field(default="hann", init=False)

    def __post_init__(self) -> None:
        frequency = frequency_tensor(self.frequency).cpu()
        count = len(frequency)
        order = torch.arange(count, dtype=torch.float64)
        default = -torch.pi * order * (order + 1) / count
        phase = default if self.phase is None else real_tensor(self.phase)
        object.__setattr__(self, "frequency", frequency)
        for name, value in (("amplitude", real_tensor(self.amplitude)), ("phase", phase)):
            if value.numel() not in (1, count):
                raise ValueError(f"{name} has {value.numel()} values for {count} tones")
            object.__setattr__(self, name, value.reshape(-1).cpu().expand(count))

    @classmethod
    def of_map(cls, found: ImpedanceMap, probe: Any = None) -> Tones:
        """The incident wave that a map implies, V/(1 - R), of a phase rule that knows phases.

        Args:
            found: of phase ``joint`` or ``self-consistent``, at the tones that were sent.
            probe: index of one probe on the map's axes; default the mean of the complex amplitudes
                over the probes, which a wave at normal incidence has alike.
        Returns:
            Amplitudes of rho c times a velocity (m/s), for engines ``unfold`` and ``direct``.
        Raises:
            ValueError: the rule knows no phase, or fell back to ``averaged``.

        >>> t = torch.arange(840, dtype=torch.float64) / 42e3
        >>> v = 0.4 * torch.cos(2 * torch.pi * 1400 * t) + 0.2 * torch.sin(2 * torch.pi * 1050 * t)
        >>> plane = tl.VelocityPlane(v[None], sampling_rate=42e3)
        >>> both = {"frequency": [1050.0, 1400.0], "phase": "joint", "interval": None}
        >>> found = tl.educe(plane, tl.load_liner("polito"), **both)
        >>> [round(float(a), 2) for a in tl.Tones.of_map(found).amplitude]
        [0.15, 0.25]
        """
        rule = found.choices.get("phase")
        if rule not in ("joint", "self-consistent"):
            raise ValueError(f"a map of phase {rule!r} knows no phase of the incident wave; educe with phase='joint'")
        at = (probe,) if isinstance(probe, int) else tuple(probe or ())
        held, peak, reflection = (
            each[at].reshape(-1, len(found.frequency))
            for each in (found.phase_rule, found.velocity_amplitude, found.reflection)
        )
        wave = peak / (1 - reflection)
        if not bool(held.any(0).all()):
            lost = found.frequency[~held.any(0)].tolist()
            raise ValueError(
                f"v is not coherent with {', '.join(f'{f:g}' for f in lost)} Hz: its phase is not "
                "known; ask for the other tones alone, or for a lower minimum_coherence"
            )
        mean = torch.where(held, wave, 0).sum(0) / held.sum(0)
        return cls(found.frequency, mean.abs(), mean.angle())

    @property
    def label(self) -> str:
        """Frequencies, amplitudes and phases."""
        parts = (("", self.frequency, "Hz"), ("amplitude ", self.amplitude, ""),
                 ("phase ", self.phase, "rad"))  # fmt: skip
        return "tones " + ", ".join(
            f"{name}{' '.join(f'{value:.6g}' for value in values.tolist())} {unit}".strip()
            for name, values, unit in parts
        )

    @property
    def band(self) -> tuple[float, float]:
        """Lowest and highest tone."""
        return float(self.frequency.min()), float(self.frequency.max())

    def _steady(self, sampling_rate: float) -> SteadyTones:
        return SteadyTones(self.frequency, self.amplitude, self.phase, sampling_rate)

    def sampled(self, samples: int, sampling_rate: float) -> Tensor:
        """(samples,)."""
        _below_nyquist(self.label, self.band[1], sampling_rate)
        return self._steady(sampling_rate).values(0, samples)[0]

    def emission(self, samples: int, sampling_rate: float) -> Emission:
        """Steady before, in and after the record."""
        return self._steady(sampling_rate)


@dataclass(frozen=True)
class _Banded:
    """What fills a band and repeats the record's values for ever."""

    low: float
    high: float
    edge: str = field(default="wrap", init=False)
    window: str = field(default="boxcar", init=False)

    @property
    def band(self) -> tuple[float, float]:
        """Its range, Hz."""
        return self.low, self.high

    def _check_band(self, kind: str) -> None:
        make_plain(self)
        require_positive(f"{kind}: lowest frequency (Hz)", self.low)
        if not self.low < self.high < math.inf:
            raise ValueError(f"{kind} runs from {self.low:g} to {self.high:g} Hz; it must run upwards")

    def sampled(self, samples: int, sampling_rate: float) -> Tensor:
        """(samples,)."""
        raise NotImplementedError

    def emission(self, samples: int, sampling_rate: float) -> Emission:
        """Repeated for ever."""
        return Sent(self.sampled(samples, sampling_rate), True)


@dataclass(frozen=True)
class Sweep(_Banded):
    """One sweep over the record, of unit amplitude.

    Args:
        low, high: Hz, at the first sample and one after the last.
        spacing: ``linear`` or ``logarithmic``.

    Each frequency passes once: Z at f then depends on |v| around that moment alone. For a Z of the
    whole record's turbulence use ``BandNoise``, or the engine ``spectral``.

    >>> tl.Sweep(300, 6000).band  # Hz
    (300.0, 6000.0)
    """

    spacing: str = "linear"

    def __post_init__(self) -> None:
        require_choice("sweep", self.spacing, SWEEPS)
        self._check_band("sweep")

    @property
    def label(self) -> str:
        """Kind and range."""
        return f"{self.spacing} sweep {self.low:g}-{self.high:g} Hz"

    def sampled(self, samples: int, sampling_rate: float) -> Tensor:
        """(samples,)."""
        _below_nyquist(self.label, self.high, sampling_rate)
        from scipy.signal import chirp  # takes half a second or more to import

        times = np.arange(samples) / sampling_rate
        duration = samples / sampling_rate
        method: Any = self.spacing
        values = chirp(times, self.low, duration, self.high, method=method, phi=-90.0)
        return torch.from_numpy(np.asarray(values, dtype=np.float64))


@dataclass(frozen=True)
class BandNoise(_Banded):
    """Noise with a flat spectrum: every line k fs/n of the record in the band, random phases.

    Args:
        low, high: Hz.
        seed: of the phases; another seed is another draw.

    rms 1. The record is one period of it, so that with the edge rule ``wrap`` no line leaks.
    """

    seed: int = 0

    def __post_init__(self) -> None:
        self._check_band("band noise")
        if not 0 <= self.seed < 1 << 63:
            raise ValueError(f"band noise: seed is {self.seed}; it is 0 to 2^63 - 1")

    @property
    def label(self) -> str:
        """Range and seed."""
        return f"band noise {self.low:g}-{self.high:g} Hz, seed {self.seed}"

    def sampled(self, samples: int, sampling_rate: float) -> Tensor:
        """(samples,)."""
        _below_nyquist(self.label, self.high, sampling_rate)
        spacing = sampling_rate / samples
        first, last = math.ceil(self.low / spacing - 1e-9), math.floor(self.high / spacing + 1e-9)
        if last < first:
            raise ValueError(
                f"{self.label}: the record's lines are {spacing:g} Hz apart and none lies in the "
                "band; widen it or use a longer record"
            )
        generator = torch.Generator().manual_seed(self.seed)
        phase = 2 * torch.pi * torch.rand(last - first + 1, generator=generator, dtype=torch.float64)
        spectrum = torch.zeros(samples // 2 + 1, dtype=torch.complex128)
        spectrum[first : last + 1] = torch.polar(torch.ones_like(phase), phase)
        values = torch.fft.irfft(spectrum, n=samples)
        return values / values.square().mean().sqrt()


@dataclass(frozen=True)
class Recorded:
    """A recorded signal.

    Args:
        signal: (n,), as long as the plane's record, in any unit.
        sampling_rate: Hz, that of the plane.
        label: for messages, the file it came from.
    """

    signal: Any
    sampling_rate: float
    label: str = "recorded signal"
    edge: str = field(default="silent", init=False)
    window: str = field(default="boxcar", init=False)

    def __post_init__(self) -> None:
        make_plain(self)
        require_positive(f"{self.label}: sampling_rate (Hz)", self.sampling_rate)
        values = real_tensor(self.signal).detach().cpu()
        if values.ndim != 1:
            raise ValueError(f"{self.label} has shape {tuple(values.shape)}; one channel is needed, choose it")
        if not bool(torch.isfinite(values).all()):
            raise ValueError(f"{self.label} holds nan or inf; repair it first")
        object.__setattr__(self, "signal", values)

    @property
    def band(self) -> None:
        """Unknown."""
        return None

    def sampled(self, samples: int, sampling_rate: float) -> Tensor:
        """(samples,)."""
        if abs(self.sampling_rate / sampling_rate - 1) > 1e-6:
            raise ValueError(
                f"{self.label} is sampled at {self.sampling_rate:g} Hz, the plane at "
                f"{sampling_rate:g} Hz; resample one of them (scipy.signal.resample_poly)"
            )
        if len(self.signal) != samples:
            raise ValueError(
                f"{self.label} has {len(self.signal)} samples, the plane's record {samples}; cut "
                "or pad it, so that nothing is dropped unseen"
            )
        return self.signal

    def emission(self, samples: int, sampling_rate: float) -> Emission:
        """Nothing before and after."""
        return Sent(self.sampled(samples, sampling_rate), False)


def parse_signal(text: str) -> Tones | Sweep | BandNoise | None:
    """A generated signal from its text; None for anything else (a file name).

    Args:
        text: ``tones:500,900``, ``sweep:300:6000[:logarithmic]``, ``noise:300:6000[:seed]``.

    Raises:
        ValueError: the kind is known, its numbers are not.
    """
    kind, _, rest = text.partition(":")
    if kind not in ("tones", "sweep", "noise"):
        return None
    try:
        if kind == "tones":
            return Tones([float(f) for f in rest.split(",")])
        if rest.count(":") not in (1, 2):
            raise ValueError("a lowest and a highest frequency are needed, and one thing more")
        low, high, *more = rest.split(":")
        if kind == "noise":
            return BandNoise(float(low), float(high), int(more[0]) if more else 0)
        return Sweep(float(low), float(high), more[0] if more else "linear")
    except ValueError as error:
        raise ValueError(
            f"incident signal {text!r} cannot be read ({error}); write tones:500,900, "
            "sweep:300:6000:logarithmic, noise:300:6000:0 or the name of a .wav or .npy file"
        ) from error

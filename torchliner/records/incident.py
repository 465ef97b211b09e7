"""Incident waves: the pressure at the liner, or rho c times the velocity (only ratios matter).

A new kind is a class with ``sampled`` like these; ``edge`` says what it is outside the record (``silent``: nothing;
``periodic``: velocity and wave repeat), and ``window`` suits its analysis.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, make_plain, real_tensor, require_positive

EDGES = ("silent", "periodic")
EXAMPLES = "tones:500,900, sweep:300:6000:logarithmic, noise:300:6000:0"


class Incident:
    """Base of all incident waves: ``label`` is kind and numbers, for messages and results; ``band`` is the lowest and
    highest frequency, Hz, None if unknown."""

    edge: ClassVar[str] = "periodic"
    window: ClassVar[str] = "boxcar"
    label: Any = ""
    band: Any = None

    def sampled(self, samples: int, sampling_rate: float) -> Tensor:
        """On a record: float64, (T,); complex128, (F, T), if each frequency is a wave by itself. A ValueError for
        frequencies beyond Nyquist, or a wave that does not suit the record."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class ComplexTones(Incident):
    """e^{j omega t} for each frequency (Hz) by itself: the incident phase ``averaged``.

    The replay is linear and the kernels are real, so the reflection of such a tone is y(cos) + j y(sin). Of
    R = <R> + <R e^{-2 j omega t}> e^{-2 j psi}, which a wave of phase psi sees, only the first term is left: the mean
    over all phases of the tone relative to v.
    """

    edge: ClassVar[str] = "silent"
    window: ClassVar[str] = "hann"
    frequency: Any

    def __post_init__(self) -> None:
        object.__setattr__(self, "frequency", frequency_tensor(self.frequency).cpu())
        object.__setattr__(self, "band", (float(self.frequency.min()), float(self.frequency.max())))
        object.__setattr__(self, "label", f"complex tones {_listed(self.frequency)} Hz")

    def sampled(self, samples: int, sampling_rate: float) -> Tensor:
        """complex128, (F, T)."""
        return torch.exp(1j * self._angles(samples, sampling_rate))

    def _angles(self, samples: int, sampling_rate: float) -> Tensor:
        """omega t, (F, T)."""
        turn = 2 * torch.pi / sampling_rate * frequency_tensor(self.frequency, sampling_rate)
        return torch.outer(turn, torch.arange(samples, dtype=torch.float64))


@dataclass(frozen=True, eq=False)
class Tones(ComplexTones):
    """Several tones at once: sum of A cos(2 pi f t + phase).

    Args:
        frequency: Hz, one or several.
        amplitude: one for all or one for each.
        phase: rad; default those of Schroeder, which keep the peak of the sum low.
    """

    amplitude: Any = 1.0
    phase: Any = None

    def __post_init__(self) -> None:
        super().__post_init__()
        count, order = len(self.frequency), torch.arange(len(self.frequency), dtype=torch.float64)
        phase = -torch.pi * order * (order + 1) / count if self.phase is None else self.phase
        for name, value in (("amplitude", self.amplitude), ("phase", phase)):
            object.__setattr__(self, name, real_tensor(value).reshape(-1).cpu().expand(count))
        shown = map(_listed, (self.frequency, self.amplitude, self.phase))
        object.__setattr__(self, "label", "tones {} Hz, amplitude {}, phase {} rad".format(*shown))

    def sampled(self, samples: int, sampling_rate: float) -> Tensor:
        """float64, (T,)."""
        return self.amplitude @ torch.cos(self._angles(samples, sampling_rate) + self.phase[:, None])


@dataclass(frozen=True)
class _Banded(Incident):
    """A wave between two frequencies, Hz, of which the record is one period; ``NAME`` is its label."""

    NAME: ClassVar[str]
    low: float
    high: float

    def __post_init__(self) -> None:
        make_plain(self)
        object.__setattr__(self, "label", self.NAME.format(**vars(self)))
        object.__setattr__(self, "band", (self.low, self.high))
        frequency_tensor([self.low, self.high])
        if self.low >= self.high:
            raise ValueError(f"{self.label} must run upwards")


@dataclass(frozen=True)
class Sweep(_Banded):
    """One sine sweep over the record, of amplitude 1, from ``low`` to ``high`` (Hz), ``linear`` or ``logarithmic``.

    Each frequency passes once, so R(f) depends on the |v| around that moment alone. ``BandNoise`` gives an R of the
    turbulence of the whole record.
    """

    NAME: ClassVar[str] = "{spacing} sweep {low:g}-{high:g} Hz"
    spacing: str = "linear"

    def sampled(self, samples: int, sampling_rate: float) -> Tensor:
        """float64, (T,)."""
        from scipy.signal import chirp  # its import takes half a second

        frequency_tensor(self.high, sampling_rate)
        method: Any = self.spacing  # scipy refuses others
        times = torch.arange(samples, dtype=torch.float64).numpy() / sampling_rate
        return torch.from_numpy(chirp(times, self.low, samples / sampling_rate, self.high, method=method, phi=-90.0))


@dataclass(frozen=True)
class BandNoise(_Banded):
    """Noise of rms 1: the lines k fs/T of the record from ``low`` to ``high`` (Hz), of one size and random phases."""

    NAME: ClassVar[str] = "band noise {low:g}-{high:g} Hz, seed {seed}"
    seed: int = 0

    def sampled(self, samples: int, sampling_rate: float) -> Tensor:
        """float64, (T,)."""
        frequency_tensor(self.high, sampling_rate)
        spacing = sampling_rate / samples
        first, last = math.ceil(self.low / spacing - 1e-9), math.floor(self.high / spacing + 1e-9)
        if last < first:
            raise ValueError(f"{self.label} holds no line of the record, they are {spacing:g} Hz apart; widen the band")
        generator = torch.Generator().manual_seed(self.seed)
        phase = 2 * torch.pi * torch.rand(last - first + 1, generator=generator, dtype=torch.float64)
        spectrum = torch.zeros(samples // 2 + 1, dtype=torch.complex128)
        spectrum[first : last + 1] = torch.polar(torch.ones_like(phase), phase)
        values = torch.fft.irfft(spectrum, n=samples)
        return values / values.square().mean().sqrt()


@dataclass(frozen=True, eq=False)
class Recorded(Incident):
    """A recorded wave in any unit, (T,), as long as the record of the velocity and at its sampling rate (Hz); ``label``
    is for messages, such as the name of its file."""

    edge: ClassVar[str] = "silent"
    signal: Any
    sampling_rate: float
    label: str = "recorded signal"

    def __post_init__(self) -> None:
        make_plain(self)
        require_positive(f"{self.label}: sampling_rate (Hz)", self.sampling_rate)
        values = real_tensor(self.signal).detach().cpu()
        if values.ndim != 1 or not bool(torch.isfinite(values).all()):
            raise ValueError(f"{self.label} has shape {tuple(values.shape)}; one channel without nan or inf is needed")
        object.__setattr__(self, "signal", values)

    def sampled(self, samples: int, sampling_rate: float) -> Tensor:
        """float64, (T,)."""
        if abs(self.sampling_rate / sampling_rate - 1) > 1e-6 or len(self.signal) != samples:
            raise ValueError(
                f"{self.label} has {len(self.signal)} samples at {self.sampling_rate:g} Hz, the velocity {samples} "
                f"at {sampling_rate:g} Hz; resample (scipy.signal.resample_poly), cut or pad one of them"
            )
        return self.signal


def _listed(values: Tensor) -> str:
    return " ".join(f"{value + 0.0:.6g}" for value in values.tolist())  # no -0


def as_incident(incident: Any, tones: type[ComplexTones]) -> Incident:
    """A wave itself; one from a text, as of ``EXAMPLES``; or ``tones`` from their frequencies in Hz."""
    if isinstance(incident, Incident):
        return incident
    if not isinstance(incident, str):
        return tones(incident)
    kind, *words = incident.replace(",", ":").split(":") if incident.startswith("tones") else incident.split(":")
    try:
        if kind == "tones":
            return Tones([float(f) for f in words])
        own: list[Any] = [int(each) if kind == "noise" else each for each in words[2:]]
        return {"sweep": Sweep, "noise": BandNoise}[kind](float(words[0]), float(words[1]), *own)
    except (LookupError, TypeError, ValueError) as error:
        raise ValueError(f"incident {incident!r} cannot be read; write {EXAMPLES}, or use tl.read_signal") from error

"""IR-TDIBC: impedance over level from the incident wave alone."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, real_tensor, require_choice, require_positive, tell
from torchliner.conversions import REFERENCE_PRESSURE, impedance_from_reflection
from torchliner.engine.kernels import AFTER, VelocityGrid, build_kernels, interpolate, kernel_band
from torchliner.fluid import Fluid
from torchliner.liners.model import as_liner, impedance_of
from torchliner.names import STEP_KERNELS
from torchliner.pressure.spectra import segment_amplitudes, transfer
from torchliner.records.incident import Incident, Tones, as_incident
from torchliner.velocity.ir_tdibc_wall import fixed_speed, step_in_time

STEPPED: dict[str, dict[str, Any]] = {  # damping: an error of 0.02 and a gain of 2 with the shipped liners
    "least-squares": {"kind": "two-sided", "before": 0.0, "regularisation": 1e-2},
    "causal": {"kind": "causal"},
}
RATE = 48_000.0  # Hz, at least
FEWEST, USUAL = 8, 16  # samples in a period of the highest frequency
SECONDS, TONE_SECONDS = 0.25, 0.04  # of a record of noise; of tones, at least
LONGEST = 1 << 17  # samples of a record of tones
READ = 8  # frequencies in the band of a wave, unless others are asked for
SEGMENT = 0.02  # s, of the spectra of what is no tone
FASTEST = 20.0  # m/s, top of the table; of 164 dB at a wall that lets all through
LOUDEST = 200.0  # dB; above, a pressure is meant
CARRIES = 1e-10  # of the strongest line's energy
DRIFTS, UNSTEADY = 1e-3, 5e-2  # drift above which there is a warning, and an error
KERNEL_PART = 0.02  # of |Z + 1|: what a kernel may change without a warning


@dataclass(frozen=True)
class LevelCurve:
    """Impedance of a wall that is driven by incident waves of L levels.

    Args:
        level: of the incident wave, dB re 20 uPa rms, (L,).
        frequency: Hz, (F,).
        reflection: Y/X, complex128, (L, F).
        rms_speed, peak_speed: of v in the record that is read, m/s, (L,).
        drift: rms change of y against the record before, of its rms, (L,).
        fixed_point: Z at the least rms |v| that is just what the incident wave then drives, (L, F).
        frozen: Z of the kernel less Z of the model, where |v| stands still at its rms, (L, F).
        choices: ``kernel``, ``kernel_band`` (Hz), ``kernel_error`` and ``kernel_gain``, largest |H - R| in the band and
            largest |H|; ``incident``, ``liner``, ``sampling_rate`` (Hz) and ``duration`` (s) of the record.
    """

    level: Tensor
    frequency: Tensor
    reflection: Tensor
    rms_speed: Tensor
    peak_speed: Tensor
    drift: Tensor
    fixed_point: Tensor
    frozen: Tensor
    choices: dict[str, Any]

    @property
    def impedance(self) -> Tensor:
        """Z, complex128, (L, F)."""
        return impedance_from_reflection(self.reflection)

    def warnings(self) -> Iterator[str]:
        """What is doubtful; ValueError for a level that has no steady state."""
        chosen, levels = self.choices, self.level.tolist()
        for level, drift in zip(levels, self.drift.tolist(), strict=True):
            still = f"at {level:g} dB y still changes by {drift:.2g} of its rms from one record to the next"
            if drift > UNSTEADY:
                remedy = f"give a longer duration, or a kernel of lower gain than {chosen['kernel_gain']:.3g}"
                raise ValueError(f"{still}: there is no steady state; {remedy}")
            if drift > DRIFTS:
                yield f"{still}; a longer duration settles it"
        share = self.frozen.abs() / (self.impedance - self.frozen + 1).abs()
        i, j = divmod(int(share.argmax()), share.shape[1])
        if share[i, j] > KERNEL_PART:
            yield (
                f"kernel {chosen['kernel']!r} is not the liner's response: with |v| frozen at the rms of {levels[i]:g} "
                f"dB it moves Z at {self.frequency[j]:g} Hz by {complex(self.frozen[i, j]):.3f}"
            )


def ir_tdibc(
    liner: Any,
    level: Any,
    incident: Any,
    *,
    frequency: Any = None,
    kernel: str = "least-squares",
    sampling_rate: float | None = None,
    duration: float | None = None,
    after: float = AFTER,
) -> LevelCurve:
    """Impedance over the level of a normally incident plane wave that alone drives the liner.

    At every step v = (x - y)/(rho c), and y(t_K) = sum_k x(t_k) h(t_K - t_k; |v_k|): the newest tap makes this an
    equation in |v_K|, solved exactly. The record is sent twice; the second is read.

    Args:
        liner: a model; its fluid gives rho c, air at 20 C where it states none.
        level: dB re 20 uPa rms of the whole incident wave, one or several, at most 200.
        incident: Hz of a tone or of several, or ``Tones``, ``BandNoise`` or ``Sweep``, which repeat.
        frequency: Hz, where Z is read; default the tones, or eight in the wave's band.
        kernel: ``least-squares``, causal, fitted on 300-3500 Hz and all that is sent or read; ``causal``, eqs
            (3.1)-(3.3) to the letter, whose dropped taps take up to a third of the resistance.
        sampling_rate: Hz, at least 8 times the highest frequency; default 48 kHz or 16 times it, in whole periods of
            tones.
        duration: s of the record, at least a kernel's length; default 0.25, of tones 0.04.
        after: s, length of the kernel; default 0.01.
    Raises:
        ValueError: a level that is nan, above 200 dB or drives |v| beyond the table; a rate or record too small; a
            table that does not hold what the kernel needs; no steady state. Levels are named.
    Warns:
        DataWarning: what ``LevelCurve.warnings`` says.
    Source: Roncen et al. (2026), section 3.1, for the method it descends from (Roncen & Cardesa 2023; Roncen 2025b),
        where v comes from incident and reflected wave. Departures: the default kernel; (3.3) as in ``build_kernels``.
    """
    model, wave, levels = as_liner(liner), as_incident(incident, Tones), real_tensor(level).reshape(-1).detach()
    for value in levels.tolist() or [math.nan]:
        if not -math.inf < value <= LOUDEST:
            raise ValueError(f"level is {value:g} dB re 20 uPa rms; it must be finite and at most {LOUDEST:g} dB")
    if wave.band is None:
        raise ValueError(f"{wave.label} states no band, to which the kernels are fitted; send tones, noise or a sweep")
    require_choice("kernel", kernel, STEP_KERNELS)
    require_positive("after (s)", after)
    rate = _rate_of(wave, sampling_rate)
    read, fluid, unit = _read_at(wave, frequency, rate), model.fluid or Fluid(), _record_of(wave, rate, duration, after)
    rms, n = REFERENCE_PRESSURE * 10 ** (levels / 20) / float(fluid.characteristic_impedance), len(unit)
    sent = rms[:, None] * unit
    # Levels of |v| never depend on the batch, so that the answer of a level is its own.
    grid = VelocityGrid(min(FASTEST, model.speed_max or FASTEST))
    how: dict[str, Any] = {"band": kernel_band(read, model, rate, wave), "after": after, **STEPPED[kernel]}
    kernels = build_kernels(model, rate, velocity_max=grid.maximum, **how)
    every = step_in_time(sent.repeat(1, 2), kernels)
    reflected, half = every[:, n:], n // 2
    for value, lost in zip(levels.tolist(), every.isnan().any(1), strict=True):
        if lost:
            raise ValueError(f"at {value:g} dB |v| exceeds {grid.maximum:g} m/s, where kernels end; lower the level")
    velocity, power = sent - reflected, 2 * (torch.fft.rfft(unit)[1:] / n).abs() ** 2
    speed, later = velocity.square().mean(1).sqrt(), every[:, 2 * n - half :]
    f = torch.fft.rfftfreq(n, 1 / rate, dtype=torch.float64)[1:]
    known = model.frequency_range or (0.0, math.inf)
    inside = (power > CARRIES * power.max()) & (f >= known[0]) & (f <= known[1])
    fixed = [fixed_speed(model, f[inside], power[inside] * size**2, grid.maximum) for size in rms]
    cut: dict[str, Any] = {"window": "boxcar"} if isinstance(wave, Tones) else {"segment": min(SEGMENT, n / rate)}
    frozen = impedance_from_reflection(interpolate(kernels.response(read), *grid.locate(speed)))
    curve = LevelCurve(
        level=levels,
        frequency=read,
        reflection=transfer(*(segment_amplitudes(each, read, rate, **cut) for each in (sent, reflected)))[0],
        rms_speed=speed,
        peak_speed=velocity.abs().amax(1),
        drift=((later - every[:, n - half : n]).square().mean(1) / later.square().mean(1)).sqrt(),
        fixed_point=impedance_of(model, read, speed.new_tensor(fixed)[:, None]),
        frozen=frozen - impedance_of(model, read, speed[:, None]),
        choices={
            "liner": str(model.describe().get("name") or model.model),
            "incident": wave.label,
            "kernel": kernel,
            "kernel_error": kernels.error,
            "kernel_gain": kernels.gain,
            "kernel_band": list(kernels.band),
            "sampling_rate": rate,
            "duration": n / rate,
        },
    )
    tell(curve.warnings())
    return curve


def _rate_of(wave: Incident, stated: float | None) -> float:
    """The sampling rate stated, or one of whole periods, Hz."""
    highest = wave.band[1]
    if stated is None:
        unit = _divisor(wave) if isinstance(wave, Tones) else 1000.0
        return unit * math.ceil(max(RATE, USUAL * highest) / unit)
    require_positive("sampling_rate (Hz)", stated)
    if stated < FEWEST * highest:
        raise ValueError(
            f"sampling_rate is {stated:g} Hz, {stated / highest:.3g} samples a period of {highest:g} Hz, the highest "
            f"of {wave.label}; give {FEWEST * highest:g} Hz or more ({USUAL * highest:g} Hz or more for its harmonics)"
        )
    return float(stated)


def _divisor(tones: Tones) -> float:
    """Highest frequency of which all tones are multiples, to 1 mHz, Hz."""
    parts = [Fraction(f).limit_denominator(1000) for f in tones.frequency.tolist()]
    whole = math.lcm(*(part.denominator for part in parts))
    return math.gcd(*(int(part * whole) for part in parts)) / whole


def _record_of(wave: Incident, rate: float, duration: float | None, after: float) -> Tensor:
    """The wave with rms 1, float64, (n,): whole periods of tones, and at least a kernel's length."""
    if duration is not None:
        require_positive("duration (s)", duration)
    samples, kernel = round((duration or SECONDS) * rate), round(after * rate) + 1
    if isinstance(wave, Tones):
        least = round(duration * rate) if duration else max(round(TONE_SECONDS * rate), kernel)
        period = Fraction(rate / _divisor(wave)).limit_denominator(LONGEST).numerator
        samples = period * math.ceil(least / period)
        if samples > LONGEST:
            raise ValueError(f"{wave.label} repeats after {period} samples at {rate:g} Hz; leave sampling_rate out")
    if samples < kernel:
        text = f"the record has {samples} samples ({1e3 * samples / rate:.3g} ms), the kernel {kernel}"
        raise ValueError(f"{wave.label}: {text}; give a longer duration or a smaller after=")
    signal = wave.sampled(samples, rate)
    return signal / signal.square().mean().sqrt()


def _read_at(wave: Incident, frequency: Any, rate: float) -> Tensor:
    """Where Z is read, Hz, (F,): by default at the tones, or at eight frequencies within the band."""
    known, (low, high) = None, wave.band
    if isinstance(wave, Tones):
        known = wave.frequency[wave.amplitude != 0]
        frequency = known if frequency is None else frequency
    if frequency is None:
        frequency = torch.linspace(low, high, READ + 2, dtype=torch.float64)[1:-1]
    read = frequency_tensor(frequency, rate)
    for f in read.tolist():
        absent = known is not None and not bool(((known - f).abs() < 1e-6 * f).any())
        if absent or not low * (1 - 1e-6) <= f <= high * (1 + 1e-6):
            raise ValueError(f"frequency {f:g} Hz is not in {wave.label}; R is not known there")
    return read

"""IR-TDIBC: impedance over level from the incident wave alone."""

import math
from fractions import Fraction
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, real_tensor, require_choice, require_positive, tell
from torchliner.conversions import REFERENCE_PRESSURE, impedance_from_reflection
from torchliner.engine.kernels import AFTER, VelocityGrid, build_kernels, interpolate, kernel_band
from torchliner.fluid import Fluid
from torchliner.liners.model import as_liner, impedance_of, reflection_of
from torchliner.names import STEP_KERNELS
from torchliner.records.incident import Incident, Recorded, Tones, as_incident
from torchliner.tones import transfer_function
from torchliner.velocity.ir_tdibc_wall import (
    FixedPoint,
    LevelCurve,
    Progress,
    fixed_points,
    settle_period,
    step_in_time,
)

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
UNHEARD = 0.01  # of a wave's energy, that may be sent where the kernel is not the liner
UNSOLVED = 1e-9  # of the largest |x|, that a period may leave of its equation
CARRIES = 1e-10  # of the strongest line's energy


def ir_tdibc(
    liner: Any,
    level: Any,
    incident: Any,
    *,
    frequency: Any = None,
    kernel: str = "least-squares",
    sampling_rate: float | None = None,
    duration: float | None = None,
    velocity_max: float | None = None,
    after: float = AFTER,
    progress: Progress | None = None,
) -> LevelCurve:
    """Impedance over the level of a normally incident plane wave that alone drives the liner.

    At every step v = (x - y)/(rho c), and y(t_K) = sum_k x(t_k) h(t_K - t_k; |v_k|): the newest tap makes this an
    equation in |v_K|, solved exactly. The record is sent twice; the second is read.

    Args:
        liner: a model; its fluid gives rho c, air at 20 C where it states none.
        level: dB re 20 uPa rms of the whole incident wave, one or several, at most 200.
        incident: Hz of a tone or of several, or ``Tones``, ``BandNoise``, ``Sweep``, ``Recorded`` (scaled to the level;
            a recording repeats as the others do, without its mean).
        frequency: Hz, where Z is read; default the tones, or eight in the wave's band.
        kernel: ``least-squares``, causal, fitted on 300-3500 Hz and all that is sent or read; ``causal``, eqs
            (3.1)-(3.3) to the letter, whose dropped taps take up to a third of the resistance; ``periodic``, the
            model's own response over a whole period at once, for waves that repeat.
        sampling_rate: Hz, at least 8 times the highest frequency; default 48 kHz or 16 times it, in whole periods of
            tones.
        duration: s of the record, at least a kernel's length; default 0.25, of tones 0.04; a recording is sent whole.
        velocity_max: m/s, top of the kernel table; default 20 or the liner's largest.
        after: s, length of the kernel; default 0.01.
        progress: called with numbers of steps done, of 2 n in all (``periodic``: levels).
    Raises:
        ValueError: a level that is nan, above 200 dB or drives |v| beyond the table; a rate or record too small; a
            table that does not hold what the kernel needs; no steady state. Levels are named.
    Warns:
        DataWarning: energy that is sent outside the band; what ``LevelCurve.warnings`` says.
    Source: Roncen et al. (2026), section 3.1, for the method it descends from (Roncen & Cardesa 2023; Roncen 2025b),
        where v comes from incident and reflected wave. Departures: the default kernel; (3.3) as in ``build_kernels``.
    """
    model, wave, levels = as_liner(liner), as_incident(incident, Tones), real_tensor(level).reshape(-1).detach()
    for value in levels.tolist() or [math.nan]:
        if not -math.inf < value <= LOUDEST:
            hint = f"; {value:g} Pa rms is {20 * math.log10(value / REFERENCE_PRESSURE):.1f} dB" if value > 0 else ""
            raise ValueError(f"level is {value:g} dB re 20 uPa rms; it must be finite and at most {LOUDEST:g} dB{hint}")
    require_choice("kernel", kernel, STEP_KERNELS)
    require_positive("after (s)", after)
    rate = _rate_of(wave, sampling_rate)
    read, fluid = _read_at(wave, frequency, rate), model.fluid or Fluid()
    unit = _record_of(wave, rate, duration, 2 if kernel == "periodic" else round(after * rate) + 1)
    n = len(unit)
    rms = REFERENCE_PRESSURE * 10 ** (levels / 20) / float(fluid.density * fluid.sound_speed)
    sent, known = rms[:, None] * unit, math.inf if model.speed_max is None else model.speed_max
    # Levels of |v| never depend on the batch, so that the answer of a level is its own.
    grid = VelocityGrid(min(FASTEST, known) if velocity_max is None else velocity_max)
    if grid.maximum > known:
        raise ValueError(f"velocity_max is {grid.maximum:g} m/s; the liner is known up to {known:g} m/s")
    band = needed = kernel_band(read, model, rate, wave)
    if kernel != "least-squares":
        needed, table = (0.0, rate / 2), model.frequency_range
        if table is not None and not table[0] <= needed[0] < needed[1] <= table[1]:
            raise ValueError(
                f"the liner is known from {table[0]:g} to {table[1]:g} Hz; kernel {kernel!r} needs "
                f"{needed[0]:g}-{needed[1]:g} Hz: take 'least-squares'"
            )
    f = torch.fft.rfftfreq(n, 1 / rate, dtype=torch.float64)[1:]
    facts = {"kernel_error": 0.0, "kernel_gain": 1.0}
    if kernel == "periodic":
        response = reflection_of(model, read, grid.speeds[:, None])
        at_zero = torch.ones(grid.levels, 1, dtype=torch.complex128)  # R(0) = 1
        of_lines = torch.cat([at_zero, reflection_of(model, f, grid.speeds[:, None])], 1)
        found = settle_period(sent, of_lines, grid, progress)
    else:
        how: dict[str, Any] = {"band": band, "after": after, **STEPPED[kernel]}
        kernels = build_kernels(model, rate, velocity_max=grid.maximum, **how)
        response, facts = kernels.response(read), {"kernel_error": kernels.error, "kernel_gain": kernels.gain}
        found = step_in_time(sent, kernels, repeats=True, progress=progress)
    peaks = sent.abs().amax(1)
    for i, (peak, left) in enumerate(zip(peaks.tolist(), found.residual.tolist(), strict=True)):
        at = f"at {levels[i]:g} dB"
        if bool(found.reflected[i].isnan().any()):
            remedy = f"give velocity_max={2 * peak:.3g}, twice the peak of the wave, which suffices for most"
            remedy = remedy if grid.maximum < known else "the liner is known no further: lower the level"
            raise ValueError(f"{at} |v| exceeds {grid.maximum:g} m/s, the top of the kernel table; {remedy}")
        if left > UNSOLVED * peak:
            text = f"{left:.2g} m/s of the equation is left; take 'least-squares', which steps in time"
            raise ValueError(f"{at} the iteration over a period does not converge: {text}")

    velocity, power = sent - found.reflected, 2 * (torch.fft.rfft(unit)[1:] / n).abs() ** 2
    speed = velocity.square().mean(1).sqrt()
    low, high = model.frequency_range or (0.0, math.inf)
    inside = (power > CARRIES * power.max()) & (f >= low) & (f <= high)
    roots = [fixed_points(model, f[inside], power[inside] * size**2, grid.maximum) for size in rms]
    cut: dict[str, Any] = {"window": "boxcar"} if isinstance(wave, Tones) else {"segment": min(SEGMENT, n / rate)}
    frozen = impedance_from_reflection(interpolate(response, *grid.locate(speed)))
    curve = LevelCurve(
        level=levels,
        frequency=read,
        reflection=transfer_function(sent, found.reflected, read, rate, **cut).response,
        rms_speed=speed,
        peak_speed=velocity.abs().amax(1),
        residual=found.residual / peaks,
        several=found.several,
        drift=found.drift,
        reflected_energy=found.reflected.square().sum(1) / sent.square().sum(1),
        fixed_points=tuple(
            tuple(FixedPoint(s, impedance_of(model, read, torch.tensor(s).double())) for s in each) for each in roots
        ),
        frozen=frozen - impedance_of(model, read, speed[:, None]),
        choices={
            "liner": str(model.describe().get("name") or model.model),
            "incident": wave.label,
            "kernel": kernel,
            **facts,
            "kernel_band": list(band),
            "sampling_rate": rate,
            "duration": n / rate,
        },
    )
    outside = (f < needed[0] * (1 - 1e-6)) | (f > needed[1] * (1 + 1e-6))
    share, notes = float(power[outside].sum() / power.sum()), list(curve.warnings())
    if share > UNHEARD:
        most = float(f[outside][power[outside].argmax()])
        text = (
            f"{100 * share:.3g} % of the energy of {wave.label}, most of it near {most:.4g} Hz, is sent outside "
            f"{needed[0]:g}-{needed[1]:g} Hz, where kernel {kernel!r} is not the liner's response; it moves |v| and so "
            "Z everywhere: filter the wave"
        )
        notes.insert(0, text)
    tell(notes)
    return curve


def _rate_of(wave: Incident, stated: float | None) -> float:
    """The sampling rate stated, or one of whole periods, Hz."""
    if isinstance(wave, Recorded):
        if stated is not None and abs(stated / wave.sampling_rate - 1) > 1e-6:
            text = f"sampled at {wave.sampling_rate:g} Hz, sampling_rate is {stated:g} Hz; resample it"
            raise ValueError(f"{wave.label} is {text}")
        return wave.sampling_rate
    assert wave.band is not None
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


def _record_of(wave: Incident, rate: float, duration: float | None, kernel: int) -> Tensor:
    """The wave with rms 1, float64, (n,): whole periods of tones, and at least ``kernel`` samples."""
    if duration is not None:
        require_positive("duration (s)", duration)
    samples = round((duration or SECONDS) * rate)
    if isinstance(wave, Recorded):
        samples = len(wave.signal)
        if duration is not None:
            raise ValueError(f"{wave.label} is sent whole, {samples / rate:.6g} s; cut it, or leave duration out")
    if isinstance(wave, Tones):
        least = round(duration * rate) if duration else max(round(TONE_SECONDS * rate), kernel)
        period = Fraction(rate / _divisor(wave)).limit_denominator(LONGEST).numerator
        samples = period * math.ceil(least / period)
        if samples > LONGEST:
            raise ValueError(
                f"{wave.label} repeats after {period} samples at {rate:g} Hz, which is too long; leave sampling_rate "
                "out, or give a multiple of the tones' common divisor"
            )
        wave.require_periodic(samples, rate)
    if samples < kernel:
        text = f"the record has {samples} samples ({1e3 * samples / rate:.3g} ms), the kernel {kernel}"
        raise ValueError(f"{wave.label}: {text}; give a longer duration or a smaller after=")
    signal = wave.sampled(samples, rate)
    signal = signal - signal.mean()  # of a recording an offset: it moves no wave
    size = signal.square().mean().sqrt()
    if not size > 0:
        raise ValueError(f"{wave.label} is one value throughout; there is no wave to scale to a level")
    return signal / size


def _read_at(wave: Incident, frequency: Any, rate: float) -> Tensor:
    """Where Z is read, Hz, (F,): by default at the tones, or at eight frequencies within the band."""
    known, (low, high) = None, wave.band or (0.0, math.inf)
    if isinstance(wave, Tones):
        known = wave.frequency[wave.amplitude != 0]
        frequency = known if frequency is None and len(known) else frequency
    if frequency is None:
        if wave.band is None:
            raise ValueError(f"{wave.label} states no frequencies; give frequency=, in Hz")
        frequency = torch.linspace(low, high, READ + 2, dtype=torch.float64)[1:-1]
    read = frequency_tensor(frequency, rate)
    for f in read.tolist():
        absent = known is not None and not bool(((known - f).abs() < 1e-6 * f).any())
        if absent or not low * (1 - 1e-6) <= f <= high * (1 + 1e-6):
            raise ValueError(f"frequency {f:g} Hz is not in {wave.label}; R is not known there")
    return read

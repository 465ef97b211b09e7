"""IR-TDIBC: impedance over level from the incident wave alone."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_choice, require_positive, whole_number
from torchliner.conversions import REFERENCE_PRESSURE, impedance_from_reflection
from torchliner.engine.kernels import AFTER
from torchliner.engine.levels import interpolate
from torchliner.fluid import Fluid
from torchliner.ir_tdibc_method.fixed_point import fixed_points, spectrum_of
from torchliner.ir_tdibc_method.level_curve import FixedPoint, LevelCurve, judge
from torchliner.ir_tdibc_method.periodic import NotSettled
from torchliner.ir_tdibc_method.sent import (
    as_signal,
    record_length,
    sampling_rate_for,
    unit_records,
)
from torchliner.ir_tdibc_method.stated import (
    band_of,
    checked_levels,
    driving_window,
    grid_of,
    read_at,
    review_band,
)
from torchliner.ir_tdibc_method.stepping import AboveTable, Progress
from torchliner.ir_tdibc_method.ways import WAYS, Answer, Case, Way
from torchliner.liners.model import as_liner
from torchliner.liners.response import impedance_of
from torchliner.names import STEP_DRIVES, STEP_KERNELS
from torchliner.records.incident import Recorded, Tones
from torchliner.tones import transfer_function

SEGMENT = 0.02  # s, of the spectra of what is no tone


def ir_tdibc(
    liner: Any,
    level: Any,
    incident: Any,
    *,
    frequency: Any = None,
    kernel: str = "least-squares",
    drive: str = "instantaneous",
    realisations: int = 1,
    sampling_rate: float | None = None,
    duration: float | None = None,
    velocity_max: float | None = None,
    band: tuple[float, float] | None = None,
    after: float = AFTER,
    running_window: float | None = None,
    segment: float | None = None,
    progress: Progress | None = None,
) -> LevelCurve:
    """Impedance over the level of a normally incident plane wave that alone drives the liner.

    At every step v = (x - y)/(rho c), and y(t_K) = sum_k x(t_k) h(t_K - t_k; |v_k|): the newest tap
    makes this an equation in |v_K|, solved exactly. The record is sent twice; the second is read.

    Args:
        liner: a model; its fluid gives rho c, air at 20 C where it states none.
        level: dB re 20 uPa rms of the whole incident wave, one or several, at most 200.
        incident: Hz of a tone or of several, or ``Tones``, ``BandNoise``, ``Sweep``, ``Recorded``
            (scaled to the level; a recording is sent once, after silence, without its mean).
        frequency: Hz, where Z is read; default the tones, or eight in the signal's band.
        kernel: ``least-squares``, causal, fitted on ``band``; ``causal``, eqs (3.1)-(3.3) to the
            letter, whose dropped taps take up to a third of the resistance; ``periodic``, the
            model's own response over a whole period at once, for signals that repeat.
        drive: ``instantaneous`` |v|, or its ``running-rms`` over the last ``running_window`` (s;
            default one period of the lowest frequency).
        realisations: N, phases of several tones or draws of noise.
        sampling_rate: Hz, at least 8 times the highest frequency; default 48 kHz or 16 times it, in
            whole periods of tones.
        duration: s of the record, at least a kernel's length; default 0.25, of tones 0.04; not of a
            recording, which is sent whole.
        velocity_max: m/s, top of the kernel table; default 20 or the liner's largest.
        band: Hz, of the kernel; default 300-3500, or wider to hold the signal's own band, of a
            recording what is read; energy that is sent outside is told of.
        after: s, length of the kernel.  segment: s, of the spectra of what is no tone, 0.02.
        progress: called with numbers of steps done, of 2 n in all (``periodic``: records).
    Raises:
        ValueError: a level that is nan, above 200 dB or drives |v| beyond the table; a rate or
            record too small; a table whose band does not hold the kernel's; no steady state. Levels
            are named.
    Source: Roncen et al. (2026), section 3.1, for the method it descends from (Roncen & Cardesa
        2023; Roncen 2025b), where v comes from incident and reflected wave. Departures: the default
        kernel; (3.3) as in ``build_kernels``.
    """
    model, signal = as_liner(liner), as_signal(incident)
    levels = checked_levels(level)
    way = WAYS[require_choice("kernel", kernel, STEP_KERNELS)]
    require_choice("drive", drive, STEP_DRIVES)
    require_positive("after (s)", after)
    if segment is not None:
        require_positive("segment (s)", segment)
        if isinstance(signal, Tones):
            raise ValueError(
                f"segment is of the spectra of noise, sweeps and recordings; {signal.label} are "
                "read over the whole record: leave it out"
            )
    if whole_number("realisations", realisations) < 1:
        raise ValueError(f"realisations is {realisations}; at least one is needed")
    rate = sampling_rate_for(signal, sampling_rate)
    n = record_length(signal, rate, duration, way.taps(after, rate))
    read = read_at(signal, frequency, rate)
    unit = unit_records(signal, realisations, n, rate)
    fluid = model.fluid or Fluid()
    rms = REFERENCE_PRESSURE * 10 ** (levels / 20) / float(fluid.density * fluid.sound_speed)
    case = Case(
        model, grid_of(model, velocity_max), (rms[:, None, None] * unit).flatten(0, 1),
        not isinstance(signal, Recorded), rate, read,
        band_of(model, kernel, band, read, signal, rate), after,
        driving_window(drive, signal, running_window, rate, n), progress,
    )  # fmt: skip
    review_band(kernel, case.band, signal, unit[0], rate)
    answer = _answered(case, way, levels)
    sent, reflected = answer.motion.incident, answer.motion.reflected
    cut = {"window": "boxcar"} if isinstance(signal, Tones) else {"segment": min(segment or SEGMENT, n / rate)}
    reflection = transfer_function(sent, reflected, read, rate, **cut).response
    shape = (len(levels), realisations)
    velocity = answer.motion.velocity
    speed = velocity.square().mean(1).sqrt().reshape(shape)
    frozen = interpolate(answer.response, *case.grid.locate(speed.square().mean(1).sqrt()))
    own = impedance_of(model, read, speed.square().mean(1).sqrt()[:, None])
    curve = LevelCurve(
        level=levels, frequency=read, reflection=reflection.reshape(*shape, -1),
        rms_speed=speed, peak_speed=velocity.abs().amax(1).reshape(shape),
        residual=(answer.motion.residual / case.sent.abs().amax(1)).reshape(shape),
        several=answer.motion.several.reshape(shape), drift=answer.drift.reshape(shape),
        reflected_energy=(reflected.square().sum(1) / sent.square().sum(1)).reshape(shape),
        fixed_points=_fixed_points(case, unit[0], rms),
        frozen=impedance_from_reflection(frozen) - own,
        kernel=kernel, kernel_error=answer.error, kernel_gain=answer.gain, kernel_band=case.band,
        slope=answer.slope, drive=drive, incident=signal.label,
        liner=str(model.describe().get("name") or model.model), sampling_rate=rate, samples=n,
    )  # fmt: skip
    judge(curve)
    return curve


def _answered(case: Case, way: Way, levels: Tensor) -> Answer:
    """The answer, or which level has none."""
    each = len(case.sent) // len(levels)
    try:
        return way.answer(case)
    except AboveTable as error:
        top, known = case.grid.maximum, case.model.speed_max
        suffices = 2 * float(case.sent[error.column].abs().max())
        remedy = (
            f"give velocity_max={suffices:.3g}, twice the peak of the wave, which suffices for most"
            if known is None or top < known
            else "the liner is known no further: lower the level"
        )
        raise ValueError(
            f"at {levels[error.column // each]:g} dB |v| exceeds {top:g} m/s, the top of the kernel table; {remedy}"
        ) from None
    except NotSettled as error:
        raise ValueError(
            f"at {levels[error.column // each]:g} dB the iteration over a period does not "
            f"converge: {error.error:.2g} m/s of the equation is left; take 'least-squares', "
            "which steps in time"
        ) from None


def _fixed_points(case: Case, unit: Tensor, rms: Tensor) -> tuple[tuple[FixedPoint, ...], ...]:
    """Of the frequency domain, by level; of the frequencies at which the liner is known."""
    frequency, power = spectrum_of(unit, case.rate)
    low, high = case.model.frequency_range or (0.0, math.inf)
    known = (frequency >= low) & (frequency <= high)
    frequency, power = frequency[known], power[known]
    return tuple(
        tuple(
            FixedPoint(speed, impedance_of(case.model, case.read, torch.tensor(speed)))
            for speed in fixed_points(case.model, frequency, power * size**2, case.grid.maximum)
        )
        for size in rms.tolist()
    )

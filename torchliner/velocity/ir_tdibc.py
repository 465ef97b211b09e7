"""IR-TDIBC: impedance over level from the incident wave alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import real_tensor, require_choice, require_positive, tell, whole_number
from torchliner.conversions import REFERENCE_PRESSURE, impedance_from_reflection
from torchliner.engine.kernels import AFTER, BAND, HIGHEST, build_kernels
from torchliner.engine.levels import VelocityGrid, interpolate
from torchliner.fluid import Fluid
from torchliner.liners.model import LinerModel, as_liner
from torchliner.liners.response import impedance_of, reflection_of
from torchliner.names import STEP_DRIVES, STEP_KERNELS
from torchliner.records.incident import Incident, Recorded, Tones, as_incident
from torchliner.tones import transfer_function
from torchliner.velocity.ir_tdibc_signal import draws_of, length_of, lines_of, rate_of, read_at
from torchliner.velocity.ir_tdibc_wall import NewestTap, Progress, Reply, settle_period, step_in_time
from torchliner.velocity.level_curve import FixedPoint, LevelCurve

STEPPED: dict[str, dict[str, Any]] = {  # damping: an error of 0.02 and a gain of 2 with the shipped liners
    "least-squares": {"kind": "two-sided", "before": 0.0, "regularisation": 1e-2},
    "causal": {"kind": "causal"},
}
SEGMENT = 0.02  # s, of the spectra of what is no tone
FASTEST = 20.0  # m/s, top of the table; of 164 dB at a wall that lets all through
LOUDEST = 200.0  # dB; above, a pressure is meant
UNHEARD = 0.01  # of a wave's energy, that may be sent where the kernel is not the liner
UNSOLVED = 1e-9  # of the largest |x|, that a period may leave of its equation
PLACES = 2001  # speeds at which the frequency domain is looked at, closer towards rest; two roots in one gap are lost


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
    progress: Progress | None = None,
) -> LevelCurve:
    """Impedance over the level of a normally incident plane wave that alone drives the liner.

    At every step v = (x - y)/(rho c), and y(t_K) = sum_k x(t_k) h(t_K - t_k; |v_k|): the newest tap makes this an
    equation in |v_K|, solved exactly. The record is sent twice; the second is read.

    Args:
        liner: a model; its fluid gives rho c, air at 20 C where it states none.
        level: dB re 20 uPa rms of the whole incident wave, one or several, at most 200.
        incident: Hz of a tone or of several, or ``Tones``, ``BandNoise``, ``Sweep``, ``Recorded`` (scaled to the level;
            a recording is sent once, after silence, without its mean).
        frequency: Hz, where Z is read; default the tones, or eight in the wave's band.
        kernel: ``least-squares``, causal, fitted on ``band``; ``causal``, eqs (3.1)-(3.3) to the letter, whose dropped
            taps take up to a third of the resistance; ``periodic``, the model's own response over a whole period at
            once, for waves that repeat.
        drive: ``instantaneous`` |v|, or its ``running-rms`` over the last period of the lowest frequency.
        realisations: N, phases of several tones or draws of noise.
        sampling_rate: Hz, at least 8 times the highest frequency; default 48 kHz or 16 times it, in whole periods of
            tones.
        duration: s of the record, at least a kernel's length; default 0.25, of tones 0.04; a recording is sent whole.
        velocity_max: m/s, top of the kernel table; default 20 or the liner's largest.
        band: Hz, of the kernel; default 300-3500, or wider to hold the wave's own band, of a recording what is read.
        after: s, length of the kernel; default 0.01.
        progress: called with numbers of steps done, of 2 n in all (``periodic``: records).
    Raises:
        ValueError: a level that is nan, above 200 dB or drives |v| beyond the table; a rate or record too small; a
            table whose band does not hold the kernel's; no steady state. Levels are named.
    Warns:
        DataWarning: energy that is sent outside the band; what ``LevelCurve.warnings`` says.
    Source: Roncen et al. (2026), section 3.1, for the method it descends from (Roncen & Cardesa 2023; Roncen 2025b),
        where v comes from incident and reflected wave. Departures: the default kernel; (3.3) as in ``build_kernels``.
    """
    model, wave, levels = as_liner(liner), as_incident(incident, Tones), _levels(level)
    require_choice("kernel", kernel, STEP_KERNELS)
    require_choice("drive", drive, STEP_DRIVES)
    require_positive("after (s)", after)
    if whole_number("realisations", realisations) < 1:
        raise ValueError(f"realisations is {realisations}; at least one is needed")
    repeats = not isinstance(wave, Recorded)
    if kernel == "periodic" and not repeats:
        raise ValueError("kernel 'periodic' needs a wave that repeats, and a recording does not; take 'least-squares'")
    rate = rate_of(wave, sampling_rate)
    n = length_of(wave, rate, duration, 2 if kernel == "periodic" else round(after * rate) + 1)
    read = read_at(wave, frequency, rate)
    unit = draws_of(wave, realisations, n, rate)
    fluid = model.fluid or Fluid()
    rms = REFERENCE_PRESSURE * 10 ** (levels / 20) / float(fluid.density * fluid.sound_speed)
    sent = (rms[:, None, None] * unit).flatten(0, 1)
    known = math.inf if model.speed_max is None else model.speed_max
    # Levels of |v| never depend on the batch, so that the answer of a level is its own.
    grid = VelocityGrid(min(FASTEST, known) if velocity_max is None else velocity_max)
    if grid.maximum > known:
        raise ValueError(f"velocity_max is {grid.maximum:g} m/s; the liner is known up to {known:g} m/s")
    band, needed = _bands(model, kernel, band, read, wave, rate)
    window = 1 if drive == "instantaneous" else round(rate / (wave.band[0] if wave.band else float(read.min())))
    if window > n:
        raise ValueError(
            f"the running rms is over a period of {window} samples, and the record has {n}; give a longer one"
        )
    lines = lines_of(unit[0], rate)
    notes = _beside(kernel, needed, wave, lines)

    facts = {"kernel_error": 0.0, "kernel_gain": 1.0, "slope": 0.0}
    if kernel == "periodic":
        f = torch.fft.rfftfreq(n, 1 / rate, dtype=torch.float64)[1:]
        response = reflection_of(model, read, grid.speeds[:, None])
        at_zero = torch.ones(grid.levels, 1, dtype=torch.complex128)  # R(0) = 1
        of_lines = torch.cat([at_zero, reflection_of(model, f, grid.speeds[:, None])], 1)
        found = settle_period(sent, of_lines, grid, window, progress)
    else:
        how: dict[str, Any] = {"band": band, "after": after, **STEPPED[kernel]}
        kernels = build_kernels(model, rate, velocity_max=grid.maximum, **how)
        response, slope = kernels.response(read), NewestTap(kernels).steepest * float(sent.abs().max())
        facts = {"kernel_error": kernels.error, "kernel_gain": kernels.gain, "slope": slope * window**-0.5}
        found = step_in_time(sent, kernels, window, repeats=repeats, progress=progress)
    _require_solved(found, sent, levels, grid.maximum, model)

    cut: dict[str, Any] = {"window": "boxcar"} if isinstance(wave, Tones) else {"segment": min(SEGMENT, n / rate)}
    velocity, shape = sent - found.reflected, (len(levels), realisations)
    speed = velocity.square().mean(1).sqrt().reshape(shape)
    still = speed.square().mean(1).sqrt()
    curve = LevelCurve(
        level=levels,
        frequency=read,
        reflection=transfer_function(sent, found.reflected, read, rate, **cut).response.reshape(*shape, -1),
        rms_speed=speed,
        peak_speed=velocity.abs().amax(1).reshape(shape),
        residual=(found.residual / sent.abs().amax(1)).reshape(shape),
        several=found.several.reshape(shape),
        drift=found.drift.reshape(shape),
        reflected_energy=(found.reflected.square().sum(1) / sent.square().sum(1)).reshape(shape),
        fixed_points=tuple(
            tuple(
                FixedPoint(float(s), impedance_of(model, read, s)) for s in _speeds(model, *lines, size, grid.maximum)
            )
            for size in rms
        ),
        frozen=impedance_from_reflection(interpolate(response, *grid.locate(still)))
        - impedance_of(model, read, still[:, None]),
        choices={
            "liner": str(model.describe().get("name") or model.model),
            "incident": wave.label,
            "drive": drive,
            "kernel": kernel,
            **facts,
            "kernel_band": list(band),
            "sampling_rate": rate,
            "duration": n / rate,
        },
    )
    tell([*notes, *curve.warnings()])
    return curve


def _levels(level: Any) -> Tensor:
    """dB, (L,)."""
    levels = real_tensor(level).reshape(-1).detach()
    if not len(levels):
        raise ValueError("no level is given; name at least one, in dB re 20 uPa rms")
    for value in levels.tolist():
        if not -math.inf < value <= LOUDEST:
            hint = f"; {value:g} Pa rms is {20 * math.log10(value / REFERENCE_PRESSURE):.1f} dB" if value > 0 else ""
            raise ValueError(f"level is {value:g} dB re 20 uPa rms; it must be finite and at most {LOUDEST:g} dB{hint}")
    return levels


def _bands(
    liner: LinerModel, kernel: str, band: tuple[float, float] | None, read: Tensor, wave: Incident, rate: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Band of the kernel, and where it needs the liner, Hz.

    By default all of the wave's band, since what is sent there moves |v| whether it is read or not.
    """
    least, most = float(read.min()), float(read.max())
    lowest, highest = wave.band or (least, most)
    low, high = band or (min(BAND[0], 0.9 * lowest), max(BAND[1], 1.1 * highest))
    high = min(high, HIGHEST * rate)
    if not low <= least <= most <= high:
        f = least if least < low else most
        raise ValueError(
            f"frequency {f:g} Hz is outside the kernel's band, {low:g}-{high:g} Hz; widen band= or raise sampling_rate"
        )
    needed = (low, high) if kernel == "least-squares" else (0.0, rate / 2)
    known = liner.frequency_range
    if known is not None and not known[0] <= needed[0] < needed[1] <= known[1]:
        raise ValueError(
            f"the liner is known from {known[0]:g} to {known[1]:g} Hz; kernel {kernel!r} needs "
            f"{needed[0]:g}-{needed[1]:g} Hz: take 'least-squares' with band= within the table"
        )
    return (low, high), needed


def _beside(kernel: str, needed: tuple[float, float], wave: Incident, lines: tuple[Tensor, Tensor]) -> list[str]:
    """A warning of energy that is sent where the kernel is not the liner."""
    frequency, power = lines
    outside = (frequency < needed[0] * (1 - 1e-6)) | (frequency > needed[1] * (1 + 1e-6))
    share = float(power[outside].sum() / power.sum())
    if share <= UNHEARD:
        return []
    most = float(frequency[outside][power[outside].argmax()])
    return [
        f"{100 * share:.3g} % of the energy of {wave.label}, most of it near {most:.4g} Hz, is sent outside "
        f"{needed[0]:g}-{needed[1]:g} Hz, where kernel {kernel!r} is not the liner's response; it moves |v| and so Z "
        "everywhere: widen band=, or filter the wave"
    ]


def _require_solved(found: Reply, sent: Tensor, levels: Tensor, top: float, liner: LinerModel) -> None:
    """Refuse a level that has no answer."""
    beyond = found.reflected.isnan().any(1)
    for i, wave in enumerate(sent):
        at, left = f"at {levels[i * len(levels) // len(sent)]:g} dB", float(found.residual[i])
        if beyond[i]:
            remedy = "the liner is known no further: lower the level"
            if liner.speed_max is None or top < liner.speed_max:
                suffices = 2 * float(wave.abs().max())
                remedy = f"give velocity_max={suffices:.3g}, twice the peak of the wave, which suffices for most"
            raise ValueError(f"{at} |v| exceeds {top:g} m/s, the top of the kernel table; {remedy}")
        if left > UNSOLVED * float(wave.abs().max()):
            raise ValueError(
                f"{at} the iteration over a period does not converge: {left:.2g} m/s of the equation is left; take "
                "'least-squares', which steps in time"
            )


def _speeds(liner: LinerModel, frequency: Tensor, power: Tensor, rms: Tensor, highest: float) -> Tensor:
    """``fixed_points`` of a wave of rms 1 sent at another rms, at those of its lines at which the liner is known."""
    low, high = liner.frequency_range or (0.0, math.inf)
    known = (frequency >= low) & (frequency <= high)
    return torch.tensor(fixed_points(liner, frequency[known], power[known] * rms**2, highest), dtype=torch.float64)


def fixed_points(liner: LinerModel, frequency: Tensor, power: Tensor, highest: float) -> Sequence[float]:
    r"""All rms speeds (m/s) up to ``highest`` that the wave and the wall agree on.

    With p_i the mean square of the incident wave (as a velocity, m2/s2, (F,)) at its frequencies f_i (Hz, (F,)),
    :math:`s^2 = \sum_i p_i |1 - R(f_i, s)|^2`, which lies between 0 and :math:`4 \sum p_i` for passive walls.
    """
    from scipy.optimize import brentq  # takes a while to import

    def excess(speed: Tensor) -> Tensor:
        made = power[:, None] * (1 - reflection_of(liner, frequency[:, None], speed)).abs() ** 2
        return speed - made.sum(0).sqrt()

    top = min(highest, 2.5 * float(power.sum().sqrt()))
    places = top * torch.linspace(0, 1, PLACES, dtype=torch.float64) ** 2
    beyond = excess(places) > 0
    ends = [(float(places[i]), float(places[i + 1])) for i in (beyond[1:] != beyond[:-1]).nonzero().flatten()]
    return [brentq(lambda s: float(excess(torch.tensor([s], dtype=torch.float64))), *each, xtol=1e-14) for each in ends]

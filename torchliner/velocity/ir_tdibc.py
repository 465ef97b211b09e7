r"""IR-TDIBC: impedance over level from the incident wave alone.

With x the incident and y the reflected wave as velocities, p/(rho c), v = x - y goes into the wall. Each emission has
the kernel of the speed \|v\| at that moment,

.. math:: y(t) = \sum_k x(t_k)\, h(t - t_k;\, |v(t_k)|).

The newest tap makes each step an equation in s = \|v\|, with m what earlier emissions have left of y:
:math:`s = |x (1 - h_0(s)) - m|`. Its right side is continuous and bounded, so there is a solution wherever the table
reaches beyond it, and only one if :math:`|x| \max|dh_0/ds| < 1`. Of several the least is taken.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import torch
from numpy.polynomial.polynomial import polyval
from torch import Tensor

from torchliner.checks import real_tensor, require_choice, require_positive, tell
from torchliner.conversions import REFERENCE_PRESSURE, impedance_from_reflection
from torchliner.engine.kernels import AFTER, STENCILS, KernelTable, build_kernels, kernel_band
from torchliner.fluid import Fluid
from torchliner.liners.model import as_liner
from torchliner.names import STEP_KERNELS
from torchliner.pressure.spectra import segment_amplitudes, transfer
from torchliner.records.incident import Tones, as_incident

Array = np.ndarray

STEPPED: dict[str, dict[str, Any]] = {  # damping: an error of 0.02 and a gain of 2 with the shipped liners
    "least-squares": {"kind": "two-sided", "before": 0.0, "regularisation": 1e-2},
    "causal": {"kind": "causal"},
}
RATE = 48e3  # Hz
FEWEST = 16  # samples in a period of the highest tone
SECONDS = 0.04  # of the record
LONGEST = 1 << 17  # samples of it
FASTEST = 20.0  # m/s, top of the table; of 164 dB at a wall that lets all through
LOUDEST = 200.0  # dB; above, a pressure is meant
DRIFTS, UNSTEADY = 1e-3, 5e-2  # drift above which there is a warning, and an error
LARGEST_ERROR = 0.05  # in R, of a kernel without a warning
PARTS, ROUNDS = 64, 8  # into which a cell with a solution is cut, again and again


@dataclass(frozen=True)
class LevelCurve:
    """Impedance of a wall that is driven by tones of L levels.

    Args:
        level: of the whole incident wave, dB re 20 uPa rms, (L,).
        frequency: of the tones, Hz, (F,).
        reflection: Y/X, complex128, (L, F).
        rms_speed, peak_speed: of v in the record that is read, m/s, (L,).
        drift: rms change of y against the record before, of its rms, (L,).
        choices: ``kernel``, ``kernel_band`` (Hz), ``kernel_error`` and ``kernel_gain``, largest |H - R| in the band and
            largest |H|; ``incident``, ``liner``, ``sampling_rate`` (Hz) and ``duration`` (s) of the record.
    """

    level: Tensor
    frequency: Tensor
    reflection: Tensor
    rms_speed: Tensor
    peak_speed: Tensor
    drift: Tensor
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
        if chosen["kernel_error"] > LARGEST_ERROR:
            text = "kernel {kernel!r} is not the liner's response: it is off by up to {kernel_error:.2g} in R"
            yield f"{text} within {{0:g}}-{{1:g}} Hz".format(*chosen["kernel_band"], **chosen)


def ir_tdibc(
    liner: Any,
    level: Any,
    incident: Any,
    *,
    kernel: str = "least-squares",
    sampling_rate: float = RATE,
    duration: float = SECONDS,
    after: float = AFTER,
) -> LevelCurve:
    """Impedance over the level of a normally incident plane wave that alone drives the liner.

    At every step v = (x - y)/(rho c), and y(t_K) = sum_k x(t_k) h(t_K - t_k; |v_k|): the tap at zero delay makes this
    an equation in |v_K|, solved exactly. The record is sent twice; the second pass is evaluated.

    Args:
        liner: a model; its fluid gives rho c, air at 20 C where it states none.
        level: dB re 20 uPa rms of the whole incident wave, one or several, at most 200.
        incident: Hz of a tone or of several at once, or ``Tones``; Z is read at each.
        kernel: ``least-squares``, causal, fitted on 300-3500 Hz and all tones; ``causal``, eqs (3.1)-(3.3) to the
            letter, whose dropped taps take up to a third of the resistance.
        sampling_rate: Hz, raised to 16 times the highest tone and to whole samples in a period of the wave.
        duration: of the record, s, raised to whole periods and at least the length of the kernel.
        after: s, length of the kernel.
    Raises:
        ValueError: a level that is nan, above 200 dB or drives |v| beyond the table; tones that repeat too
            rarely; a table that does not hold what the kernel needs; no steady state. Levels are named.
    Warns:
        DataWarning: what ``LevelCurve.warnings`` says.
    Source: Roncen et al. (2026), section 3.1, for the method it descends from (Roncen & Cardesa 2023; Roncen 2025b),
        where v comes from incident and reflected wave. Departures: the default kernel; (3.3) as in ``build_kernels``.
    """
    model, wave, levels = as_liner(liner), as_incident(incident, Tones), real_tensor(level).reshape(-1).detach()
    for value in levels.tolist() or [math.nan]:
        if not -math.inf < value <= LOUDEST:
            raise ValueError(f"level is {value:g} dB re 20 uPa rms; it must be finite and at most {LOUDEST:g} dB")
    if not isinstance(wave, Tones):
        raise ValueError(f"{wave.label}: IR-TDIBC sends tones; give their frequencies in Hz, or tl.Tones")
    require_choice("kernel", kernel, STEP_KERNELS)
    unit, rate = record_of(wave, sampling_rate, duration, after)
    read, n = wave.frequency[wave.amplitude != 0], len(unit)
    rms = REFERENCE_PRESSURE * 10 ** (levels / 20) / float((model.fluid or Fluid()).characteristic_impedance)
    # Levels of |v| never depend on the batch, so that the answer of a level is its own.
    how: dict[str, Any] = {"velocity_max": min(FASTEST, model.speed_max or FASTEST), **STEPPED[kernel]}
    kernels = build_kernels(model, rate, band=kernel_band(read.tolist(), model, rate), after=after, **how)
    sent = rms[:, None] * unit
    every = step_in_time(sent.repeat(1, 2), kernels)
    for value, lost in zip(levels.tolist(), every.isnan().any(1), strict=True):
        if lost:
            most = kernels.grid.maximum
            raise ValueError(f"at {value:g} dB |v| exceeds {most:g} m/s, where kernels end; lower the level")
    reflected, before, later = every[:, n:], every[:, n - n // 2 : n], every[:, 2 * n - n // 2 :]
    velocity = sent - reflected
    about: dict[str, Any] = {
        "liner": str(model.describe().get("name") or model.model),
        "incident": wave.label,
        "kernel": kernel,
    }
    about |= {"sampling_rate": rate, "duration": n / rate}
    curve = LevelCurve(
        level=levels,
        frequency=read,
        reflection=transfer(*(segment_amplitudes(each, read, rate, window="boxcar") for each in (sent, reflected)))[0],
        rms_speed=velocity.square().mean(1).sqrt(),
        peak_speed=velocity.abs().amax(1),
        drift=((later - before).square().mean(1) / later.square().mean(1)).sqrt(),
        choices=about | {"kernel_error": kernels.error, "kernel_gain": kernels.gain, "kernel_band": list(kernels.band)},
    )
    tell(curve.warnings())
    return curve


def record_of(wave: Tones, least_rate: float, duration: float, after: float) -> tuple[Tensor, float]:
    """The wave with rms 1 in whole periods of all tones together, float64, (n,), and its sampling rate, Hz."""
    for name, value in {"sampling_rate (Hz)": least_rate, "duration (s)": duration, "after (s)": after}.items():
        require_positive(name, value)
    tones, lowest = wave.frequency.tolist(), float(wave.frequency.min())
    repeats = lowest / math.lcm(*(Fraction(f / lowest).limit_denominator().denominator for f in tones))  # Hz
    period = math.ceil(max(least_rate, FEWEST * max(tones)) / repeats - 1e-9)
    rate = period * repeats
    n = period * math.ceil(max(round(duration * rate), round(after * rate) + 1) / period)
    if n > LONGEST:
        raise ValueError(f"{wave.label} repeats {repeats:g} times in a second, after {period} samples; round the tones")
    signal = wave.sampled(n, rate)
    return signal / signal.square().mean().sqrt(), rate


def step_in_time(sent: Tensor, kernels: KernelTable) -> Tensor:
    """The reply y of a wall at rest, m/s, (L, n), one sample after another; nan where |v| leaves the table.

    Args:
        sent: incident waves as velocities, m/s, float64, (L, n).
        kernels: causal, first tap at 0.
    Source: Roncen et al. (2026), eq. (3.2) and section 3.1: "a reference array stores the precomputed response, which
        is then sequentially processed into a secondary array to accumulate the boundary condition's future response";
        v from incident and reflected wave as in Roncen (2025b).
    """
    grid, taps, x = kernels.grid, kernels.taps.numpy(), sent.numpy()
    power, nodes = 2 if grid.spacing == "sqrt" else 1, np.array(STENCILS[grid.interpolation])
    # Speeds are scale * place**power, and between two levels the newest tap is a polynomial of the place, counted from
    # the base of their stencil; ``lagrange`` has the coefficients for a tap of 1 at each node.
    scale, speeds, steps = grid.maximum / (grid.levels - 1) ** power, grid.speeds.numpy(), np.linspace(0, 1, PARTS + 1)
    bases = np.arange(grid.levels - 1).clip(-nodes[0], grid.levels - 1 - nodes[-1])
    lagrange = np.linalg.inv(np.vander(nodes.astype(float), increasing=True))
    newest = lagrange @ taps[bases + nodes[:, None], 0]

    def emitted(sent: Array, memory: Array) -> Array:
        """The kernels of the least |v|, times x, (L, K)."""
        free, rows = (sent - memory)[:, None], np.arange(len(sent))
        there = speeds >= np.abs(free - sent[:, None] * taps[:, 0])
        cell = np.maximum(there.argmax(1) - 1, 0)
        base, polynomial = bases[cell, None], newest[:, cell, None]
        low, high = cell, cell + 1
        for _ in range(ROUNDS):
            places = low[:, None] + (high - low)[:, None] * steps
            tap = polyval(places - base, polynomial, tensor=False)
            ahead = scale * places**power >= np.abs(free - sent[:, None] * tap)
            ahead[:, -1] = True  # whatever rounding says
            end = np.maximum(ahead.argmax(1), 1)
            low, high = places[rows, end - 1], places[rows, end]
        weights = np.vander(high - base[:, 0], len(nodes), increasing=True) @ lagrange
        weights *= np.where(there.any(1), sent, np.nan)[:, None]
        return (weights[:, None] @ taps[base + nodes])[:, 0]

    y = np.zeros((len(x), x.shape[1] + taps.shape[1]))  # complete up to the present step
    for k in range(x.shape[1]):
        y[:, k : k + taps.shape[1]] += emitted(x[:, k], y[:, k])
    return torch.from_numpy(y[:, : x.shape[1]])

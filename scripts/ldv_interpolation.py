"""What the way onto a grid does to laser Doppler velocities, on bursts whose true velocity is known.

    python scripts/ldv_interpolation.py [-o FOLDER] [--check]

A tone of 1500 Hz (2 m/s peak) and Gaussian turbulence (1.5 m/s rms, falling like f^-5/3 from 500 Hz
to 20 kHz) are seen at Poisson arrivals and rebuilt. By mean rate: the factor on the tone and the error
of its amplitude (200 draws); rms and the educed Z of the liner `onera`.

For Poisson arrivals of rate lambda the distances B, F from any instant to the arrivals before and after are
independent and exponential. With x = omega/lambda ``hold`` leaves <e^(-j omega B)> = 1/(1 + jx) of a tone. ``linear``:
given D = B + F, of density lambda^2 D e^(-lambda D), the mean over B of [F e^(-j omega B) + B e^(j omega F)]/D is
2 (1 - cos(omega D))/(omega D)^2; over D, by Frullani's integral, ln(1 + x^2)/x^2.
"""

import functools
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.interpolate import CubicSpline
from torch import Tensor

import torchliner as tl
from common import run_study
from torchliner.bursts.arrivals import corrected_coherent_part, onto_grid, tone_attenuation
from torchliner.names import GRID_METHODS
from torchliner.report.figure import COLOURS, MARKERS, finish, styled, subplots
from torchliner.studies.variants import Row

FREQUENCY, PEAK, RMS = 1500.0, 2.0, 1.5  # Hz, m/s, m/s
KNEE, HIGHEST, FINE = 500.0, 20e3, 200e3  # Hz; of the turbulence, and of the true record
RATES = (8e3, 10e3, 15e3, 20e3, 25e3, 35e3, 50e3, 100e3)
PUBLISHED = {15: 0.84, 25: 0.94, 50: 0.98}  # factor of linear interpolation, by kHz
SHORT, LONG, DRAWS = 0.1, 2.0, 200  # s; records for the errors of amplitudes, and for all else
GRID = 60e3  # Hz: 40 steps a period, three times the turbulence's end
RULES = ("averaged", "self-consistent")
CORRECTED = "linear, tone corrected"
WAYS = (*GRID_METHODS, CORRECTED)
FITS = ("as interpolated", "corrected", "fit at the arrivals")
PANELS = {  # of rms and Z over the true ones
    "rms": "rms",
    "resistance averaged": "resistance, averaged",
    "resistance self-consistent": "resistance, self-consistent",
}


class Flow:
    """Velocity at any time: a tone and one draw of turbulence, over ``seconds``."""

    def __init__(self, seconds: float, seed: int) -> None:
        count = 1 << math.ceil(math.log2((seconds + 0.01) * FINE))
        self.generator = np.random.default_rng(seed)
        self.seconds = seconds
        frequency = np.fft.rfftfreq(count, 1 / FINE)
        weights = (1 + (frequency / KNEE) ** 2) ** (-5 / 12) * (frequency <= HIGHEST)
        weights[0] = 0.0
        white = np.fft.rfft(self.generator.standard_normal(count))
        noise = np.fft.irfft(white * weights, n=count)
        scale = RMS / math.sqrt(2 * float((weights**2).sum()) / count)
        kept = math.ceil((seconds + 0.005) * FINE)
        self.turbulence = CubicSpline(np.arange(kept) / FINE, scale * noise[:kept])

    def velocity(self, times: Tensor) -> Tensor:
        """m/s."""
        tone = PEAK * torch.cos(2 * math.pi * FREQUENCY * times)
        return tone + torch.from_numpy(self.turbulence(times.numpy()))

    def arrivals(self, rate: float) -> Tensor:
        """Of a Poisson process, whatever the velocity: s."""
        steps = self.generator.exponential(1 / rate, int(1.2 * rate * self.seconds) + 50)
        times = torch.from_numpy(np.cumsum(steps))
        return times[times < self.seconds]


def closed_forms(rate: Any) -> dict[str, Any]:
    """Size of the factor on the tone by method."""
    x = 2 * math.pi * FREQUENCY / np.asarray(rate)
    return {"linear": np.log1p(x**2) / x**2, "hold": 1 / np.hypot(1, x)}


def factors(number: int, rate: float) -> dict[str, float]:
    """|G| of drawn arrivals by method."""
    times = Flow(LONG, number).arrivals(rate)
    signals = {method: onto_grid(times, times, method=method, frequency=FREQUENCY) for method in GRID_METHODS}
    found = {f"factor, {method}": tone_attenuation(each, FREQUENCY).factor for method, each in signals.items()}
    return {name: float(factor.abs().squeeze()) for name, factor in found.items()}


def fit_at_arrivals(times: Tensor, values: Tensor) -> complex:
    """A of the tone from the samples themselves: least squares, no grid, no bias."""
    turns = 2 * math.pi * FREQUENCY * times
    model = torch.stack([turns.cos(), -turns.sin(), torch.ones_like(turns)], 1)
    cosine, sine, _ = torch.linalg.lstsq(model, values[:, None]).solution[:, 0].tolist()
    return complex(cosine, sine) / 2


def amplitude_errors(number: int, rate: float) -> dict[str, float]:
    """Bias and scatter of the tone's amplitude by linear interpolation, over its size."""
    found = []
    for draw in range(DRAWS):
        flow = Flow(SHORT, 1000 * (number + 1) + draw)
        times = flow.arrivals(rate)
        values = flow.velocity(times)
        signal = onto_grid(times, values, GRID)
        damping = tone_attenuation(signal, FREQUENCY, window="boxcar")
        line = damping.line(signal)
        turn = np.exp(-2j * np.pi * FREQUENCY * signal.start)
        lines = [complex(each[0]) * turn for each in (line, damping.true_amplitude(line))]
        found.append([*lines, fit_at_arrivals(times, values)])
    errors = np.array(found) / (PEAK / 2) - 1
    sizes = {"bias": abs(errors.mean(0)), "scatter": errors.std(0, ddof=1)}
    return {f"{word}, {name}": float(v) for word, each in sizes.items() for name, v in zip(FITS, each, strict=True)}


def effects(number: int, rate: float) -> dict[str, float]:
    """rms, and resistance and reactance under each phase rule, by method, over the truth of the same draw."""
    flow = Flow(LONG, 500 + number)
    times = flow.arrivals(rate)
    values = flow.velocity(times)
    signals = {method: onto_grid(times, values, GRID, method) for method in GRID_METHODS}
    damping = tone_attenuation(signals["linear"], FREQUENCY)
    signals[CORRECTED] = corrected_coherent_part(signals["linear"], damping)
    velocity = torch.stack([flow.velocity(signals["linear"].times), *(signal.values for signal in signals.values())])
    columns = {"rms": velocity.std(1)}
    plane = tl.VelocityPlane(velocity, sampling_rate=GRID)
    for rule in RULES:
        found = tl.educe(plane, tl.load_liner("onera"), FREQUENCY, phase=rule, interval=None, averaging="admittance")
        z = found.impedance[:, 0]
        columns |= {f"resistance {rule}": z.real, f"reactance {rule}": z.imag}
    pairs = {name: zip(WAYS, (column / column[0])[1:], strict=True) for name, column in columns.items()}
    return {f"{name}, {way}": float(value) for name, each in pairs.items() for way, value in each}


def rows_of() -> list[Row]:
    """One for each mean rate."""
    return [
        Row({"mean rate (Hz)": rate} | factors(i, rate) | amplitude_errors(i, rate) | effects(i, rate))
        for i, rate in enumerate(RATES)
    ]


@styled
def draw(rows: Sequence[Row], path: Path) -> None:
    """``attenuation``: factor on the tone, bias and scatter of its amplitude; ``effects``: rms and R over the truth."""
    kilohertz, fine = np.array(RATES) / 1e3, np.geomspace(8, 100, 101)
    figure, axes = subplots(1, 2, 3.5)
    left, right = axes[0]
    for i, method in enumerate(GRID_METHODS):
        drawn = [row[f"factor, {method}"] for row in rows]
        left.plot(kilohertz, drawn, MARKERS[i], color=COLOURS[i], label=method)
    for i, (method, closed) in enumerate(closed_forms(1e3 * fine).items()):
        left.plot(fine, closed, color=COLOURS[i], label=f"{method}, closed form")
    left.plot(list(PUBLISHED), list(PUBLISHED.values()), "+", color="k", markersize=9, label="linear, known values")
    for i, name in enumerate(FITS):
        for word, line in (("bias", "--"), ("scatter", "-")):
            label = f"{word}, {name}"
            right.plot(kilohertz, [row[label] for row in rows], MARKERS[i] + line, color=COLOURS[i], label=label)
    left.set_ylabel("factor on the tone $|G|$")
    right.set(ylabel=r"error of the amplitude, over $|A|$", yscale="log")
    for axis in (left, right):
        axis.legend(fontsize=7)
        axis.set(xlabel=r"arrivals $\lambda$ (kHz)", xscale="log")
    finish(figure, path.with_name("ldv_attenuation.png"))
    figure, axes = subplots(1, len(PANELS), 3.1)
    for axis, (name, label) in zip(axes[0], PANELS.items(), strict=True):
        axis.axhline(1.0, color="k", linewidth=0.9, label="velocity known everywhere")
        for i, way in enumerate(WAYS):
            axis.plot(kilohertz, [row[f"{name}, {way}"] for row in rows], MARKERS[i] + "-", color=COLOURS[i], label=way)
        axis.set(xlabel=r"arrivals $\lambda$ (kHz)", xscale="log", ylabel=f"{label}, over the true value")
    finish(figure, path.with_name("ldv_effects.png"), legend=3)


main = functools.partial(run_study, __doc__, "ldv_interpolation", rows_of, draw)


if __name__ == "__main__":
    sys.exit(main())

"""What the way onto a grid does to laser Doppler velocities, on bursts whose true velocity is known.

    python scripts/ldv_interpolation.py [-o FOLDER] [--draws 200]

A tone of 1500 Hz (2 m/s peak) and Gaussian turbulence (1.5 m/s rms, falling like f^-5/3 from 500 Hz
to 20 kHz) are seen at Poisson arrivals and rebuilt. Figures with their numbers as CSV: the factor
on the tone and the error of its amplitude; rms and the educed Z of the liner `onera`.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from scipy.interpolate import CubicSpline
from torch import Tensor

import torchliner as tl
from common import RESULTS, options_of, parser_of
from studies.arrival_figures import Curves, draw_attenuation, draw_effects
from studies.poisson import CLOSED_FORMS, poisson_attenuation
from torchliner.bursts.arrivals import GridSignal, corrected_coherent_part, onto_grid, tone_attenuation
from torchliner.names import GRID_METHODS

FREQUENCY, PEAK, RMS = 1500.0, 2.0, 1.5  # Hz, m/s, m/s
KNEE, HIGHEST, FINE = 500.0, 20e3, 200e3  # Hz; of the turbulence, and of the true record
RATES = (8e3, 10e3, 15e3, 20e3, 25e3, 35e3, 50e3, 100e3)
PUBLISHED = {15e3: 0.84, 25e3: 0.94, 50e3: 0.98}
SHORT, LONG = 0.1, 2.0  # s; records for the errors of amplitudes, and for all else
GRID = 60e3  # Hz: 40 steps a period, three times the turbulence's end
VARIABLE = "mean rate (Hz)"
RULES = ("averaged", "self-consistent")
CORRECTED = ("linear, tone corrected", "linear, tone and its noise corrected")


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


def attenuation_tables() -> tuple[Curves, Curves]:
    """|G| for drawn arrivals, and the closed forms on finer rates."""
    found: dict[str, list[float]] = {method: [] for method in GRID_METHODS}
    for seed, rate in enumerate(RATES):
        times = Flow(LONG, seed).arrivals(rate)
        for method in GRID_METHODS:
            factor = tone_attenuation(onto_grid(times, times, method=method, frequency=FREQUENCY), FREQUENCY).factor
            found[method].append(float(factor.abs().squeeze()))
    fine = np.geomspace(RATES[0], RATES[-1], 101)
    closed = {method: poisson_attenuation(FREQUENCY, fine, method).abs().numpy() for method in CLOSED_FORMS}
    drawn = {method: np.array(values) for method, values in found.items()}
    return (
        Curves(np.array(RATES), drawn, VARIABLE),
        Curves(fine, closed, VARIABLE),
    )


def fit_at_arrivals(times: Tensor, values: Tensor) -> complex:
    """A of the tone from the samples themselves: least squares, no grid, no bias."""
    turns = 2 * math.pi * FREQUENCY * times
    model = torch.stack([turns.cos(), -turns.sin(), torch.ones_like(turns)], 1)
    cosine, sine, _ = torch.linalg.lstsq(model, values[:, None]).solution[:, 0].tolist()
    return complex(cosine, sine) / 2


def amplitude_errors(draws: int) -> Curves:
    """Bias and scatter of the tone's amplitude by linear interpolation, over its size."""
    names = ("as interpolated", "corrected", "fit at the arrivals")
    columns: dict[str, list[float]] = {}
    for number, rate in enumerate(RATES):
        found = []
        for draw in range(draws):
            flow = Flow(SHORT, 1000 * (number + 1) + draw)
            times = flow.arrivals(rate)
            values = flow.velocity(times)
            signal = onto_grid(times, values, GRID)
            factors = tone_attenuation(signal, FREQUENCY, window="boxcar")
            line = factors.line(signal)
            turn = np.exp(-2j * np.pi * FREQUENCY * signal.start)
            lines = [complex(each[0]) * turn for each in (line, factors.true_amplitude(line))]
            found.append([*lines, fit_at_arrivals(times, values)])
        errors = np.array(found) / (PEAK / 2) - 1
        for i, name in enumerate(names):
            bias, scatter = abs(errors[:, i].mean()), errors[:, i].std(ddof=1)
            columns.setdefault(f"bias, {name}", []).append(float(bias))
            columns.setdefault(f"scatter, {name}", []).append(float(scatter))
    numbers = {name: np.array(column) for name, column in columns.items()}
    return Curves(np.array(RATES), numbers, VARIABLE)


def effects() -> tuple[list[tuple[str, Curves, float]], Curves]:
    """Panels of rms and Z by method, relative to the truth of the same draw; and all numbers."""
    rows = []
    for number, rate in enumerate(RATES):
        flow = Flow(LONG, 500 + number)
        times = flow.arrivals(rate)
        values = flow.velocity(times)
        signals = {method: onto_grid(times, values, GRID, method) for method in GRID_METHODS}
        signals |= _corrections(signals["linear"])
        true = flow.velocity(signals["linear"].times)
        rows.append(_effects_of({"true": true} | {n: s.values for n, s in signals.items()}))
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    parts = ("rms (m/s)", *(f"{p} {rule}" for rule in RULES for p in ("resistance", "reactance")))
    numbers = {f"{part}, {name}": column[:, i] for name, column in columns.items() for i, part in enumerate(parts)}
    panels = []
    for i, label in ((0, "rms"), (1, "resistance, averaged"), (3, "resistance, self-consistent")):
        shown = {n: c[:, i] / columns["true"][:, i] for n, c in columns.items() if n != "true"}
        panels.append((f"{label}, over the true value", Curves(np.array(RATES), shown, VARIABLE), 1.0))
    return panels, Curves(np.array(RATES), numbers, VARIABLE)


def _corrections(signal: GridSignal) -> dict[str, GridSignal]:
    factors = tone_attenuation(signal, FREQUENCY)
    pairs = zip(CORRECTED, (False, True), strict=True)
    return {name: corrected_coherent_part(signal, factors, noise=noise) for name, noise in pairs}


def _effects_of(signals: dict[str, Tensor]) -> dict[str, list[float]]:
    """rms, and resistance and reactance under each phase rule."""
    plane = tl.VelocityPlane(torch.stack(list(signals.values())), sampling_rate=GRID)
    found = {name: [float(values.std())] for name, values in signals.items()}
    for rule in RULES:
        result = tl.educe(plane, tl.load_liner("onera"), FREQUENCY, phase=rule, interval=None, averaging="admittance")
        for name, z in zip(signals, result.impedance[:, 0], strict=True):
            found[name] += [float(z.real), float(z.imag)]
    return found


def study(folder: Path, draws: int) -> dict[str, Curves]:
    """Draw the figures into a folder; returns all numbers by name."""
    factors, closed = attenuation_tables()
    errors = amplitude_errors(draws)
    draw_attenuation(factors, closed, PUBLISHED, errors, folder / "ldv_attenuation.png")
    panels, numbers = effects()
    draw_effects(panels, folder / "ldv_effects.png")
    return {"attenuation": factors, "closed_forms": closed, "errors": errors, "effects": numbers}


def main(arguments: Sequence[str] | None = None) -> int:
    parser = parser_of(__doc__, RESULTS / "ldv_interpolation")
    parser.add_argument("--draws", type=int, default=200, help="of the amplitude's errors")
    options = options_of(parser, arguments)
    for name, table in study(options.output, options.draws).items():
        table.write_csv(options.output / f"ldv_{name}.csv")
    print(f"figures and numbers are in {options.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

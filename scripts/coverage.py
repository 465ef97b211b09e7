"""How often the 95 % intervals hold the known value, of planes and of lines of microphones.

    python scripts/coverage.py [planes | waves] [--trials N]

``planes``: velocity is Gaussian turbulence of 3 m/s rms, alone or beside a tone of 3 m/s that all probes share. E[R]
follows from quadrature over the turbulence and the phase of the tone, so that the truth is Z(E[R]) of the liner `onera`
at 1400 Hz. Spectra: low-passed at 1 kHz, and two of exponential correlation (0.4 and 1.5 ms). A row of 2000 trials has
a standard error of 0.5 %. A (z, x) plane holds many trials: each column is a liner of its own, whose admittance
averaged over z goes the same way through the code as that of a whole liner; its cells and probes are trials, too. A
short record is off in the mean, because the admittance of probes is not linear in it, and phase-locked averaging takes
off some of its turbulence: the intervals are to hold the known value nevertheless.

``waves``: 12 microphones above a wall of three known impedances (600, 1000, 1500 Hz; M = 0.3), with the wave from the
source, a share 0.3 + 0.2j of it coming back, and errors of level and phase that are a multiple of those assumed. The
intervals are those of draws. R and X at the three frequencies count apart: the standard error of a row is 1 % or less
with 200 lines.
"""

import dataclasses
import itertools
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import torch
from torch import Tensor

import torchliner as tl
from common import options_of, parser_of
from torchliner.duct.dispersion import wavenumber_from_impedance
from torchliner.liners.model import LinerModel
from torchliner.pressure.microphone_errors import LEVEL_ERROR, PHASE_ERROR, MicrophoneErrors
from torchliner.pressure.two_waves import two_wave_fit
from torchliner.pressure.waves import kumaresan_tufts
from torchliner.records import WallEduction
from torchliner.records.educed import Educed, Interval

Rows = Iterator[dict[str, object]]
RATE, FREQUENCY, RMS = 42000.0, 1400.0, 3.0
PER_PERIOD = 30  # samples
TONES = {"no tone": 0.0, "tone": 3.0}  # m/s
PERIODS = (8, 16, 100)
LONG = 50  # periods, from which a liner has a quarter of the trials
PITCH = 0.01  # m, of the cells
AVERAGINGS = ("admittance", "phase-locked")
AT_ONCE = 2_000_000  # samples of a plane
# Liners: cells, probes in each, and whether these share half of their energy or none.
COLUMNS = {"liner of 8 cells": (8, 16, True), "liner of 200": (1, 200, False)}
HEIGHT, MACH, BACK = 0.05, 0.3, 0.3 + 0.2j  # of waves
FREQUENCIES = torch.tensor([600.0, 1000.0, 1500.0], dtype=torch.float64)
WALLS = torch.tensor([0.8 - 1.2j, 1.5 + 0.3j, 2.33 - 0.3j], dtype=torch.complex128)
X = 0.012 * torch.arange(12, dtype=torch.float64)
SIDES = {"upstream": "downstream", "downstream": "upstream"}  # of the source, and where its wave runs
METHODS: dict[str, Callable[..., WallEduction]] = {"kt": kumaresan_tufts, "two-waves": two_wave_fit}
SIZES = (1.0, 2.0, 4.0)  # of the errors, over those assumed


def exponential(seconds: float) -> Callable[[Tensor], Tensor]:
    """Amplitude of noise whose correlation falls like exp(-t/seconds)."""
    return lambda frequency: 1 / torch.sqrt(1 + (2 * math.pi * frequency * seconds) ** 2)


SPECTRA: dict[str, Callable[[Tensor], Tensor]] = {
    "1 kHz noise": lambda frequency: ((frequency > 0) & (frequency <= 1000)).to(torch.float64),
    "exponential, 0.4 ms": exponential(0.4e-3),
    "exponential, 1.5 ms": exponential(1.5e-3),
}


def turbulence(spectrum: str, shape: tuple[int, ...], samples: int, random: torch.Generator) -> Tensor:
    """Gaussian noise, (*shape, samples), m/s, of ``RMS`` in the mean over records."""
    length = 1 << math.ceil(math.log2(2 * samples))  # cut from twice as much: no periodicity
    amplitude = SPECTRA[spectrum](torch.fft.rfftfreq(length, 1 / RATE, dtype=torch.float64))
    amplitude[-1] = 0
    kept = int(amplitude.nonzero()[-1]) + 1
    power = 2 * amplitude.square().sum() - amplitude[0] ** 2
    weights = amplitude[:kept] * (RMS * length / power.sqrt())
    white = torch.randn(*shape, kept, dtype=torch.complex64, generator=random)
    white[..., 0] = math.sqrt(2) * white[..., 0].real
    return torch.fft.irfft(white * weights.float(), n=length)[..., :samples]


def true_impedance(liner: LinerModel, tone: float) -> complex:
    """Z of E[R(|v|)], by quadrature over the turbulence and the phases that are sampled."""
    speed = torch.linspace(0, 10 * RMS + tone, 200001, dtype=torch.float64)
    density = torch.zeros_like(speed)
    for step in range(PER_PERIOD):
        middle = tone * math.sin(2 * math.pi / PER_PERIOD * step)
        for side in (middle, -middle):
            density += torch.exp(-(((speed - side) / RMS) ** 2) / 2) / (math.sqrt(2 * math.pi) * RMS * PER_PERIOD)
    reflection = tl.reflection_from_impedance(liner.impedance(FREQUENCY, speed))
    return complex(tl.impedance_from_reflection(torch.trapezoid(reflection * density, speed)))


def summary(parts: Sequence[Educed], true: complex) -> dict[str, object]:
    """Share of intervals that hold the known value, their median widths, and the mean error of the values in their own
    standard deviations."""
    flat = (part.map(Tensor.flatten).interval for part in parts)
    interval = Interval.joined([each for each in flat if each is not None])
    value = torch.cat([part.impedance.flatten() for part in parts])
    low, high, off = (torch.view_as_real(each - true).T for each in (interval.low, interval.high, value))
    numbers = {"{} inside (%)": 100 * ((low <= 0) & (high >= 0)).double().mean(1)}
    numbers |= {"width of {}": (high - low).median(1).values, "{} off (sd)": off.mean(1) / off.std(1)}
    found = {name.format(part): float(each[i]) for name, each in numbers.items() for i, part in enumerate("RX")}
    return {"trials": len(value), **found, "runs": float(interval.runs.median())}


def plane_of(spectrum: str, name: str, periods: int, tone: float, count: int, seed: int) -> tl.VelocityPlane:
    """``count`` columns side by side, each of which is a liner."""
    random, samples = torch.Generator().manual_seed(seed), periods * PER_PERIOD
    cells, size, shares = COLUMNS[name]
    velocity = turbulence(spectrum, (cells, size, count), samples, random)
    if shares:
        velocity = velocity.add_(turbulence(spectrum, (cells, 1, count), samples, random)).mul_(math.sqrt(0.5))
    velocity += (tone * torch.sin(2 * math.pi / PER_PERIOD * torch.arange(samples, dtype=torch.float64))).float()
    z, x = (step * (torch.arange(n) + 0.5).double() for step, n in ((PITCH / size, cells * size), (PITCH, count)))
    return tl.VelocityPlane(velocity.flatten(0, 1), sampling_rate=RATE, frequency=FREQUENCY, x=x, z=z)


def rows_of(name: str, spectrum: str, periods: int, trials: int) -> Rows:
    """Of planes: one for each tone, averaging and size of the average. Trials are what is independent: one probe of
    each cell, the cells, the columns."""
    liner: Any = dataclasses.replace(tl.load_liner("onera"), cell_pitch=PITCH)  # type: ignore[type-var]
    columns, (cells, size, _) = math.ceil(trials / 4) if periods >= LONG else trials, COLUMNS[name]
    at_once = max(1, AT_ONCE // (cells * size * periods * PER_PERIOD))
    for words, tone in TONES.items():
        done: dict[tuple[str, str], list[Educed]] = {}
        for seed, first in enumerate(range(0, columns, at_once)):
            found = tl.educe(plane_of(spectrum, name, periods, tone, min(at_once, columns - first), seed), liner)
            for averaging in AVERAGINGS:
                done.setdefault((averaging, name), []).append(found.along_x[averaging])
                if cells > 1:
                    probes = found.probes[averaging].map(lambda each: each.unflatten(0, (cells, size))[:, 0].flatten())
                    done.setdefault((averaging, "probe"), []).append(probes)
                    done.setdefault((averaging, f"cell of {size}"), []).append(found.cells[averaging])
        for (averaging, of), parts in done.items():
            about = {"of": of, "averaging": averaging, "spectrum": spectrum, "v": words, "periods": periods}
            yield about | summary(parts, true_impedance(liner, tone))


def planes(trials: int = 2000) -> Rows:
    """Of every spectrum, liner and length."""
    for spectrum, name, periods in itertools.product(SPECTRA, COLUMNS, PERIODS):
        yield from rows_of(name, spectrum, periods, trials)


def clean_line(side: str) -> tl.MicrophoneLine:
    """Pressures of both waves, 100 Pa at the microphone next to the source."""

    def wave(direction: str) -> Tensor:
        alpha = wavenumber_from_impedance(WALLS, FREQUENCIES, height=HEIGHT, mach=MACH, direction=direction)
        return torch.exp(-1j * alpha * (X[:, None] - X[0 if direction == "downstream" else -1]))

    pressure = 100 * (wave(SIDES[side]) + BACK * wave(side))
    return tl.MicrophoneLine(X, pressure, FREQUENCIES, duct_height=HEIGHT, mach=MACH, source_side=side)


def held_by_draws(method: str, side: str, size: float, lines: int, draws: int) -> tuple[float, list[WallEduction]]:
    """Share of the intervals, of draws of the errors as assumed, that hold R and X of noisy lines; what was found."""
    line, found, held = clean_line(side), [], []
    for pressure in MicrophoneErrors(LEVEL_ERROR * size, PHASE_ERROR * size, lines, seed=5).drawn(line.pressure):
        found.append(METHODS[method](dataclasses.replace(line, pressure=pressure), draws=draws))
        low, high = found[-1].interval()
        held += [(low.real < WALLS.real) & (WALLS.real < high.real)]
        held += [(low.imag < WALLS.imag) & (WALLS.imag < high.imag)]
    return float(torch.stack(held).double().mean()), found


def waves(trials: int = 200) -> Rows:
    """Of every method, side of the source and size of the errors; 200 draws each."""
    for side, method, size in itertools.product(SIDES, METHODS, SIZES):
        held = 100 * held_by_draws(method, side, size, trials, 200)[0]
        yield {"method": method, "source": side, "errors": size, "held (%)": held}


PARTS: dict[str, Callable[..., Rows]] = {each.__name__: each for each in (planes, waves)}


def main(arguments: Sequence[str] | None = None) -> int:
    parser = parser_of(__doc__)
    parser.add_argument("part", nargs="?", choices=PARTS, default="planes")
    parser.add_argument("--trials", type=int)
    options = options_of(parser, arguments)
    rows = PARTS[options.part](**{} if options.trials is None else {"trials": options.trials})
    for i, row in enumerate(rows):
        if i == 0:
            print(*(f"{key:20s}" for key in row))
        print(*(f"{f'{v:.3g}' if isinstance(v, float) else v!s:20s}" for v in row.values()), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""How often the 95 % intervals hold the known value: synthetic turbulence whose impedance is known.

    python scripts/coverage.py [--trials 2000] [--csv FILE]

Velocity is Gaussian turbulence of 3 m/s rms, alone or beside a tone of 3 m/s that all probes share. E[R] follows from
quadrature over the turbulence and the phase of the tone, so that the truth is Z(E[R]) of the liner `onera` at 1400 Hz.
Spectra: low-passed at 1 kHz, and two of exponential correlation (0.4 and 1.5 ms). A row of 2000 trials has a standard
error of 0.5 %.

A (z, x) plane holds many trials: each column is a liner of its own, whose admittance averaged over z goes the same way
through the code as that of a whole liner; its cells and probes are trials, too. A short record is off in the mean,
because the admittance of probes is not linear in it, and phase-locked averaging takes off some of its turbulence: the
intervals are to hold the known value nevertheless.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

import torchliner as tl
from common import options_of, parser_of
from torchliner.io.csv_rows import write_rows
from torchliner.liners.model import LinerModel
from torchliner.records.educed import Educed, Interval

RATE, FREQUENCY, RMS = 42000.0, 1400.0, 3.0
PER_PERIOD = 30  # samples
TONES = {"no tone": 0.0, "tone": 3.0}  # m/s
PERIODS = (8, 16, 100)
PITCH = 0.01  # m, of the cells
AVERAGINGS = ("admittance", "phase-locked")
AT_ONCE = 2_000_000  # samples of a plane
LONG = 50  # periods, from which a liner has a quarter of the trials


@dataclass(frozen=True)
class Column:
    """A liner of ``cells`` cells of ``size`` probes, which share half of their energy or none."""

    name: str
    cells: int
    size: int
    shares: bool


COLUMNS = (Column("liner of 8 cells", 8, 16, True), Column("liner of 200", 1, 200, False))


def low_passed(frequency: Tensor) -> Tensor:
    """Amplitude of noise up to 1 kHz."""
    return ((frequency > 0) & (frequency <= 1000)).to(torch.float64)


def exponential(seconds: float) -> Callable[[Tensor], Tensor]:
    """Amplitude of noise whose correlation falls like exp(-t/seconds)."""
    return lambda frequency: 1 / torch.sqrt(1 + (2 * math.pi * frequency * seconds) ** 2)


SPECTRA = {
    "1 kHz noise": low_passed,
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


def plane_of(spectrum: str, column: Column, periods: int, tone: float, count: int, seed: int) -> tl.VelocityPlane:
    """``count`` columns side by side, each of which is a liner."""
    random, samples = torch.Generator().manual_seed(seed), periods * PER_PERIOD
    velocity = turbulence(spectrum, (column.cells, column.size, count), samples, random)
    if column.shares:
        shared = turbulence(spectrum, (column.cells, 1, count), samples, random)
        velocity = velocity.add_(shared).mul_(math.sqrt(0.5))
    velocity += (tone * torch.sin(2 * math.pi / PER_PERIOD * torch.arange(samples, dtype=torch.float64))).float()
    z = (torch.arange(column.cells * column.size) + 0.5) * PITCH / column.size
    x = (torch.arange(count) + 0.5) * PITCH
    return tl.VelocityPlane(velocity.flatten(0, 1), sampling_rate=RATE, frequency=FREQUENCY, x=x.double(), z=z.double())


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


def trials_of(found: tl.ImpedanceMap, column: Column, averaging: str) -> dict[str, Educed]:
    """Those of a plane whose records are independent: one probe of each cell, the cells, the columns."""
    if column.cells == 1:
        return {column.name: found.along_x[averaging]}
    one = found.probes[averaging].map(lambda each: each.unflatten(0, (column.cells, column.size))[:, 0].flatten())
    return {"probe": one, f"cell of {column.size}": found.cells[averaging], column.name: found.along_x[averaging]}


def summary(parts: Sequence[Educed], true: complex) -> dict[str, object]:
    """Share of intervals that hold the known value, their median widths, and the mean error of the values in their own
    standard deviations."""
    interval = Interval.joined([part.interval.map(Tensor.flatten) for part in parts if part.interval is not None])
    value = torch.cat([part.impedance.flatten() for part in parts])
    low, high, off = (torch.view_as_real(each - true).T for each in (interval.low, interval.high, value))
    numbers = {"{} inside (%)": 100 * ((low <= 0) & (high >= 0)).double().mean(1)}
    numbers |= {"width of {}": (high - low).median(1).values, "{} off (sd)": off.mean(1) / off.std(1)}
    found = {name.format(part): float(each[i]) for name, each in numbers.items() for i, part in enumerate("RX")}
    return {"trials": len(value), **found, "runs": float(interval.runs.median())}


def rows_of(column: Column, spectrum: str, periods: int, trials: int, liner: LinerModel) -> Iterator[dict[str, object]]:
    """One for each tone, averaging and size of the average."""
    columns = math.ceil(trials / 4) if periods >= LONG else trials
    at_once = max(1, AT_ONCE // (column.cells * column.size * periods * PER_PERIOD))
    for name, tone in TONES.items():
        done: dict[tuple[str, str], list[Educed]] = {}
        for seed, first in enumerate(range(0, columns, at_once)):
            count = min(at_once, columns - first)
            found = tl.educe(plane_of(spectrum, column, periods, tone, count, seed), liner)
            for averaging in AVERAGINGS:
                for size, each in trials_of(found, column, averaging).items():
                    done.setdefault((averaging, size), []).append(each)
        for (averaging, size), parts in done.items():
            about = {"of": size, "averaging": averaging, "spectrum": spectrum, "v": name}
            yield about | {"periods": periods} | summary(parts, true_impedance(liner, tone))


def main(arguments: Sequence[str] | None = None) -> int:
    parser = parser_of(__doc__)
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--spectra", nargs="+", choices=SPECTRA, default=list(SPECTRA))
    parser.add_argument("--periods", nargs="+", type=int, default=PERIODS)
    parser.add_argument("--csv", type=Path, help="write the table")
    options = options_of(parser, arguments)
    liner = tl.load_liner("onera")
    assert isinstance(liner, tl.SDoFLiner)
    liner = dataclasses.replace(liner, cell_pitch=PITCH)
    print(*(f"truth with {name}: {true_impedance(liner, tone):.4f}" for name, tone in TONES.items()), sep="\n")
    done: list[dict[str, object]] = []
    for spectrum, column, periods in itertools.product(options.spectra, COLUMNS, options.periods):
        for row in rows_of(column, spectrum, periods, options.trials, liner):
            if not done:
                print(*(f"{key:20s}" for key in row))
            done.append(row)
            print(*(f"{f'{v:.3g}' if isinstance(v, float) else v!s:20s}" for v in row.values()), flush=True)
    if options.csv is not None:
        write_rows(done, options.csv)
    return 0


if __name__ == "__main__":
    sys.exit(main())

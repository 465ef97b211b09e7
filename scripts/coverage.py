"""How often the 95 % intervals hold the truth: synthetic turbulence whose impedance is known.

    python scripts/coverage.py [--trials 2000] [--csv FILE]

Every probe (or cell of probes) is a trial: Gaussian velocity of 3 m/s rms, whose E[R] follows from
quadrature, so that the truth is Z(E[R]) of the liner `onera` at 1400 Hz. Spectra: low-passed at
1 kHz, and two of exponential correlation (0.4 and 1.5 ms). A row of 2000 trials has a standard
error of 0.5 %.

Stations are bursts of 10 s at random arrivals, held until the next one (a held value has the
distribution of the velocity itself, so that the truth is the same), educed by segments of 1 s; ten
of them are a line.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import torch

import torchliner as tl
from common import options_of, parser_of
from torchliner.io.csv_rows import write_rows

RATE, FREQUENCY, RMS = 42000.0, 1400.0, 3.0
RECORDS = {"16 periods": 16, "100 periods": 100, "1 s": 1400}
TRIALS = 500  # of one seed
IN_A_CELL, PITCH = 16, 12.44e-3  # probes; m, of the liner
STATION, ARRIVALS, IN_A_LINE = 10.0, 4200.0, 10  # s; a second; stations
FASTEST = 10 * RMS  # 10 standard deviations: no record exceeds it


def low_passed(frequency: torch.Tensor) -> torch.Tensor:
    """Amplitude of noise up to 1 kHz."""
    return ((frequency > 0) & (frequency <= 1000)).to(torch.float64)


def exponential(seconds: float) -> Callable[[torch.Tensor], torch.Tensor]:
    """Amplitude of noise whose correlation falls like exp(-t/seconds)."""
    return lambda frequency: 1 / torch.sqrt(1 + (2 * math.pi * frequency * seconds) ** 2)


SPECTRA = {
    "1 kHz noise": low_passed,
    "exponential, 0.4 ms": exponential(0.4e-3),
    "exponential, 1.5 ms": exponential(1.5e-3),
}


def velocity(
    amplitude: Callable[[torch.Tensor], torch.Tensor], probes: int, samples: int, seed: int
) -> torch.Tensor:
    """Gaussian noise (probes, samples), m/s, of ``RMS`` in the mean over records."""
    length = 1 << math.ceil(math.log2(2 * samples))  # cut from twice as much: no periodicity
    generator = torch.Generator().manual_seed(seed)
    weights = amplitude(torch.fft.rfftfreq(length, 1 / RATE, dtype=torch.float64))
    power = float(2 * (weights**2).sum() - weights[0] ** 2 - weights[-1] ** 2) / length
    parts = []
    for low in range(0, probes, 100):
        white = torch.randn(min(100, probes - low), length, generator=generator)
        shaped = torch.fft.irfft(torch.fft.rfft(white) * weights, n=length)
        parts.append((shaped[:, :samples] * (RMS / math.sqrt(power))).to(torch.float32))
    return torch.cat(parts)


def true_impedance(liner: tl.SDoFLiner) -> complex:
    """Z of E[R(|v|)] for Gaussian v: Gauss-Hermite quadrature would miss the corner at 0."""
    speed = torch.linspace(0, FASTEST, 400001, dtype=torch.float64)
    density = torch.exp(-((speed / RMS) ** 2) / 2) * math.sqrt(2 / math.pi) / RMS
    reflection = tl.reflection_from_impedance(liner.impedance(FREQUENCY, speed))
    mean = torch.trapezoid(reflection * density, speed)
    return complex(tl.impedance_from_reflection(mean))


def plane_of_probes(spectrum: str, count: int, samples: int, seed: int) -> tl.VelocityPlane:
    """Independent probes."""
    return tl.VelocityPlane(velocity(SPECTRA[spectrum], count, samples, seed), sampling_rate=RATE)


def plane_of_cells(spectrum: str, count: int, samples: int, seed: int) -> tl.VelocityPlane:
    """Cells of 16 probes that share half of their energy."""
    shared = velocity(SPECTRA[spectrum], count, samples, seed).repeat_interleave(IN_A_CELL, 0)
    own = velocity(SPECTRA[spectrum], count * IN_A_CELL, samples, seed + 500_000)
    x = (np.arange(len(own)) + 0.5) * PITCH / IN_A_CELL
    return tl.VelocityPlane((shared + own) / math.sqrt(2), sampling_rate=RATE, x=x)


def coverage(
    spectrum: str, periods: int, trials: int, liner: tl.SDoFLiner, *, of: str = "probe"
) -> dict[str, float]:
    """Share of probes or cells (%) whose interval holds the truth, and the median width.

    A cell's mean admittance has the truth of its probes, which are alike in the mean.
    """
    make, name = {
        "probe": (plane_of_probes, "probes"), "cell of 16": (plane_of_cells, "cells"),
    }[of]  # fmt: skip
    true = true_impedance(liner)
    inside, widths, runs = [], [], []
    samples = round(periods * RATE / FREQUENCY)
    for seed in range(math.ceil(trials / TRIALS)):
        count = min(TRIALS, trials - seed * TRIALS)
        plane = make(spectrum, count, samples, 1000 * seed + periods)
        found = tl.educe(plane, liner, FREQUENCY, velocity_max=FASTEST).uncertainty
        interval = getattr(found, name)
        low, high = interval.low[:, 0].numpy(), interval.high[:, 0].numpy()
        for part in (np.real, np.imag):
            inside.append((part(low) <= part(true)) & (part(true) <= part(high)))
            widths.append(part(high) - part(low))
        runs.append(interval.runs.numpy())
    return _summary(inside, widths, runs)


def _summary(
    inside: list[np.ndarray], widths: list[np.ndarray], runs: list[np.ndarray]
) -> dict[str, float]:
    """Resistance and reactance take turns in the lists."""
    return {
        "R inside (%)": 100 * float(np.mean(np.concatenate(inside[0::2]))),
        "X inside (%)": 100 * float(np.mean(np.concatenate(inside[1::2]))),
        "width of R": float(np.median(np.concatenate(widths[0::2]))),
        "width of X": float(np.median(np.concatenate(widths[1::2]))),
        "runs": float(np.median(np.concatenate(runs))),
    }


def bursts(spectrum: str, seed: int) -> tl.BurstRecord:
    """A station of ``STATION`` seconds."""
    values = velocity(SPECTRA[spectrum], 1, round(STATION * RATE), seed)[0]
    generator = torch.Generator().manual_seed(seed + 700_000)
    met = torch.rand(len(values), generator=generator) < ARRIVALS / RATE
    times = torch.arange(len(values), dtype=torch.float64)[met] / RATE
    return tl.BurstRecord(times, wall_normal=values[met], x=float(seed), y=1e-3, z=0.0,
                          name=f"station {seed}")  # fmt: skip


def station_coverage(spectrum: str, trials: int, liner: tl.SDoFLiner) -> list[dict[str, object]]:
    """As ``coverage``, of stations and of lines of ten."""
    true = true_impedance(liner)
    found: dict[str, tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]]
    found = {"station": ([], [], []), f"line of {IN_A_LINE}": ([], [], [])}
    for first in range(0, trials, IN_A_LINE):
        line = tl.educe_bursts(
            [bursts(spectrum, first + i) for i in range(IN_A_LINE)], liner, FREQUENCY,
            method="hold", correction="none", grid_rate=2 * ARRIVALS, velocity_max=FASTEST,
            flagged="use", monte_carlo=2,
        )  # fmt: skip
        assert line.interval is not None
        assert line.average is not None
        assert line.average.interval is not None
        of_both = (line.interval, line.average.interval)
        for interval, lists in zip(of_both, found.values(), strict=True):
            low, high = interval.low.reshape(-1).numpy(), interval.high.reshape(-1).numpy()
            for part in (np.real, np.imag):
                lists[0].append((part(low) <= part(true)) & (part(true) <= part(high)))
                lists[1].append(part(high) - part(low))
            lists[2].append(interval.runs.reshape(-1).numpy())
    return [
        {"of": of, "spectrum": spectrum, "record": f"{STATION:g} s of bursts",
         "trials": sum(len(part) for part in lists[2]), **_summary(*lists)}
        for of, lists in found.items()
    ]  # fmt: skip


def rows(trials: int, *, only_stations: bool = False) -> Iterator[dict[str, object]]:
    liner = tl.load_liner("onera")
    assert isinstance(liner, tl.SDoFLiner)
    cases = [("probe", spectrum, record) for spectrum in SPECTRA for record in RECORDS]
    cases += [("cell of 16", "1 kHz noise", record) for record in list(RECORDS)[:2]]
    for of, spectrum, record in [] if only_stations else cases:
        yield {"of": of, "spectrum": spectrum, "record": record, "trials": trials} | coverage(
            spectrum, RECORDS[record], trials, liner, of=of
        )
    for spectrum in SPECTRA:
        yield from station_coverage(spectrum, trials, liner)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = parser_of(__doc__)
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--only-stations", action="store_true", help="leave the planes out")
    parser.add_argument("--csv", type=Path, help="write the table")
    options = options_of(parser, arguments)
    true = true_impedance(tl.load_liner("onera"))
    print(f"truth {true:.4f}, {options.trials} trials a row, 95 % intervals")
    done = []
    for row in rows(options.trials, only_stations=options.only_stations):
        done.append(row)
        print("  ".join(
            f"{value:.3g}" if isinstance(value, float) else f"{value!s:20s}"
            for value in row.values()
        ), flush=True)  # fmt: skip
    if options.csv is not None:
        write_rows(done, options.csv)
    return 0


if __name__ == "__main__":
    sys.exit(main())

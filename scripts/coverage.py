"""How often the 95 % intervals hold the truth: synthetic turbulence whose impedance is known.

    python scripts/coverage.py [--trials 2000] [--csv FILE]

Every probe (or cell of probes) is a trial: Gaussian velocity of 3 m/s rms, whose E[R] follows from
quadrature, so that the truth is Z(E[R]) of the liner `onera` at 1400 Hz. Spectra: low-passed at
1 kHz, and two of exponential correlation (0.4 and 1.5 ms). A row of 2000 trials has a standard
error of 0.5 %. R is the mean of R(|v|) over whole periods, each sample with weight 1 or with that
of a Hann window on the times of emission.

Stations are bursts of 10 s at random arrivals, held until the next one (a held value has the
distribution of the velocity itself, so that the truth is the same), educed by segments of 1 s; ten
of them are a line.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch

import torchliner as tl
from common import options_of, parser_of
from torchliner.conversions import admittance_from_reflection
from torchliner.io.csv_rows import write_rows
from torchliner.liners.model import LinerModel
from torchliner.records import Interval
from torchliner.signals.blocks import MOST_BLOCKS, plan_blocks
from torchliner.signals.resampling import Resampling
from torchliner.signals.windows import make_window
from torchliner.tdibc.groups import Groups, Members

RATE, FREQUENCY, RMS = 42000.0, 1400.0, 3.0
RECORDS = {"16 periods": 16, "100 periods": 100, "1 s": 1400}
TRIALS, PROBES = 500, 8000  # of one seed: alone, and in averages
STATION, ARRIVALS, IN_A_LINE = 10.0, 4200.0, 10  # s; a second; stations
FASTEST = 10 * RMS  # 10 standard deviations: no record exceeds it
WINDOWS = ("boxcar", "hann")
LEVEL = 0.95


@dataclass(frozen=True)
class Average:
    """Of ``size`` probes, which share half of their energy or none."""

    size: int
    shares: bool


AVERAGES = {"cell of 16": Average(16, True), "mean of 200": Average(200, False)}


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


def velocity(amplitude: Callable[[torch.Tensor], torch.Tensor], probes: int, samples: int, seed: int) -> torch.Tensor:
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


def true_impedance(liner: LinerModel) -> complex:
    """Z of E[R(|v|)] for Gaussian v: Gauss-Hermite quadrature would miss the corner at 0."""
    speed = torch.linspace(0, FASTEST, 400001, dtype=torch.float64)
    density = torch.exp(-((speed / RMS) ** 2) / 2) * math.sqrt(2 / math.pi) / RMS
    reflection = tl.reflection_from_impedance(liner.impedance(FREQUENCY, speed))
    mean = torch.trapezoid(reflection * density, speed)
    return complex(tl.impedance_from_reflection(mean))


def probes(spectrum: str, count: int, samples: int, seed: int) -> torch.Tensor:
    """Velocity of independent probes, (count, samples)."""
    return velocity(SPECTRA[spectrum], count, samples, seed)


def members(spectrum: str, count: int, samples: int, seed: int, of: Average) -> torch.Tensor:
    """Velocity of the probes of averages, (size x count, samples)."""
    own = velocity(SPECTRA[spectrum], count * of.size, samples, seed + 500_000)
    if not of.shares:
        return own
    shared = velocity(SPECTRA[spectrum], count, samples, seed).repeat_interleave(of.size, 0)
    return (shared + own) / math.sqrt(2)


def block_means(
    speed: torch.Tensor, liner: LinerModel, window: str, most: int = MOST_BLOCKS
) -> tuple[torch.Tensor, torch.Tensor]:
    """Mean R of each block under a window, (S, N), and the blocks' weights, of sum 1, (S,)."""
    blocks = plan_blocks(speed.shape[1], 0, RATE / FREQUENCY, most)
    weight = make_window(window, blocks.borders[-1]).weights
    share = blocks.sums(weight)
    sums = torch.empty(blocks.count, len(speed), dtype=torch.complex128)
    for s, (begin, end) in enumerate(pairwise(blocks.borders)):
        z = liner.impedance(FREQUENCY, speed[:, begin:end].abs().to(torch.float64))
        sums[s] = tl.reflection_from_impedance(z) @ weight[begin:end].to(sums)
    return sums / share[:, None], share / share.sum()


def interval_of_probes(series: torch.Tensor, how: Resampling) -> Interval:
    """Each by itself, from R of each block, (S, N)."""
    return how.over_time(series - series.mean(0), how.weights.to(series) @ series)


def interval_of_averages(series: torch.Tensor, how: Resampling, size: int) -> Interval:
    """Mean admittance of each ``size`` columns of R, (S, size x C)."""
    value, away = (how.weights.to(series) @ series)[:, None], (series - series.mean(0))[..., None]
    count, whole = len(value) // size, slice(0, len(value))
    groups = Groups(
        torch.arange(count).repeat_interleave(size), count,
        admittance_from_reflection(value), len(series),
    )  # fmt: skip
    groups.add(Members.of(whole, value, away, how.scatter(away)))
    return groups.interval(how).map(lambda field: field[:, 0])


def coverage(
    spectrum: str, periods: int, trials: int, liner: LinerModel, *, of: str = "probe",
    window: str = "boxcar", most: int = MOST_BLOCKS,
) -> dict[str, float]:  # fmt: skip
    """Share of probes or cells (%) whose interval holds the truth, and the median width.

    A cell's mean admittance has the truth of its probes, which are alike in the mean.
    """
    average = AVERAGES.get(of)
    at_once = TRIALS if average is None else PROBES // average.size
    true = true_impedance(liner)
    inside, widths, runs = [], [], []
    samples = round(periods * RATE / FREQUENCY)
    for seed in range(math.ceil(trials / at_once)):
        about = spectrum, min(at_once, trials - seed * at_once), samples, 1000 * seed + periods
        speed = probes(*about) if average is None else members(*about, average)
        series, weights = block_means(speed, liner, window, most)
        how = Resampling(weights, LEVEL)
        if average is None:
            interval = interval_of_probes(series, how)
        else:
            interval = interval_of_averages(series, how, average.size)
        low, high = interval.low.numpy(), interval.high.numpy()
        for part in (np.real, np.imag):
            inside.append((part(low) <= part(true)) & (part(true) <= part(high)))
            widths.append(part(high) - part(low))
        runs.append(interval.runs.numpy())
    return _summary(inside, widths, runs)


def _summary(inside: list[np.ndarray], widths: list[np.ndarray], runs: list[np.ndarray]) -> dict[str, float]:
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


def station_coverage(spectrum: str, trials: int, liner: LinerModel) -> list[dict[str, object]]:
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
        {"of": of, "window": "segments", "spectrum": spectrum, "record": f"{STATION:g} s of bursts",
         "trials": sum(len(part) for part in lists[2]), **_summary(*lists)}
        for of, lists in found.items()
    ]  # fmt: skip


def rows(trials: int, *, only_stations: bool = False, only_planes: bool = False) -> Iterator[dict[str, object]]:
    liner = tl.load_liner("onera")
    assert isinstance(liner, tl.SDoFLiner)
    cases = [("probe", spectrum, record) for spectrum in SPECTRA for record in RECORDS]
    cases += [("cell of 16", "1 kHz noise", record) for record in list(RECORDS)[:2]]
    cases += [("mean of 200", spectrum, "16 periods") for spectrum in list(SPECTRA)[::2]]
    for window in [] if only_stations else WINDOWS:
        for of, spectrum, record in cases:
            found = coverage(spectrum, RECORDS[record], trials, liner, of=of, window=window)
            yield {"of": of, "window": window, "spectrum": spectrum, "record": record,
                   "trials": trials, **found}  # fmt: skip
    for spectrum in [] if only_planes else SPECTRA:
        yield from station_coverage(spectrum, trials, liner)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = parser_of(__doc__)
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--only-stations", action="store_true", help="leave the planes out")
    parser.add_argument("--only-planes", action="store_true", help="leave the stations out")
    parser.add_argument("--csv", type=Path, help="write the table")
    options = options_of(parser, arguments)
    true = true_impedance(tl.load_liner("onera"))
    print(f"truth {true:.4f}, {options.trials} trials a row, 95 % intervals")
    done = []
    for row in rows(options.trials, only_stations=options.only_stations, only_planes=options.only_planes):
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

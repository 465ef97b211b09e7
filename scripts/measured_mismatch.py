"""Upstream against downstream source on a real lined duct: wavenumbers and impedance, 200-1480 Hz.

    python scripts/measured_mismatch.py liner.txt [-o docs/figures] [--spacing 55] [--scan]

The file is that of a public package for duct acoustics (MIT licence): columns of complex numbers, a
header naming them. It is read where it is and not part of this repository. Spacing of the ten
microphones over the liner and the height normal to it are not in it, so they are arguments: the
wavenumbers need the spacing alone, the impedances both.
"""

from __future__ import annotations

import dataclasses
import math
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import least_squares
from torch import Tensor

import torchliner as tl
from common import FIGURES, parser_of
from studies.mismatch import MeasuredWave, draw_mismatch, wave_rows
from torchliner.io.csv_rows import write_rows
from torchliner.pressure.plane_waves import split_waves
from torchliner.records import MicrophoneLine, WallEduction

HEADER = ("Mach-Number upstream", "temperature upstream", "f", "Mic1 Liner", "Mic10 Liner", "case")
CASES = {"upstream": 0, "downstream": 2}  # source side: its number in the last column
REPEATED = 3  # a second measurement of case 2
MACH, TEMPERATURE, FREQUENCY, LINER, CASE = 0, 2, 4, slice(8, 18), 21
RIGID = {
    "before the liner": (slice(5, 8), (-0.249, -0.059, 0.0)),
    "behind the liner": (slice(18, 21), (0.0, 0.055, 0.248)),
}
HEARD = 0.15  # of the pressure: below it the reflected wave cannot be told from noise
BANDS = ((300, 450), (450, 700), (700, 1000), (1000, 1480))  # Hz
SCANNED = (40.0, 80.0)  # mm, heights of ``--scan`` besides the two
SPACINGS = (0.049, 0.051, 0.053, 0.055, 0.057, 0.059)  # m, of ``--scan``
Rows = NDArray[np.complex128]
Array = NDArray[np.float64]


def read_rows(path: Path) -> Rows:
    """All rows, (440, 22); the header must name the columns that are used."""
    with path.open(encoding="utf-8") as file:
        header = file.readline().lstrip("# ").strip().split(",")
    missing = [name for name in HEADER if name not in header]
    if missing or len(header) != CASE + 1:
        raise ValueError(
            f"{path}: the header names {len(header)} columns, without {missing}; {CASE + 1} "
            f"columns with {', '.join(HEADER)} are needed"
        )
    rows = np.loadtxt(path, dtype=complex, delimiter=",", comments="#")
    if not np.isfinite(rows).all():
        raise ValueError(f"{path} holds values that are not finite")
    return rows


def line_of(rows: Rows, case: int, side: str, height: float, spacing: float) -> MicrophoneLine:
    """The ten microphones over the liner, frequencies increasing."""
    some = rows[rows[:, CASE].real == case]
    if not len(some):
        raise ValueError(f"the file holds no rows of case {case}")
    some = some[np.argsort(some[:, FREQUENCY].real)]
    mach, temperature = (np.unique(some[:, column].real) for column in (MACH, TEMPERATURE))
    if len(mach) > 1 or len(temperature) > 1:
        raise ValueError(f"case {case} has several Mach numbers or temperatures: {mach}, K {temperature}")
    return MicrophoneLine(
        spacing * np.arange(10),
        some[:, LINER].T,
        some[:, FREQUENCY].real,
        duct_height=height,
        mach=float(mach[0]),
        source_side=side,
        fluid=tl.Fluid.from_temperature(float(temperature[0])),
        name=f"case {case}, source {side}",
    )


def error_of(line: MicrophoneLine) -> tuple[float, float]:
    """Standard deviations in dB and degrees that two free waves leave, median over frequency.

    Four complex numbers are fitted to the N pressures; a complex error of relative variance s^2 is
    s/sqrt(2) nepers in level and s/sqrt(2) radians in phase.
    """
    free = tl.two_wave_fit(line, tied=False)
    count = line.microphones
    error = float(free.residual.median()) * math.sqrt(count / (count - 4) / 2)
    return 20 * error / math.log(10), math.degrees(error)


def waves_of(line: MicrophoneLine, draws: int) -> list[MeasuredWave]:
    """By Kumaresan and Tufts, by the two-wave fit, and both waves of a free fit."""
    level, phase = error_of(line)
    seed = torch.Generator().manual_seed(0)
    with_source = "downstream" if line.source_side == "upstream" else "upstream"
    found = [
        method(line, draws=draws, level_error=level, phase_error=phase, generator=seed)
        for method in (tl.kumaresan_tufts, tl.two_wave_fit)
    ]
    free = tl.two_wave_fit(line, tied=False)
    back = MeasuredWave.of(line.source_side, free, line, mode=1)
    return [
        *(MeasuredWave.of(with_source, each, line) for each in (*found, free)),
        back.where(share_of(free, line) > HEARD),
    ]


def share_of(found: WallEduction, line: MicrophoneLine) -> Tensor:
    """rms over the microphones of the reflected wave over that of both, (F,)."""
    distance = (line.x - found.origin)[:, None, None]
    parts = (found.amplitudes * torch.exp(-1j * found.modes * distance)).abs().square().sum(0)
    return (parts[1] / parts.sum(0)).sqrt()


def apparent_mach(rows: Rows, cases: Sequence[int]) -> dict[str, tuple[float, float]]:
    """Of plane waves in the rigid ducts at known places: the M that leaves least, and what."""
    some = rows[np.isin(rows[:, CASE].real, cases)]
    frequency = torch.from_numpy(some[:, FREQUENCY].real.copy())
    speed = float(tl.Fluid.from_temperature(float(some[0, TEMPERATURE].real)).sound_speed)
    found = {}
    for name, (columns, places) in RIGID.items():
        pressure = torch.from_numpy(some[:, columns].T.copy())
        x = torch.tensor(places, dtype=torch.float64)
        left = [
            (float(split_waves(pressure, x, frequency, speed, mach)[1].median()), mach)
            for mach in np.arange(0.15, 0.351, 0.005).tolist()
        ]
        found[name] = (min(left)[1], min(left)[0])
    return found


def mismatch_lines(rows: Rows, heights: Sequence[float], spacing: float, machs: Sequence[float]) -> list[str]:
    """Median impedances by band, of both waves in both records, for heights and Mach numbers."""
    lines = [
        f"{'H mm':>5s} {'M':>6s} {'band Hz':>9s} | downstream wave: "
        f"{'source up':>13s} {'source down':>13s} | upstream wave: {'source down':>13s} "
        f"{'source up':>13s} | |dZ|/|Z| of directions, of sources"
    ]
    for height in heights:
        for mach in machs:
            both = [
                dataclasses.replace(line_of(rows, case, side, height, spacing), mach=mach)
                for side, case in CASES.items()
            ]
            lines += _band_lines(both, height, mach)
    return lines


def _band_lines(both: Sequence[MicrophoneLine], height: float, mach: float) -> list[str]:
    """Free fits; the reflected waves where they are heard."""
    common, *index = np.intersect1d(*(each.frequency.numpy() for each in both), return_indices=True)
    with_source: list[Rows] = []
    back: list[Rows] = []
    for line, some in zip(both, index, strict=True):
        fit = tl.two_wave_fit(line, tied=False)
        for mode, into in ((0, with_source), (1, back)):
            wall = MeasuredWave.of("", fit, line, mode=mode).impedance.numpy()[some]
            heard = (share_of(fit, line) > HEARD).numpy()[some]
            into.append(np.where(heard | (mode == 0), wall, np.nan))
    lines = []
    for low, high in BANDS:
        band = (common >= low) & (common <= high)
        values = [each[band] for each in (with_source[0], back[1], with_source[1], back[0])]
        down, _, up, up_again = values
        first, second, third, fourth = (_median(each) for each in values)
        lines.append(
            f"{1e3 * height:5.0f} {mach:6.3f} {low:4d}-{high:4d} | {'':16s} {first:>13s} "
            f"{second:>13s} | {'':14s} {third:>13s} {fourth:>13s} | "
            f"{_distance(down, up)} {_distance(up_again, up)}"
        )
    return lines


def _distance(one: Rows, other: Rows) -> str:
    """Median of |one/other - 1|, where there are both."""
    apart = np.abs(one / other - 1)
    return f"{np.nanmedian(apart):.3f}" if np.isfinite(apart).any() else "-"


def _median(values: NDArray[np.complex128]) -> str:
    """Of what is not nan, if that is at least five values."""
    good = values[np.isfinite(values)]
    if len(good) < 5:
        return "-"
    return f"{np.median(good.real):.2f}{np.median(good.imag):+.2f}j"


def height_lines(rows: Rows, heights: Sequence[float], spacing: float, mach: float) -> list[str]:
    """What each height makes of the liner: X = m k - cot k D from 300 to 1000 Hz, and X = 0."""
    lines = []
    for height in heights:
        for side, case in CASES.items():
            line = dataclasses.replace(line_of(rows, case, side, height, spacing), mach=mach)
            found = tl.two_wave_fit(line).impedance.numpy()
            k = 2 * np.pi * line.frequency.numpy() / float(line.fluid.sound_speed)
            band = (line.frequency.numpy() >= 300) & (line.frequency.numpy() <= 1000)
            (mass, depth), left = _resonator(k[band], found[band].imag)
            sign = np.flatnonzero(np.diff(np.sign(found[band].imag)) > 0)
            lines.append(
                f"H {1e3 * height:.0f} mm, M {mach:.3f}, source {side}: X = 0 near "
                f"{float(line.frequency[band][sign[0]]) if len(sign) else math.nan:.0f} Hz; mass "
                f"{1e3 * mass:.0f} mm, cavity {1e3 * depth:.0f} mm leave {left:.2f} rms in X; "
                f"median R {np.median(found[band].real):.2f}"
            )
    return lines


def _resonator(k: Array, reactance: Array) -> tuple[tuple[float, float], float]:
    """Mass and depth (m) of m k - cot k D by least squares, and the rms that they leave."""

    def off(trial: Array) -> Array:
        return np.asarray(trial[0] * k - 1 / np.tan(k * trial[1]) - reactance)

    fits = [least_squares(off, start) for start in ((0.02, 0.05), (0.1, 0.05), (0.6, 0.01))]
    best = min(fits, key=lambda fit: fit.cost)
    return (float(best.x[0]), float(best.x[1])), math.sqrt(2 * best.cost / len(k))


def scan_lines(rows: Rows, heights: Sequence[float], machs: Sequence[float]) -> list[str]:
    """What the tied fit leaves over the free one, by spacing, height and Mach number."""
    lines = ["rms residual of the tied fit over that of the free one, medians, sources up and down"]
    for mach in machs:
        for height in heights:
            cells = []
            for spacing in SPACINGS:
                pair = []
                for side, case in CASES.items():
                    line = line_of(rows, case, side, height, spacing)
                    line = dataclasses.replace(
                        line, mach=mach, pressure=line.pressure[:, ::2], frequency=line.frequency[::2]
                    )
                    tied, free = (tl.two_wave_fit(line, tied=t).residual for t in (True, False))
                    pair.append(f"{float((tied / free).median()):.2f}")
                cells.append(f"{1e3 * spacing:.0f} mm {'/'.join(pair)}")
            lines.append(f"M {mach:.3f}, H {1e3 * height:3.0f} mm: " + ", ".join(cells))
    return lines


def repeatability(rows: Rows, spacing: float) -> str:
    """Of wavenumbers between two measurements of the same case."""
    lines = [line_of(rows, case, "downstream", 0.02, spacing) for case in (CASES["downstream"], REPEATED)]
    found = [tl.kumaresan_tufts(line) for line in lines]
    common, *index = np.intersect1d(*(x.frequency.numpy() for x in lines), return_indices=True)
    k = 2 * np.pi * torch.from_numpy(common) / float(lines[0].fluid.sound_speed)
    off = ((found[0].wavenumber[index[0]] - found[1].wavenumber[index[1]]) / k).abs()
    return (
        f"wavenumbers of two measurements at {len(common)} frequencies: |d alpha|/k "
        f"{float(off.median()):.4f} in the median, {float(off.max()):.3f} at most"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    parser = parser_of(__doc__, FIGURES)
    parser.add_argument("file", type=Path, help="liner.txt")
    parser.add_argument("--spacing", type=float, default=55.0, help="of the microphones, mm")
    parser.add_argument("--heights", type=float, nargs="+", default=[20.0, 110.0], help="mm")
    parser.add_argument("--draws", type=int, default=500)
    parser.add_argument("--scan", action="store_true", help="residuals over spacing and height")
    options = parser.parse_args(arguments)
    warnings.showwarning = lambda message, *_, **__: print(f"warning: {message}", file=sys.stderr)
    rows = read_rows(options.file)
    spacing, heights = 1e-3 * options.spacing, [1e-3 * height for height in options.heights]
    options.output.mkdir(parents=True, exist_ok=True)
    waves = [
        wave
        for height in heights
        for side, case in CASES.items()
        for wave in waves_of(line_of(rows, case, side, height, spacing), options.draws)
    ]
    for side, case in CASES.items():
        level, phase = error_of(line_of(rows, case, side, heights[0], spacing))
        print(f"source {side}: two free waves leave {level:.2f} dB, {phase:.1f} degrees a microphone")
    print(repeatability(rows, spacing))
    apparent = apparent_mach(rows, list(CASES.values()))
    for name, (mach, left) in apparent.items():
        print(f"plane waves {name}: M = {mach:.3f} leaves least, {100 * left:.1f} %")
    machs = (float(rows[0, MACH].real), float(np.mean([mach for mach, _ in apparent.values()])))
    print("\n".join(mismatch_lines(rows, heights, spacing, machs)))
    print("\n".join(height_lines(rows, heights, spacing, machs[-1])))
    if options.scan:
        scanned = sorted({*heights, *(1e-3 * height for height in SCANNED)})
        print("\n".join(scan_lines(rows, scanned, machs)))
    write_rows([row for wave in waves for row in wave_rows(wave)], options.output / "measured_mismatch.csv")
    draw_mismatch(waves, heights, options.output / "measured_mismatch.png")
    print(f"figure and numbers are in {options.output}")


if __name__ == "__main__":
    main()

"""Upstream against downstream source on a real lined duct: wavenumbers and impedance, 200-1480 Hz.

    python scripts/measured_mismatch.py liner.txt [-o docs/figures] [--spacing 55]

The file is that of a public package for duct acoustics (MIT licence): columns of complex numbers, a header naming them.
It is not part of this repository. Spacing of the ten microphones over the liner and the height normal to it are not in
it: the wavenumbers need the spacing alone, the impedances both.
"""

import itertools
import math
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

import torchliner as tl
from common import FIGURES, parser_of
from torchliner.io.csv_rows import write_rows
from torchliner.records.wall_eduction import deviation as deviation_of
from torchliner.report import figure as fig
from torchliner.studies.variants import Row

HEADER = ("Mach-Number upstream", "temperature upstream", "f", "Mic1 Liner", "Mic10 Liner", "case")
CASES = {"upstream": 0, "downstream": 2}  # source side: its number in the last column
MACH, TEMPERATURE, FREQUENCY, LINER, CASE = 0, 2, 4, slice(8, 18), 21
HEARD = 0.15  # of the pressure: below it the reflected wave cannot be told from noise
BANDS = ((300, 450), (450, 700), (700, 1000), (1000, 1480))  # Hz
TIED, FREE = "two waves", "two free waves"  # as ``two_wave_fit`` names its results
LEVEL, NEPER, THIN = 0.95, 20 / np.log(10), 4  # of the shaded intervals; dB; every so manieth symbol


def lines_of(path: Path, heights: Sequence[float], spacing: float) -> list[tl.MicrophoneLine]:
    """The ten microphones over the liner, frequencies increasing, a line a height (m) and side of the source."""
    with path.open(encoding="utf-8") as file:
        header = file.readline().lstrip("# ").strip().split(",")
    missing = [name for name in HEADER if name not in header]
    if missing or len(header) != CASE + 1:
        raise ValueError(
            f"{path}: the header names {len(header)} columns, without {missing}; {CASE + 1} columns with "
            f"{', '.join(HEADER)} are needed"
        )
    rows, lines = np.loadtxt(path, dtype=complex, delimiter=",", comments="#"), []
    for height in heights:
        for side, case in CASES.items():
            some = rows[rows[:, CASE].real == case]
            if not len(some):
                raise ValueError(f"the file holds no rows of case {case}")
            some = some[np.argsort(some[:, FREQUENCY].real)]
            about: dict[str, Any] = {"duct_height": height, "mach": float(some[0, MACH].real), "source_side": side}
            about["fluid"] = tl.Fluid.from_temperature(float(some[0, TEMPERATURE].real))
            x, frequency = spacing * np.arange(10), some[:, FREQUENCY].real
            lines.append(tl.MicrophoneLine(x, some[:, LINER].T, frequency, name=f"source {side}", **about))
    return lines


def rows_of(line: tl.MicrophoneLine, draws: int) -> list[Row]:
    """A row a wave and frequency: Kumaresan and Tufts, the two-wave fit, and both waves of a free fit.

    Errors of level and phase are those that two free waves leave: four complex numbers are fitted to the N pressures; a
    complex error of relative variance s^2 is s/sqrt(2) nepers in level and s/sqrt(2) radians in phase.
    """
    free, count = tl.two_wave_fit(line, tied=False), line.microphones
    error = float(free.residual.median()) * math.sqrt(count / (count - 4) / 2)
    about: Any = {"draws": draws, "level_error": NEPER * error, "phase_error": math.degrees(error)}
    seed, sides = torch.Generator().manual_seed(0), ("downstream", "upstream")
    ahead, behind = sides if line.source_side == "upstream" else sides[::-1]
    print(f"source {line.source_side}: two free waves leave {NEPER * error:.2f} dB, {math.degrees(error):.1f} degrees")
    kt, tied = (method(line, generator=seed, **about) for method in (tl.kumaresan_tufts, tl.two_wave_fit))
    # rms over the microphones of the reflected wave over that of both.
    distance = (line.x - free.origin)[:, None, None]
    parts = (free.amplitudes * torch.exp(-1j * free.modes * distance)).abs().square().sum(0)
    heard = ((parts[1] / parts.sum(0)).sqrt() > HEARD).tolist()
    back = [row for row, known in zip(_wave(behind, free, line, True), heard, strict=True) if known]
    return [row for found in (kt, tied, free) for row in _wave(ahead, found, line)] + back


def _wave(direction: str, found: tl.WallEduction, line: tl.MicrophoneLine, reflected: bool = False) -> list[Row]:
    wave, z, gas = found.wavenumber, found.impedance, float(line.fluid.sound_speed)
    low = high = spread = None
    if found.draws is not None:
        (low, high), spread = found.interval(LEVEL), deviation_of(found.draws.wavenumber)  # type: ignore[attr-defined]
    if reflected:  # in coordinates of the flow the relation holds for either direction
        wave = found.modes[..., 1, :]
        about: Any = {"height": line.duct_height, "mach": line.mach, "condition": found.choices["condition"]}
        z = tl.impedance_from_wavenumber(wave, found.frequency, sound_speed=gas, **about)
    rows = []
    for i, f in enumerate(found.frequency.tolist()):
        row = Row(direction=direction, source=line.source_side, method=found.method, frequency=f)
        row |= {"reflected": int(reflected), "height": float(line.duct_height), "k": 2 * math.pi * f / gas}
        values = {"alpha": wave, "alpha_std": spread, "z": z, "z_low": low, "z_high": high}
        row |= {name: None if each is None else complex(each[i]) for name, each in values.items()}
        rows.append(Row(row, residual=float(found.residual[i])))
    return rows


def plain(row: Row) -> dict[str, str]:
    """Of the CSV, four digits."""
    found = {name: str(row[name]) for name in ("direction", "source", "method", "reflected")}
    found |= {"height_mm": f"{1e3 * row.height:g}", "frequency_hz": f"{row.frequency:g}"}
    for name, unit in (("alpha", "_per_m"), ("alpha_std", "_per_m"), ("z", ""), ("z_low", ""), ("z_high", "")):
        for part in ("real", "imag"):
            found[f"{name}_{part}{unit}"] = "" if row[name] is None else f"{getattr(row[name], part):.4g}"
    return found | {"residual": f"{row.residual:.3g}"}


def print_bands(rows: Sequence[Row], height: float) -> None:
    """Median Z by band, of both waves in both records."""
    for low, high in BANDS:
        words, here = [], [r for r in rows if (r.method, r.height) == (FREE, height) and low <= r.frequency <= high]
        for wave, source in itertools.product(("downstream", "upstream"), CASES):
            z = np.array([row.z for row in here if (row.direction, row.source) == (wave, source)])
            middle = f"{np.median(z.real):.2f}{np.median(z.imag):+.2f}j" if len(z) > 4 else "-"
            words.append(f"{wave} wave, source {source} {middle}")
        print(f"H {1e3 * height:g} mm, {low}-{high} Hz: {'; '.join(words)}")


def curves_of(rows: Sequence[Row], height: float, left_out: str, value: Any) -> list[dict[str, Any]]:
    """A curve a wave: lines for the fits, dots for Kumaresan and Tufts, open symbols for reflected waves; ``value``
    takes a row. Fits of the method ``left_out`` are not drawn."""
    waves: dict[Any, list[Row]] = {}
    for row in rows:
        if row.height == height and (row.reflected or row.method != left_out):
            waves.setdefault((row.direction, row.source, row.method, row.reflected), []).append(row)
    curves = []
    for (direction, source, method, reflected), wave in waves.items():
        fit, colour = method in (TIED, FREE), fig.COLOURS[direction != "downstream"]
        kind = "reflected" if reflected else "two-wave fit" if fit else "Kumaresan-Tufts"
        label, some = f"{direction} wave, source {source}: {kind}", wave if fit and not reflected else wave[::THIN]
        look: dict[str, Any] = {"color": colour, "label": label}
        if reflected:
            look = fig.dots("k", "s" if direction == "upstream" else "^", label, markerfacecolor="none", markersize=3)
        elif not fit:
            look = fig.dots(colour, "o", label, markersize=2.6)
        if method == TIED:
            look["ends"] = [[row[end] for row in some] for end in ("z_low", "z_high")]
        curves.append(look | {"x": [1e-3 * row.frequency for row in some], "y": [value(row) for row in some]})
    return curves


@fig.styled
def draw(rows: Sequence[Row], heights: Sequence[float], path: Path) -> fig.Figure:
    """Phase and decay of the waves by fits that know no height; below them R and X under each assumed height, lines by
    fits that tie both waves to one impedance."""
    figure, axes = fig.subplots(1 + len(heights), 2, 2.15 * (1 + len(heights)) + 0.6)

    def wavenumber(row: Row) -> complex:
        return complex(abs(row.alpha.real) / row.k, NEPER * abs(row.alpha.imag))

    fig.draw_parts(curves_of(rows, heights[0], TIED, wavenumber), fig.KHZ, poles=None, axes=axes[0])
    for axis, label in zip(axes[0], (r"$|\mathrm{Re}\,\alpha|/k$", r"decay (dB m$^{-1}$)"), strict=True):
        axis.set(ylabel=label, ylim=(0, None))
    for panels, height in zip(axes[1:], heights, strict=True):
        fig.draw_parts(curves_of(rows, height, FREE, lambda row: row.z), fig.KHZ, poles=None, axes=panels)
        tied = np.array([row.z for row in rows if (row.height, row.method) == (height, TIED)])
        for axis, (part, _) in zip(panels, fig.PARTS, strict=True):
            # A reflected wave that is hardly heard reaches anywhere.
            low, high = np.percentile(fig.part_of(tied, part), [1, 99])
            margin = 0.2 * (high - low)
            axis.set_ylim(0 if part == "resistance" else low - margin, high + margin)
            axis.text(0.03, 0.95, f"$H = {1e3 * height:g}$ mm", transform=axis.transAxes, va="top", fontsize=8)
    for axis in axes.flat:
        axis.set_xlim(0.18, 1.5)
    return fig.finish(figure, path, legend=2)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = parser_of(__doc__, FIGURES)
    parser.add_argument("file", type=Path, help="liner.txt")
    parser.add_argument("--spacing", type=float, default=55.0, help="of the microphones, mm")
    parser.add_argument("--heights", type=float, nargs="+", default=[20.0, 110.0], help="mm")
    parser.add_argument("--draws", type=int, default=500)
    options = parser.parse_args(arguments)
    warnings.showwarning = lambda message, *_, **__: print(f"warning: {message}", file=sys.stderr)
    heights = [1e-3 * height for height in options.heights]
    options.output.mkdir(parents=True, exist_ok=True)
    lines = lines_of(options.file, heights, 1e-3 * options.spacing)
    rows = [row for line in lines for row in rows_of(line, options.draws)]
    for height in heights:
        print_bands(rows, height)
    write_rows([plain(row) for row in rows], options.output / "measured_mismatch.csv")
    draw(rows, heights, options.output / "measured_mismatch.png")


if __name__ == "__main__":
    main()

"""How often the 95 % intervals of Kumaresan-Tufts and of the fits of two waves hold the known Z.

    python scripts/coverage_waves.py [--lines 200] [--draws 200]

A line is 12 microphones above a wall of three known impedances (600, 1000, 1500 Hz; M = 0.3), with the wave from the
source, a share 0.3 + 0.2j of it coming back, and errors of level and phase that are a multiple of those assumed. The
intervals are those of draws. R and X at the three frequencies count apart: the standard error of a row is 1 % or less
with 200 lines.
"""

from __future__ import annotations

import dataclasses
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from itertools import product

import torch
from torch import Tensor

import torchliner as tl
from common import options_of, parser_of
from torchliner.checks import DataWarning
from torchliner.duct.dispersion import wavenumber_from_impedance
from torchliner.pressure.kumaresan_tufts import kumaresan_tufts
from torchliner.pressure.microphone_errors import LEVEL_ERROR, PHASE_ERROR, draw_pressures
from torchliner.pressure.two_waves import free_wave_fit, two_wave_fit
from torchliner.records import WallEduction

HEIGHT, MACH, BACK = 0.05, 0.3, 0.3 + 0.2j
FREQUENCY = torch.tensor([600.0, 1000.0, 1500.0], dtype=torch.float64)
WALLS = torch.tensor([0.8 - 1.2j, 1.5 + 0.3j, 2.33 - 0.3j], dtype=torch.complex128)
X = 0.012 * torch.arange(12, dtype=torch.float64)
SIDES = {"upstream": "downstream", "downstream": "upstream"}  # of the source, and where its wave runs
METHODS: dict[str, Callable[..., WallEduction]] = {
    "kt": kumaresan_tufts,
    "two-waves": two_wave_fit,
    "free-waves": free_wave_fit,
}
SIZES = (1.0, 2.0, 4.0)  # of the errors, over those assumed


def clean_line(side: str) -> tl.MicrophoneLine:
    """Pressures of both waves, 100 Pa at the microphone next to the source."""

    def wave(direction: str) -> Tensor:
        alpha = wavenumber_from_impedance(WALLS, FREQUENCY, height=HEIGHT, mach=MACH, direction=direction)
        return torch.exp(-1j * alpha * (X[:, None] - X[0 if direction == "downstream" else -1]))

    pressure = 100 * (wave(SIDES[side]) + BACK * wave(side))
    return tl.MicrophoneLine(X, pressure, FREQUENCY, duct_height=HEIGHT, mach=MACH, source_side=side)


def held_by_draws(method: str, side: str, size: float, lines: int, draws: int) -> tuple[float, list[WallEduction]]:
    """Share of the intervals, of draws of the errors as assumed, that hold R and X of noisy lines; what was found."""
    line, random, found, held = clean_line(side), torch.Generator().manual_seed(5), [], []
    level, phase = LEVEL_ERROR * size, PHASE_ERROR * size
    for pressure in draw_pressures(line.pressure, lines, random, level_error=level, phase_error=phase):
        found.append(METHODS[method](dataclasses.replace(line, pressure=pressure), draws=draws))
        low, high = found[-1].interval(0.95)
        held += [(low.real < WALLS.real) & (WALLS.real < high.real)]
        held += [(low.imag < WALLS.imag) & (WALLS.imag < high.imag)]
    return float(torch.stack(held).double().mean()), found


def rows(lines: int, draws: int) -> Iterator[tuple[str, str, float, float]]:
    """Method, side of the source, size of the errors and the share of intervals that hold, %."""
    for side, method, size in product(SIDES, METHODS, SIZES):
        yield method, side, size, 100 * held_by_draws(method, side, size, lines, draws)[0]


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a row for each method, side and size."""
    parser = parser_of(__doc__)
    parser.add_argument("--lines", type=int, default=200)
    parser.add_argument("--draws", type=int, default=200)
    options = options_of(parser, arguments)
    print("method      source      errors  held (%)")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DataWarning)
        for name, side, size, share in rows(options.lines, options.draws):
            print(f"{name:10}  {side:10}  {size:6g}  {share:.1f}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

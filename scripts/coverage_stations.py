"""How often the 95 % intervals of laser Doppler stations hold the known value: ``coverage.py`` of bursts.

    python scripts/coverage_stations.py [--trials 600]

Stations are bursts of 10 s at random arrivals, held until the next one (a held value has the distribution of the
velocity itself, so that the truth is the same), educed by segments of 1 s; ten of them are a line.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import torch

import torchliner as tl
from common import options_of, parser_of
from coverage import FREQUENCY, RATE, SPECTRA, summary, true_impedance, turbulence
from torchliner.checks import DataWarning
from torchliner.liners.model import LinerModel
from torchliner.records.educed import Educed

STATION, ARRIVALS, IN_A_LINE = 10.0, 4200.0, 10  # s; a second; stations


def bursts(spectrum: str, seed: int) -> tl.BurstRecord:
    """A station of ``STATION`` seconds."""
    random = torch.Generator().manual_seed(seed)
    values = turbulence(spectrum, (), round(STATION * RATE), random)
    met = torch.rand(len(values), generator=random) < ARRIVALS / RATE
    times = torch.arange(len(values), dtype=torch.float64)[met] / RATE
    return tl.BurstRecord(times, wall_normal=values[met], x=float(seed), y=1e-3, z=0.0, name=f"station {seed}")


def rows(spectrum: str, trials: int, liner: LinerModel) -> Iterator[dict[str, object]]:
    """Of stations, and of lines of ten."""
    stations: list[Educed] = []
    lines: list[Educed] = []
    how: dict[str, Any] = {"method": "hold", "correction": "none", "grid_rate": 2 * ARRIVALS, "flagged": "use"}
    for first in range(0, trials, IN_A_LINE):
        records = [bursts(spectrum, first + i) for i in range(IN_A_LINE)]
        line = tl.educe_bursts(records, liner, FREQUENCY, monte_carlo=2, **how)
        average = line.average
        assert average is not None
        stations.append(Educed(tl.reflection_from_impedance(line.impedance), line.interval))
        lines.append(Educed(tl.reflection_from_impedance(average.impedance), average.interval))
    for of, parts in (("station", stations), (f"line of {IN_A_LINE}", lines)):
        yield {"of": of, "spectrum": spectrum} | summary(parts, true_impedance(liner, 0.0))


def main(arguments: Sequence[str] | None = None) -> int:
    parser = parser_of(__doc__)
    parser.add_argument("--trials", type=int, default=600, help="stations")
    options = options_of(parser, arguments)
    warnings.simplefilter("ignore", DataWarning)
    for spectrum in SPECTRA:
        for row in rows(spectrum, options.trials, tl.load_liner("onera")):
            print(
                "  ".join(
                    f"{name} {value:.3g}" if isinstance(value, float) else str(value) for name, value in row.items()
                )
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())

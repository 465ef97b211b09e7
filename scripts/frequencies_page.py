"""Tables and pictures of docs/frequencies.md: many frequencies, one for another.

python scripts/frequencies_page.py [-o docs/figures]
"""

from collections.abc import Sequence
from pathlib import Path

import torch

import torchliner as tl
from common import DATA, FIGURES, options_of, parser_of
from torchliner.conversions import impedance_from_reflection
from torchliner.liners.model import LinerModel, reflection_of
from torchliner.report.curves import draw_spectrum
from torchliner.report.figure import COLOURS, LINES, finish, panels_of, styled

LINERS = ("polito", "onera")
TOTAL, OTHER = 3.0, 2000.0  # rms of v, m/s; Hz
SHARES = (0.1, 0.2, 0.5, 0.9)
NODES = 256


def impedances(liner: LinerModel, share: float) -> tuple[complex, complex]:
    """Z at ``OTHER`` with a tone that has a share of the variance of v, beside Gaussian turbulence, and of that
    turbulence alone."""
    middle = (torch.arange(NODES, dtype=torch.float64) + 0.5) / NODES
    turbulent = TOTAL * (1 - share) ** 0.5 * 2**0.5 * torch.erfinv(2 * middle - 1)
    tonal = TOTAL * share**0.5 * 2**0.5 * torch.cos(2 * torch.pi * middle)
    frequency = torch.tensor(OTHER, dtype=torch.float64)
    speeds = ((turbulent[:, None] + tonal).abs().flatten(), turbulent.abs())
    beside, alone = (impedance_from_reflection(reflection_of(liner, frequency, v).mean()) for v in speeds)
    return complex(beside), complex(alone)


@styled
def draw_shares(path: Path) -> None:
    """How far Z is off without the tone."""
    shares = torch.linspace(0.01, 0.99, 99).tolist()
    figure, (axis,) = panels_of(1, 2.6)
    for name, colour, line in zip(LINERS, COLOURS, LINES, strict=False):
        pairs = (impedances(tl.load_liner(name), share) for share in shares)
        change = [100 * abs(alone / beside - 1) for beside, alone in pairs]
        axis.plot([100 * share for share in shares], change, color=colour, linestyle=line, label=name)
    across = "share of the variance of $v$ that is in step with the tone (%)"
    axis.set(xlabel=across, ylabel=f"change of $Z$ at {OTHER / 1e3:g} kHz without it (%)")
    finish(figure, path, f"v of {TOTAL:g} m/s rms in all", legend=3)


def main(arguments: Sequence[str] | None = None) -> int:
    options = options_of(parser_of(__doc__, FIGURES), arguments)
    draw_shares(options.output / "frequencies_tone_share.png")
    for share in SHARES:
        beside, alone = impedances(tl.load_liner(LINERS[0]), share)
        print(f"| {100 * share:g} % | {beside:.2f} | {alone:.2f} | {100 * abs(alone / beside - 1):.0f} % |")
    plane = tl.read_plane(DATA / "slit_g03_145_y0.5mm.h5")
    found = tl.educe(plane, tl.load_liner(plane.liner), [300 + 100.0 * i for i in range(58)])
    draw_spectrum([found], options.output / "frequencies_g03_145.png")
    print(*found.notes, found.choices["nodes"], found.choices["model_error"], found.choices["tone_share"], sep="\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

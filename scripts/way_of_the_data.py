"""Draw docs/figures/way_of_the_data.png: from the samples of a plane to its map.

python scripts/way_of_the_data.py [FILE]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import FancyBboxPatch

TARGET = Path(__file__).parent.parent / "docs" / "figures" / "way_of_the_data.png"
STEPS = [  # place along x, heading, what happens, file
    (0.0, "record", "slabs of v(t)\n(t, P)", "sums"),
    (1.0, "drive", "columns u(t)\nby averaging", "drives"),
    (2.0, "one loop", "sums over blocks\n(S, R, K, N)", "sums, nodes"),
    (3.0, "weights", "R(f) at K speeds\n(S, N, F)", "nodes, moments"),
    (4.0, "phase rule", "R from ⟨R⟩ and\n⟨R e$^{-2jωt}$⟩", "phase"),
    (5.0, "averages", "cells and liner, all\nwithout each block", "averages, intervals"),
    (6.0, "map", "Z, low, high\nwarnings", "educe, review"),
]
BOX = (0.84, 0.62)


def arrow(
    axes: Axes, start: tuple[float, float], end: tuple[float, float], bend: float = 0.0, color: str = "#444"
) -> None:
    style = {"arrowstyle": "-|>", "color": color, "lw": 1.2, "connectionstyle": f"arc3,rad={bend}"}
    axes.annotate("", end, start, arrowprops=style)


def draw(path: Path) -> None:
    figure, axes = plt.subplots(figsize=(11, 2.5), layout="constrained")
    for x, heading, text, file in STEPS:
        left = x - BOX[0] / 2
        axes.add_patch(FancyBboxPatch((left, -BOX[1] / 2), *BOX, boxstyle="round,pad=0.02", fc="#eef3f8", ec="#31557a"))
        axes.text(x, 0.17, heading, ha="center", va="center", weight="bold", size=10)
        axes.text(x, -0.11, text, ha="center", va="center", size=8)
        axes.text(x, -0.44, file, ha="center", va="center", size=7, family="monospace", color="#666")
        if x > 0:
            arrow(axes, (x - 1 + BOX[0] / 2 + 0.02, 0), (left - 0.02, 0))
    survey = "#b5651d"
    arrow(axes, (2.0, 0.35), (1.0, 0.35), 0.35, survey)
    axes.text(1.5, 0.66, "survey of the whole record: phase-locked reads once more", ha="center", size=8, color=survey)
    axes.set(xlim=(-0.5, 6.5), ylim=(-0.55, 0.78))
    axes.axis("off")
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else TARGET)

"""torchliner export."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

import torchliner as tl
from torchliner.cli import options as opt
from torchliner.cli.files import show_results

if TYPE_CHECKING:
    from torchliner.liners.multipole import Multipole

EXAMPLES = ("map.h5 --poles 6 --band 500 3000 -o liner.json",)
OPTIONS = [
    opt.Option("map", "map of torchliner educe, of several frequencies", opt.PATH),
    opt.Option("--poles", "fewer than frequencies; default 8", opt.COUNT, default=8),
    opt.Option("--band", "lowest and highest frequency to fit; default all of the map", opt.HZ, nargs=2),
    opt.averaging(None, text="default: that of the map's answer"),
    opt.output("write poles and residues, or the coefficient lists of solvers as .txt,", ".json", ".txt"),
    *opt.PRINTING,
]


def run(options: argparse.Namespace) -> int:
    """Print the poles, and how well they meet the map."""
    from torchliner.io.multipole_file import plain_multipole

    model = tl.read_map(options.map).time_domain(options.poles, band=options.band, averaging=options.averaging)
    show_results(options, _text(model), plain_multipole(model), output=model.write)
    return 0


def _text(model: Multipole) -> str:
    from torchliner.io.multipole_file import coefficients_of

    low, high = model.band
    held = coefficients_of(model.poles, model.residues)
    rows = [(a, b, c / 2, -d / 2) for a, b, c, d in held["complex_poles"]]
    rows += [(a, 0.0, r, 0.0) for a, r in held["real_poles"]]
    lines = [
        f"R = 1 + sum r/(s - p) from {low:g} to {high:g} Hz: error in R at most {model.error:.2g}; stable and passive",
        "",
        f"{'-Re p, 1/s':>14} {'Im p, 1/s':>14} {'Re r, 1/s':>14} {'Im r, 1/s':>14}",
        *(" ".join(f"{value:14.6g}" for value in row) for row in rows),
    ]
    conjugates = "poles with Im p > 0 have a conjugate with the conjugate residue"
    return "\n".join([*lines, "", conjugates] if held["complex_poles"] else lines)

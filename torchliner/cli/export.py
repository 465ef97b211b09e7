"""torchliner export."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from torchliner.cli.files import show_results
from torchliner.cli.options import shared
from torchliner.names import AVERAGINGS

if TYPE_CHECKING:
    from torchliner.liners.multipole import Multipole

OPTIONS = {
    "": {
        "map MAP": "map of torchliner educe, of several frequencies",
        "--poles N": {"default": 8, "help": "fewer than frequencies; default 8"},
        "--band HZ HZ": "lowest and highest frequency to fit; default all of the map",
        "--averaging": (list(AVERAGINGS), "default: that of the map's answer"),
        "--output FILE": "write poles and residues as .json, or the coefficient lists of solvers as .txt",
    }
    | shared("--json", "--quiet")
}


def run(options: argparse.Namespace) -> int:
    """Print the poles, and how well they meet the map."""
    from torchliner.io.map_file import read_map
    from torchliner.io.multipole_file import plain_multipole

    model = read_map(options.map).time_domain(options.poles, band=options.band, averaging=options.averaging)
    show_results(options, lambda: _text(model), lambda: plain_multipole(model), output=model.write)
    return 0


def _text(model: Multipole) -> str:
    from torchliner.io.multipole_file import coefficients_of

    low, high = model.band
    held = coefficients_of(model.poles, model.residues)
    lines = [
        f"R = 1 + sum r/(s - p) from {low:g} to {high:g} Hz: error in R at most {model.error:.2g}; stable and passive",
        "",
        f"{'-Re p, 1/s':>14} {'Im p, 1/s':>14} {'Re r, 1/s':>14} {'Im r, 1/s':>14}",
    ]
    lines += [f"{a:14.6g} {b:14.6g} {c / 2:14.6g} {-d / 2:14.6g}" for a, b, c, d in held["complex_poles"]]
    lines += [f"{a:14.6g} {0.0:14.6g} {r:14.6g} {0.0:14.6g}" for a, r in held["real_poles"]]
    conjugates = "poles with Im p > 0 have a conjugate with the conjugate residue"
    return "\n".join([*lines, "", conjugates] if held["complex_poles"] else lines)

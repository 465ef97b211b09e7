"""torchliner demo."""

from __future__ import annotations

import argparse
import shlex
from importlib import resources
from importlib.util import find_spec

from torchliner.cli import options as opt

PLANES = ("slit_n130_y0.5mm.h5", "slit_n130_y2.5mm.h5")
EXAMPLES = ("",)
OPTIONS = [
    opt.Option("--folder", "write maps and, with matplotlib, pictures here; default: the table alone", opt.FOLDER)
]


def run(options: argparse.Namespace) -> int:
    """The main job on two shipped planes, by the command that one would type."""
    from torchliner.cli.main import main

    with resources.as_file(resources.files("torchliner").joinpath("demo_planes")) as folder:
        words = ["educe", *(str(folder / name) for name in PLANES)]
        if options.folder is not None:
            options.folder.mkdir(parents=True, exist_ok=True)
            words += ["-o", str(options.folder / "map.h5")]
            if find_spec("matplotlib") is not None:
                words += ["--figure", str(options.folder)]
        about = "A slit liner under 130 dB without flow, at 0.5 and 2.5 mm, from a simulation that resolves its holes."
        print(f"{about}\n$ torchliner {shlex.join(words)}\n", flush=True)
        code = main([*words, "--quiet"])
    if options.folder is not None and code == 0:
        print(f"\nMaps (.h5), numbers (.csv) and pictures (.png) are in {options.folder}")
    return code

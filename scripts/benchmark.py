"""Time of everything that must be fast, with its error beside it.

    python scripts/benchmark.py [PART ...] [--full] [--device cuda]

A row is the best of some runs after one that is not counted, in s, and in ns for each velocity sample where that is
what counts. The quick plane has 1712 probes x 2280 samples (200 kHz, 11.4 ms, float32); --full takes the paper's 548 x
50 probes, files up to 16 GB and lines of 120 stations.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from benchmarks import engine, files, methods
from common import options_of, parser_of

WORKS = (engine.engine, methods.studies, methods.bursts, methods.duct, files.cold, files.memory)
PARTS: dict[str, Callable[[Any], None]] = {work.__name__: work for work in WORKS}


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; default all")
    parser.add_argument("--full", action="store_true", help="the sizes of the paper")
    parser.add_argument("--device", type=torch.device, default="cpu", help="of the part engine")
    parser.add_argument("--folder", type=Path, help="for large files; default a temporary one")
    options = options_of(parser)
    if unknown := {*options.parts} - {*PARTS}:
        parser.error(f"no part {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    threads = torch.get_num_threads()
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    for name in options.parts or PARTS:
        torch.set_num_threads(threads)
        print(f"\n{name}: {(PARTS[name].__doc__ or '').splitlines()[0]}")
        PARTS[name](options)


if __name__ == "__main__":
    main()

"""torchliner compare."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import torchliner as tl
from torchliner.cli import options as opt
from torchliner.cli.files import liner_names, show_results

EXAMPLES = ("first.h5 second.h5",)
OWN = [
    opt.Option("first", "map of torchliner educe, or moments of torchliner reduce", opt.PATH),
    opt.Option("second", "another one of the same cells", opt.PATH),
    opt.averaging(None, text="default: that of both"),
    opt.frequency("the tone; of moments alone, a map has its frequencies"),
]
OPTIONS = [*OWN, opt.OF_LINER, opt.ROWS, *opt.PRINTING]


def run(options: argparse.Namespace) -> int:
    """Print how far the second is off the first, for the liner and each cell."""
    from torchliner.io.moments_file import holds_moments
    from torchliner.report.studies import comparison_table

    both = (options.first, options.second)
    given = [f"--{name}" for name in ("frequency", "liner") if getattr(options, name) is not None]
    if given and not any(map(holds_moments, both)):
        raise ValueError(
            f"{options.first} and {options.second} are maps, which have their frequencies and "
            f"liner; leave out {' and '.join(given)}, or name moments of torchliner reduce"
        )
    first, second = (_map_of(path, options) for path in both)
    found = tl.compare(first, second, options.averaging)
    table = comparison_table(found)
    words = f"second less first, averaging {found.averaging}; {found.words}"
    show_results(options, f"{table.as_text()}\n{words}", found, output=table.write_csv)
    return 0


def _map_of(path: Path, options: argparse.Namespace) -> Any:
    """A map, or that of moments."""
    from torchliner.io.moments_file import holds_moments

    if not holds_moments(path):
        return tl.read_map(path)
    known = tl.read_moments(path)
    (name,) = liner_names(options.liner, [known], [path])
    averaging = {} if options.averaging is None else {"averaging": options.averaging}
    return known.educe(tl.load_liner(name), options.frequency, **averaging)

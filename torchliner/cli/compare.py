"""torchliner compare."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from torchliner.cli.files import liner_names, show_results
from torchliner.cli.options import frequency_option, shared
from torchliner.names import AVERAGINGS

OPTIONS = {
    "": {
        "first PATH": "map of torchliner educe, or moments of torchliner reduce",
        "second PATH": "another one of the same cells",
        "--averaging": (list(AVERAGINGS), "over cells; default: that of both"),
        **frequency_option("the tone; of moments alone, a map has its frequencies"),
        "--liner LINER": "of moments: preset, .toml, .csv or .py file; default: the one the file names",
    }
    | shared("--output", "--json", "--quiet"),
}


def run(options: argparse.Namespace) -> int:
    """Print how far the second is off the first, for the liner and each cell."""
    from torchliner.io.moments_file import holds_moments
    from torchliner.report.studies import comparison_table
    from torchliner.studies.compare import compare

    given = [f"--{name}" for name in ("frequency", "liner") if getattr(options, name) is not None]
    if given and not any(holds_moments(path) for path in (options.first, options.second)):
        raise ValueError(
            f"{options.first} and {options.second} are maps, which have their frequencies and "
            f"liner; leave out {' and '.join(given)}, or name moments of torchliner reduce"
        )
    first, second = (_map_of(path, options) for path in (options.first, options.second))
    found = compare(first, second, options.averaging)
    table = comparison_table(found)
    words = f"second less first, averaging {found.averaging}; {found.words}"
    show_results(options, lambda: f"{table.as_text()}\n{words}", lambda: found, output=table.write_csv)
    return 0


def _map_of(path: Path, options: argparse.Namespace) -> Any:
    """A map, or that of moments."""
    from torchliner.io.map_file import read_map
    from torchliner.io.moments_file import holds_moments, read_moments
    from torchliner.liners.catalogue import load_liner

    if not holds_moments(path):
        return read_map(path)
    known = read_moments(path)
    (name,) = liner_names(options.liner, [known], [path])
    averaging = {} if options.averaging is None else {"averaging": options.averaging}
    return known.educe(load_liner(name), options.frequency, **averaging)

"""torchliner info."""

from __future__ import annotations

import argparse
from typing import Any

from torchliner.cli.files import check_files, read_planes
from torchliner.cli.options import print_json, shared

OPTIONS = {
    "": shared("plane", "--json", "--quiet") | {"--figure PICTURE": "draw v0, v', u' along x there"}
}


def run(options: argparse.Namespace) -> int:
    """Print the description; 1 if a check fails."""
    from torchliner.replay.inspection import inspect_plane

    check_files(options, [options.plane])
    (plane,) = read_planes([options.plane])
    found = inspect_plane(plane)
    if options.json:
        print_json({"facts": found.facts, "failures": found.failures, "missing": found.missing})
    else:
        _print(found)
    if options.figure is not None:
        from torchliner.report.figures import draw_velocity

        draw_velocity([plane], options.figure)
    return 1 if found.failures else 0


def _print(found: Any) -> None:
    for key, value in found.facts.items():
        print(f"{key:34s} {value:.6g}" if isinstance(value, float) else f"{key:34s} {value}")
    if found.missing:
        print(f"{'not stated':34s} {', '.join(found.missing)}")
    for failure in found.failures:
        print(f"check failed: {failure}")
    if not found.failures:
        print("all checks passed")

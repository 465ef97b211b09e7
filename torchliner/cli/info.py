"""torchliner info."""

from __future__ import annotations

import argparse
from typing import Any

from torchliner.cli.files import planes_of, read_planes, read_records, show_results
from torchliner.cli.options import shared
from torchliner.cli.plane_options import plane_options

OPTIONS = {
    "": shared("plane", "--json", "--quiet") | {"--figure PICTURE": "draw v0, v', u' along x there"}
} | plane_options()


def run(options: argparse.Namespace) -> int:
    """Print the description; 1 if a check fails."""
    from torchliner.io.planes import format_of, paths_of
    from torchliner.records import VelocityPlane
    from torchliner.report.figures import draw_velocity
    from torchliner.report.inspection import inspect_moments, inspect_plane

    # Of moments there is nothing to draw: the plane is asked for.
    (plane,) = (
        read_records([options.plane], options) if options.figure is None else read_planes([options.plane], options)
    )
    read = isinstance(plane, VelocityPlane)
    about = {"format": ", ".join({format_of(each).name: 0 for each in paths_of(options.plane)})}
    found = inspect_plane(plane) if isinstance(plane, VelocityPlane) else inspect_moments(plane)
    found.facts.update(about if read else {})
    show_results(
        options,
        lambda: _text(found),
        lambda: {"facts": found.facts, "failures": found.failures, "missing": found.missing},
        figure=lambda path: draw_velocity(planes_of([plane]), path),
    )
    return 1 if found.failures else 0


def _text(found: Any) -> str:
    facts = found.facts | ({"not stated": ", ".join(found.missing)} if found.missing else {})
    lines = [f"{key:34s} {value:.6g}" if isinstance(value, float) else f"{key:34s} {value}"
             for key, value in facts.items()]  # fmt: skip
    failures = [f"check failed: {failure}" for failure in found.failures]
    return "\n".join([*lines, *(failures or ["all checks passed"])])

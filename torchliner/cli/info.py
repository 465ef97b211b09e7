"""torchliner info."""

from __future__ import annotations

import argparse
from typing import Any

import torchliner as tl
from torchliner.cli import options as opt
from torchliner.cli.choices import READING
from torchliner.cli.files import planes_of, read_planes, read_records, show_results

EXAMPLES = ("plane.h5",)
OPTIONS = [opt.ONE_PLANE, *opt.PRINTING, *opt.figure("draw v0, v', u' along x there"), *READING]


def run(options: argparse.Namespace) -> int:
    """Print the description; 1 if a check fails."""
    from torchliner.io.planes import format_of, paths_of
    from torchliner.report.figures import draw_velocity
    from torchliner.report.inspection import inspect_moments, inspect_plane

    # Of moments there is nothing to draw: the plane is asked for.
    read: Any = read_records if options.figure is None else read_planes
    (plane,) = read([options.plane], options)
    if isinstance(plane, tl.VelocityPlane):
        found = inspect_plane(plane)
        found.facts["format"] = ", ".join({format_of(each).name: 0 for each in paths_of(options.plane)})
    else:
        found = inspect_moments(plane)
    show_results(
        options,
        _text(found),
        {"facts": found.facts, "failures": found.failures, "missing": found.missing},
        figure=lambda path: draw_velocity(planes_of([plane]), path),
    )
    return 1 if found.failures else 0


def _text(found: Any) -> str:
    facts = found.facts | ({"not stated": ", ".join(found.missing)} if found.missing else {})
    lines = [f"{key:34s} {f'{v:.6g}' if isinstance(v, float) else v}" for key, v in facts.items()]
    return "\n".join([*lines, *([f"check failed: {each}" for each in found.failures] or ["all checks passed"])])

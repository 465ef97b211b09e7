"""torchliner convert."""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from inspect import signature
from typing import TYPE_CHECKING

from torchliner.cli.files import show_results
from torchliner.cli.options import CASE, dest, progress_bar, shared, spelled, stated
from torchliner.cli.plane_options import plane_options, reading
from torchliner.names import ARRAY_ENDINGS, PLANE_LAYOUTS, resolve

if TYPE_CHECKING:
    from torchliner.records import VelocityPlane

MEANINGS = "; ".join(f"{name}, {text}" for name, (_, text) in PLANE_LAYOUTS.items())
OPTIONS = {
    "": {
        "source SOURCE": "file or folder of any format of planes, or 'run_*.nc': restarts to join",
        "--output FILE": {"required": True, "help": "write the plane as .h5/.nc"},
        "--layout": {
            "choices": list(PLANE_LAYOUTS), "help": f"{MEANINGS}; default: what the file says"},
        "--compress": "gzip: smaller, slower to read",
        "--compress-level N": "of --compress: 1, quick, to 9, small; default 9",
        "--memory SIZE": "for slabs, e.g. 500MB; default 0.13 GB",
    }
    | shared("--json", "--quiet"),
    **plane_options(further=False),
    "arrays": {
        "--towards-liner": "data are positive INTO it",
        "--y ARRAY": "heights of particle images, FILE or FILE:VARIABLE; default: none",
        "--row I": "of an axis y, from 0; default: none",
    },
    "about the case (SI, of the plane as written; default: not stated)": {
        "--height M": "above the liner, m"
    }
    | CASE,
    "scaling (time scales by length over velocity)": {
        "--scale-length FACTOR": {"default": 1.0, "help": "of lengths; default 1"},
        "--scale-velocity FACTOR": {"default": 1.0, "help": "of velocities; default 1"},
    },
}  # fmt: skip
ABOUT = ["height", *map(dest, CASE)]
OF_LAYOUTS = ("towards_liner", "y", "row")  # beside ``reading``


def run(options: argparse.Namespace) -> int:
    """Read, scale, write, and say what was written."""
    from torchliner.checks import tell
    from torchliner.io.plane_selection import scaled
    from torchliner.io.plane_writer import write_plane
    from torchliner.records.unit_checks import plane_unit_warnings

    if options.compress_level is not None and not options.compress:
        raise ValueError("--compress-level is of --compress; give that as well, or leave --compress-level out")
    plane, facts = _read(options), stated(options, ABOUT)
    if "incident_level" in facts:  # of the plane as written
        plane = replace(plane, incident_level=None)
    if (options.scale_length, options.scale_velocity) != (1.0, 1.0):
        plane = scaled(plane, options.scale_length, options.scale_velocity)
    plane = replace(plane, **facts, provenance={**plane.provenance, "file": options.source.name})
    tell(plane_unit_warnings(plane, plane.frequency))
    size = plane.velocity.dtype.itemsize * plane.probes * plane.samples
    size *= 1 if plane.streamwise is None else 2
    level = True if options.compress_level is None else options.compress_level
    began = time.monotonic()
    with progress_bar(size, options.source.name, options, unit="B") as step:
        write_plane(plane, options.output, options.compress and level, memory=options.memory, progress=step)
    took = time.monotonic() - began
    found = {"output": str(options.output), "probes": list(plane.probe_shape),
             "samples": plane.samples, "sampling_rate": float(plane.sampling_rate)}  # fmt: skip
    shape = "x".join(map(str, plane.probe_shape)) or "1"
    show_results(
        options, lambda: f"{options.output}: {shape} probes, {plane.samples} samples at "
                         f"{plane.sampling_rate:g} Hz; {size / 1e6:.3g} MB in {took:.2g} s, "
                         f"{size / 1e6 / max(took, 1e-3):.3g} MB/s",
        lambda: found,
    )  # fmt: skip
    return 0


def _read(options: argparse.Namespace) -> VelocityPlane:
    """By what the file says, or by a layout, which is stated or the only way to read it."""
    from torchliner.io.plane_selection import select
    from torchliner.io.planes import format_of, paths_of, read_plane

    layout = options.layout
    if layout is None and (options.row is not None or options.y is not None):
        layout = "array"
    try:
        for path in paths_of(options.source) if layout is None else ():
            format_of(path)
    except OSError:
        if options.source.suffix.lower() not in ARRAY_ENDINGS:
            raise
        layout = "array"
    if layout is None:
        plane = read_plane(options.source, lazy=True, **reading(options))
        return select(plane, factor=-1.0) if options.towards_liner else plane
    read = resolve(PLANE_LAYOUTS[layout][0])
    known = {*signature(read).parameters, "start", "stop", "region", "every"}
    if given := sorted({*reading(options), *stated(options, OF_LAYOUTS)} - known):
        raise ValueError(f"--layout {layout} takes no {spelled(given)}; leave that or --layout out")
    wanted = {name: value for name in signature(read).parameters
              if (value := getattr(options, name, None)) is not None}  # fmt: skip
    part = {name: getattr(options, name) for name in ("start", "stop", "region")}
    return select(read(options.source, **wanted), **part, every=options.every or 1)

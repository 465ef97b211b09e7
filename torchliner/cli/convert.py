"""torchliner convert."""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import torchliner as tl
from torchliner.cli import options as opt
from torchliner.cli.choices import SELECTION, STATED
from torchliner.cli.files import show_results
from torchliner.cli.messages import progress_bar
from torchliner.cli.signatures import of

EXAMPLES = ("'run_*.nc' -o plane.h5 --normal y",)
SCALING = "scaling (time scales by length over velocity)"
ABOUT = [opt.Option("--height", "above the liner, m", opt.M), *opt.CASE]
OPTIONS = [
    opt.Option("source", "file or folder of any format of planes, or 'run_*.nc': restarts to join", opt.PATH),
    opt.output("write the plane", *opt.HDF5, required=True),
    opt.Option("--compress", "gzip: smaller, slower to read"),
    opt.Option("--compress-level", "of --compress: 1, quick, to 9, small; default 9", opt.INDEX),
    *of("io.plane_writer:write_plane", "memory", memory={"kind": opt.TEXT}),
    *opt.PRINTING,
    *SELECTION,
    *STATED,
    *opt.group("about the case (SI, of the plane as written; default: not stated)", *ABOUT),
    opt.Option("--scale-length", "of lengths; default 1", opt.NUMBER, default=1.0, group=SCALING),
    opt.Option("--scale-velocity", "of velocities; default 1", opt.NUMBER, default=1.0, group=SCALING),
]


def run(options: argparse.Namespace) -> int:
    """Read, scale, write, and say what was written."""
    from torchliner.checks import tell
    from torchliner.io.plane_selection import scaled
    from torchliner.io.plane_writer import write_plane
    from torchliner.records.unit_checks import plane_unit_warnings

    if options.compress_level is not None and not options.compress:
        raise ValueError("--compress-level is of --compress; give that as well, or leave --compress-level out")
    plane = tl.read_plane(options.source, lazy=True, **opt.given(options, [*SELECTION, *STATED]))
    facts = opt.given(options, ABOUT)
    if "incident_level" in facts:  # of the plane as written
        plane = replace(plane, incident_level=None)
    if (options.scale_length, options.scale_velocity) != (1.0, 1.0):
        plane = scaled(plane, options.scale_length, options.scale_velocity)
    plane = replace(plane, **facts, provenance={**plane.provenance, "file": options.source.name})
    tell(plane_unit_warnings(plane, plane.frequency))
    size = plane.velocity.dtype.itemsize * plane.probes * plane.samples * (1 if plane.streamwise is None else 2)
    level = True if options.compress_level is None else options.compress_level
    began = time.monotonic()
    with progress_bar(size, options.source.name, options, unit="B") as step:
        write_plane(plane, options.output, options.compress and level, memory=options.memory, progress=step)
    took = time.monotonic() - began
    found = {
        "output": str(options.output),
        "probes": list(plane.probe_shape),
        "samples": plane.samples,
        "sampling_rate": float(plane.sampling_rate),
    }
    shape = "x".join(map(str, plane.probe_shape)) or "1"
    words = f"{options.output}: {shape} probes, {plane.samples} samples at {plane.sampling_rate:g} Hz"
    speed = f"{size / 1e6:.3g} MB in {took:.2g} s, {size / 1e6 / max(took, 1e-3):.3g} MB/s"
    show_results(options, f"{words}; {speed}", found)
    return 0

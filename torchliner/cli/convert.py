"""torchliner convert."""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

from torchliner.cli.files import show_results
from torchliner.cli.options import CASE, dest, progress_bar, shared, stated
from torchliner.cli.plane_options import plane_options, reading

OPTIONS = {
    "": {
        "source SOURCE": "file or folder of any format of planes, or 'run_*.nc': restarts to join",
        "--output FILE": {"required": True, "help": "write the plane as .h5/.nc"},
        "--compress": "gzip: smaller, slower to read",
        "--compress-level N": "of --compress: 1, quick, to 9, small; default 9",
        "--memory SIZE": "for slabs, e.g. 500MB; default 0.13 GB",
    }
    | shared("--json", "--quiet"),
    **plane_options(further=False),
    "about the case (SI, of the plane as written; default: not stated)": {"--height M": "above the liner, m"} | CASE,
    "scaling (time scales by length over velocity)": {
        "--scale-length FACTOR": {"default": 1.0, "help": "of lengths; default 1"},
        "--scale-velocity FACTOR": {"default": 1.0, "help": "of velocities; default 1"},
    },
}
ABOUT = ["height", *map(dest, CASE)]


def run(options: argparse.Namespace) -> int:
    """Read, scale, write, and say what was written."""
    from torchliner.checks import tell
    from torchliner.io.plane_selection import scaled
    from torchliner.io.plane_writer import write_plane
    from torchliner.io.planes import read_plane
    from torchliner.records.unit_checks import plane_unit_warnings

    if options.compress_level is not None and not options.compress:
        raise ValueError("--compress-level is of --compress; give that as well, or leave --compress-level out")
    plane, facts = read_plane(options.source, lazy=True, **reading(options)), stated(options, ABOUT)
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
    found = {
        "output": str(options.output),
        "probes": list(plane.probe_shape),
        "samples": plane.samples,
        "sampling_rate": float(plane.sampling_rate),
    }
    shape = "x".join(map(str, plane.probe_shape)) or "1"
    show_results(
        options,
        lambda: (
            f"{options.output}: {shape} probes, {plane.samples} samples at "
            f"{plane.sampling_rate:g} Hz; {size / 1e6:.3g} MB in {took:.2g} s, "
            f"{size / 1e6 / max(took, 1e-3):.3g} MB/s"
        ),
        lambda: found,
    )
    return 0

"""torchliner convert."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

from torchliner import names
from torchliner.cli.files import check_files
from torchliner.cli.options import CASE, stated

if TYPE_CHECKING:
    from torchliner.records import VelocityPlane

MEANINGS = "; ".join(f"{name}, {text}" for name, text in names.LAYOUTS.items())
OPTIONS = {
    "": {
        "source SOURCE": ".npy, .mat, .h5, or a simulation file",
        "--output FILE": {"required": True, "help": "plane file to write"},
        "--layout": {
            "choices": list(names.LAYOUTS), "default": "array",
            "help": f"{MEANINGS}; default array"},
        "--compress": "gzip: smaller, slower to read",
    },
    "resolved, channel": {
        "--case NAME": "resolved: group; required there",
        "--line I": {"default": 0, "help": "index of the height; default 0"},
        "--stride N": {"default": 1, "help": "resolved: keep every N-th x; default 1"},
    },
    "array": {
        "--variable NAME": "name in the file; default: the only one",
        "--axes LIST": "its axes in order: time,z,x or y,x,time or probe,time ...; required",
        "--velocity-units UNIT": "m/s, mm/s, ...; required",
        "--sampling-rate HZ": "Hz; required",
        "--towards-liner": "data are positive INTO it",
        "--x NAME": "coordinates along the duct: FILE or FILE:VARIABLE; default: none",
        "--z NAME": "likewise across the duct",
        "--y NAME": "likewise above the liner, of particle images; that of --row is the height",
        "--row I": "of an axis y, from 0; default: none",
        "--length-units UNIT": {"default": "m", "help": "of --x, --z and --y; default m"},
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
ABOUT = (
    "height frequency incident_level mach displacement_thickness source_side liner title"
).split()


def run(options: argparse.Namespace) -> int:
    """Read, scale, write, and say what was written."""
    from torchliner.io.plane_file import write_plane
    from torchliner.io.resolved import read_channel, read_resolved

    check_files(options, [options.source])
    if options.layout == "resolved":
        if options.case is None:
            raise ValueError("--layout resolved needs --case")
        plane = read_resolved(options.source, options.case, options.line, options.stride)
    elif options.layout == "channel":
        plane = read_channel(options.source, options.line)
    else:
        plane = _from_array(options)
    if (options.scale_length, options.scale_velocity) != (1.0, 1.0):
        plane = plane.scaled(options.scale_length, options.scale_velocity)
    facts = stated(options, ABOUT)
    plane = replace(plane, **facts, provenance={**plane.provenance, "file": options.source.name})
    write_plane(plane, options.output, compress=options.compress)
    shape = "x".join(str(n) for n in plane.probe_shape) or "1"
    print(f"{options.output}: {shape} probes, {plane.samples} samples at "
          f"{plane.sampling_rate:g} Hz")  # fmt: skip
    return 0


def _from_array(options: argparse.Namespace) -> VelocityPlane:
    from torchliner.io.arrays import plane_from_array, read_array

    for name in ("axes", "velocity_units", "sampling_rate"):
        if getattr(options, name) is None:
            raise ValueError(
                f"--{name.replace('_', '-')} is needed for an array: nothing about it is guessed"
            )
    coordinates = {}
    for name, where in stated(options, ("x", "z", "y")).items():
        file, _, variable = where.partition(":")
        coordinates[name] = read_array(file, variable or None)
    return plane_from_array(
        read_array(options.source, options.variable),
        options.axes.split(","),
        options.velocity_units,
        options.sampling_rate,
        towards_liner=options.towards_liner,
        row=options.row,
        length_units=options.length_units,
        name=str(options.source),
        **coordinates,
    )

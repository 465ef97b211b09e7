"""torchliner convert."""

from __future__ import annotations

import argparse
from contextlib import suppress
from dataclasses import replace
from inspect import signature
from typing import TYPE_CHECKING

from torchliner.cli.files import show_results, write_text
from torchliner.cli.options import CASE, count, dest, shared, stated
from torchliner.names import PLANE_LAYOUTS, resolve

if TYPE_CHECKING:
    from torchliner.records import VelocityPlane

MEANINGS = "; ".join(f"{name}, {text}" for name, (_, text) in PLANE_LAYOUTS.items())
OPTIONS = {
    "": {
        "source SOURCE": ".npy, .mat, .h5, or a simulation file",
        "--output FILE": {"required": True, "help": "write the plane as .h5/.nc"},
        "--layout": {
            "choices": list(PLANE_LAYOUTS), "default": "array",
            "help": f"{MEANINGS}; default array"},
        "--compress": "gzip: smaller, slower to read",
    }
    | shared("--json", "--quiet"),
    "resolved, channel": {
        "--case NAME": "resolved: group; required there",
        "--line I": {"default": 0, "help": "index of the height; default 0"},
        "--stride N": {
            "default": 1, "type": count, "help": "resolved: keep every N-th x; default 1"},
        "--liner-file FILE": "write the case's own liner, of --layout resolved, .toml; default: "
                             "none",
        "--linear CASE": "resolved: case of low level, or Z as 0.243-0.203j, of the same lattice, "
                         "that fixes the linear part of --liner-file; default: the model's",
    },
    "array": {
        "--variable NAME": "name in the file; default: the only one",
        "--axes LIST": "its axes in order: time,z,x or y,x,time or probe,time ...; required",
        "--velocity-units UNIT": "m/s, mm/s, ...; required",
        "--sampling-rate HZ": "Hz; required",
        "--towards-liner": "data are positive INTO it",
        "--x ARRAY": "coordinates along the duct: FILE or FILE:VARIABLE; default: none",
        "--z ARRAY": "likewise across the duct",
        "--y ARRAY": "likewise above the liner, of particle images; that of --row is the height",
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
ABOUT = ["height", *map(dest, CASE)]


def run(options: argparse.Namespace) -> int:
    """Read, scale, write, and say what was written."""
    from torchliner.io.plane_file import write_plane

    if options.liner_file is not None and options.layout != "resolved":
        raise ValueError("--liner-file is for --layout resolved, whose files state a geometry")
    read = resolve(PLANE_LAYOUTS[options.layout][0])
    wanted = {name: getattr(options, name) for name in signature(read).parameters
              if name in options}  # fmt: skip
    plane: VelocityPlane = read(options.source, **wanted)
    if (options.scale_length, options.scale_velocity) != (1.0, 1.0):
        plane = plane.scaled(options.scale_length, options.scale_velocity)
    facts = stated(options, ABOUT)
    plane = replace(plane, **facts, provenance={**plane.provenance, "file": options.source.name})
    if options.liner_file is not None:
        _write_liner(options)
    found = {"output": str(options.output), "probes": list(plane.probe_shape),
             "samples": plane.samples, "sampling_rate": float(plane.sampling_rate)}  # fmt: skip
    shape = "x".join(map(str, plane.probe_shape)) or "1"
    show_results(
        options, lambda: f"{options.output}: {shape} probes, {plane.samples} samples at "
                         f"{plane.sampling_rate:g} Hz",
        lambda: found, output=lambda path: write_plane(plane, path, compress=options.compress),
    )  # fmt: skip
    return 0


def _write_liner(options: argparse.Namespace) -> None:
    """The liner of a resolved case as a file of its own."""
    from torchliner.io.resolved_liner import resolved_liner
    from torchliner.liners.catalogue import liner_text

    linear = options.linear
    if linear is not None:
        with suppress(ValueError):
            linear = complex(linear)
    liner = resolved_liner(options.source, options.case, linear)
    source = f"{options.source.name}, case {options.case}; linear part: {options.linear or 'model'}"
    write_text(liner_text(liner, source), options.liner_file)

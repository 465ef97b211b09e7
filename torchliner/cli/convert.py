"""torchliner convert."""

from __future__ import annotations

import argparse
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING

from torchliner.names import PLANE_LAYOUTS, resolve

if TYPE_CHECKING:
    from torchliner.records import VelocityPlane


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options."""
    parser.add_argument("source", type=Path, help=".npy, .mat, .h5, or a simulation file")
    parser.add_argument("-o", "--output", type=Path, required=True, help="plane file to write")
    parser.add_argument("--layout", choices=PLANE_LAYOUTS, default="array",
                        help="array: one variable, all stated here; resolved, channel: the "
                        "project's simulation files")  # fmt: skip
    parser.add_argument("--case", help="resolved: group")
    parser.add_argument(
        "--line", type=int, default=0, help="resolved, channel: index of the height"
    )
    parser.add_argument("--stride", type=int, default=1, help="resolved: keep every n-th x")
    array = parser.add_argument_group("array")
    array.add_argument("--variable", help="name in the file, if it holds several")
    array.add_argument("--axes", help="its axes in order, e.g. time,z,x or y,x,time or probe,time")
    array.add_argument("--velocity-units", help="m/s, mm/s, ...")
    array.add_argument("--sampling-rate", type=float, metavar="HZ")
    array.add_argument("--towards-liner", action="store_true", help="data are positive INTO it")
    array.add_argument("--x", help="coordinates: FILE or FILE:VARIABLE")
    array.add_argument("--z", help="likewise")
    array.add_argument("--y", help="likewise, of particle images; that of --row is the height")
    array.add_argument("--row", type=int, help="of an axis y, from 0")
    array.add_argument("--length-units", default="m", help="of --x, --z and --y")
    about = parser.add_argument_group("about the case (SI, of the plane as written)")
    about.add_argument("--height", type=float, metavar="M")
    about.add_argument("--frequency", type=float, metavar="HZ")
    about.add_argument("--incident-level", type=float, metavar="DB")
    about.add_argument("--mach", type=float)
    about.add_argument("--displacement-thickness", type=float, metavar="M")
    about.add_argument("--source-side", choices=["upstream", "downstream", "normal", "none"])
    about.add_argument("--liner", help="name of the liner below")
    about.add_argument("--title")
    scale = parser.add_argument_group("scaling (time scales by length/velocity)")
    scale.add_argument("--scale-length", type=float, default=1.0)
    scale.add_argument("--scale-velocity", type=float, default=1.0)
    parser.add_argument("--compress", action="store_true", help="gzip: smaller, slower to read")


ABOUT = (
    "height frequency incident_level mach displacement_thickness source_side liner title"
).split()


def run(options: argparse.Namespace) -> int:
    """Read, scale, write, and say what was written."""
    from torchliner.io.plane_file import write_plane

    read = resolve(PLANE_LAYOUTS[options.layout])
    wanted = {name: getattr(options, name) for name in signature(read).parameters
              if name in options}  # fmt: skip
    plane: VelocityPlane = read(options.source, **wanted)
    if (options.scale_length, options.scale_velocity) != (1.0, 1.0):
        plane = plane.scaled(options.scale_length, options.scale_velocity)
    said = {key: getattr(options, key) for key in ABOUT if getattr(options, key) is not None}
    plane = replace(plane, **said, provenance={**plane.provenance, "file": options.source.name})
    write_plane(plane, options.output, compress=options.compress)
    shape = "x".join(str(n) for n in plane.probe_shape) or "1"
    print(f"{options.output}: {shape} probes, {plane.samples} samples at "
          f"{plane.sampling_rate:g} Hz")  # fmt: skip
    return 0

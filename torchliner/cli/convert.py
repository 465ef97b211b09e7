"""torchliner convert."""

from __future__ import annotations

import argparse
import hashlib
import json
import time
from contextlib import suppress
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING

from torchliner.cli.files import show_results, write_text
from torchliner.cli.options import CASE, count, dest, progress_bar, shared, spelled, stated
from torchliner.cli.plane_options import plane_options, reading
from torchliner.names import ARRAY_ENDINGS, PLANE_LAYOUTS, resolve
from torchliner.version import __version__

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
    "resolved, channel": {
        "--case NAME": "resolved: group; required there",
        "--line I": "index of the height; default 0",
        "--stride N": {"type": count, "help": "resolved: keep every N-th x; default 1"},
        "--liner-file FILE": "write the case's own liner, of --layout resolved, .toml; default: "
                             "none",
        "--linear CASE": "resolved: case of low level, or Z as 0.243-0.203j, of the same lattice, "
                         "that fixes the linear part of --liner-file; default: the model's",
    },
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
OF_LAYOUTS = ("case", "line", "stride", "towards_liner", "y", "row")  # beside ``reading``
HOW = ("output", "json", "quiet", "memory", "figure")  # options that change nothing of the data


def run(options: argparse.Namespace) -> int:
    """Read, scale, write, and say what was written."""
    from torchliner.checks import tell
    from torchliner.io.plane_selection import scaled
    from torchliner.io.plane_writer import write_plane
    from torchliner.io.planes import paths_of
    from torchliner.records.unit_checks import plane_unit_warnings

    if options.liner_file is not None and options.layout != "resolved":
        raise ValueError("--liner-file is for --layout resolved, whose files state a geometry")
    for given, of in (("linear", "liner_file"), ("compress_level", "compress")):
        if getattr(options, given) is not None and not getattr(options, of):
            first, second = spelled([given]), spelled([of])
            raise ValueError(f"{first} is of {second}; give that as well, or leave {first} out")
    plane, facts = _read(options), stated(options, ABOUT)
    if "incident_level" in facts:  # of the plane as written
        plane = replace(plane, incident_level=None)
    if (options.scale_length, options.scale_velocity) != (1.0, 1.0):
        plane = scaled(plane, options.scale_length, options.scale_velocity)
    plane = replace(plane, **facts, provenance={**plane.provenance, "file": options.source.name})
    tell(plane_unit_warnings(plane, plane.frequency))
    if options.liner_file is not None:
        _write_liner(options)
    size = plane.velocity.dtype.itemsize * plane.probes * plane.samples
    size *= 1 if plane.streamwise is None else 2
    level = True if options.compress_level is None else options.compress_level
    began = time.monotonic()
    with progress_bar(size, options.source.name, options, unit="B") as step:
        write_plane(
            plane, options.output, options.compress and level,
            memory=options.memory, source=_digest(options, paths_of(options.source)), progress=step,
        )  # fmt: skip
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
        if given := sorted({*stated(options, OF_LAYOUTS)} - {"towards_liner"}):
            raise ValueError(f"{spelled(given)}: for --layout resolved or channel; state that, or "
                             "leave this out")  # fmt: skip
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


def _digest(options: argparse.Namespace, paths: list[Path]) -> str:
    """Words for what is written: the files as they are now, and all that is asked of them."""
    from torchliner.records.origin import series_of

    files: list[Path] = []
    for path in paths:
        files += sorted(path.rglob("*")) if path.is_dir() else [path, *series_of(path)]
    facts = [(str(each), each.stat().st_size, each.stat().st_mtime_ns) for each in files]
    asked = {name: str(value) for name, value in vars(options).items() if name not in HOW}
    words = json.dumps([__version__, facts, sorted(asked.items())])
    return hashlib.sha256(words.encode()).hexdigest()


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

"""Options of the commands that read planes: what the files do not say, and what part of them."""

from __future__ import annotations

import argparse
from typing import Any

from torchliner.cli.options import argument, count, dest, stated
from torchliner.names import NORMALS, OVERLAPS

SELECTION: dict[str, Any] = {
    "--start S": "samples from this time on, s, on the clock of the file; default: all",
    "--stop S": "samples before this time, s; default: all",
    "--every N": {"type": count, "help": "every N-th sample in time; default 1"},
    "--region LIST": "probes with x, or x and z, in there, m: X0:X1 or X0:X1,Z0:Z1; default: all",
}
STATED: dict[str, Any] = {
    "--variable NAME": "name of the velocity in the file; default: the one that fits",
    "--group NAME": "group of the file; default: all",
    "--axes LIST": "axes of an array in order: time,z,x or probe,time ...; default: as the file "
                   "says",
    "--velocity-units UNIT": "m/s, mm/s ..., where the file has none; default: the file's",
    "--length-units UNIT": "of coordinates, likewise",
    "--sampling-rate HZ": "Hz, where the file has no times; default: the file's",
    "--normal AXIS": {
        "choices": NORMALS,
        "help": "of vectors and points, away from the liner; default: as the format has it"},
    "--row I": {"type": int, "help": "of several heights or components the one that is taken, from 0; default: one"},
    "--wall-normal-component": "one value a point, whatever its name, is the velocity along the wall normal",
    "--x ARRAY": "coordinates along the duct: FILE or FILE:VARIABLE; default: the file's",
    "--z ARRAY": "likewise across the duct",
    "--holes PATH": "places of the holes, for figures: a table x [mm], z [mm], diameter [mm], "
                    "without z for slits; default: the file's",
    "--points PATH": "point list, of histories at points; default: none",
    "--overlap": (OVERLAPS, "what counts of samples that two files of one run hold with other values; default refuse"),
}  # fmt: skip


def plane_options(further: bool = True, *, selection: bool = True) -> dict[str, dict[str, Any]]:
    """The tables by title.

    Args:
        further: they wait for --help-all.
        selection: with the part of the data.
    """
    tables = {"part of the data": SELECTION} if selection else {}
    return {
        title: {
            spec: argument(spec, entry)[1] | ({"further": True} if further else {}) for spec, entry in table.items()
        }
        for title, table in {**tables, "missing metadata": STATED}.items()
    }


def reading(options: argparse.Namespace, *, selection: bool = True) -> dict[str, Any]:
    """What the user said of the data, for ``read_plane``."""
    found = stated(options, [dest(spec) for spec in ({**SELECTION, **STATED} if selection else STATED)])
    if "axes" in found:
        found["axes"] = found["axes"].split(",")
    return found

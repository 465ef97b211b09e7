"""torchliner reduce."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import torchliner as tl
from torchliner.cli import options as opt
from torchliner.cli.choices import READING, choices
from torchliner.cli.files import read_planes, show_results
from torchliner.cli.messages import progress_bar

EXAMPLES = ("plane.h5 -o plane.moments.h5",)
CHOICES = choices("averaging phase drive running_window mean missing background allow_short device dtype")
OWN = [
    opt.ONE_PLANE,
    opt.output("write the moments", *opt.HDF5, required=True),
    replace(opt.OF_LINER, text="model, for which the moments are good and whose cells count; default: any liner"),
    opt.Option("--cell-pitch", "side of the cells, m, without --liner; default: that of the preset of the file", opt.M),
    opt.frequency("the tone of the file; rows of --phase are kept for it"),
]
OPTIONS = [*OWN, *opt.PRINTING, *CHOICES, *READING]


def run(options: argparse.Namespace) -> int:
    """Write the moments and say how large and how good they are."""
    (plane,) = read_planes([options.plane], options)
    liner = None if options.liner is None else tl.load_liner(options.liner)
    named = tl.load_liner(plane.liner) if plane.liner in tl.preset_names() else None
    pitch, chosen = options.cell_pitch, opt.given(options, CHOICES)
    if pitch is None and liner is None and named is not None:
        pitch = named.cell_pitch
    with progress_bar(2 * plane.samples, options.plane.name, options) as bar:
        found = tl.moments(plane, liner, options.frequency, cell_pitch=pitch, progress=bar, **chosen)
    found.write(options.output)
    facts = _facts(options, plane, found, liner or named)
    show_results(options, _text(facts), facts)
    return 0


def _facts(options: argparse.Namespace, plane: Any, found: Any, liner: Any) -> dict[str, Any]:
    """Of the file, and of the error for a liner that is known."""
    nodes = {} if found.nodes is None else found.nodes.describe()
    where = None if options.liner is None else options.frequency or plane.frequency
    return {
        "output": str(options.output),
        "bytes": options.output.stat().st_size,
        "bytes_of_velocity": plane.velocity.dtype.itemsize * plane.samples * plane.probes,
        "probes": plane.probes,
        "cells": found.cells.count,
        "samples": plane.samples,
        "cell_pitch": found.cell_pitch,
        "blocks": found.survey.blocks.count,
        "functions": None if found.nodes is None else found.nodes.count,
        "centre": nodes.get("centre"),
        "any_liner": options.liner is None,
        "liner": None if liner is None else liner.describe().get("name"),
        "error_in_R": None if liner is None else found.error(liner, where),
    }


def _text(facts: dict[str, Any]) -> str:
    size, data = facts["bytes"] / 1e6, facts["bytes_of_velocity"] / 1e6
    pitch = facts["cell_pitch"]
    cells = "all probes together" if pitch is None else f"{facts['cells']} of {1e3 * pitch:g} mm"
    centre = "" if facts["centre"] is None else f", c = {facts['centre']:g} m/s"
    good = ["any liner smooth in |v|, whose results state the error in R"] if facts["any_liner"] else []
    if facts["liner"] is not None:
        where = "300 to 6000 Hz" if facts["any_liner"] else "the frequencies asked for"
        good.append(f"{facts['error_in_R']:.1e} for {facts['liner']} at {where}")
    functions = f"K = {facts['functions']} functions of |v|{centre}: good for {'; '.join(good)}"
    return (
        f"{facts['output']}: {size:.3g} MB, the velocity {data:.3g} MB ({data / size:.3g} times as much)\n"
        f"{facts['probes']} probes, cells: {cells}; {facts['samples']} samples, {facts['blocks']} blocks for error "
        f"bars\n{'no functions of |v|: the rms is enough' if facts['functions'] is None else functions}"
    )

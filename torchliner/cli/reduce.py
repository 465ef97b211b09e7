"""torchliner reduce."""

from __future__ import annotations

import argparse
from typing import Any

from torchliner.cli.choice_options import choice_options, chosen_from
from torchliner.cli.files import read_planes, show_results
from torchliner.cli.options import frequency_option, progress_bar, shared
from torchliner.cli.plane_options import plane_options

CHOICES = (
    "phase", "drive", "mean", "averaging", "background_rms", "running_window", "missing",
    "allow_short", "device", "dtype",
)  # fmt: skip
OPTIONS = {
    "": shared("plane")
    | {
        "--output FILE": {"required": True, "help": "write the moments as .h5/.nc"},
        "--liner LINER": "model: preset, .toml, .csv or .py file, for which K and c are chosen and "
                         "over whose cells v is averaged; default: any liner",
        "--cell-pitch M": "side of the cells, m, without --liner; default: that of the preset that "
                          "the file names, else all probes are one cell",
        **frequency_option("the tone of the file; rows of --phase are kept for it"),
    }
    | shared("--json", "--quiet"),
} | choice_options(CHOICES) | plane_options()  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Write the moments and say how large and how good they are."""
    from torchliner.liners.catalogue import load_liner, preset_names
    from torchliner.velocity.educe import moments

    (plane,) = read_planes([options.plane], options)
    liner = None if options.liner is None else load_liner(options.liner)
    named = load_liner(plane.liner) if plane.liner in preset_names() else None
    pitch = options.cell_pitch
    if pitch is None and liner is None and named is not None:
        pitch = named.cell_pitch
    with progress_bar(2 * plane.samples, options.plane.name, options) as bar:
        found = moments(
            plane, liner, options.frequency, cell_pitch=pitch, progress=bar,
            **chosen_from(options, CHOICES),
        )  # fmt: skip
    found.write(options.output)
    facts = _facts(options, plane, found, liner or named)
    show_results(options, lambda: _text(facts), lambda: facts)
    return 0


def _facts(options: argparse.Namespace, plane: Any, found: Any, liner: Any) -> dict[str, Any]:
    """Of the file, and of the error for a liner that is known."""
    nodes = {} if found.nodes is None else found.nodes.describe()
    return {
        "output": str(options.output), "bytes": options.output.stat().st_size,
        "bytes_of_velocity": plane.velocity.dtype.itemsize * plane.samples * plane.probes,
        "probes": plane.probes, "cells": found.cells.count, "samples": plane.samples,
        "cell_pitch": found.cell_pitch, "blocks": found.survey.blocks.count,
        "functions": None if found.nodes is None else found.nodes.count,
        "centre": nodes.get("centre"), "any_liner": options.liner is None,
        "liner": None if liner is None else liner.describe().get("name"),
        "error_in_R": None if liner is None else found.error(
            liner, None if options.liner is None else options.frequency or plane.frequency),
    }  # fmt: skip


def _text(facts: dict[str, Any]) -> str:
    size, data = facts["bytes"] / 1e6, facts["bytes_of_velocity"] / 1e6
    pitch = facts["cell_pitch"]
    cells = "all probes together" if pitch is None else f"{facts['cells']} of {1e3 * pitch:g} mm"
    centre = "" if facts["centre"] is None else f", c = {facts['centre']:g} m/s"
    good = []
    if facts["any_liner"]:
        good.append("any liner smooth in |v|, whose results state the error in R")
    if facts["liner"] is not None:
        where = "300 to 6000 Hz" if facts["any_liner"] else "the frequencies asked for"
        good.append(f"{facts['error_in_R']:.1e} for {facts['liner']} at {where}")
    return "\n".join([
        f"{facts['output']}: {size:.3g} MB, the velocity {data:.3g} MB "
        f"({data / size:.3g} times as much)",
        f"{facts['probes']} probes, cells: {cells}; {facts['samples']} samples, "
        f"{facts['blocks']} blocks for error bars",
        "no functions of |v|: the rms is enough" if facts["functions"] is None else
        f"K = {facts['functions']} functions of |v|{centre}: good for {'; '.join(good)}",
    ])  # fmt: skip

"""torchliner replay."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace

import torchliner as tl
from torchliner.cli import options as opt
from torchliner.cli.choices import READING, SHOWN, choices
from torchliner.cli.educe import finish
from torchliner.cli.files import incident_signal, liner_names, read_planes
from torchliner.cli.messages import progress_bar
from torchliner.cli.signatures import of

EXAMPLES = (
    "plane.h5 --incident noise:300:3500 --segment 0.01 -o map.h5",
    "plane.h5 --kernel causal --spacing uniform --interpolation linear --window hann",
)
CHOICES = [
    opt.averaging("admittance", "admittance", "velocity"),
    *choices("mean missing interval no_intervals device dtype"),
    *of(
        "velocity.replay:replay",
        "kernel levels spacing interpolation velocity_max window segment",
        shown=SHOWN,
        group="kernel and replay",
    ),
]
OPTIONS = [
    opt.ONE_PLANE,
    *opt.INCIDENT,
    opt.frequency("the tone of the file, or the lines of --incident"),
    opt.output("write the map", *opt.RESULT),
    replace(opt.output("write the reflected signal of every probe", *opt.HDF5), flag="--reflected"),
    opt.OF_LINER,
    *opt.PICTURES_OF,
    *opt.PRINTING,
    opt.STRICT,
    *CHOICES,
    *READING,
]


def run(options: argparse.Namespace) -> int:
    """Replay the wave at every probe, print a row a frequency, write what was asked for."""
    from torchliner.io.result_writers import require_result

    incident = incident_signal(options)
    (plane,) = planes = read_planes([options.plane], options)
    if options.output is not None:
        count = len(options.frequency or [0]) if incident is None else math.inf
        require_result(options.output, count, plane.x is not None or plane.z is not None)
    if incident is None:
        incident = options.frequency or plane.frequency
        if incident is None:
            raise ValueError(f"{options.plane} states no tone; name --incident or --frequency")
    (name,) = liner_names(options.liner, planes, [options.plane])
    about, chosen = {"reflected": options.reflected}, opt.given(options, CHOICES)
    with progress_bar(plane.samples, options.plane.name, options) as step:
        found = tl.replay(plane, tl.load_liner(name), incident, options.frequency, progress=step, **about, **chosen)
    return finish(options, [found], planes, [] if options.output is None else [options.output])

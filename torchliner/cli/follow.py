"""torchliner follow."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import Any

import torchliner as tl
from torchliner.cli import options as opt
from torchliner.cli.choices import NO_GIVEN_PHASE, STATED, choices
from torchliner.cli.files import preset_named
from torchliner.cli.messages import print_json

EXAMPLES = ("plane.h5 --until 0.05",)
CHOICES = [
    opt.averaging("admittance", "admittance", "velocity"),
    *choices("phase interval no_intervals dtype", phase=NO_GIVEN_PHASE),
]
READING = opt.group("missing metadata", *STATED, further=True)
OWN = [
    opt.Option("plane", "plane file that grows, or folder into which files come, in the order of names", opt.PLANE),
    opt.Option("--until", "half-width of the interval of Z, over rho c, that ends it; default: none", opt.NUMBER),
    opt.Option("--every", "between two looks, s; default 5", opt.S, default=5.0),
    opt.Option("--idle", "without new samples, after which it ends, s; default 600", opt.S, default=600.0),
    opt.output("write the moments so far, at the end, on Ctrl-C and on SIGTERM,", *opt.HDF5),
]
OPTIONS = [*OWN, opt.OF_LINER, *opt.PRINTING, opt.TONE, *CHOICES, *READING]
HEADING = "samples    record s  f Hz      Z               half-width  needed s  until then"


def run(options: argparse.Namespace) -> int:
    """A row each time samples have come; 1 if the half-width was not reached."""
    from torchliner.campaign.follow import Following, Frames, follow

    for name in ("every", "idle", "until"):
        value = getattr(options, name)
        if value is not None and value <= 0:
            raise ValueError(f"--{name} is {value:g}; it is above 0")
    if options.until is not None and options.no_intervals:
        raise ValueError("--until asks for the interval, which --no-intervals leaves out")
    frames = Frames(options.plane, opt.given(options, READING))
    liner = options.liner
    if liner is None:
        liner = preset_named(tl.read_plane(frames.files()[0], lazy=True, **frames.request).liner, options.plane)
    chosen = opt.given(options, CHOICES)
    following = Following(frames, tl.load_liner(liner), options.frequency, until=options.until, **chosen)
    if not options.json:
        print(HEADING, flush=True)

    def tell(rows: list[Any]) -> None:
        for row in rows:
            if options.json:
                print_json(asdict(row))
            else:
                print(_line(row), flush=True)

    reached = False
    try:
        reached = follow(following, tell, every=options.every, idle=options.idle)
    finally:  # whatever ends it leaves what there is
        if options.output is not None and following.going is not None and following.going.periods:
            following.moments().write(options.output)
    return 0 if reached or options.until is None else 1


def _line(row: Any) -> str:
    """One standing; the rest of the waiting as it is short to read."""
    left, width, needed = row.remaining, row.half_width, row.needed
    later = "-" if left != left else "now" if left == 0 else f"{left:.3g} s"
    for seconds, unit in ((60, "min"), (3600, "h")):
        if left >= 5 * seconds:
            later = f"{left / seconds:.3g} {unit}"
    z = f"{row.impedance.real:.3f}{row.impedance.imag:+.3f}j"
    known = [f"{v:.3g}" if v == v else "-" for v in (width, needed)]
    head = f"{row.samples:<9}  {row.duration:<8.4g}  {row.frequency:<8.1f}  {z:<14}"
    return f"{head}  {known[0]:<10}  {known[1]:<8}  {later}"

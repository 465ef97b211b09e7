"""torchliner follow."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import Any

from torchliner.cli.choice_options import NO_GIVEN_PHASE, choice_options, chosen_from
from torchliner.cli.files import preset_named
from torchliner.cli.options import frequency_option, number, print_json, shared
from torchliner.names import AVERAGINGS

CHOICES = ("phase", "averaging", "interval", "no_intervals", "dtype")
AVERAGING = {"--averaging": (list(AVERAGINGS)[:2], "over cells; default admittance")}
OPTIONS = {
    "": {
        "plane PLANE": "plane file that grows, or folder into which files come, read in the order "
                       "of their names",
        "--until HALF_WIDTH": {"type": number, "help": "of the interval of Z that ends it, over "
                               "rho c; default: none"},
        "--every S": {"type": number, "default": 5.0, "help": "between two looks, s; default 5"},
        "--idle S": {"type": number, "default": 600.0, "help": "without new samples, after which "
                     "it ends, s; default 600"},
        "--output FILE": "write the moments so far as .h5/.nc, at the end and on Ctrl-C",
    }
    | shared("--liner", "--json", "--quiet")
    | frequency_option("the tone of the file"),
} | choice_options(CHOICES, NO_GIVEN_PHASE | AVERAGING)  # fmt: skip
HEADING = "samples    record s  f Hz      Z               half-width  needed s  until then"


def run(options: argparse.Namespace) -> int:
    """A row each time samples have come; 1 if the half-width was not reached."""
    from torchliner.campaign.follow import Following, Frames, follow
    from torchliner.liners.catalogue import load_liner

    for name in ("every", "idle", "until"):
        value = getattr(options, name)
        if value is not None and value <= 0:
            raise ValueError(f"--{name} is {value:g}; it is above 0")
    if options.until is not None and options.no_intervals:
        raise ValueError("--until asks for the interval, which --no-intervals leaves out")
    liner = options.liner or preset_named(Frames(options.plane).liner, options.plane)
    following = Following(
        options.plane, load_liner(liner), options.frequency,
        until=options.until, **chosen_from(options, CHOICES),
    )  # fmt: skip
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
    finally:  # Ctrl-C, and errors of later files, leave what there is
        if options.output is not None and following.going is not None and following.going.periods:
            following.moments().write(options.output)
    return 0 if reached or options.until is None else 1


def _line(row: Any) -> str:
    """One standing; the rest of the waiting as it is short to read."""
    left = row.remaining
    later = "-" if left != left else "now" if left == 0 else f"{left:.3g} s" if left < 300 else (
        f"{left / 60:.3g} min" if left < 18000 else f"{left / 3600:.3g} h")  # fmt: skip
    z = f"{row.impedance.real:.3f}{row.impedance.imag:+.3f}j"
    width, needed = (f"{v:.3g}" if v == v else "-" for v in (row.half_width, row.needed))
    return f"{row.samples:<9d}  {row.duration:<8.4g}  {row.frequency:<8.1f}  {z:14s}  {width:10s}  {needed:8s}  {later}"

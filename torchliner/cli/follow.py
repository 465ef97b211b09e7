"""torchliner follow."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import Any

from torchliner.cli.choice_options import NO_GIVEN_PHASE, choice_options, chosen_from
from torchliner.cli.files import preset_named
from torchliner.cli.options import frequency_option, number, print_json, shared
from torchliner.cli.plane_options import plane_options, reading
from torchliner.names import AVERAGINGS

CHOICES = ("phase", "averaging", "interval", "no_intervals", "dtype")
AVERAGING = {"--averaging": (list(AVERAGINGS)[:2], "over cells; default admittance")}
FILES: dict[str, Any] = {
    "plane PLANE": "plane file that grows, or folder into which files come, read in the order of their names",
    "--until HALF_WIDTH": {"type": number, "help": "of the interval of Z that ends it, over rho c; default: none"},
    "--every S": {"type": number, "default": 5.0, "help": "between two looks, s; default 5"},
    "--idle S": {
        "type": number,
        "default": 600.0,
        "help": "without new samples, after which it ends, s; default 600",
    },
    "--output FILE": "write the moments so far as .h5/.nc, at the end, on Ctrl-C and on SIGTERM",
}
OPTIONS = {
    "": FILES | shared("--liner", "--json", "--quiet") | frequency_option("the tone of the file"),
    **choice_options(CHOICES, NO_GIVEN_PHASE | AVERAGING),
    **plane_options(selection=False),
}
HEADING = "samples    record s  f Hz      Z               half-width  needed s  until then"


def run(options: argparse.Namespace) -> int:
    """A row each time samples have come; 1 if the half-width was not reached."""
    from torchliner.campaign.follow import Following, Frames, follow
    from torchliner.io.planes import read_plane
    from torchliner.liners.catalogue import load_liner

    for name in ("every", "idle", "until"):
        value = getattr(options, name)
        if value is not None and value <= 0:
            raise ValueError(f"--{name} is {value:g}; it is above 0")
    if options.until is not None and options.no_intervals:
        raise ValueError("--until asks for the interval, which --no-intervals leaves out")
    frames = Frames(options.plane, reading(options, selection=False))
    liner = options.liner
    if liner is None:
        liner = preset_named(read_plane(frames.files()[0], lazy=True, **frames.request).liner, options.plane)
    choices = chosen_from(options, CHOICES)
    following = Following(frames, load_liner(liner), options.frequency, until=options.until, **choices)
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
    known = (f"{v:.3g}" if v == v else "-" for v in (width, needed))
    cells = zip(
        (9, 8, 8, 14, 10, 8), (row.samples, f"{row.duration:.4g}", f"{row.frequency:.1f}", z, *known), strict=True
    )
    return "  ".join([*(f"{text:<{size}}" for size, text in cells), later])

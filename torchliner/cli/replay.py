"""torchliner replay."""

from __future__ import annotations

import argparse
import math

from torchliner.cli.choice_options import REPLAYED, choice_options, chosen_from
from torchliner.cli.educe import finish
from torchliner.cli.files import incident_signal, liner_names, read_planes
from torchliner.cli.options import frequency_option, progress_bar, shared
from torchliner.cli.plane_options import plane_options
from torchliner.names import AVERAGINGS, RESULT_ENDINGS

CHOICES = (*REPLAYED, "averaging", "mean", "missing", "interval", "no_intervals", "device", "dtype")
OWN = {"--averaging": (list(AVERAGINGS)[:2], "over cells; default admittance")}
OPTIONS = {
    "": {
        "plane PLANE": "file of a plane, of any format; 'run_*.nc' joins restarts",
        "--incident SIGNAL": "tones:500,900, sweep:300:6000:logarithmic, noise:300:6000:SEED (Hz), or a .wav or .npy "
        "file; default: tones of --frequency, each by itself",
        "--incident-rate HZ": "sampling rate of an .npy file, Hz; default: none",
        **frequency_option("the tone of the file, or the lines of --incident"),
        "--output FILE": f"write the map as {RESULT_ENDINGS}",
        "--reflected FILE": "write the reflected signal of every probe as .h5/.nc",
    }
    | shared("--liner", "--figure", "--json", "--quiet", "--strict")
}
OPTIONS |= choice_options(CHOICES, OWN) | plane_options()


def run(options: argparse.Namespace) -> int:
    """Replay the wave at every probe, print a row a frequency, write what was asked for."""
    from torchliner.io.result_writers import require_result
    from torchliner.liners.catalogue import load_liner
    from torchliner.velocity.replay import replay

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
    with progress_bar(plane.samples, options.plane.name, options) as step:
        found = replay(
            plane, load_liner(name), incident, options.frequency, reflected=options.reflected, progress=step,
            **chosen_from(options, CHOICES),
        )  # fmt: skip
    return finish(options, [found], planes, [] if options.output is None else [options.output])

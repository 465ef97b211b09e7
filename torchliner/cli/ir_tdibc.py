"""torchliner ir-tdibc."""

from __future__ import annotations

import argparse

from torchliner import names
from torchliner.cli.files import incident_signal, show_results
from torchliner.cli.options import frequency_option, progress_bar, shared, stated

CHOICES = ("kernel", "drive", "realisations", "sampling_rate", "duration", "velocity_max", "band", "after")
KERNEL = (
    "least-squares (default): causal, fitted on --band; causal: taps before zero dropped, to the letter; periodic: no "
    "kernel, a period at once"
)
SIGNAL = (
    "tones:500,900, sweep:300:6000:logarithmic, noise:300:6000:SEED (Hz), or a .wav or .npy file, scaled to each "
    "level; default: --frequency, all at once"
)
BAND = "of the kernel; default 300 3500, or wider to hold what is sent, of a file what is read"
OPTIONS = {
    "": {
        "liner LINER": "preset, .toml, .csv or .py file",
        "--level DB ...": {"required": True, "help": "of the whole incident wave, dB re 20 uPa rms"},
        **frequency_option("none; with --incident its tones, or eight in its band"),
        "--incident SIGNAL": SIGNAL,
        "--incident-rate HZ": "sampling rate of an .npy file, Hz; default: none",
        "--realisations N": "draws of noise, or phases of several tones; default 1",
        "--kernel": (names.STEP_KERNELS, KERNEL),
        "--drive": (names.STEP_DRIVES, "|v| of the moment (default), or its rms over a period of the lowest frequency"),
        "--sampling-rate HZ": "of the steps; default 48 kHz, or 16 times the highest frequency",
        "--duration S": "of the record that is read; default 0.25, of tones 0.04; a file is sent whole",
        "--output FILE": "write the rows as .csv",
        "--figure PICTURE": "draw R and X over level there",
        "--velocity-max M/S": {"help": "top of the kernel table; default 20, or the liner's", "further": True},
        "--band HZ HZ": {"help": BAND, "further": True},
        "--after S": {"help": "length of the kernel; default 0.01", "further": True},
    }
    | shared("--json", "--quiet"),
}


def run(options: argparse.Namespace) -> int:
    """Print Z over level; draw."""
    from torchliner.liners.catalogue import load_liner
    from torchliner.report.level_report import draw_levels, level_facts, level_table, level_text
    from torchliner.velocity.ir_tdibc import ir_tdibc

    liner = load_liner(options.liner)
    incident, choices = incident_signal(options), stated(options, CHOICES)
    if incident is None and options.frequency is None:
        raise ValueError("nothing is sent; give --frequency of a tone, or --incident")
    for name in {"band", "after"} & choices.keys():
        if options.kernel == "periodic":
            raise ValueError(f"--{name} is of a kernel, and 'periodic' has none; leave it out")
    choices |= {"band": tuple(choices["band"])} if "band" in choices else {}
    frequency = options.frequency if incident else None
    with progress_bar(0, f"{options.liner}", options, "step") as step:
        sent = incident or options.frequency
        curve = ir_tdibc(liner, options.level, sent, frequency=frequency, progress=step, **choices)
    show_results(
        options,
        lambda: level_text(curve),
        lambda: level_facts(curve),
        output=level_table(curve).write_csv,
        figure=lambda path: draw_levels(curve, path),
    )
    return 0

"""torchliner ir-tdibc."""

from __future__ import annotations

import argparse

from torchliner import names
from torchliner.cli.files import incident_signal, show_results
from torchliner.cli.options import frequency_option, progress_bar, shared, stated

CHOICES = (
    "kernel", "drive", "realisations", "sampling_rate", "duration", "velocity_max", "band",
    "after", "running_window", "segment",
)  # fmt: skip
OPTIONS = {
    "": {
        "liner LINER": "preset, .toml, .csv or .py file",
        "--level DB ...": {
            "required": True, "help": "of the whole incident wave, dB re 20 uPa rms"},
        **frequency_option("none; with --incident its tones, or eight in its band"),
        "--incident SIGNAL": "tones:500,900, sweep:300:6000:logarithmic, noise:300:6000:SEED (Hz), "
        "or a .wav or .npy file, scaled to each level; default: --frequency, all at once",
        "--incident-rate HZ": "sampling rate of an .npy file, Hz; default: none",
        "--realisations N": "draws of noise, or phases of several tones; default 1",
        "--kernel": (
            names.STEP_KERNELS, "least-squares (default): causal, fitted on --band; causal: taps "
            "before zero dropped, to the letter; periodic: no kernel, a period at once"),
        "--drive": (
            names.STEP_DRIVES, "|v| of the moment (default), or its rms over --running-window"),
        "--sampling-rate HZ": "of the steps; default 48 kHz, or 16 times the highest frequency",
        "--duration S": "of the record that is read; default 0.25, of tones 0.04; a file is sent "
                        "whole",
        "--output FILE": "write the rows as .csv",
        "--figure PICTURE": "draw R and X over level there",
        "--velocity-max M/S": {
            "help": "top of the kernel table; default 20, or the liner's", "further": True},
        "--band HZ HZ": {
            "help": "of the kernel; default 300 3500, or wider to hold what is sent, of a file "
            "what is read",
            "further": True},
        "--after S": {"help": "length of the kernel; default 0.01", "further": True},
        "--running-window S": {
            "help": "default one period of the lowest frequency", "further": True},
        "--segment S": {
            "help": "of the spectra of noise, sweeps, files; default 0.02", "further": True},
    }
    | shared("--json", "--quiet"),
}  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Print Z over level; draw."""
    from torchliner.ir_tdibc_method.ir_tdibc import ir_tdibc
    from torchliner.liners.catalogue import load_liner
    from torchliner.report.level_report import draw_levels, level_facts, level_table, level_text

    liner = load_liner(options.liner)
    incident, choices = incident_signal(options), stated(options, CHOICES)
    if incident is None and options.frequency is None:
        raise ValueError("nothing is sent; give --frequency of a tone, or --incident")
    for name in ("band", "after"):
        if name in choices and options.kernel == "periodic":
            raise ValueError(f"--{name} is of a kernel, and 'periodic' has none; leave it out")
    if "band" in choices:
        choices["band"] = tuple(choices["band"])
    with progress_bar(0, f"{options.liner}", options, "step") as step:
        curve = ir_tdibc(
            liner, options.level, incident or options.frequency, progress=step,
            frequency=options.frequency if incident else None, **choices,
        )  # fmt: skip
    show_results(
        options, lambda: level_text(curve), lambda: level_facts(curve),
        output=level_table(curve).write_csv, figure=lambda path: draw_levels(curve, path),
    )  # fmt: skip
    return 0

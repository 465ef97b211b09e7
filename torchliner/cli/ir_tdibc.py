"""torchliner ir-tdibc."""

from __future__ import annotations

import argparse
from dataclasses import replace

import torchliner as tl
from torchliner import names
from torchliner.cli import options as opt
from torchliner.cli.files import incident_signal, show_results
from torchliner.cli.messages import progress_bar
from torchliner.cli.signatures import of

EXAMPLES = (
    "lbm_slit --frequency 1400 --level 115 130 145 --figure z.png -o z.csv",
    "onera --incident noise:500:3000 --level 120 140 --realisations 8 --frequency 1000",
)
CHOICES = of(
    "velocity.ir_tdibc:ir_tdibc",
    "kernel drive realisations sampling_rate duration velocity_max band after",
    kernel={"kind": names.STEP_KERNELS},
    drive={"kind": names.STEP_DRIVES},
    velocity_max={"further": True},
    band={"kind": opt.HZ, "nargs": 2, "further": True},
    after={"further": True},
)
OPTIONS = [
    opt.Option("liner", "preset, .toml, .csv or .py file", opt.LINER),
    opt.Option("--level", "of the whole incident wave, dB re 20 uPa rms", opt.DB, nargs="+", required=True),
    opt.frequency("none; with --incident its tones, or eight in its band"),
    replace(opt.INCIDENT[0], text=f"{opt.INCIDENT[0].text}, all at once; scaled to each level"),
    opt.INCIDENT[1],
    *CHOICES,
    opt.ROWS,
    *opt.figure("draw R and X over level there"),
    *opt.PRINTING,
]


def run(options: argparse.Namespace) -> int:
    """Print Z over level; draw."""
    from torchliner.report.level_report import draw_levels, level_facts, level_table, level_text

    liner = tl.load_liner(options.liner)
    incident, chosen = incident_signal(options), opt.given(options, CHOICES)
    if incident is None and options.frequency is None:
        raise ValueError("nothing is sent; give --frequency of a tone, or --incident")
    for name in {"band", "after"} & chosen.keys():
        if options.kernel == "periodic":
            raise ValueError(f"--{name} is of a kernel, and 'periodic' has none; leave it out")
    with progress_bar(0, f"{options.liner}", options, "step") as step:
        wave, read = (options.frequency, None) if incident is None else (incident, options.frequency)
        curve = tl.ir_tdibc(liner, options.level, wave, frequency=read, progress=step, **chosen)
    show_results(
        options,
        level_text(curve),
        level_facts(curve),
        output=level_table(curve).write_csv,
        figure=lambda path: draw_levels(curve, path),
    )
    return 0

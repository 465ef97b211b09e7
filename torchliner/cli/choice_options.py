"""The choices of an eduction as options, one definition for all commands that educe."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

from torchliner import names
from torchliner.cli.options import argument, averaging_option, dest, stated

SHOWN = (
    "phase averaging drive mean wall_filter kernel window segment interval device dtype"
).split()  # by --help; --help-all shows the others too


def phase_option(rules: Sequence[str]) -> dict[str, Any]:
    """--phase with some of the rules."""
    meanings = "; ".join(f"{rule}, {names.PHASES[rule]}" for rule in rules)
    return {"--phase": (rules, f"of the incident tone: {meanings}; default averaged")}


NO_GIVEN_PHASE = phase_option([rule for rule in names.PHASES if rule != "given"])

CHOICES: dict[str, dict[str, Any]] = {
    "phase and velocity": {
        **phase_option(list(names.PHASES)),
        "--drive": (names.DRIVES, "|v| that drives the liner model; default instantaneous"),
        "--mean": (names.MEANS, "time-mean of v in the drive; default kept"),
        "--wall-filter C": "squared coherence with the tone, 0 to 1, below which a probe counts as "
                           "wall in averages over probes; default: no filter",
        "--reference-phase RAD": "for --phase given: x(t) = cos(2 pi f t + RAD); default: none",
        "--minimum-coherence C": "squared coherence, 0 to 1, below which --phase self-consistent "
                                 "falls back to averaged; default 0.5",
        **averaging_option("phase-locked", passed=False),
        "--background-rms M/S": "of --averaging phase-locked: rms of the turbulence without the "
                                "sound, to which the incoherent velocity is brought down; default: "
                                "none",
        "--running-window S": "of --drive running-rms, s; default one period of the lowest "
                              "frequency",
        "--missing": (names.MISSING, "probes with nan or inf; default refuse"),
        "--allow-short": "accept records of fewer than four periods",
    },
    "kernel and replay": {
        "--kernel": (names.KERNELS, "default two-sided"),
        "--levels N": "velocity levels of the table of kernels; default 200",
        "--spacing": (names.SPACINGS, "of the levels; default sqrt"),
        "--interpolation": (names.INTERPOLATIONS, "between levels; default cubic"),
        "--velocity-max M/S": "highest level, m/s; default: that of the record, rounded up",
        "--window": (names.WINDOWS, "default hann for tones and segments, else boxcar"),
        "--segment S": "s, of segments that overlap by half; default the whole record",
    },
    "error bars": {
        "--interval LEVEL": "confidence level, 0 to 1; default 0.95",
        "--no-intervals": "no error bars",
    },
    "level check": {
        "--level-limit DB": "that Z with the velocity may be off a known pressure; default 0.3",
        "--level-uncertainty DB": "of that pressure, adds to the limit; default 0",
    },
    "machine": {
        "--device NAME": "cpu, cuda or cuda:1; default: that of the data",
        "--dtype": (names.DTYPES, "precision; default: that of the data"),
    },
}  # fmt: skip
REPLAYED = [dest(spec) for spec in CHOICES["kernel and replay"]]
EDUCED = [name for name in map(dest, chain(*CHOICES.values())) if name not in REPLAYED]  # by educe


def choice_options(wanted: Sequence[str], others: Mapping[str, Any] | None = None) -> dict[str, dict[str, Any]]:
    """Tables of options, for ``add_options``; their defaults are those of ``torchliner.educe``.

    Args:
        wanted: names of choices; those not in ``SHOWN`` wait for --help-all.
        others: in the place of entries of ``CHOICES``.
    """
    found: dict[str, dict[str, Any]] = {}
    for title, table in CHOICES.items():
        for spec in (spec for spec in table if dest(spec) in wanted):
            _, settings = argument(spec, (others or {}).get(spec, table[spec]))
            further = {"further": dest(spec) not in SHOWN}
            found.setdefault(title, {})[spec] = settings | further
    return found


def chosen_from(options: argparse.Namespace, wanted: Sequence[str]) -> dict[str, Any]:
    """What the user chose of the choices ``wanted``, for ``educe(**choices)``.

    Raises:
        ValueError: a level of error bars, and none of them.
    """
    chosen = stated(options, wanted)
    if chosen.pop("no_intervals", False):
        if "interval" in chosen:
            raise ValueError("--no-intervals leaves out what --interval is of; name one of them")
        chosen["interval"] = None
    return chosen

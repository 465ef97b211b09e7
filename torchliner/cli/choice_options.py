"""The choices of an eduction as options, one definition for all commands that educe."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import Any

from torchliner import names
from torchliner.cli.options import argument, dest, stated

SHOWN = (
    "phase order drive mean wall_filter engine edge window interval device dtype memory"
).split()  # by --help; --help-all shows the others too


def phase_option(rules: Sequence[str]) -> dict[str, Any]:
    """--phase with some of the rules."""
    meanings = "; ".join(f"{rule}, {names.PHASE_RULES[rule][1]}" for rule in rules)
    return {"--phase": (rules, f"of the incident tone: {meanings}; default averaged")}


NO_GIVEN_PHASE = phase_option([rule for rule in names.PHASE_RULES if rule != "given"])

CHOICES: dict[str, dict[str, Any]] = {
    "phase and velocity": {
        **phase_option(list(names.PHASE_RULES)),
        "--drive": (names.DRIVES, "|v| that drives the liner model; default instantaneous"),
        "--mean": (names.MEANS, "time-mean of v in the drive; default kept"),
        "--wall-filter C": "squared coherence with the tone, 0 to 1, below which a probe counts as "
                           "wall in averages over probes; default: no filter",
        "--reference-phase RAD": "for --phase given: x(t) = cos(2 pi f t + RAD); default: none",
        "--minimum-coherence C": "squared coherence, 0 to 1, below which --phase self-consistent "
                                 "falls back to averaged; default 0.5",
        "--order": (names.ORDERS, "of averaging, which the answer follows: default coherent first, "
                    "what of v is coherent with the tone is averaged over a cell; with an incident "
                    "signal probes first"),
        "--oncoming-rms M/S": "of --order coherent first: rms of the turbulence without the sound, "
                              "to which the incoherent velocity is brought down; default: none",
        "--running-window S": "of --drive running-rms, s; default one period of the lowest "
                              "frequency",
        "--missing": (names.MISSING, "probes with nan or inf; default refuse"),
        "--allow-short": "accept records of fewer than four periods",
    },
    "kernel and replay": {
        "--engine": (("auto", *names.ENGINES), "default auto: spectral for tones, unfold with an "
                     "incident signal"),
        "--edge": (("auto", *names.EDGE_RULES), "what is taken beyond the ends of the record; "
                   "default auto: finite for tones, else that of the signal"),
        "--window NAME": "default whole-periods, each emission time alike; or a sum of few cosines "
                         "on the reflected signal: hann, blackman, boxcar; --engine unfold: any of "
                         "scipy, hann unless stated, with --incident over the whole record boxcar",
        "--kernel": (names.KERNELS, "default two-sided"),
        "--response": (names.RESPONSES, "lines from the liner model or from the kernel; default "
                       "model where tones and the two-sided kernel allow it"),
        "--band HZ HZ": "where the kernel stands for the liner, Hz; default 300 to 3500 Hz and the "
                        "frequencies asked for",
        "--levels N": "velocity levels of the tables of --engine unfold and direct; default 200",
        "--spacing": (names.SPACINGS, "of the levels; default sqrt"),
        "--interpolation": (names.INTERPOLATIONS, "between levels; default cubic"),
        "--velocity-max M/S": "highest level, m/s; default: that of the record, rounded up",
        "--pre-roll S": "start of the record that only emits, s; default 0",
        "--segment S": "of the estimate with --incident, s; default the whole record",
        "--rank-tolerance R": "error in R allowed to the low-rank kernels of --engine unfold; "
                              "default 5e-6 in float32, 3e-11 in float64",
    },
    "error bars": {
        "--interval LEVEL": "confidence level, 0 to 1; default 0.95",
        "--no-intervals": "no error bars",
        "--resample": (names.RESAMPLED, "what is drawn for the whole liner; default time"),
    },
    "closure": {
        "--closure-limit DB": "that Z with the velocity may be off a known pressure; default 0.3",
        "--level-doubt DB": "of that pressure, adds to the limit; default 0",
    },
    "machine": {
        "--device NAME": "cpu, cuda or cuda:1; default: that of the data",
        "--dtype": (names.DTYPES, "precision; default: that of the data"),
        "--memory SIZE": "for slabs and work, e.g. 500MB, 2GB; default: what is fast, 0.2 GB, for "
                         "--engine unfold 1 GB",
    },
}  # fmt: skip
ALL = [dest(spec) for group in CHOICES.values() for spec in group]


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
        ValueError: a level or a way of error bars, and none of them.
    """
    chosen = stated(options, wanted)
    if chosen.pop("no_intervals", False):
        if given := [f"--{name}" for name in ("interval", "resample") if name in chosen]:
            raise ValueError(f"--no-intervals leaves out what {given[0]} is of; name one of them")
        chosen["interval"] = None
    if "band" in chosen:
        chosen["band"] = tuple(chosen["band"])
    return chosen

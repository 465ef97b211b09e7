"""The choices of an eduction as options, one definition for all commands that educe."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

NO_GIVEN_PHASE = {"choices": ["averaged", "self-consistent"]}  # where no phase can be given
ORDER_WORDS = ("probes first", "velocity first")

CHOICES: dict[str, dict[str, Any]] = {
    "engine": {"choices": ["auto", "spectral", "unfold", "direct"]},
    "segment": {"type": float, "metavar": "S", "help": "of --incident's estimate"},
    "phase": {"choices": ["averaged", "self-consistent", "given"]},
    "drive": {"choices": ["instantaneous", "rms", "running-rms"]},
    "mean": {"choices": ["kept", "removed"], "help": "time-mean of v in the drive"},
    "kernel": {"choices": ["two-sided", "causal"]},
    "response": {"choices": ["model", "kernel"]},
    "edge": {"choices": ["auto", "finite", "wrap", "silent"]},
    "window": {"help": "window of scipy, e.g. hann, boxcar, kaiser,8"},
    "band": {"nargs": 2, "type": float, "metavar": "HZ", "help": "band of the kernel"},
    "levels": {"type": int, "help": "velocity levels of the tables"},
    "spacing": {"choices": ["sqrt", "uniform"]},
    "interpolation": {"choices": ["cubic", "linear"]},
    "velocity_max": {"type": float, "metavar": "M/S", "help": "top of the levels"},
    "pre_roll": {"type": float, "metavar": "S", "help": "start that only emits"},
    "running_window": {"type": float, "metavar": "S", "help": "of --drive running-rms"},
    "minimum_coherence": {"type": float, "metavar": "C", "help": "for --phase self-consistent"},
    "wall_filter": {"type": float, "metavar": "C", "help": "squared coherence with the tone below "
                    "which a probe counts as wall in averages over probes"},
    "missing": {"choices": ["refuse", "exclude"], "help": "probes with nan or inf"},
    "allow_short": {"action": "store_true", "default": None,
                    "help": "accept fewer than four periods"},
    "interval": {"type": float, "metavar": "LEVEL", "help": "of the error bars, 0 to 1; default "
                 "0.95"},
    "draws": {"type": int, "help": "of the moving-block bootstrap; default 999"},
    "seed": {"type": int, "help": "of the bootstrap; default 0"},
    "resample": {"choices": ["time", "time-span", "time-cells"], "help": "for the whole liner's "
                 "error bars"},
    "device": {"help": "cpu, cuda, cuda:1"},
    "dtype": {"choices": ["float32", "float64"]},
    "memory": {"metavar": "SIZE", "help": "for slabs and work, e.g. 500MB, 2GB"},
    "compile": {"choices": ["auto", "never", "always"], "help": "fuse inner loops"},
    "rank_tolerance": {"type": float, "metavar": "R", "help": "error in R allowed to the low-rank "
                       "kernels of --engine unfold"},
}  # fmt: skip


def add_choice_options(
    parser: argparse.ArgumentParser, names: Sequence[str], **others: dict[str, Any]
) -> None:
    """Options of some of the choices; their defaults are those of ``torchliner.educe``.

    ``others``: by name, in the place of the entry in ``CHOICES``.
    """
    group = parser.add_argument_group("choices of the eduction")
    for name in names:
        group.add_argument("--" + name.replace("_", "-"), **(others.get(name) or CHOICES[name]))
    parser.set_defaults(choice_names=tuple(names))


def add_order_option(parser: argparse.ArgumentParser, default: str) -> None:
    """--order of averaging."""
    parser.add_argument(
        "--order", choices=ORDER_WORDS, default=default,
        help="of averaging: the admittance over probes, or the velocity; default "
        f"'{default}'",
    )  # fmt: skip


def chosen_from(options: argparse.Namespace) -> dict[str, Any]:
    """What the user chose, for ``educe(**choices)``."""
    chosen = {name: getattr(options, name) for name in options.choice_names}
    chosen = {name: value for name, value in chosen.items() if value is not None}
    if "band" in chosen:
        chosen["band"] = tuple(chosen["band"])
    return chosen

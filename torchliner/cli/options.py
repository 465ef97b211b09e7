"""Options that several commands share, how they are read, and what is printed."""

from __future__ import annotations

import argparse
import cmath
import json
import math
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any

from torchliner import names
from torchliner.cli.parser import Parser
from torchliner.ranges import frequencies

LARGEST = 1 << 53  # of whole numbers that a float64 holds


def number(text: str) -> float:
    """A finite number; argparse reports a ValueError itself."""
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not finite; a number is needed")
    return value


def whole_number(text: str, low: int = 0) -> int:
    """An index or a count; argparse reports a ValueError itself."""
    value = int(text)
    if not low <= value <= LARGEST:
        raise argparse.ArgumentTypeError(f"{text!r} is outside {low} to 2^53; a whole number in there is needed")
    return value


def count(text: str) -> int:
    """A whole number above 0."""
    return whole_number(text, 1)


class Joined(argparse.Action):
    """Lists of an option as one list, each value once: ranges may overlap."""

    def __call__(self, parser: Any, namespace: Any, values: Any, *_: Any) -> None:
        """Store it."""
        setattr(namespace, self.dest, list(dict.fromkeys(chain(*values))))


KINDS = {
    number: "HZ S M MM M/S DB DEG RAD C D R U LEVEL SHARE FACTOR MODULATION AVERAGINGS CHANGE".split(),
    whole_number: "N I".split(),
    Path: "FILE PICTURE FOLDER PATH PLANE LINE SOURCE RECORD".split(),
}
KIND_OF = {metavar: kind for kind, metavars in KINDS.items() for metavar in metavars}


def frequency_option(default: str, name: str = "--frequency", value: Sequence[float] | None = None) -> dict[str, Any]:
    """Values or ranges of frequency; ``default``: what ``value`` stands for, in words."""
    text = f"values in Hz, or ranges LOW:HIGH:STEP; default: {default}"
    return {f"{name} HZ ...": {"type": frequencies, "action": Joined, "default": value, "help": text}}


SHARED: dict[str, Any] = {
    "planes PLANE ...": "files of planes, of any format; 'run_*.nc' joins restarts",
    "plane PLANE": "file of a plane, of any format; 'run_*.nc' joins restarts",
    "--liner LINER": "preset, or .toml, .csv or .py file of a model; default: the one the file names",
    **frequency_option("the tone of the file"),
    "--output FILE": "write the rows as .csv",
    "--figure FOLDER": "draw pictures there",
    "--copy FILE": "write the preset as .toml, to edit",
    "--json": "print JSON instead of a table",
    "--quiet": "no progress bar, no warnings",
    "--strict": "exit code 1 where the level check fails for the answer",
}
CLUSTER: dict[str, Any] = {
    "--cluster WHERE": "workers that read the planes: local:N, N processes here; tcp://HOST:PORT of a dask scheduler, "
    "or its .json file; default: none, this process",
    "--wait S": "for its scheduler and its first worker, s; default 30",
}
CASE: dict[str, Any] = {
    "--frequency HZ": "tone in Hz",
    "--incident-level DB": "of the incident wave (normal incidence) or at the wall (grazing), dB re 20 uPa rms",
    "--mach M": "bulk Mach number",
    "--displacement-thickness M": "of the boundary layer, m",
    "--source-side": (
        [side for side in names.SOURCE_SIDES if side != "unknown"],
        "side that the sound comes from",
    ),
    "--liner NAME": "name of the liner below",
    "--title TEXT": "of tables and figures",
}  # facts that a file may leave unsaid


def add_options(parser: Parser, groups: Mapping[str, Mapping[str, Any]]) -> None:
    """Options and arguments from a table a group.

    Args:
        parser: takes them.
        groups: tables by title, that of the parser's own group being "". A table is keyed by what
            stands in the help: "--json" (a flag), "--speed M/S ..." (one or more), "--band HZ HZ"
            (two), "planes PLANE ..." (an argument), "duct [DUCT]" (that may be left out);
            ``KINDS`` says of what type a value is. The entry is the text, or choices and text, or
            settings of ``add_argument``; ``further`` among them waits for --help-all.
    """
    for title, table in groups.items():
        group = parser.add_argument_group(title) if title else parser
        for spec, entry in table.items():
            flags, settings = argument(spec, entry)
            further = settings.pop("further", False)
            action = group.add_argument(*flags, **settings)
            if flags == ["--figure"]:  # as some commands spelt it
                group.add_argument("--figures", **settings | {"dest": "figure", "help": argparse.SUPPRESS})
                width = "of figures: one (3.4, a column), page (5.3), two (7) or any in; default: page"
                group.add_argument("--figure-width", metavar="WIDTH", help=width)
            if further:
                parser.leave_out(action)


def argument(spec: str, entry: Any) -> tuple[list[str], dict[str, Any]]:
    """What ``add_argument`` takes, from an entry of a table."""
    name, _, shown = spec.partition(" ")
    settings = dict(entry) if isinstance(entry, dict) else {"help": entry}
    if isinstance(entry, tuple):
        settings = {"choices": entry[0], "help": entry[1]}
    elif not shown and "choices" not in settings:
        settings = {"action": "store_true"} | settings
    if shown:
        optional = shown.startswith("[")
        metavars = (shown[1:-1] if optional else shown).split()
        settings = {"type": KIND_OF.get(metavars[0], str)} | settings
        if metavars[-1] == "...":
            settings["nargs"] = "*" if optional else "+"
            metavars.pop()
        elif optional or len(metavars) > 1:
            settings["nargs"] = "?" if optional else len(metavars)
        settings["metavar"] = metavars[0] if len(metavars) == 1 else tuple(metavars)
    return ["-o", name] if name == "--output" else [name], settings


def shared(*wanted: str) -> dict[str, Any]:
    """Some of ``SHARED`` by name."""
    return {spec: entry for spec, entry in SHARED.items() if spec.split()[0] in wanted}


def level_check_code(options: argparse.Namespace, results: Iterable[Any]) -> int:
    """1 with --strict where the level check of a map or a line fails, else 0."""
    failed = any(result.level_check is not None and result.level_check.failed for result in results)
    return 1 if options.strict and failed else 0


def averaging_option(default: str, *, passed: bool = True) -> dict[str, Any]:
    """--averaging; ``passed``: the default reaches the function, in the place of its own."""
    meanings = "; ".join(f"{name}, {text}" for name, text in names.AVERAGINGS.items())
    entry = {"choices": list(names.AVERAGINGS), "help": f"over cells: {meanings}; default {default}"}
    return {"--averaging": entry | ({"default": default} if passed else {})}


def dest(spec: str) -> str:
    """The attribute that an entry of a table sets."""
    return spec.split()[0].removeprefix("--").replace("-", "_")


def spelled(keys: Iterable[str]) -> str:
    """Options by their attributes, as they are typed: "--in-situ, --quiet"."""
    return ", ".join(f"--{key.replace('_', '-')}" for key in keys)


def stated(options: argparse.Namespace, keys: Iterable[str]) -> dict[str, Any]:
    """Those of the options that the user gave, by name."""
    found = {key: getattr(options, key, None) for key in keys}
    return {key: value for key, value in found.items() if value is not None and value is not False}


def split_pair(text: str, option: str) -> tuple[str, str]:
    """NAME=VALUE."""
    name, equals, value = text.partition("=")
    if not equals:
        raise ValueError(f"{option} {text!r} cannot be read; write NAME=VALUE")
    return name.strip(), value.strip()


def complex_number(text: str, option: str, infinite: str = "") -> complex:
    """R+Xj, finite.

    Args:
        text: as typed.
        option: its name.
        infinite: what to write for an infinite value, for the message.
    Raises:
        ValueError: it cannot be read, or is not finite.
    """
    try:
        value = complex(text.replace(" ", ""))
    except ValueError:
        raise ValueError(f"{option} {text!r} cannot be read; write 2.33-0.30j") from None
    if not cmath.isfinite(value):
        raise ValueError(f"{option} {text!r} is not finite; write {infinite}a value such as 2.33-0.30j")
    return value


def print_json(value: Any) -> None:
    """JSON on standard output; what is not finite becomes null."""
    print(json.dumps(_plain(value), indent=2, allow_nan=False))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, complex):
        return {"resistance": _plain(value.real), "reactance": _plain(value.imag)}
    if isinstance(value, float) and not (abs(value) < float("inf")):
        return None
    return value


@contextmanager
def progress_bar(total: int, label: str, options: argparse.Namespace, unit: str = "sample") -> Iterator[Any]:
    """A callable that takes steps done; None with --quiet or if standard error is no terminal.

    Args:
        total: steps in all, at most.
        label: what is worked on.
        options: of the command.
        unit: of a step.
    """
    if options.quiet or not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, desc=label, unit=unit, unit_scale=unit in ("sample", "B"), leave=False) as bar:
        yield bar.update

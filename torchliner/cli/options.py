"""Options: each is declared once, with how its value is read and what part a file plays."""

from __future__ import annotations

import argparse
import cmath
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

from torchliner import names
from torchliner.io.whole_file import HDF5 as HDF5
from torchliner.io.whole_file import PICTURES
from torchliner.ranges import frequencies

LARGEST = 1 << 53  # of whole numbers that a float64 holds


@dataclass(frozen=True)
class Kind:
    """What a value is.

    Args:
        metavar: what help calls it.
        needs: what is wanted, for messages.
        read: the value of a word; ValueError where it is none.
        part: of a file, for ``gate``: "read", "named" (a file, or a name that is none), "written", "folder" (written).
        endings: that an output may have.
    """

    metavar: str
    needs: str = ""
    read: Callable[[str], Any] = str
    part: str = ""
    endings: tuple[str, ...] = ()

    def __call__(self, text: str) -> Any:
        """The value, for argparse."""
        try:
            return self.read(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} cannot be read; {self.needs} is needed") from None


def finite(text: str) -> complex:
    """R+Xj."""
    value = complex(text.replace(" ", ""))
    if not cmath.isfinite(value):
        raise ValueError(text)
    return value


def number(text: str) -> float:
    """A finite one."""
    if not math.isfinite(value := float(text)):
        raise ValueError(text)
    return value


def whole_number(text: str, low: int = 0) -> int:
    """An index or a count."""
    if not low <= (value := int(text)) <= LARGEST:
        raise ValueError(text)
    return value


TEXT, NUMBER, COMPLEX = Kind("TEXT"), Kind("X", "a finite number", number), Kind("R+XJ", "a value as 2.3-0.3j", finite)
HZ, S, M, MM, MPS, DB = (replace(NUMBER, metavar=unit) for unit in ("HZ", "S", "M", "MM", "M/S", "DB"))
INDEX = Kind("I", "a whole number from 0 to 2^53", whole_number)
COUNT = Kind("N", "a whole number from 1 to 2^53", lambda text: whole_number(text, 1))
FREQUENCIES = Kind("HZ", "a frequency in Hz, or LOW:HIGH:STEP,", frequencies)
PATH, FILE, PLANE = (Kind(word, read=Path, part="read") for word in ("PATH", "FILE", "PLANE"))
NAMED, LINER, ARRAY, QUIET = (Kind(word, part="named") for word in ("NAME", "LINER", "ARRAY", "FILE"))
DUCT = Kind("DUCT", part="named")
PICTURE = Kind("PICTURE", read=Path, part="written", endings=PICTURES)
FOLDER = Kind("FOLDER", read=Path, part="folder")


@dataclass(frozen=True)
class Option:
    """An option or an argument of commands.

    Args:
        flag: "--mach", or "planes" of an argument.
        text: help.
        kind: of a value; or the names that it may be; None of a switch.
        nargs, default, required: as argparse has them.
        many: may be given several times, each time with one more value.
        further: waits for --help-all.
        group: title in the help.
        about: text of --help, where that is shorter than ``text``.
    """

    flag: str
    text: str
    kind: Kind | Iterable[str] | None = None
    nargs: str | int | None = None
    default: Any = None
    required: bool = False
    many: bool = False
    further: bool = False
    group: str = ""
    about: str = ""

    @property
    def dest(self) -> str:
        """The attribute that it sets."""
        return self.flag.removeprefix("--").replace("-", "_")

    def settings(self) -> dict[str, Any]:
        """What ``add_argument`` takes."""
        if self.kind is None:
            return {"action": "store_true"}
        found: dict[str, Any] = {"nargs": self.nargs, "default": [] if self.many else self.default}
        if not isinstance(self.kind, Kind):
            found["choices"] = list(self.kind)
        else:
            found |= {"type": self.kind, "metavar": self.kind.metavar}
        if self.flag.startswith("--"):
            found["required"] = self.required
            found["action"] = Joined if self.kind is FREQUENCIES else "append" if self.many else "store"
        return found


class Joined(argparse.Action):
    """Lists of an option as one list, each value once: ranges may overlap."""

    def __call__(self, parser: Any, namespace: Any, values: Any, *_: Any) -> None:
        """Store it."""
        setattr(namespace, self.dest, list(dict.fromkeys(chain(*values))))


def group(title: str, *options: Option, further: bool = False) -> list[Option]:
    """Options under a title; ``further``: they wait for --help-all."""
    return [replace(each, group=title, further=each.further or further) for each in options]


def output(text: str, *endings: str, required: bool = False) -> Option:
    """--output, a file with one of the endings."""
    kind = Kind("FILE", read=Path, part="written", endings=endings)
    return Option("--output", f"{text} as {', '.join(endings)}", kind, required=required)


def figure(text: str, kind: Kind = PICTURE) -> list[Option]:
    """--figure, a picture or a folder of pictures, and how wide they are."""
    width = "of figures: one (3.4, a column), page (5.3), two (7), or a width in inches; default: page"
    return [Option("--figure", text, kind), Option("--figure-width", width, Kind("WIDTH"))]


def frequency(default: str, flag: str = "--frequency", values: Sequence[float] | None = None) -> Option:
    """Values or ranges of frequency; ``default``: what ``values`` stands for, in words."""
    text = f"values in Hz, or ranges LOW:HIGH:STEP; default: {default}"
    return Option(flag, text, FREQUENCIES, nargs="+", default=values)


def averaging(default: str | None, *of: str, text: str = "") -> Option:
    """--averaging with its own default; ``of``: some of the averagings alone."""
    known = {name: names.AVERAGINGS[name] for name in of or names.AVERAGINGS}
    meanings = text or "; ".join(f"{name}, {words}" for name, words in known.items()) + f"; default {default}"
    return Option("--averaging", f"averaging over cells{',' if not text else ';'} {meanings}", known, default=default)


RESULT = (*HDF5, *names.RESULT_WRITERS)
ANY_FORMAT = "of any format; 'run_*.nc' joins restarts"
ONE_PLANE, PLANES = (
    Option("plane", f"file of a plane, {ANY_FORMAT}", PLANE),
    Option("planes", f"files of planes, {ANY_FORMAT}", PLANE, nargs="+"),
)
OF_LINER = Option("--liner", "preset, or .toml, .csv or .py file of a model; default: the one the file names", LINER)
TONE = frequency("the tone of the file")
ROWS = output("write the rows", ".csv")
COPY = replace(output("write the preset, to edit,", ".toml"), flag="--copy")
PICTURES_OF = figure("draw pictures there", FOLDER)
PRINTING = [
    Option("--json", "print JSON instead of a table"),
    Option("--quiet", "no progress bar, no warnings"),
]
STRICT = Option("--strict", "exit code 1 where the level check fails for the answer")
WAVES = "tones:500,900, sweep:300:6000:logarithmic, noise:300:6000:SEED (Hz), or a .wav or .npy file"
INCIDENT = [
    Option("--incident", f"{WAVES}; default: tones of --frequency", Kind("SIGNAL", part="named")),
    Option("--incident-rate", "sampling rate of an .npy file, Hz; default: none", HZ),
]
WORKERS = "that read the data: local:N, N processes here; tcp://HOST:PORT of a dask scheduler, or its .json file"
CLUSTER = [
    Option("--cluster", f"workers {WORKERS}; default: none, this process", Kind("WHERE")),
    Option("--wait", "for its scheduler and its first worker, s; default 30", S),
]
SPL = "of the incident wave (normal incidence) or at the wall (grazing), dB re 20 uPa rms"
LEVEL = Option("--incident-level", f"{SPL}; default: that of the file", DB)
CASE = [
    Option("--frequency", "tone in Hz", HZ),
    Option("--incident-level", SPL, DB),
    Option("--mach", "bulk Mach number", NUMBER),
    Option("--displacement-thickness", "of the boundary layer, m", M),
    Option("--source-side", "side that the sound comes from", [s for s in names.SOURCE_SIDES if s != "unknown"]),
    Option("--liner", "name of the liner below", TEXT),
    Option("--title", "of tables and figures", TEXT),
]  # facts that a file may leave unsaid


def given(options: argparse.Namespace, declared: Iterable[Option]) -> dict[str, Any]:
    """Those of the options that the user gave, by name; ``interval`` None with --no-intervals.

    Raises:
        ValueError: a level of error bars, and none of them.
    """
    found = {each.dest: getattr(options, each.dest) for each in declared}
    found = {key: value for key, value in found.items() if value is not None and value is not False}
    if "background" in found:
        found["background"] = background_given(found["background"])
    if found.pop("no_intervals", False):
        if "interval" in found:
            raise ValueError("--no-intervals leaves out what --interval is of; name one of them")
        found["interval"] = None
    return found


def background_given(words: Sequence[str]) -> Any:
    """A number in m/s, or planes or moments without sound.

    Raises:
        ValueError: a number beside others.
    """
    import torchliner as tl
    from torchliner.io.moments_file import holds_moments

    try:
        (word,) = words
        return float(word)
    except ValueError:
        return [tl.read_moments(each) if holds_moments(each) else tl.read_plane(each, lazy=True) for each in words]


def spelled(keys: Iterable[str]) -> str:
    """Options by their attributes, as they are typed: "--in-situ, --quiet"."""
    return ", ".join(f"--{key.replace('_', '-')}" for key in keys)

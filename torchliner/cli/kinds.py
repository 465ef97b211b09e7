"""What an option and a command are, and the kinds of values."""

from __future__ import annotations

import argparse
import cmath
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from torchliner.io.whole_file import PICTURES
from torchliner.ranges import frequencies


@dataclass(frozen=True)
class Kind:
    """What a value is: its name in the help, how a word is read, and of a file what the command does with it."""

    metavar: str
    read: Callable[[str], Any] = str
    part: str = ""  # "read", "named" (a file, or a name that is none), "written", "folder" (written)
    endings: tuple[str, ...] = ()  # that an output may have

    def __call__(self, text: str) -> Any:
        """The value, for argparse."""
        try:
            return self.read(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} cannot be read as {self.metavar}") from None


def finite(text: str) -> complex:
    """R+Xj; of a real number a complex one."""
    if not cmath.isfinite(value := complex(text.replace(" ", ""))):
        raise ValueError(text)
    return value


def number(text: str) -> float:
    """A finite one."""
    if not math.isfinite(value := float(text)):
        raise ValueError(text)
    return value


def whole_number(text: str) -> int:
    """An index or a count, that a float64 holds."""
    if not 0 <= (value := int(text)) <= 1 << 53:
        raise ValueError(text)
    return value


TEXT, NUMBER, COMPLEX, COUNT = Kind("TEXT"), Kind("X", number), Kind("R+XJ", finite), Kind("N", whole_number)
HZ, S, M, MPS, DB = (replace(NUMBER, metavar=unit) for unit in ("HZ", "S", "M", "M/S", "DB"))
FREQUENCIES = Kind("HZ or LOW:HIGH:STEP", frequencies)
PATH, FILE, PLANE = (Kind(word, Path, "read") for word in ("PATH", "FILE", "PLANE"))
LINER, ARRAY, DUCT, SIGNAL, QUIET = (Kind(word, part="named") for word in ("LINER", "ARRAY", "DUCT", "SIGNAL", "FILE"))
PICTURE, FOLDER = Kind("PICTURE", Path, "written", PICTURES), Kind("FOLDER", Path, "folder")


@dataclass(frozen=True)
class Option:
    """An option, "--mach", or an argument, "planes"; ``kind``: of a value, or its names; None of a switch."""

    flag: str
    text: str
    kind: Kind | Iterable[str] | None = None
    nargs: str | int | None = None
    default: Any = None
    required: bool = False
    many: bool = False  # may be given several times, each time with one more value
    further: bool = False  # waits for --help-all
    group: str = ""  # title in the help

    @property
    def dest(self) -> str:
        """The attribute that it sets."""
        return self.flag.removeprefix("--").replace("-", "_")

    def settings(self) -> dict[str, Any]:
        """What ``add_argument`` takes."""
        if self.kind is None:
            return {"action": "store_true"}
        found: dict[str, Any] = {"nargs": self.nargs, "default": [] if self.many else self.default}
        if isinstance(self.kind, Kind):
            found |= {"type": self.kind, "metavar": self.kind.metavar.split()[0]}
        else:
            found["choices"] = list(self.kind)
        if self.flag.startswith("--"):
            found["required"] = self.required
            found["action"] = Joined if self.kind is FREQUENCIES else "append" if self.many else "store"
        return found


class Joined(argparse.Action):
    """Lists of an option as one list, each value once: ranges may overlap."""

    def __call__(self, parser: Any, namespace: Any, values: Any, *_: Any) -> None:
        """Store it."""
        setattr(namespace, self.dest, list(dict.fromkeys(chain(*values))))


class Command(NamedTuple):
    """A command, or a task of one; those that read planes have the options of that as well, in ``options.reading``."""

    run: Callable[[Any], int | None]  # takes the parsed options; returns the exit code, None for 0
    options: Sequence[Option]
    examples: tuple[str, ...]  # words after the name of the command
    chosen: Sequence[Option] = ()  # options that a public function takes as they are: given ones are ``options.chosen``

"""Kinds of values that options take, and how each is read from a word."""

import argparse
import cmath
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from torchliner.names import frequencies


@dataclass(frozen=True)
class Kind:
    """What a value is: its name in the help, how a word is read; of a file, what the command does with it."""

    metavar: str
    read: Callable[[str], Any] = str
    part: str = ""  # "read"; "named": a file or another name; "written"; "drawn": a picture or a folder; "folder"
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
    finite(text)
    return float(text)


def bounds(text: str) -> dict[str, tuple[float, ...]]:
    """Low and high by name; () of a name alone."""
    found: dict[str, tuple[float, ...]] = {}
    for each in text.split(","):
        name, equals, ends = (part.strip() for part in each.partition("="))
        found[name] = tuple(map(number, ends.split(":"))) if equals else ()
        if len(found[name]) not in (0, 2):
            raise ValueError(text)
    return found


def tolerance(text: str) -> tuple[str, float]:
    """Name and half-width."""
    name, value = text.split("=")
    return name.strip(), number(value)


def reference(text: str) -> Any:
    """A value, or a name."""
    try:
        return finite(text)
    except ValueError:
        return text


TEXT, NUMBER, COMPLEX, COUNT = Kind("TEXT"), Kind("X", number), Kind("R+XJ", finite), Kind("N", int)
LEVEL = Kind("LEVEL", lambda text: None if text.lower() == "none" else number(text))
BOUNDS, TOLERANCES = Kind("NAME[=LOW:HIGH],...", bounds), Kind("NAME=X", tolerance)
REFERENCE = Kind("NAME or R+XJ", reference)
WALL = Kind("R+XJ", lambda text: text if text == "rigid" else finite(text))
FREQUENCIES = Kind("HZ or LOW:HIGH:STEP", frequencies)

"""The parser of a command: argparse that names the nearest word for a slip."""

from __future__ import annotations

import argparse
import re
import sys
from itertools import chain
from typing import Any, NoReturn

from torchliner.cli.options import FREQUENCIES, Command, Option
from torchliner.names import did_you_mean

BAD_INPUT = 2
PRINTING = (
    Option("--json", "print JSON instead of a table"),
    Option("--verbose", "print all there is, and every warning"),
    Option("--quiet", "no progress bar, no warnings"),
    Option("--debug", "print the traceback of an error"),
)
TAKEN = ("chosen", "reading", "facts")  # dicts of given options


class Parser(argparse.ArgumentParser):
    """Of one command."""

    def __init__(self, name: str, command: Command) -> None:
        super().__init__(prog=f"torchliner {name}", description=f"{command.summary}.", allow_abbrev=False)
        # No option begins with a minus and a digit: -0.17-0.07j is an impedance, not an option.
        self._negative_number_matcher = re.compile(r"-\.?\d")
        every = [one for each in command.options for one in ([each] if isinstance(each, Option) else each.options())]
        self.options = sorted([*every, *PRINTING], key=lambda each: each.to == "reading")  # that of the files last
        groups: dict[str, Any] = {"": self}
        for each in self.options:
            if each.group not in groups:
                groups[each.group] = self.add_argument_group(each.group)
            flags = ["-o", each.flag] if each.flag == "--output" else [each.flag]
            groups[each.group].add_argument(*flags, help=each.text.replace("%", "%%"), **each.settings())
        needed = [each for each in self.options if each.required or each.flag[:1] != "-"]
        words = [each.flag if each.required else each.dest.upper() for each in needed]
        words = [f"{a} ..." if b.nargs == "+" or b.required else a for a, b in zip(words, needed, strict=True)]
        self.usage = " ".join([self.prog, "[options]", *words])

    def parse(self, words: list[str]) -> argparse.Namespace:
        """The options; those that go into a dict stand there by name, if they are given."""
        found = self.parse_args(words)
        for name in TAKEN:
            setattr(found, name, {})
        for each in self.options:
            value = getattr(found, each.dest, None)
            if each.kind is FREQUENCIES and value is not None:  # ranges may overlap
                setattr(found, each.dest, list(dict.fromkeys(chain(*value))))
            if each.to and hasattr(found, each.dest):
                getattr(found, each.to)[each.dest] = getattr(found, each.dest)
        return found

    def in_words(self, text: str) -> str:
        """Keywords of Python, as ``allow_short=True``, as options of the command."""
        flags = {each.dest: each.flag for each in self.options if each.flag[:1] == "-"}

        def option(found: re.Match[str]) -> str:
            name, value = found.groups()
            return f"{flags[name]} {value}".removesuffix(" True") if name in flags else found[0]

        return re.sub(r"(?<![\w-])([a-z]\w*)=['\"]?(\.\.\.|[\w+-]+(?:\.\w+)*)['\"]?", option, text)

    def error(self, message: str) -> NoReturn:
        """Print the message with the nearest known word, and where to find help; exit with 2."""
        if wrong := re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message):
            message += did_you_mean(wrong[1], [word.strip(" '") for word in wrong[2].split(",")])
        if extra := re.match(r"unrecognized arguments: (.*)", message, re.DOTALL):
            known = [*self._option_string_actions]
            words = [word + did_you_mean(word.split("=")[0], known) for word in extra[1].split()]
            message = f"unknown option or argument: {', '.join(words)}"
        print(f"{self.prog}: {message}\nSee {self.prog} --help", file=sys.stderr)
        sys.exit(BAD_INPUT)

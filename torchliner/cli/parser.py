"""The parser of the commands: argparse with a short and a whole help, that names the nearest word for a slip."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

from torchliner.cli.kinds import Option
from torchliner.names import did_you_mean

BAD_INPUT = 2
FILES = {"bash": "_shtab_compgen_files", "zsh": "_files", "tcsh": "f"}  # as shtab completes them


class Usage(argparse.RawDescriptionHelpFormatter):
    """One line of usage: the options that must be given, [options], the arguments."""

    def add_usage(
        self, usage: str | None, actions: Iterable[argparse.Action], groups: Any, prefix: str | None = None
    ) -> None:
        """As argparse, without the options that may be left out."""
        needed = [action for action in actions if action.required or not action.option_strings]
        super().add_usage(usage, [argparse.Action([], "options", metavar="[options]"), *needed], [], prefix)


class Parser(argparse.ArgumentParser):
    """Refuses words with the nearest known one; ``whole``: its help has the options that are ``further`` too."""

    def __init__(self, *arguments: Any, whole: bool = False, **settings: Any) -> None:
        usual: dict[str, Any] = {"formatter_class": Usage, "allow_abbrev": False, "add_help": False}
        super().__init__(*arguments, **usual | settings)
        # No option begins with a minus and a digit: -0.17-0.07j is an impedance, not an option.
        self._negative_number_matcher = re.compile(r"-\.?\d")
        self.whole = whole
        self.add_argument("-h", "--help", action="help", help="print this help and exit")
        self.add_argument(
            "--debug", action="store_true", default=argparse.SUPPRESS, help="print the traceback of an error"
        )

    def add_options(self, options: Iterable[Option]) -> None:
        """Those of a command, and --help-all where --help leaves some out."""
        groups: dict[str, Any] = {"": self}
        options = list(options)
        further = sum(option.further for option in options)
        for option in options:
            if option.group not in groups:
                groups[option.group] = self.add_argument_group(option.group)
            flags = ["-o", option.flag] if option.flag == "--output" else [option.flag]
            action = groups[option.group].add_argument(*flags, help=option.text, **option.settings())
            action.help = self.in_words(option.text).replace("%", "%%")
            if getattr(option.kind, "part", ""):
                action.complete = FILES  # type: ignore[attr-defined]
            if option.further and not self.whole:
                action.help = argparse.SUPPRESS
        if further and not self.whole:
            self.epilog = f"{self.epilog}\n\n{further} more options: {self.prog} --help-all"
        text = "print the help with all options and exit" if further else argparse.SUPPRESS
        self.add_argument("--help-all", action="help", help=text)

    def in_words(self, text: str) -> str:
        """Keywords of Python, as ``allow_short=True``, as options of the command."""
        flags = {action.dest: action.option_strings[-1] for action in self._actions if action.option_strings}

        def option(found: re.Match[str]) -> str:
            name, value = found.groups()
            if (name, value) == ("interval", "None"):
                return "--no-intervals"
            return " ".join([flags[name], *value.split("True")]).strip() if name in flags else found[0]

        return re.sub(r"(?<![\w-])([a-z]\w*)=['\"]?(\.\.\.|[\w+-]+(?:\.\w+)*)['\"]?", option, text)

    def chosen(self, options: argparse.Namespace) -> Parser:
        """The parser of the task that was chosen, or this one."""
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                found: Parser = action.choices[getattr(options, action.dest)].chosen(options)
                return found
        return self

    def error(self, message: str) -> NoReturn:
        """Print the message with a suggestion and where to find help; exit with 2."""
        wrong = re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message)
        if wrong:
            message += did_you_mean(wrong[1], [word.strip(" '") for word in wrong[2].split(",")])
        print(f"{self.prog}: {message}\nSee {self.prog} --help", file=sys.stderr)
        sys.exit(BAD_INPUT)

    def refuse(self, extras: Sequence[str]) -> NoReturn:
        """Complain of unknown options, each with its nearest known one."""
        known = [option for action in self._actions for option in action.option_strings]
        unknown = [word + did_you_mean(word.split("=")[0], known) for word in extras if word[:1] == "-"]
        self.error(f"unknown option or argument: {', '.join(unknown or map(repr, extras))}")

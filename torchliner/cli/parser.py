"""The parser of the commands: two lengths of help, and the nearest word for a slip."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

from torchliner.names import did_you_mean

BAD_INPUT = 2
EXAMPLES_FOLLOW = "examples:"


class Usage(argparse.HelpFormatter):
    """One line of usage: the options that must be given, [options], the arguments."""

    def add_usage(
        self,
        usage: str | None,
        actions: Iterable[argparse.Action],
        groups: Iterable[Any],
        prefix: str | None = None,
    ) -> None:
        """As argparse, without the options that may be left out."""
        needed = [action for action in actions if action.required or not action.option_strings]
        rest = argparse.Action([], "options", metavar="[options]")
        super().add_usage(usage, [rest, *needed], [], prefix)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        """Lines of examples stay as they are."""
        if text.startswith(EXAMPLES_FOLLOW):
            return text
        return super()._fill_text(text, width, indent)


class ShowAll(argparse.Action):
    """--help-all: the help with the options that --help leaves out."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        """Print it and exit."""
        assert isinstance(parser, Parser)
        for action, text in parser.further.items():
            action.help = text
        parser.epilog = parser.examples
        parser.print_help()
        parser.exit()


class Parser(argparse.ArgumentParser):
    """argparse that can leave options out of --help and names the nearest known word.

    ``further``: the options that only --help-all shows, each with its text; ``examples``: text that
    ends the help.
    """

    def __init__(self, *arguments: Any, examples: str = "", **settings: Any) -> None:
        usual: dict[str, Any] = {"formatter_class": Usage, "allow_abbrev": False, "add_help": False}
        super().__init__(*arguments, **usual | settings)
        # No option begins with a minus and a digit: -0.17-0.07j is an impedance, not an option.
        self._negative_number_matcher = re.compile(r"-\.?\d")
        self.further: dict[argparse.Action, str | None] = {}
        self.examples = examples
        self.epilog = self.epilog or examples
        self.add_argument("-h", "--help", action="help", help="print this help and exit")
        self.add_argument(
            "--debug", action="store_true", default=argparse.SUPPRESS,
            help="print the traceback of an error",
        )  # fmt: skip
        self._help_all = self.add_argument("--help-all", action=ShowAll, nargs=0, help=argparse.SUPPRESS)

    def text_of(self, action: argparse.Action) -> str:
        """The help of an option, whether or not --help shows it."""
        return self.further.get(action) or action.help or ""

    def chosen(self, options: argparse.Namespace) -> Parser:
        """The parser of the task that was chosen, or this one."""
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                found: Parser = action.choices[getattr(options, action.dest)].chosen(options)
                return found
        return self

    def leave_out(self, action: argparse.Action) -> None:
        """Show an option with --help-all alone."""
        self.further[action] = action.help
        action.help = argparse.SUPPRESS
        self._help_all.help = "print the help with all options and exit"
        more = f"{len(self.further)} more options: {self.prog} --help-all"
        self.epilog = "\n\n".join(filter(None, [self.examples, more]))

    def error(self, message: str) -> NoReturn:
        """Print the message with a suggestion and where to find help; exit with 2."""
        wrong = re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message)
        if wrong:
            known = [word.strip(" '") for word in wrong.group(2).split(",")]
            message += did_you_mean(wrong.group(1), known)
        print(f"{self.prog}: {message}\nSee {self.prog} --help", file=sys.stderr)
        sys.exit(BAD_INPUT)

    def refuse(self, extras: Sequence[str]) -> NoReturn:
        """Complain of unknown options, each with its nearest known one."""
        known = [option for action in self._actions for option in action.option_strings]
        unknown = [word + did_you_mean(word.split("=")[0], known) for word in extras if word[:1] == "-"]
        self.error(f"unknown option or argument: {', '.join(unknown or map(repr, extras))}")

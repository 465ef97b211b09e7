"""The parser of the commands: two lengths of help, the nearest word for a slip, completion by shtab."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

from torchliner.cli.options import Kind, Option
from torchliner.names import did_you_mean

BAD_INPUT = 2
SHELLS = ("bash", "zsh", "tcsh")
KEYWORD = r"(?<![\w-])([a-z]\w*)=(\([^()]*\)|['\"][^'\"]*['\"]|\.\.\.|[\w+-]+(?:\.\w+)*)"  # and its value


class Usage(argparse.RawDescriptionHelpFormatter):
    """One line of usage: the options that must be given, [options], the arguments."""

    def add_usage(
        self, usage: str | None, actions: Iterable[argparse.Action], groups: Any, prefix: str | None = None
    ) -> None:
        """As argparse, without the options that may be left out."""
        needed = [action for action in actions if action.required or not action.option_strings]
        super().add_usage(usage, [argparse.Action([], "options", metavar="[options]"), *needed], [], prefix)


class Parser(argparse.ArgumentParser):
    """argparse with --help-all, that names the nearest known word.

    ``whole``: text of --help-all of the options that --help leaves out or shortens; ``examples`` end the help.
    """

    def __init__(self, *arguments: Any, examples: str = "", **settings: Any) -> None:
        usual: dict[str, Any] = {"formatter_class": Usage, "allow_abbrev": False, "add_help": False, "epilog": examples}
        super().__init__(*arguments, **usual | settings)
        # No option begins with a minus and a digit: -0.17-0.07j is an impedance, not an option.
        self._negative_number_matcher = re.compile(r"-\.?\d")
        self.whole: dict[argparse.Action, str] = {}
        self.examples = examples
        self.add_argument("-h", "--help", action="help", help="print this help and exit")
        self.add_argument(
            "--debug", action="store_true", default=argparse.SUPPRESS, help="print the traceback of an error"
        )

    def add_options(self, options: Iterable[Option]) -> None:
        """Those of a command, and --help-all where it has more to say."""
        groups: dict[str, Any] = {"": self}
        hidden: list[argparse.Action] = []
        for option in options:
            if option.group not in groups:
                groups[option.group] = self.add_argument_group(option.group)
            flags = ["-o", option.flag] if option.flag == "--output" else [option.flag]
            action = groups[option.group].add_argument(*flags, **option.settings())
            action.help = option.about or option.text
            if option.further or action.help != option.text:
                self.whole[action] = option.text
            if option.further:
                hidden.append(action)
        for action in self._actions:
            if action in self.whole:
                self.whole[action] = self.in_words(self.whole[action]).replace("%", "%%")
            action.help = self.in_words(action.help or "").replace("%", "%%")
        for action in hidden:
            action.help = argparse.SUPPRESS
        text = "print the help with all options and exit" if self.whole else argparse.SUPPRESS
        self.add_argument("--help-all", action=ShowAll, nargs=0, help=text)
        if hidden:
            self.epilog = f"{self.examples}\n\n{len(hidden)} more options: {self.prog} --help-all"

    def show_all(self) -> None:
        """The help is that of --help-all."""
        for action, text in self.whole.items():
            action.help = text
        self.epilog = self.examples

    def in_words(self, text: str) -> str:
        """Keywords of Python, as ``allow_short=True``, as options of the command."""
        flags = {action.dest: action.option_strings[-1] for action in self._actions if action.option_strings}

        def option(found: re.Match[str]) -> str:
            name, value = found.groups()
            if name == "interval" and value == "None" and "no_intervals" in flags:
                return flags["no_intervals"]
            words = re.sub(r"[()',\"]+", " ", value).split()
            return " ".join([flags[name], *(w for w in words if w != "True")]) if name in flags else found[0]

        return re.sub(KEYWORD, option, text)

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


class ShowAll(argparse.Action):
    """--help-all."""

    def __call__(self, parser: Any, *_: Any) -> NoReturn:
        """Print it and exit."""
        parser.show_all()
        parser.print_help()
        sys.exit()


class PrintCompletion(argparse.Action):
    """--print-completion SHELL: the script that the shell sources."""

    def __call__(self, parser: Any, namespace: Any, values: Any, *_: Any) -> NoReturn:
        """Print it and exit."""
        try:
            import shtab
        except ImportError:
            parser.error('completion needs shtab: pip install "torchliner[completion]"')
        every = [parser]
        for each in every:
            each.show_all()
            for action in each._actions:
                if isinstance(action, argparse._SubParsersAction):
                    action.help = "command"
                    every += action.choices.values()
                elif isinstance(action.type, Kind) and action.type.part:
                    action.complete = shtab.DIRECTORY if action.type.part == "folder" else shtab.FILE
        print(shtab.complete(parser, values))
        sys.exit()

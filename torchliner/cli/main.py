"""``torchliner``: parse, call, print. Heavy imports wait inside the commands."""

from __future__ import annotations

import argparse
import importlib
import re
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from torchliner.names import did_you_mean
from torchliner.version import __version__

COMMANDS = {
    "educe": "impedance map of one or several velocity planes",
    "insitu": "impedance from facesheet and backplate pressure, and from microphones",
    "kt": "impedance from microphones along a lined duct, by wavenumber",
    "info": "describe and check a velocity plane",
    "convert": "write a plane file from simulation files or plain arrays",
    "duct": "sound field and modes of a lined duct with flow",
    "ldv": "bursts of laser Doppler stations: describe, check, convert, educe",
    "liner": "geometry, resonance and impedance of a liner",
    "audit": "how far each open choice moves the impedance, beside its interval",
    "height": "impedance over height and averaging length, and which height to take",
    "sensitivity": "change of Z with each parameter of a liner; tolerances propagated",
    "calibrate": "parameters of a liner fitted to known impedances, and what they predict",
    "verify": "order tables and checks of the duct solvers; exit code 1 if one fails",
    "truth": "every rule beside the true impedance of resolved cases",
}
DONE, CHECK_FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130


class Parser(argparse.ArgumentParser):
    """argparse that suggests the nearest option or choice and exits with 2."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        # No option begins with a minus and a digit: -0.17-0.07j is an impedance, not an option.
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message: str) -> NoReturn:
        """Print the message with a suggestion and where to find help."""
        wrong = re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message)
        if wrong:
            known = [word.strip(" '") for word in wrong.group(2).split(",")]
            message += did_you_mean(wrong.group(1), known)
        print(f"{self.prog}: {message}\nSee {self.prog} --help", file=sys.stderr)
        sys.exit(BAD_INPUT)

    def refuse(self, extras: Sequence[str], options: argparse.Namespace) -> NoReturn:
        """Complain of unknown options, each with its nearest known one."""
        for action in self._actions:  # a task of a command knows more than the command
            if isinstance(action, argparse._SubParsersAction):
                action.choices[getattr(options, action.dest)].refuse(extras, options)
        known = [option for action in self._actions for option in action.option_strings]
        said = [word + did_you_mean(word.split("=")[0], known) for word in extras if word[0] == "-"]
        self.error(f"unknown option or argument: {', '.join(said or extras)}")


def build_parser() -> tuple[Parser, dict[str, Parser]]:
    """The top parser and those of the commands."""
    top = Parser(
        prog="torchliner",
        description="Acoustic liner impedance from velocity measured just above the liner.",
        allow_abbrev=False,
    )
    top.add_argument("--version", action="version", version=f"torchliner {__version__}")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", parser_class=Parser)
    parsers = {}
    for name, summary in COMMANDS.items():
        parser = commands.add_parser(
            name,
            help=summary,
            description=f"{summary[0].upper()}{summary[1:]}.",
            allow_abbrev=False,
        )
        importlib.import_module(f"torchliner.cli.{name}").add_arguments(parser)
        parsers[name] = parser
    return top, parsers


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code: 0 done, 1 a check failed, 2 bad input."""
    top, parsers = build_parser()
    options, extras = top.parse_known_args(arguments)
    if options.command is None:
        top.print_help()
        return DONE
    if extras:
        parsers[options.command].refuse(extras, options)
    command = importlib.import_module(f"torchliner.cli.{options.command}")
    try:
        return int(command.run(options))
    except BrokenPipeError:  # the reader of a pipe has seen enough
        sys.stdout = None  # type: ignore[assignment]  # nothing to flush into
        return DONE
    except (ValueError, TypeError, OSError, ImportError, RuntimeError) as error:
        print(f"torchliner {options.command}: {error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print(f"torchliner {options.command}: interrupted", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())

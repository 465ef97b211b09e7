"""Completion of commands, options and files in the shell, by shtab."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, NoReturn

from torchliner.cli.gate import MAYBE
from torchliner.cli.parser import Parser

SHELLS = ("bash", "zsh", "tcsh")


class PrintCompletion(argparse.Action):
    """--print-completion SHELL: the script that the shell sources."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, *_: Any
    ) -> NoReturn:
        """Print it and exit."""
        try:
            import shtab
        except ImportError:
            parser.error('completion needs shtab: pip install "torchliner[completion]"')
        assert isinstance(parser, Parser)
        _show_all(parser, shtab.FILE, shtab.DIRECTORY)
        print(shtab.complete(parser, values))
        parser.exit()


def _show_all(parser: Parser, file: Any, folder: Any) -> None:
    """Every command and option completes, and files where files are meant."""
    for action, text in parser.further.items():
        action.help = text
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            action.help = action.help if action.help != argparse.SUPPRESS else "command"
            for each in action.choices.values():
                _show_all(each, file, folder)
        elif action.type is Path or action.metavar in MAYBE:
            action.complete = folder if action.metavar == "FOLDER" else file  # type: ignore[attr-defined]

"""What a command says: errors, warnings and results, in its own words and safe for a terminal."""

from __future__ import annotations

import argparse
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Any

from torchliner.cli.parser import Parser
from torchliner.io.whole_file import printable

PACKAGE = str(Path(__file__).resolve().parents[1])
EXPECTED = (ValueError, TypeError, OSError, ImportError, RuntimeError)
KEYWORD = r"(?<![\w-])([a-z]\w*)=(\([^()]*\)|'[^']*'|\.\.\.|[\w+-]+(?:\.\w+)*)"  # and its value
NUMBERS = r"\d+(?:\.\d+)?(?:e[-+]?\d+)?"
NO_MEMORY = ("can't allocate memory", "out of memory", "Unable to allocate")


def error_text(error: Exception, inputs: Sequence[str]) -> str:
    """One message of an error, with the files where it names none of them.

    Args:
        error: as caught.
        inputs: that the command reads.
    """
    text = str(error) or type(error).__name__
    files = ", ".join(inputs)
    lead = f"{files}: " if files and not any(name in text for name in inputs) else ""
    if isinstance(error, MemoryError) or any(words in text for words in NO_MEMORY):
        return f"{lead}not enough memory: {text}; take fewer probes or samples"
    if isinstance(error, EXPECTED) and not isinstance(error, RecursionError):
        return text if _is_ours(error) else lead + text
    return (
        f"{lead}{type(error).__name__}: {text.splitlines()[0]}; this is a fault of torchliner: "
        "please report it, with the file and with what --debug prints"
    )


def _is_ours(error: Exception) -> bool:
    """Whether this package raised it, not a library that knows of no file."""
    step = error.__traceback__
    while step is not None and step.tb_next is not None:
        step = step.tb_next
    return step is not None and step.tb_frame.f_code.co_filename.startswith(PACKAGE)


def in_command_words(text: str, parser: Parser) -> str:
    """Keywords of Python, as ``allow_short=True``, as options of a command."""
    flags = {a.dest: a.option_strings[-1] for a in parser._actions if a.option_strings}

    def option(found: re.Match[str]) -> str:
        name, value = found.groups()
        if name == "interval" and value == "None" and "no_intervals" in flags:
            return flags["no_intervals"]
        if name not in flags:
            return found[0]
        words = re.sub(r"[()',\"]+", " ", value or "").split()
        return " ".join([flags[name], *(word for word in words if word != "True")])

    return re.sub(KEYWORD, option, text)


class Printable:
    """A stream on which nothing moves the cursor or cannot be encoded."""

    def __init__(self, stream: Any) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """With control characters written out."""
        coding = self.stream.encoding or "utf-8"
        text = printable(text).encode(coding, "backslashreplace").decode(coding)
        return int(self.stream.write(text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextmanager
def printable_output() -> Iterator[None]:
    """Titles and names from files reach the terminal as text alone."""
    if sys.stdout is None:  # closed by the caller
        yield
        return
    with redirect_stdout(Printable(sys.stdout)):  # type: ignore[type-var]
        yield


@contextmanager
def warnings_on_stderr(options: argparse.Namespace, parser: Parser, inputs: Sequence[str]) -> Iterator[None]:
    """Show each warning once, on one line, or none with --quiet.

    One that several inputs share, but for its numbers, is shown for the first of them; the others
    are named at the end. What libraries will change one day is left to --debug.

    Args:
        options, parser: of the command.
        inputs: names of the files, which may still be filled in.
    """
    seen: dict[str, list[str]] = {}

    def show(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        text = printable(in_command_words(str(message), parser))
        named = max((name for name in inputs if name in text), key=len, default="")
        others = seen.setdefault(re.sub(NUMBERS, "#", text.replace(named, "")), [])
        if not others:
            print(f"warning: {text}", file=sys.stderr)
        if named not in others:
            others.append(named)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore" if getattr(options, "quiet", False) else "always")
        if not getattr(options, "debug", False):
            for category in (DeprecationWarning, PendingDeprecationWarning, FutureWarning):
                warnings.simplefilter("ignore", category)
        warnings.showwarning = show
        try:
            yield
        finally:
            for text, (_, *others) in seen.items():
                if others:
                    words = " ".join(text.partition(": ")[2].split()[:7])
                    names = ", ".join(others)
                    print(f"warning: '{words} ...' also applies to {len(others)} more: {names}",
                          file=sys.stderr)  # fmt: skip

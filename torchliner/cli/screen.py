"""What a command says of errors and warnings, safe for a terminal."""

from __future__ import annotations

import argparse
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from torchliner.cli.parser import Parser
from torchliner.io.whole_file import printable

EXPECTED = (ValueError, TypeError, OSError, ImportError, RuntimeError)
NO_MEMORY = ("can't allocate memory", "out of memory", "Unable to allocate")
NUMBERS = r"\d+(?:\.\d+)?(?:e[-+]?\d+)?"
WARNINGS_SHOWN = 3  # without --verbose


def error_text(error: Exception, inputs: Sequence[str]) -> str:
    """One message of an error; of one that was not foreseen with the inputs, which a library does not name."""
    text, lead = str(error) or type(error).__name__, "".join(f"{name}: " for name in inputs[:1])
    if isinstance(error, MemoryError) or any(words in text for words in NO_MEMORY):
        return f"{lead}not enough memory: {text}; take fewer probes or samples"
    if isinstance(error, EXPECTED) and not isinstance(error, RecursionError):
        return text
    return (
        f"{lead}{type(error).__name__}: {text.splitlines()[0]}; this is a fault of torchliner: please report it, with "
        "the file and with what --debug prints"
    )


@contextmanager
def warnings_on_stderr(options: argparse.Namespace, parser: Parser, inputs: Sequence[str]) -> Iterator[None]:
    """Each warning once, on one line, what moves Z most first: three, all with --verbose, none with --quiet.

    One that several inputs share, but for its numbers, is shown for the first. What libraries plan is left out.
    """
    seen: dict[str, str] = {}

    def keep(message: Warning | str, *_: Any, **__: Any) -> None:
        text = printable(parser.in_words(str(message)))
        named = max((name for name in inputs if name in text), key=len, default="")
        seen.setdefault(re.sub(NUMBERS, "#", text.replace(named, "")), text)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore" if options.quiet else "always")
        for category in (DeprecationWarning, PendingDeprecationWarning, FutureWarning):
            warnings.simplefilter("ignore", category)
        warnings.showwarning = keep
        try:
            yield
        finally:
            notes = getattr(options, "notes", ())  # of the result, which know how far they may move Z
            sizes = {printable(parser.in_words(str(note))): getattr(note, "size", None) for note in notes}
            texts = sorted(seen.values(), key=lambda text: -(sizes.get(text) or 0.0))
            shown = texts if options.verbose else texts[:WARNINGS_SHOWN]
            for text in shown:
                size = sizes.get(text)
                print(f"warning{'' if size is None else f' (may move Z by {size:.2g})'}: {text}", file=sys.stderr)
            if len(texts) > len(shown):
                print(f"warning: {len(texts) - len(shown)} more; --verbose prints them", file=sys.stderr)

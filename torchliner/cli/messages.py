"""What a command says: errors, warnings and results, safe for a terminal."""

from __future__ import annotations

import argparse
import json
import math
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
NO_MEMORY = ("can't allocate memory", "out of memory", "Unable to allocate")
NUMBERS = r"\d+(?:\.\d+)?(?:e[-+]?\d+)?"


def error_text(error: Exception, inputs: Sequence[str]) -> str:
    """One message of an error, with the inputs where a library names none of them."""
    text = str(error) or type(error).__name__
    files = ", ".join(inputs)
    lead = f"{files}: " if files and not any(name in text for name in inputs) else ""
    if isinstance(error, MemoryError) or any(words in text for words in NO_MEMORY):
        return f"{lead}not enough memory: {text}; take fewer probes or samples"
    if not isinstance(error, EXPECTED) or isinstance(error, RecursionError):
        return (
            f"{lead}{type(error).__name__}: {text.splitlines()[0]}; this is a fault of torchliner: "
            "please report it, with the file and with what --debug prints"
        )
    step = error.__traceback__
    while step is not None and step.tb_next is not None:
        step = step.tb_next
    ours = step is not None and step.tb_frame.f_code.co_filename.startswith(PACKAGE)
    return text if ours else lead + text


class Printable:
    """A stream on which nothing moves the cursor or cannot be encoded."""

    def __init__(self, stream: Any) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """With control characters written out."""
        coding = self.stream.encoding or "utf-8"
        return int(self.stream.write(printable(text).encode(coding, "backslashreplace").decode(coding)))

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
    """
    seen: dict[str, list[str]] = {}

    def show(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        text = printable(parser.in_words(str(message)))
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
                    more = f"also applies to {len(others)} more: {', '.join(others)}"
                    print(f"warning: '{words} ...' {more}", file=sys.stderr)


@contextmanager
def progress_bar(total: int, label: str, options: argparse.Namespace, unit: str = "sample") -> Iterator[Any]:
    """A callable that takes steps done, ``total`` at most; None with --quiet or if standard error is no terminal."""
    if options.quiet or not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, desc=label, unit=unit, unit_scale=unit in ("sample", "B"), leave=False) as bar:
        yield bar.update


def print_json(value: Any) -> None:
    """JSON on standard output; what is not finite becomes null."""
    print(json.dumps(_plain(value), indent=2, allow_nan=False))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, complex):
        return {"resistance": _plain(value.real), "reactance": _plain(value.imag)}
    return None if isinstance(value, float) and not math.isfinite(value) else value

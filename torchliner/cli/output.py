"""What a command says: results, warnings and errors, safe for a terminal."""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from torchliner.cli.parser import Parser
from torchliner.io.whole_file import printable

PACKAGE = str(Path(__file__).resolve().parents[1])
EXPECTED = (ValueError, TypeError, OSError, ImportError, RuntimeError)
NO_MEMORY = ("can't allocate memory", "out of memory", "Unable to allocate")
NUMBERS = r"\d+(?:\.\d+)?(?:e[-+]?\d+)?"
WARNINGS_SHOWN = 3  # without --verbose


def show(
    options: argparse.Namespace,
    found: Any,
    text: Callable[[Any], str],
    plain: Callable[[Any], Any] | None = None,
    write: Callable[[Any], Any] | None = None,
    draw: Callable[[Any, Path], Any] | None = None,
) -> None:
    """The rule of every command: write --output, draw --figure, print the result as text or, with --json, its values.

    Args:
        text, plain: of ``found``; ``plain`` default: what was found.
        write: takes the path of --output.
        draw: takes what was found and the path of --figure.
    """
    if write is not None and (path := getattr(options, "output", None)) is not None:
        write(path)
    if draw is not None and (path := getattr(options, "figure", None)) is not None:
        draw(found, path)
    if options.json:
        print(json.dumps(_plain(plain(found) if plain else found), indent=2, allow_nan=False))
    else:
        print(text(found))


def _plain(value: Any) -> Any:
    """What is not finite becomes null."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, complex):
        return {"resistance": _plain(value.real), "reactance": _plain(value.imag)}
    return None if isinstance(value, float) and not math.isfinite(value) else value


def facts_text(facts: dict[str, Any]) -> str:
    """A line a fact, those of a nested one indented; nothing of what is None, of many numbers how many they are."""
    lines = []
    for key, value in facts.items():
        if isinstance(value, list):
            value = dict(enumerate(value)) if isinstance(value[0], dict) else f"{len(value)} values"
        if isinstance(value, dict):
            lines += [str(key), *(f"  {line}" for line in facts_text(value).splitlines())]
        elif value is not None:
            lines.append(f"{key!s:34s} {f'{value:.6g}' if isinstance(value, float) else value}")
    return "\n".join(lines)


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
def warnings_on_stderr(options: argparse.Namespace, parser: Parser, inputs: Sequence[str]) -> Iterator[None]:
    """Each warning once, on one line: three, all with --verbose, none with --quiet.

    One that several inputs share, but for its numbers, is shown for the first of them. What libraries will change
    one day is left to --debug.
    """
    seen: dict[str, int] = {}
    most = math.inf if getattr(options, "verbose", False) else WARNINGS_SHOWN

    def show_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        text = printable(parser.in_words(str(message)))
        named = max((name for name in inputs if name in text), key=len, default="")
        key = re.sub(NUMBERS, "#", text.replace(named, ""))
        seen[key] = seen.get(key, 0) + 1
        if seen[key] == 1 and len(seen) <= most:
            print(f"warning: {text}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore" if getattr(options, "quiet", False) else "always")
        if not getattr(options, "debug", False):
            for category in (DeprecationWarning, PendingDeprecationWarning, FutureWarning):
                warnings.simplefilter("ignore", category)
        warnings.showwarning = show_warning
        try:
            yield
        finally:
            if len(seen) > most:
                print(f"warning: {len(seen) - most} more; --verbose prints them", file=sys.stderr)


@contextmanager
def progress_bar(total: int, label: Any, options: argparse.Namespace, unit: str = "sample") -> Iterator[Any]:
    """A callable that takes steps done, ``total`` at most; None with --quiet or if standard error is no terminal."""
    if options.quiet or not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, desc=str(label), unit=unit, unit_scale=unit in ("sample", "B"), leave=False) as bar:
        yield bar.update

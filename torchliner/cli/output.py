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
    text: Callable[[Any], str] | None = None,
    write: Callable[[Any], Any] | None = None,
    draw: Callable[[Any, Path], Any] | None = None,
) -> None:
    """The rule of every command: write --output, draw --figure, print the result as text or, with --json, its values.

    Args:
        found: an ``Answer``, which knows all of it; else plain values, of which ``text`` makes the words.
        write: takes the path of --output; default the rows as CSV.
        draw: takes what was found and the path of --figure; default the pictures, one a frequency.
    """
    answer = text is None
    if (path := getattr(options, "output", None)) is not None and (write or answer):
        (write or found.table.write_csv)(path)
    if (path := getattr(options, "figure", None)) is not None and (draw or answer):
        draw(found, path) if draw else found.draw(path)
    options.notes = found.notes if answer else ()
    if options.json:
        print(json.dumps(_plain(found.plain if answer else found), indent=2, allow_nan=False))
    else:
        print(text(found) if text else found.screen(getattr(options, "verbose", False), warnings=False))


def _plain(value: Any, name: str = "") -> Any:
    """What is not finite becomes null, what is complex its two parts; ``name``: of the value."""
    if isinstance(value, dict):
        return {str(key): _plain(item, str(key)) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item, name) for item in value]
    if isinstance(value, complex):
        from torchliner.report.table import parts_of  # brings torch, which --help does without

        return dict(zip(parts_of(name), (_plain(value.real), _plain(value.imag)), strict=True))
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
    seen: dict[str, str] = {}
    most = None if getattr(options, "verbose", False) else WARNINGS_SHOWN

    def keep(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        text = printable(parser.in_words(str(message)))
        named = max((name for name in inputs if name in text), key=len, default="")
        seen.setdefault(re.sub(NUMBERS, "#", text.replace(named, "")), text)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore" if getattr(options, "quiet", False) else "always")
        if not getattr(options, "debug", False):
            for category in (DeprecationWarning, PendingDeprecationWarning, FutureWarning):
                warnings.simplefilter("ignore", category)
        warnings.showwarning = keep
        try:
            yield
        finally:
            sizes = {printable(parser.in_words(str(note))): getattr(note, "size", None) for note in _notes(options)}
            texts = sorted(seen.values(), key=lambda text: -(sizes.get(text) or 0.0))
            for text in texts[:most]:
                size = sizes.get(text)
                print(f"warning{'' if size is None else f' (may move Z by {size:.2g})'}: {text}", file=sys.stderr)
            if most is not None and len(texts) > most:
                print(f"warning: {len(texts) - most} more; --verbose prints them", file=sys.stderr)


def _notes(options: argparse.Namespace) -> Sequence[Any]:
    """Of the result that was shown, which know how far they may move Z."""
    found: Sequence[Any] = getattr(options, "notes", ())
    return found


@contextmanager
def progress_bar(total: int, label: Any, options: argparse.Namespace, unit: str = "sample") -> Iterator[Any]:
    """A callable that takes steps done, ``total`` at most; None with --quiet or if standard error is no terminal."""
    if options.quiet or not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, desc=str(label), unit=unit, unit_scale=unit in ("sample", "B"), leave=False) as bar:
        yield bar.update

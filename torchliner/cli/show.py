"""What every command does with what it found."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from torchliner.io.whole_file import printable
from torchliner.report.answer import Answer, answer_of
from torchliner.report.table import parts_of, table_of


def show(
    options: argparse.Namespace,
    found: Any,
    write: Callable[[Any], Any] | None = None,
    draw: Callable[[Path], Any] | None = None,
    **about: Any,
) -> None:
    """The rule of every command: write --output, draw --figure, print the answer as text or, with --json, its values.

    Args:
        found: a result, or its ``Answer``; ``about``: what ``answer_of`` wants to know besides.
        write, draw: take the path; default the rows as CSV, and the pictures, one a frequency.
    """
    answer = found if isinstance(found, Answer) else answer_of(found, **about)
    if (path := getattr(options, "output", None)) is not None:
        (write or answer.table.write_csv)(path)
    if (path := getattr(options, "figure", None)) is not None:
        (draw or answer.draw)(path)
    options.notes = answer.notes
    if options.json:
        print(json.dumps(_plain(answer.plain), indent=2, allow_nan=False), flush=True)
    else:
        print(printable(answer.screen(options.verbose, warnings=False)), flush=True)


def told(title: str, plain: Any, *lines: str) -> Answer:
    """An answer without a table."""
    return Answer(title, lines, table_of([]), more=plain)


def _plain(value: Any, name: str = "") -> Any:
    """What is not finite becomes null, what is complex its two parts; ``name``: of the value."""
    if isinstance(value, dict):
        return {str(key): _plain(item, str(key)) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item, name) for item in value]
    if isinstance(value, complex):
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


@contextmanager
def progress_bar(total: int, options: argparse.Namespace, unit: str = "sample") -> Iterator[Any]:
    """A callable that takes steps done, ``total`` at most; None with --quiet or if standard error is no terminal."""
    if options.quiet or not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, desc=options.command, unit=unit, unit_scale=unit in ("sample", "B"), leave=False) as bar:
        yield bar.update

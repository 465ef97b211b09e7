"""Options that several commands share, and how results are printed."""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


def add_output_options(parser: argparse.ArgumentParser) -> None:
    """--json and --quiet."""
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("--quiet", action="store_true", help="no progress bar, no warnings")


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
    if isinstance(value, float) and not (abs(value) < float("inf")):
        return None
    return value


@contextmanager
def warnings_on_stderr(quiet: bool) -> Iterator[None]:
    """Show warnings as one line each, or not at all."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore" if quiet else "always")
        warnings.showwarning = lambda message, *_, **__: print(
            f"warning: {message}", file=sys.stderr
        )
        yield


@contextmanager
def progress_bar(total: int, label: str, quiet: bool) -> Iterator[Any]:
    """A callable that takes steps done; silent unless standard error is a terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, desc=label, unit="sample", unit_scale=True, leave=False) as bar:
        yield bar.update

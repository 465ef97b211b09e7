"""Options that several commands share, and how results are printed."""

from __future__ import annotations

import argparse
import cmath
import json
import sys
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from torchliner.records import VelocityPlane

MOST_FREQUENCIES = 10_000  # of one range: more is a slip of the step


def add_output_options(parser: argparse.ArgumentParser) -> None:
    """--json and --quiet."""
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("--quiet", action="store_true", help="no progress bar, no warnings")


def split_pair(text: str, option: str) -> tuple[str, str]:
    """NAME=VALUE."""
    name, equals, value = text.partition("=")
    if not equals:
        raise ValueError(f"{option} {text!r} cannot be read; write NAME=VALUE")
    return name.strip(), value.strip()


def complex_number(text: str, option: str, infinite: str = "") -> complex:
    """R+Xj, finite.

    Args:
        text: as typed.
        option: its name.
        infinite: what to write for an infinite value, for the message.
    Raises:
        ValueError: it cannot be read, or is not finite.
    """
    try:
        value = complex(text.replace(" ", ""))
    except ValueError:
        raise ValueError(f"{option} {text!r} cannot be read; write 2.33-0.30j") from None
    if not cmath.isfinite(value):
        raise ValueError(
            f"{option} {text!r} is not finite; write {infinite}a value such as 2.33-0.30j"
        )
    return value


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
        # Of torch itself, when it first differentiates forward.
        warnings.filterwarnings("ignore", message=".torch.jit.script. is deprecated")
        warnings.showwarning = lambda message, *_, **__: print(
            f"warning: {message}", file=sys.stderr
        )
        yield


PICTURES = (".png", ".pdf", ".svg", ".jpg", ".eps", ".tif")


def require_ending(path: Path | None, endings: Sequence[str], option: str) -> None:
    """Refuse a file name whose ending says something else than what is written.

    Raises:
        ValueError: it does.
    """
    if path is not None and path.suffix.lower() not in endings:
        raise ValueError(
            f"{option} {path} ends in {path.suffix or 'nothing'!r}; it must be one of "
            f"{', '.join(endings)}"
        )


def refuse_inputs(
    outputs: Iterable[Path | None],
    inputs: Iterable[Path | str | None],
    figure: Path | None = None,
) -> None:
    """No output may be an input, or another output, or lie in a folder that does not exist.

    ``figure`` is one of the outputs too.

    Raises:
        ValueError: one is.
        OSError: the folder is missing.
    """
    require_ending(figure, PICTURES, "--figure")
    outputs = [*outputs, figure]
    taken = {Path(path).resolve() for path in inputs if path is not None}
    for path in (path for path in outputs if path is not None):
        if path.resolve() in taken:
            raise ValueError(f"the output {path} is an input or another output; name another file")
        if not path.parent.is_dir():
            raise OSError(f"{path}: the folder {path.parent} does not exist")
        taken.add(path.resolve())


def write_copy(text: str, path: Path) -> None:
    """Write a preset's text to a new file.

    Raises:
        ValueError: the file exists: it may hold edits; it does not end in .toml.
    """
    from torchliner.io.whole_file import written_whole

    require_ending(path, [".toml"], "--copy")
    if path.exists():
        raise ValueError(f"{path} exists; it is not overwritten")
    with written_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


@contextmanager
def progress_bar(total: int, label: str, quiet: bool, unit: str = "sample") -> Iterator[Any]:
    """A callable that takes steps done; silent unless standard error is a terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    scaled = unit == "sample"
    with tqdm(total=total, desc=label, unit=unit, unit_scale=scaled, leave=False) as bar:
        yield bar.update


def liner_name(plane: VelocityPlane, path: Path) -> str:
    """The preset a plane file names; see ``known_liner``."""
    return known_liner(plane.liner, path)


def known_liner(name: str, path: Path) -> str:
    """The preset a file names.

    Raises:
        ValueError: it names none.
    """
    from torchliner.liners.catalogue import preset_names

    if name not in preset_names():
        said = f"names {name!r}, which is no preset" if name else "names no liner"
        raise ValueError(
            f"{path} {said}; choose a model with --liner ({', '.join(preset_names())})"
        )
    return name


def frequencies(text: str) -> list[float]:
    """One frequency, or LOW:HIGH:STEP with both ends; argparse reports a ValueError itself."""
    numbers = [float(part) for part in text.split(":")]
    if len(numbers) == 1:
        return numbers
    low, high, step = numbers
    if not (step > 0 and low <= high < float("inf") and (high - low) / step < MOST_FREQUENCIES):
        raise ValueError(text)
    return [low + i * step for i in range(int((high - low) / step + 1e-9) + 1)]

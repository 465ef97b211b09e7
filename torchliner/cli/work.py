"""What commands share: what they read, and what they do with what they found."""

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import torchliner as tl
from torchliner.cli.options import spelled
from torchliner.engine.moments import Moments
from torchliner.io.moments_file import holds_moments
from torchliner.io.whole_file import printable, written_whole
from torchliner.records import VelocityPlane
from torchliner.records.velocity_plane import restated
from torchliner.report.answer import Answer, answer_of
from torchliner.report.table import flat_words

Record = VelocityPlane | Moments


def read_planes(paths: Sequence[Path], options: argparse.Namespace) -> list[VelocityPlane]:
    """The planes, with their velocity still in the file, as the options say."""
    return [tl.read_plane(path, lazy=True, **options.reading) for path in paths]


def read_records(paths: Sequence[Path], options: argparse.Namespace) -> list[Record]:
    """Planes, or the moments that planes were reduced to."""
    found: list[Record] = []
    for path in paths:
        if not holds_moments(path):
            found += read_planes([path], options)
        elif options.reading:
            raise ValueError(f"{path} holds moments, which have no parts: leave out {spelled(sorted(options.reading))}")
        else:
            found.append(tl.read_moments(path))
    return found


def choices_of(options: argparse.Namespace) -> dict[str, Any]:
    """The choices; --background is a number in m/s, or names planes or moments without sound, which are opened."""
    background: Any = options.chosen.get("background")
    if background is None:
        return options.chosen
    try:
        (background,) = map(float, background)
    except ValueError:
        background = [tl.read_moments(p) if holds_moments(p) else tl.read_plane(p, lazy=True) for p in background]
    return {**options.chosen, "background": background}


def planes_of(records: Sequence[Record]) -> list[VelocityPlane]:
    """What is stated of the planes; those that were reduced have no velocity."""
    return [each.plane if isinstance(each, Moments) else each for each in records]


def samples_of(records: Sequence[Record]) -> int:
    """Of all planes, for a progress bar: each is read twice."""
    return 2 * sum(plane.samples for plane in planes_of(records))


def with_facts(record: Record, facts: dict[str, Any]) -> Record:
    """A plane, or moments of one, with other facts about the case."""
    if isinstance(record, Moments):
        return replace(record, plane=restated(record.plane, facts))
    return restated(record, facts)


def liners_of(options: argparse.Namespace, records: Sequence[Record], paths: Sequence[Path]) -> list[Any]:
    """The liner of each plane: that of --liner, else the preset its file names."""
    named = [options.liner or preset_named(p.liner, path) for p, path in zip(planes_of(records), paths, strict=True)]
    known = {name: tl.load_liner(name) for name in named}
    return [known[name] for name in named]


def only_liner(options: argparse.Namespace, records: Sequence[Record], paths: Sequence[Path]) -> Any:
    """The one liner of all planes; ValueError where they name several."""
    first, *others = liners_of(options, records, paths)
    if any(each is not first for each in others):
        named = ", ".join(sorted({plane.liner for plane in planes_of(records)}))
        raise ValueError(f"the planes name different liners, {named}; state with --liner which one all of them have")
    return first


def preset_named(name: str, path: Path) -> str:
    """The preset a file names; ValueError where it names none."""
    if name not in tl.preset_names():
        fault = f"names {name!r}, which is no preset" if name else "names no liner"
        raise ValueError(f"{path} {fault}; choose a model with --liner ({', '.join(tl.preset_names())})")
    return name


def incident_signal(options: argparse.Namespace) -> Any:
    """The signal of --incident: a recording, or the text of a generated one; None if there is none."""
    wave = options.incident
    return tl.read_signal(wave) if wave is not None and Path(wave).suffix == ".wav" else wave


def write_text(text: str, path: Path, *, anew: bool = False) -> None:
    """Write a whole TOML file, or leave the old one; ``anew``: it may hold edits, and is not overwritten."""
    if anew and path.exists():
        raise ValueError(f"{path} exists; it is not overwritten")
    with written_whole(path, ".toml") as temporary:
        temporary.write_text(text, encoding="utf-8")


def show(options: argparse.Namespace, found: Any, write: Callable[[Path], Any] | None = None, **about: Any) -> None:
    """The rule of every command: write --output (default the rows as CSV), draw --figure, print the answer, an
    ``Answer`` or that of a result, as text or, with --json, its values."""
    answer = found if isinstance(found, Answer) else answer_of(found, **about)
    if (path := getattr(options, "output", None)) is not None:
        (write or answer.table.write_csv)(path)
    if (path := getattr(options, "figure", None)) is not None:
        (answer.draw if path.suffix else answer.write_pictures)(path)
    options.notes = answer.notes
    if options.json:
        print(json.dumps(answer.plain, indent=2, allow_nan=False), flush=True)
    else:
        print(printable(answer.screen(options.verbose, warnings=False)), flush=True)


def told(title: str, plain: Any, *lines: str) -> Answer:
    """An answer without a table."""
    return Answer(title, lines, more=plain)


def facts_text(facts: dict[str, Any]) -> str:
    """A line a fact."""
    return "\n".join(f"{name:34s} {words}" for name, words in flat_words(facts))


@contextmanager
def progress_bar(total: int, options: argparse.Namespace, unit: str = "sample") -> Iterator[Any]:
    """A callable that takes steps done, ``total`` at most; None with --quiet or if standard error is no terminal."""
    if options.quiet or not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, desc=options.command, unit=unit, unit_scale=unit in ("sample", "B"), leave=False) as bar:
        yield bar.update

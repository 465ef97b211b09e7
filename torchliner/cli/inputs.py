"""What commands read: planes or their moments, liners, signals."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torchliner as tl
from torchliner.cli.options import spelled

if TYPE_CHECKING:
    from torchliner.engine.moments import Moments
    from torchliner.records import VelocityPlane

    Record = VelocityPlane | Moments


def read_planes(paths: Sequence[Path], options: argparse.Namespace, *, lazy: bool = True) -> list[VelocityPlane]:
    """The planes, by default with their velocity still in the file, as the options say."""
    return [tl.read_plane(path, lazy=lazy, **options.reading) for path in paths]


def read_records(paths: Sequence[Path], options: argparse.Namespace) -> list[Record]:
    """Planes, or the moments that planes were reduced to; by paths that workers in other folders can open.

    Raises:
        ValueError: a part of moments is asked for.
    """
    from torchliner.io.moments_file import holds_moments

    said = dict(options.reading)
    facts = {"holes": tl.read_holes(said.pop("holes"))} if "holes" in said else {}
    found: list[Record] = []
    for path in paths if getattr(options, "cluster", None) is None else [path.absolute() for path in paths]:
        if not holds_moments(path):
            found += read_planes([path], options)
        elif said:
            raise ValueError(f"{path} holds moments, of which there is no part: leave out {spelled(said)}")
        else:
            found.append(with_facts(tl.read_moments(path), facts))
    return found


def planes_of(records: Sequence[Record]) -> list[VelocityPlane]:
    """What is stated of the planes; those that were reduced have no velocity."""
    found: list[Any] = [getattr(each, "plane", each) for each in list[Any](records)]
    return found


def with_facts(record: Any, facts: dict[str, Any]) -> Any:
    """A plane, or moments of one, with other facts about the case."""
    from torchliner.records.velocity_plane import restated

    (plane,) = planes_of([record])
    return restated(record, facts) if plane is record else replace(record, plane=restated(plane, facts))


def liners_of(options: argparse.Namespace, records: Sequence[Record], paths: Sequence[Path]) -> list[Any]:
    """The liner of each plane: that of --liner, else the preset its file names."""
    named = [options.liner or preset_named(p.liner, path) for p, path in zip(planes_of(records), paths, strict=True)]
    known = {name: tl.load_liner(name) for name in named}
    return [known[name] for name in named]


def only_liner(options: argparse.Namespace, records: Sequence[Record], paths: Sequence[Path]) -> Any:
    """The one liner of all planes.

    Raises:
        ValueError: they name several.
    """
    first, *others = liners_of(options, records, paths)
    if any(each is not first for each in others):
        named = ", ".join(sorted({plane.liner for plane in planes_of(records)}))
        raise ValueError(
            f"the planes name different liners, {named}; give those of one liner, or state with --liner which one all "
            "of them have"
        )
    return first


def preset_named(name: str, path: Path) -> str:
    """The preset a file names.

    Raises:
        ValueError: it names none.
    """
    if name not in tl.preset_names():
        fault = f"names {name!r}, which is no preset" if name else "names no liner"
        raise ValueError(f"{path} {fault}; choose a model with --liner ({', '.join(tl.preset_names())})")
    return name


def incident_signal(options: argparse.Namespace) -> Any:
    """The signal of --incident and --incident-rate: a recording, or the text of a generated one."""
    if options.incident is not None and Path(options.incident).suffix in (".wav", ".npy"):
        return tl.read_signal(options.incident, options.incident_rate)
    if options.incident_rate is not None:
        raise ValueError("--incident-rate is the rate of an --incident file; name the file, or leave it out")
    return options.incident


def write_text(text: str, path: Path) -> None:
    """Write a whole TOML file, or leave the old one."""
    from torchliner.io.whole_file import written_whole

    with written_whole(path, ".toml") as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_copy(text: str, path: Path) -> None:
    """Write a preset's text to a new file: one that exists may hold edits."""
    if path.exists():
        raise ValueError(f"{path} exists; it is not overwritten")
    write_text(text, path)

"""Files of the commands: planes and their liners are read, results written and printed."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchliner.cli.options import print_json, spelled
from torchliner.cli.plane_options import reading

if TYPE_CHECKING:
    from torchliner.engine.moments import Moments
    from torchliner.records import VelocityPlane


def show_results(
    options: argparse.Namespace,
    text: Callable[[], str],
    plain: Callable[[], Any],
    *,
    output: Callable[[Path], Any] | None = None,
    figure: Callable[[Path], Any] | None = None,
) -> None:
    """Write --output and draw --figure where they are asked for; print the text, or JSON.

    Args:
        options: of the command.
        text, plain: make what is printed, and what is printed with --json.
        output, figure: make the files, each from its path.
    """
    for name, write in (("output", output), ("figure", figure)):
        path = getattr(options, name, None)
        if write is not None and path is not None:
            write(path)
    if options.json:
        print_json(plain())
    else:
        print(text())


def write_text(text: str, path: Path) -> None:
    """Write a whole TOML file, or leave the old one."""
    from torchliner.io.whole_file import written_whole

    with written_whole(path, ".toml") as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_copy(text: str, path: Path) -> None:
    """Write a preset's text to a new file.

    Raises:
        ValueError: the file exists: it may hold edits.
    """
    if path.exists():
        raise ValueError(f"{path} exists; it is not overwritten")
    write_text(text, path)


def read_planes(paths: Sequence[Path], options: argparse.Namespace, *, lazy: bool = True) -> list[VelocityPlane]:
    """The planes, by default with their velocity still in the file, as the options say.

    Raises:
        ValueError: a file holds moments alone.
    """
    from torchliner.io.moments_file import holds_moments
    from torchliner.io.planes import read_plane

    for path in paths:
        if holds_moments(path):
            raise ValueError(
                f"{path} holds moments of |v|; its time samples are gone, which this needs: name "
                "the plane file that was reduced"
            )
    return [read_plane(path, lazy=lazy, **reading(options)) for path in paths]


def seen_from_anywhere(options: argparse.Namespace, paths: Sequence[Path] | None = None) -> list[Path]:
    """Planes by paths that workers in other folders can open, if there are any."""
    named = options.planes if paths is None else paths
    return list(named) if options.cluster is None else [path.absolute() for path in named]


def read_records(paths: Sequence[Path], options: argparse.Namespace) -> list[VelocityPlane | Moments]:
    """Planes, or the moments that planes were reduced to.

    Raises:
        ValueError: a part of moments is asked for.
    """
    from torchliner.io.holes import read_holes
    from torchliner.io.moments_file import holds_moments, read_moments

    said = reading(options)
    facts = {"holes": read_holes(said.pop("holes"))} if "holes" in said else {}
    for path in paths if said else ():
        if holds_moments(path):
            raise ValueError(f"{path} holds moments, of which there is no part: leave out {spelled(said)}")
    return [
        with_facts(read_moments(path), facts) if holds_moments(path)
        else read_planes([path], options)[0]
        for path in paths
    ]  # fmt: skip


def planes_of(records: Sequence[VelocityPlane | Moments]) -> list[VelocityPlane]:
    """What is stated of the planes; those that were reduced have no velocity."""
    from torchliner.engine.moments import Moments

    return [each.plane if isinstance(each, Moments) else each for each in records]


def with_facts(record: Any, facts: dict[str, Any]) -> Any:
    """A plane, or moments of one, with other facts about the case."""
    from torchliner.records.velocity_plane import restated

    plane = getattr(record, "plane", None)
    if plane is None:
        return restated(record, facts)
    return replace(record, plane=restated(plane, facts))


def liner_names(liner: str | None, records: Sequence[VelocityPlane | Moments], paths: Sequence[Path]) -> list[str]:
    """The liner of each plane: that of --liner, else the preset its file names."""
    planes = planes_of(records)
    return [liner or preset_named(p.liner, path) for p, path in zip(planes, paths, strict=True)]


def only_liner(liner: str | None, planes: Sequence[VelocityPlane | Moments], paths: Sequence[Path]) -> Any:
    """The one liner of all planes.

    Raises:
        ValueError: they name several.
    """
    from torchliner.liners.catalogue import load_liner

    found = sorted(set(liner_names(liner, planes, paths)))
    if len(found) > 1:
        raise ValueError(
            f"the planes name different liners, {', '.join(found)}; give those of one liner, or "
            "state with --liner which one all of them have"
        )
    return load_liner(found[0])


def preset_named(name: str, path: Path) -> str:
    """The preset a file names.

    Raises:
        ValueError: it names none.
    """
    from torchliner.liners.catalogue import preset_names

    if name not in preset_names():
        fault = f"names {name!r}, which is no preset" if name else "names no liner"
        raise ValueError(f"{path} {fault}; choose a model with --liner ({', '.join(preset_names())})")
    return name


def incident_signal(options: argparse.Namespace) -> Any:
    """The signal of --incident and --incident-rate, or None.

    Raises:
        ValueError: a rate of what is no file.
    """
    if options.incident is None:
        if options.incident_rate is not None:
            raise ValueError("--incident-rate is the rate of an --incident file; name the file")
        return None
    from torchliner.io.signal_file import read_signal
    from torchliner.records.incident import parse_signal

    generated = parse_signal(options.incident)
    if generated is None:
        return read_signal(options.incident, options.incident_rate)
    if options.incident_rate is not None:
        raise ValueError("--incident-rate is for a file; a generated signal takes the rate that is "
                         "needed: leave it out")  # fmt: skip
    return generated

"""Files of the commands: outputs are checked before anything is computed, inputs are read."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchliner.cli.options import print_json

if TYPE_CHECKING:
    from torchliner.records import VelocityPlane

PICTURES = (".png", ".pdf", ".svg", ".jpg", ".jpeg", ".eps", ".ps", ".tif", ".tiff", ".webp")


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


def check_files(
    options: argparse.Namespace,
    inputs: Iterable[Path | str | None],
    *endings: str,
    outputs: Sequence[Path | None] | None = None,
) -> None:
    """Refuse names of outputs before anything is computed.

    Args:
        options: with ``output``, ``figure`` or both.
        inputs: files that are read; none may be an output.
        endings: of --output; any if none is named.
        outputs: what is written besides the figure, where that is not --output alone.
    Raises:
        ValueError: an output is an input or another output, or ends in something else.
        OSError: its folder is missing.
    """
    output, figure = getattr(options, "output", None), getattr(options, "figure", None)
    taken = {Path(path).resolve() for path in inputs if path is not None}
    for path in (*([output] if outputs is None else outputs), figure):
        if path is None:
            continue
        if path.resolve() in taken:
            raise ValueError(f"the output {path} is an input or another output; name another file")
        if not path.parent.is_dir():
            raise OSError(f"{path}: the folder {path.parent} does not exist")
        taken.add(path.resolve())
    require_ending(figure, PICTURES, "--figure")
    if endings:
        require_ending(output, endings, "--output")


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
    """Write a whole text file, or leave the old one."""
    from torchliner.io.whole_file import written_whole

    with written_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_copy(text: str, path: Path) -> None:
    """Write a preset's text to a new file.

    Raises:
        ValueError: the file exists: it may hold edits; it does not end in .toml.
    """
    require_ending(path, [".toml"], "--copy")
    if path.exists():
        raise ValueError(f"{path} exists; it is not overwritten")
    write_text(text, path)


def read_planes(paths: Sequence[Path], *, lazy: bool = True) -> list[VelocityPlane]:
    """The planes, by default with their velocity still in the file."""
    from torchliner.io.plane_file import read_plane

    return [read_plane(path, lazy=lazy) for path in paths]


def liner_names(
    liner: str | None, planes: Sequence[VelocityPlane], paths: Sequence[Path]
) -> list[str]:
    """The liner of each plane: that of --liner, else the preset its file names."""
    return [liner or preset_named(p.liner, path) for p, path in zip(planes, paths, strict=True)]


def only_liner(liner: str | None, planes: Sequence[VelocityPlane], paths: Sequence[Path]) -> Any:
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
        raise ValueError(
            f"{path} {fault}; choose a model with --liner ({', '.join(preset_names())})"
        )
    return name

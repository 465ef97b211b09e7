"""Reports by kind of result, in memory and from files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from torchliner.io import line_file, map_file, microphone_file, point_file, wall_file
from torchliner.io.hdf5 import open_file, text_attribute
from torchliner.io.moments_file import holds_moments, read_moments
from torchliner.io.planes import read_plane
from torchliner.io.tables import FileKind
from torchliner.io.whole_file import HDF5, printable, writable
from torchliner.liners.catalogue import load_liner
from torchliner.records import ImpedanceLine, ImpedanceMap, MicrophoneLine, PointImpedances
from torchliner.report.page.of_duct import page_of_duct
from torchliner.report.page.of_line import page_of_line
from torchliner.report.page.of_map import page_of_map
from torchliner.report.page.of_points import page_of_points
from torchliner.report.page.of_wall import page_of_wall
from torchliner.report.page.render import ENDING, Page, require_report
from torchliner.report.page.subject import subject_of

RESULTS: tuple[tuple[FileKind, Callable[[Path], Any]], ...] = (
    (map_file.KIND, map_file.read_map),
    (line_file.KIND, line_file.read_line),
    (point_file.KIND, point_file.read_points),
    (wall_file.KIND, wall_file.read_wall),
    (microphone_file.KIND, microphone_file.read_microphones),
)
PAGES: dict[type, Callable[[Any, Path | None], Page]] = {
    ImpedanceLine: page_of_line, PointImpedances: page_of_points, tuple: page_of_wall,
    MicrophoneLine: page_of_duct,
}  # fmt: skip


def write_report(
    result: ImpedanceMap | ImpedanceLine | PointImpedances, path: str | Path, *,
    data: Any = None, liner: Any = None, source: Path | None = None,
) -> None:  # fmt: skip
    """One self-contained HTML page of a result, as ``Result.report``.

    Args:
        result, path, data, liner: as there.
        source: file of the result.
    """
    require_report()
    writable(path, ENDING)
    page_of(result, data=data, liner=liner, source=source).write(path)


def page_of(result: Any, *, data: Any = None, liner: Any = None, source: Path | None = None) -> Page:
    """By kind of result.

    Raises:
        TypeError: no result.
        ValueError: data or a liner beside a result that takes none; see ``subject_of``.
    """
    if isinstance(result, ImpedanceMap):
        return page_of_map(subject_of(result, source, data, liner))
    make = PAGES.get(type(result))
    if make is None:
        raise TypeError(
            f"{type(result).__name__} is no result that has a report; a map, a line, points, "
            "impedances from microphones and solved ducts are"
        )
    if data is not None or liner is not None:
        raise ValueError("data and liner are for the report of a map, and this result is none: leave them out")
    return make(result, source)


def read_result(path: Path) -> Any:
    """A result of any kind.

    Raises:
        ValueError: the file is none, and what it is; a result of a newer version.
    """
    if path.suffix.lower() not in HDF5:
        raise ValueError(
            f"{path} ends in {path.suffix or 'nothing'!r}; a report is made of a result as "
            f"{', '.join(HDF5)} or of the folder of a campaign"
        )
    with open_file(path) as file:
        schema = text_attribute(file, "schema")
    for kind, read in RESULTS:
        if schema == kind.schema:
            return read(path)
        stem = kind.schema.rpartition(" ")[0]
        if schema is not None and schema.rpartition(" ")[0] == stem:
            raise ValueError(
                f"{path} has the format {printable(schema)!r}, and this torchliner reads "
                f"{kind.schema!r}: take the torchliner that wrote it, or a newer one"
            )
    what = f"its schema is {printable(schema)!r}" if schema else "it states no schema"
    raise ValueError(f"{path} is no result: {what}; a report is made of an impedance map, an "
                     "impedance line, point impedances, impedances from microphones (torchliner kt "
                     "-o), a solved duct or the folder of a campaign")  # fmt: skip


def data_of(path: Path, **request: Any) -> Any:
    """A plane whose velocity stays in its file, or moments."""
    return read_moments(path) if holds_moments(path) else read_plane(path, lazy=True, **request)


def report_file(path: Path, output: Path, data: Path | None = None, liner: str | None = None) -> Page:
    """The page of a file of results, written."""
    result = read_result(path)
    page = page_of(
        result, source=path, data=None if data is None else data_of(data),
        liner=None if liner is None else load_liner(liner),
    )  # fmt: skip
    page.write(output)
    return page

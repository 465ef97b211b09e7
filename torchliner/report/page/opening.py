"""Reports by kind of result, in memory and from files."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from torchliner.file_checks import naming
from torchliner.io.hdf5 import open_file, text_attribute
from torchliner.io.microphone_file import read_microphones
from torchliner.io.own_file import read_line, read_map, read_points, read_wall
from torchliner.io.whole_file import HDF5, printable, writable
from torchliner.records import (
    FieldFit,
    ImpedanceLine,
    ImpedanceMap,
    MicrophoneLine,
    PointImpedances,
    WallEduction,
)
from torchliner.report.page.of_map import page_of_map
from torchliner.report.page.of_stations import page_of_line, page_of_points
from torchliner.report.page.of_wall import page_of_duct, page_of_wall
from torchliner.report.page.render import ENDING, Page, require_report

RESULTS: dict[str, Callable[[Path], Any]] = {
    ImpedanceMap.SCHEMA: read_map,
    ImpedanceLine.SCHEMA: read_line,
    PointImpedances.SCHEMA: read_points,
    WallEduction.GROUPS[0]: read_wall,
    MicrophoneLine.SCHEMA: read_microphones,
}
PAGES: dict[type, Callable[[Any, Path | None], Page]] = {
    ImpedanceMap: page_of_map,
    ImpedanceLine: page_of_line,
    PointImpedances: page_of_points,
    tuple: page_of_wall,
    MicrophoneLine: page_of_duct,
}


def write_report(
    result: ImpedanceMap | ImpedanceLine | PointImpedances | WallEduction | FieldFit | MicrophoneLine,
    path: str | Path,
    *others: Any,
) -> None:
    """One self-contained HTML page of a result, as its ``report``; ``others``: eductions beside the first."""
    require_report()
    writable(path, ENDING)
    shown: Any = result if type(result) in PAGES else (result, *others)
    page_of(shown).write(path)


def page_of(result: Any, source: Path | None = None) -> Page:
    """By kind of result; ``source``: its file, which may be damaged in what it says of itself."""
    with nullcontext() if source is None else naming(source):
        return PAGES[type(result)](result, source)


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
    for known, read in RESULTS.items():
        if schema == known:
            return read(path)
        stem = known.rpartition(" ")[0]
        if schema is not None and schema.rpartition(" ")[0] == stem:
            raise ValueError(
                f"{path} has the format {printable(schema)!r}, and this torchliner reads "
                f"{known!r}: take the torchliner that wrote it, or a newer one"
            )
    what = f"its schema is {printable(schema)!r}" if schema else "it states no schema"
    raise ValueError(
        f"{path} is no result: {what}; a report is made of an impedance map, an impedance line, point impedances, "
        "impedances from microphones (torchliner kt -o), a solved duct or the folder of a campaign"
    )


def report_file(path: Path, output: Path) -> Page:
    """The page of a file of results, written."""
    page = page_of(read_result(path), path)
    page.write(output)
    return page

"""What files of results share: a heading, and statistical intervals of impedances."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py

from torchliner.fluid import Fluid
from torchliner.io.hdf5 import is_there, read_json, read_texts, to_json, write_texts
from torchliner.io.tables import FileKind, Sizes, Table, impedance, read_variables, real, write_variables
from torchliner.names import RESULT_WRITERS
from torchliner.records import Gap, Interval, LevelCheck
from torchliner.records.level_check import FACTS

OTHERS = (".csv", *RESULT_WRITERS)
HEADING: dict[str, Any] = {
    "title": "", "source_side": "unknown", "choices": {}, "notes": (), "fluid": Fluid(),
}  # fmt: skip
BOUNDS = {
    "low": "lower bound",
    "high": "upper bound",
    "standard_error": "standard error",
    "bias": "bias (taken off the bounds, not off the value)",
}


def result_kind(schema: str, noun: str, **attributes: Any) -> FileKind:
    """A kind of file with title, side of the source, choices, notes and gas among attributes."""
    return FileKind(schema, noun, {**HEADING, **attributes}, others=OTHERS)


def interval_table(stem: str, dims: tuple[str, ...]) -> Table:
    """Variables ``<stem>resistance_low`` and so on, of one ``Interval`` over ``dims``."""
    return (
        *(impedance(bound, f"{stem}{{}}_{bound}", dims,
                    attributes={"long_name": f"{text} of {{part}}; {{words}}"})
          for bound, text in BOUNDS.items()),
        real(f"{stem}interval_runs", "1", dims, field="runs",
             attributes={"long_name": "number of independent runs of the record; {words}"}),
    )  # fmt: skip


def read_interval(file: h5py.Group, table: Table, path: str | Path, sizes: Sizes | None = None) -> Interval | None:
    """What is there of an ``interval_table``; None if nothing is."""
    if not is_there(file, table[0].names[0], path):
        return None
    return Interval(**read_variables(file, table, path, sizes=sizes))


def words_of_interval(level: float) -> str:
    """What an interval is, for its variables; ``level`` from 0 to 1."""
    return f"{100 * level:g} %, statistical (blocks of the record), not the spread over positions"


GAPS = {name.replace("level", "level_gap").replace("phase", "phase_gap"): name for name in Gap.__dataclass_fields__}
KNOWN_LEVEL = (real("known_pressure_level", "dB", ("frequency",), field="pressure_level",
                    attributes={"long_name": "level of the known pressure"}),)  # fmt: skip


def _gap_table(stem: str, dims: tuple[str, ...]) -> Table:
    """Variables ``<stem>level_gap`` and so on, of one ``Gap`` over ``dims``."""
    return tuple(
        real(f"{stem}{name}", "degree" if field.startswith("phase") else "dB", dims, field=field,
             any_size=field.endswith(("_low", "_high")), attributes={
                 "long_name": f"{field.replace('_', ', ')}: implied over known pressure"})
        for name, field in GAPS.items()
    )  # fmt: skip


def _gap_tables(of_cells: str) -> dict[str, Table]:
    """Of the fields of a level check."""
    return {
        "liner": _gap_table("", ("averaging", "frequency")),
        "cells": _gap_table(f"{of_cells}_", ("averaging", of_cells, "frequency")),
    }


def write_averagings(file: h5py.Group, names: tuple[str, ...]) -> None:
    """The dimension ``averaging``."""
    write_texts(file, "averaging", names, "averaging")
    file["averaging"].attrs["long_name"] = "averaging over the probes of a cell"


def write_level_check(file: h5py.Group, found: LevelCheck, of_cells: str = "cell") -> None:
    """Into an open file, or a group of one, with the dimensions ``frequency`` and ``of_cells``."""
    file.attrs["level_check"] = to_json({name: getattr(found, name) for name in FACTS})
    write_averagings(file, found.averagings)
    write_variables(file, found, KNOWN_LEVEL)
    for field, table in _gap_tables(of_cells).items():
        write_variables(file, getattr(found, field), table)


def read_level_check(file: h5py.Group, path: str | Path, sizes: Sizes, of_cells: str = "cell") -> LevelCheck | None:
    """What ``write_level_check`` wrote; None if there is none.

    Raises:
        ValueError: a variable has another shape or unit, or the attribute lacks a value.
    """
    facts = read_json(file, "level_check", path, {})
    if not facts:
        return None
    if {*facts} != {*FACTS}:
        raise ValueError(f"{path}: attribute 'level_check' has {', '.join(facts)}; {', '.join(FACTS)} are needed")
    names = tuple(read_texts(file, "averaging", path))
    if facts["averaging"] not in names:
        raise ValueError(f"{path}: attribute 'level_check' judges by {facts['averaging']!r}, not one of {names}")
    sizes = sizes | {"averaging": (len(names),)}
    gaps: dict[str, Any] = {
        field: Gap(**read_variables(file, table, path, sizes=sizes)) for field, table in _gap_tables(of_cells).items()
    }
    return LevelCheck(names, **facts, **read_variables(file, KNOWN_LEVEL, path, sizes=sizes), **gaps)

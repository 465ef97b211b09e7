"""What files of results share: a heading, and statistical intervals of impedances."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py

from torchliner.fluid import Fluid
from torchliner.io.hdf5 import is_there, read_json, to_json, write_index
from torchliner.io.tables import FileKind, Table, impedance, read_variables, real, write_variables
from torchliner.names import RESULT_WRITERS
from torchliner.records import Closure, Gap, Interval, Uncertainty
from torchliner.records.closure import CLOSURE_FACTS

OTHERS = (".csv", *RESULT_WRITERS)
Sizes = dict[str, tuple[int, ...]]  # of dimensions by name
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
    older = attributes.pop("older", ())
    return FileKind(schema, noun, {**HEADING, **attributes}, others=OTHERS, older=older)


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


# Intervals of a map; "probes" are the dimensions of its probes, "along" the last of them.
UNCERTAINTY = {
    "probes": interval_table("", ("probes", "frequency")),
    "along_x": interval_table("along_x_", ("along", "frequency")),
    "cells": interval_table("cell_", ("cell", "frequency")),
    "cells_velocity_first": interval_table("cell_velocity_first_", ("cell", "frequency")),
    "liner": interval_table("liner_", ("frequency",)),
    "liner_velocity_first": interval_table("liner_velocity_first_", ("frequency",)),
    "cells_coherent_first": interval_table("cell_coherent_first_", ("cell", "frequency")),
    "liner_coherent_first": interval_table("liner_coherent_first_", ("frequency",)),
}


def write_uncertainty(
    file: h5py.Group,
    found: Any,
    dims: tuple[str, ...] = (),
    tables: Mapping[str, Table] = UNCERTAINTY,
) -> None:
    """Into an open map file whose probes have the dimensions ``dims``; or the intervals of
    ``tables`` into another file or a group of one."""
    file.attrs["uncertainty"] = to_json(dict(found.settings))
    level = 100 * float(found.settings["level"])
    words = f"{level:g} %, statistical (moving blocks over time), not the spread over positions"
    axes = {"probes": dims, "along": dims[-1:]}
    for name, table in tables.items():
        if getattr(found, name) is not None:
            write_variables(file, getattr(found, name), table, axes, words)


def read_uncertainty(
    file: h5py.Group, path: str | Path, sizes: Sizes | None = None, kind: Any = Uncertainty,
    tables: Mapping[str, Table] = UNCERTAINTY,
) -> Any:  # fmt: skip
    """What ``write_uncertainty`` wrote, as a record of ``kind``; None if there is none."""
    if "uncertainty" not in file.attrs:
        return None
    found = {name: read_interval(file, table, path, sizes) for name, table in tables.items()}
    settings = read_json(file, "uncertainty", path, {})
    return kind(**{n: v for n, v in found.items() if v is not None}, settings=settings)


def gap_table(stem: str, dims: tuple[str, ...]) -> Table:
    """Variables ``<stem>closure_level`` and so on, of one ``Gap`` over ``dims``."""
    return tuple(
        real(f"{stem}closure_{name}", "degree" if name.startswith("phase") else "dB", dims,
             field=name, any_size=name.endswith(("_low", "_high")), attributes={
                 "long_name": f"{name.replace('_', ', ')}: implied over known pressure; {{words}}"})
        for name in ("level", "level_low", "level_high", "phase", "phase_low", "phase_high")
    )  # fmt: skip


CLOSURE_LEVEL = (real("closure_pressure_level", "dB", ("frequency",), field="pressure_level",
                      attributes={"long_name": "level of the known pressure"}),)  # fmt: skip


def write_closure(file: h5py.Group, found: Closure, of_cells: str = "cell") -> None:
    """Into an open file with the dimensions ``frequency`` and ``of_cells``."""
    texts = {name: getattr(found, name) for name in CLOSURE_FACTS}
    file.attrs["closure"] = to_json({"orders": found.orders, **texts})
    write_index(file, "order", len(found.orders))
    write_variables(file, found, CLOSURE_LEVEL)
    for stem, dims in _closure_dims(of_cells).items():
        gap = found.cells if stem else found.liner
        write_variables(file, gap, gap_table(stem, dims), words=", ".join(found.orders))


def read_closure(file: h5py.Group, path: str | Path, sizes: Sizes, of_cells: str = "cell") -> Closure | None:
    """What ``write_closure`` wrote; None if there is none.

    Args:
        file: or the group of one that holds it.

    Raises:
        ValueError: a variable has another shape or unit, or the attribute lacks a value.
    """
    texts = read_json(file, "closure", path, {})
    if not texts:
        return None
    missing = {"orders", *CLOSURE_FACTS} - set(texts)
    if missing:
        raise ValueError(f"{path}: attribute 'closure' lacks {', '.join(sorted(missing))}")
    sizes["order"] = (len(texts["orders"]),)
    gaps = [
        Gap(**read_variables(file, gap_table(stem, dims), path, sizes=sizes))
        for stem, dims in _closure_dims(of_cells).items()
    ]
    level = read_variables(file, CLOSURE_LEVEL, path, sizes=sizes)
    facts = {name: texts[name] for name in CLOSURE_FACTS}
    return Closure(tuple(texts["orders"]), **facts, **level, liner=gaps[0], cells=gaps[1])


def _closure_dims(of_cells: str) -> dict[str, tuple[str, ...]]:
    return {"": ("order", "frequency"), f"{of_cells}_": ("order", of_cells, "frequency")}

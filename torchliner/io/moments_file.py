"""The record of moments as netCDF-4: all that an eduction takes, to the last bit."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import torch

from torchliner.engine.blocks import Blocks
from torchliner.engine.drives import Drive
from torchliner.engine.moments import Moments, ReducedVelocity
from torchliner.engine.nodes import OfOneLiner, nodes_of
from torchliner.engine.survey import Membership, Survey, gram_of
from torchliner.io.axes import read_coordinate
from torchliner.io.hdf5 import open_file, place, set_texts, text_attribute
from torchliner.io.own_file import take
from torchliner.io.own_writer import fill
from torchliner.io.tables import FileKind, new_file, read_variables, write_attribute, write_variables
from torchliner.names import AVERAGINGS
from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells
from torchliner.records.declared import Part, Variable, require_shape, variables_of

STEM = "torchliner moments "
OWN: dict[str, Any] = {"velocity": {}, "blocks": {}, "nodes": {}, "settings": {}, "notes": ()}
KIND = FileKind(f"{STEM}1", "record of moments", OWN)
PRECISIONS = {"float32": torch.float32, "float64": torch.float64}
BLOCK = ("block", "point")
SQUARES = "square of cells"
KNOWN = (
    Variable("lines", "Hz", ("line",), name="line_frequency"),
    Variable("turns", "Hz", ("turn",), name="turn_frequency", optional=True),
    Variable("used", "1", ("point",), "flag"),
    Variable("area", "m2", ("point",), optional=True),
)
SURVEY = (
    Variable("sums", "m/s", ("block", "row", "point"), name="line_sums", wide=True),
    Variable("squares", "m2/s2", BLOCK, name="square_sums", wide=True),
    Variable("peaks", "m/s", BLOCK),
)
LOCKED = (
    Variable("taken", "m/s", ("harmonic_row", "point")),
    Variable("scale", "1", ("point",), optional=True),
    Variable("share", "1", ("harmonic", "cell")),
)
SUMS = {
    SQUARES: Variable(SQUARES, "m2/s2", ("block", "cell"), name="cell_square_sums", wide=True),
    **{
        name: Variable(name, "1", ("block", "turn_row", "node", each), name=f"{name.replace('-', '_')}_sums")
        for name, each in {"admittance": "point", "velocity": "cell", "phase-locked": "point"}.items()
    },
}
CELLS = tuple(variables_of(Cells))


def write_moments(known: Moments, path: str | Path) -> None:
    """Write a record of moments; the old file, if any, is replaced when the new one is whole.

    Raises:
        ValueError: the moments answer certain frequencies of one liner alone.
    """
    if isinstance(known.nodes, OfOneLiner):
        at = known.nodes.frequency.tolist()
        raise ValueError(f"{path}: moments of one liner at {at} Hz have no file; use tl.moments")
    plane, seen = known.plane, known.survey
    said = {
        "velocity": {
            "shape": list(plane.velocity.shape),
            "precision": str(plane.velocity.dtype).removeprefix("torch."),
        },
        "blocks": {**vars(seen.blocks), "harmonics": seen.harmonics},
        "nodes": {} if known.nodes is None else known.nodes.describe(),
        "settings": {**known.settings, "cell_pitch": known.cell_pitch},
        "notes": known.notes,
    }
    turns = known.turns if len(known.turns) else None
    own = SimpleNamespace(lines=seen.lines, turns=turns, used=known.used, area=plane.area)
    sums = {name: each[:, 0, 0] if name == SQUARES else each for name, each in known.sums.items()}
    with new_file(path) as file:
        fill(file, plane, unsaid=("velocity", "streamwise", "sampling_rate", "name", "area"))
        set_texts(file, schema=KIND.schema)
        for key, value in said.items():
            write_attribute(file, key, value)
        write_variables(file, own, KNOWN)
        write_variables(file, SimpleNamespace(**sums), tuple(SUMS[name] for name in sums))
        write_variables(file, seen, SURVEY)
        write_variables(file, known.cells, CELLS)
        if known.locked is not None:
            write_variables(file, known.locked, LOCKED)


def holds_moments(path: str | Path) -> bool:
    """Whether a file says that it holds moments, of whatever format."""
    if not (Path(path).is_file() and h5py.is_hdf5(path)):
        return False
    with open_file(path) as file:
        return (text_attribute(file, "schema") or "").startswith(STEM)


def read_moments(path: str | Path) -> Moments:
    """Read what ``Moments.write`` wrote.

    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: of another kind or format; a dataset is missing, is not finite, or has a wrong shape or unit; the
            message names FILE:/dataset.
    """
    path = Path(path)
    with open_file(path) as file:
        KIND.require(file, path)
        said = KIND.read_head(file, path)
        shape, precision = tuple(said["velocity"]["shape"]), PRECISIONS[said["velocity"]["precision"]]
        harmonics = said["blocks"].pop("harmonics")
        blocks = Blocks(**said["blocks"] | {"borders": tuple(said["blocks"]["borders"])})
        nodes = nodes_of(said["nodes"]) if said["nodes"] else None
        settings, pitch = said["settings"], said["settings"].pop("cell_pitch")
        locks = settings["averaging"] == "phase-locked"
        names = [SQUARES, *([*AVERAGINGS][: 2 + locks] if nodes else [])]
        tables = {
            "own": KNOWN,
            "cells": CELLS,
            "survey": SURVEY,
            "locked": LOCKED if locks else (),
            "sums": tuple(SUMS[name] for name in names),
        }
        found = {part: read_variables(file, table, path) for part, table in tables.items()}
        own, cells = found["own"], Cells(**found["cells"])
        turns = own.get("turns", torch.zeros(0, dtype=torch.float64))
        about: dict[str, Any] = {axis: read_coordinate(file, axis, shape[:-1], path) for axis in "xz"}
        about |= {"velocity": ReducedVelocity(shape, precision, str(path)), "streamwise": None, "name": str(path)}
        about |= {"sampling_rate": blocks.sampling_rate, "area": own.get("area")}
        plane = take(file, VelocityPlane, path, about, Part())
        count = {"point": plane.probes, "block": blocks.count, "line": len(own["lines"]), "cell": cells.count}
        count |= {"row": 1 + 2 * len(own["lines"]), "harmonic": 1 + harmonics, "harmonic_row": 1 + 2 * harmonics}
        count |= {"turn_row": 1 + 2 * len(turns)} | ({} if nodes is None else {"node": nodes.count})
        sizes: dict[str, tuple[int, ...]] = {name: (size,) for name, size in count.items()}
        for part, table in tables.items():
            for row in (row for row in table if row.field in found[part]):
                value, label = found[part][row.field], place(file, row.names[0], path)
                require_shape(row, value.shape, sizes, label)
                if row not in CELLS and not bool(torch.isfinite(value).all()):
                    raise ValueError(f"{label} holds values that are not finite; reduce the data again")
    survey = Survey(blocks, own["lines"], harmonics, **found["survey"], gram=gram_of(blocks, own["lines"]))
    tone = {"lines": own["lines"][:harmonics], "sampling_rate": blocks.sampling_rate}
    return Moments(
        plane=plane,
        settings=settings,
        cell_pitch=pitch,
        cells=cells,
        membership=Membership.of(cells.labels, cells.count, survey.sums.device),
        used=own["used"],
        survey=survey,
        locked=Drive(**tone, **found["locked"]) if locks else None,
        nodes=nodes,
        turns=turns,
        sums={name: each[:, None, None] if name == SQUARES else each for name, each in found["sums"].items()},
        notes=said["notes"],
    )

"""The record of moments as netCDF-4: all that an eduction takes, to the last bit."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import torch

from torchliner.engine.blocks import Blocks
from torchliner.engine.drives import Drive
from torchliner.engine.moments import Moments, ReducedVelocity
from torchliner.engine.nodes import Chebyshev, Levels, Nodes
from torchliner.engine.survey import Membership, Survey
from torchliner.io.hdf5 import is_there, open_file, text_attribute
from torchliner.io.own_file import read_attribute, read_coordinate, read_row, require_schema, take
from torchliner.io.own_writer import fill, new_file, write_row
from torchliner.names import AVERAGINGS
from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells
from torchliner.records.checked import require_shapes
from torchliner.records.declared import Variable, table_of, variables_of
from torchliner.records.notes import Note

STEM = "torchliner moments "
SCHEMA = f"{STEM}1"
BLOCK = ("block", "point")
SQUARES = "square of cells"
CELLS, AREA = variables_of(Cells), Variable("area", "m2", ("point",))
(START,) = table_of(VelocityPlane, "start")
PRECISIONS = {"float32": torch.float32, "float64": torch.float64}
Notes = tuple[Note | str, ...]
KNOWN = (
    Variable("turns", "Hz", ("turn",), name="turn_frequency", optional=True),
    Variable("used", "1", ("point",), "flag"),
)
SURVEY = (
    Variable("lines", "Hz", ("line",), name="line_frequency"),
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


def write_moments(known: Moments, path: str | Path) -> None:
    """Write a record of moments; the old file, if any, is replaced when the new one is whole. A ValueError for moments
    that answer certain frequencies of one liner alone."""
    if known.onto is not None:
        raise ValueError(f"{path}: moments of one liner at certain frequencies have no file; use tl.moments")
    plane, seen = known.plane, known.survey
    velocity = {"shape": list(plane.velocity.shape), "precision": str(plane.velocity.dtype).removeprefix("torch.")}
    said = {
        "schema": SCHEMA,
        "velocity": velocity,
        "blocks": {**vars(seen.blocks), "harmonics": seen.harmonics},
        "nodes": {} if known.nodes is None else vars(known.nodes),
        "settings": {**known.settings, "cell_pitch": known.cell_pitch},
        "notes": known.notes,
    }
    held = ((known, KNOWN), (seen, SURVEY), (known.cells, CELLS), (known.locked, LOCKED))
    with new_file(path) as file:
        fill(file, plane, unsaid=("velocity", "area"), **said)
        for owner, table in held if known.locked else held[:-1]:
            for row in table:
                value = getattr(owner, row.field)
                if not (value is None or (row.optional and len(value) == 0)):
                    write_row(file, row, value)
        for name, each in known.sums.items():
            write_row(file, SUMS[name], each[:, 0, 0] if name == SQUARES else each)
        write_row(file, START, plane.start)
        if plane.area is not None:
            write_row(file, AREA, plane.area)


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
        require_schema(file, path, SCHEMA)
        head = ("velocity", "blocks", "nodes", "settings")
        said = {key: read_attribute(file, key, dict[str, Any], path) for key in head}
        shape, precision = tuple(said["velocity"]["shape"]), PRECISIONS[said["velocity"]["precision"]]
        harmonics, borders = said["blocks"].pop("harmonics"), tuple(said["blocks"]["borders"])
        blocks = Blocks(**said["blocks"] | {"borders": borders})
        nodes: Nodes | None = None
        if plain := said["nodes"]:
            of_table = plain.pop("kind") == "levels"
            nodes = Levels(tuple(plain["kinks"]), plain["parts"]) if of_table else Chebyshev(**plain)
        settings, pitch = said["settings"], said["settings"].pop("cell_pitch")
        locks = settings["averaging"] == "phase-locked"
        sums = [SUMS[name] for name in (SQUARES, *([*AVERAGINGS][: 2 + locks] if nodes else []))]
        rows = (*KNOWN, *SURVEY, *CELLS, *(LOCKED if locks else ()), *sums)
        there = [row for row in rows if not row.optional or is_there(file, row.names[0], path)]
        found = {row.field: read_row(file, row, path) for row in there}
        area = read_row(file, AREA, path) if is_there(file, AREA.field, path) else None
        about: dict[str, Any] = {axis: read_coordinate(file, axis, shape[:-1], path) for axis in "xz"}
        left = ReducedVelocity(shape, precision, str(path), in_file=True)
        about |= {"velocity": left, "name": str(path)}
        plane = take(file, VelocityPlane, path, about | {"sampling_rate": blocks.sampling_rate, "area": area})
        lines, turns = found["lines"], found.get("turns", torch.zeros(0, dtype=torch.float64))
        count = {"point": plane.probes, "block": blocks.count, "line": len(lines), "turn_row": 1 + 2 * len(turns)}
        count |= {"row": 1 + 2 * len(lines), "harmonic": 1 + harmonics, "harmonic_row": 1 + 2 * harmonics}
        count |= {} if nodes is None else {"node": nodes.count}
        stored = [(replace(row, field=row.names[0]), found[row.field]) for row in there]
        require_shapes(stored, str(path), {key: (n,) for key, n in count.items()})
        for row in there:
            if row not in CELLS and not bool(torch.isfinite(found[row.field]).all()):
                raise ValueError(f"{path}:/{row.names[0]} holds values that are not finite; reduce the data again")
        notes = read_attribute(file, "notes", Notes, path)

    def fields(table: Iterable[Variable]) -> dict[str, Any]:
        return {row.field: found[row.field] for row in table if row in there}

    cells = Cells(**fields(CELLS))
    survey = Survey(blocks=blocks, harmonics=harmonics, **fields(SURVEY))
    tone = {"lines": lines[:harmonics], "sampling_rate": blocks.sampling_rate}
    return Moments(
        plane=plane,
        settings=settings,
        cell_pitch=pitch,
        cells=cells,
        membership=Membership.of(cells, found["used"], survey.sums.device),
        used=found["used"],
        survey=survey,
        locked=Drive(**tone, **fields(LOCKED)) if locks else None,
        nodes=nodes,
        turns=turns,
        sums={row.field: found[row.field][:, None, None] if row.field == SQUARES else found[row.field] for row in sums},
        notes=notes,
    )

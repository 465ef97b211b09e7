"""The record of moments as netCDF-4: all that an eduction takes, to the last bit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import torch
from torch import Tensor

from torchliner.engine.blocks import Blocks
from torchliner.engine.drives import Drive
from torchliner.engine.moments import SETTINGS, Moments, ReducedVelocity
from torchliner.engine.nodes import Chebyshev, Nodes, OfOneLiner, nodes_of
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
SLACK = 1e-6  # relative, of the number of samples
POINT, BLOCK = ("point",), ("block", "point")
CELLS = tuple(variables_of(Cells))
SURVEY = (
    Variable("sums", "m/s", ("block", "row", "point"), name="line_sums", wide=True),
    Variable("squares", "m2/s2", BLOCK, name="square_sums", wide=True),
    Variable("peaks", "m/s", BLOCK),
)
LOCKED = (
    Variable("taken", "m/s", ("harmonic_row", "point")),
    Variable("scale", "1", POINT, optional=True),
    Variable("share", "1", ("harmonic", "cell")),
)
KNOWN = (
    Variable("lines", "Hz", ("line",), name="line_frequency"),
    Variable("turns", "Hz", ("turn",), name="turn_frequency", optional=True),
    Variable("used", "1", POINT, "flag"),
)
AREA = Variable("area", "m2", POINT, optional=True)
SQUARES = "square of cells"
COLUMNS = {"admittance": "point", "velocity": "cell", "phase-locked": "point"}
SUMS = {
    SQUARES: Variable(SQUARES, "m2/s2", ("block", "cell"), name="cell_square_sums", wide=True),
    **{
        name: Variable(name, "1", ("block", "turn_row", "node", each), name=f"{name.replace('-', '_')}_sums")
        for name, each in COLUMNS.items()
    },
}


def write_moments(known: Moments, path: str | Path) -> None:
    """Write a record of moments; the old file, if any, is replaced when the new one is whole.

    Raises:
        ValueError: the moments answer certain frequencies of one liner alone.
    """
    if isinstance(known.nodes, OfOneLiner):
        at = known.nodes.frequency.tolist()
        raise ValueError(f"{path}: moments of one liner at {at} Hz have no file; use tl.moments")
    plane, seen, locked = known.plane, known.survey, known.locked
    kind = str(plane.velocity.dtype).removeprefix("torch.")
    said = {
        "velocity": {"shape": list(plane.velocity.shape), "precision": kind},
        "blocks": {**vars(seen.blocks), "harmonics": seen.harmonics},
        "nodes": {} if known.nodes is None else known.nodes.describe(),
        "settings": {**known.settings, "cell_pitch": known.cell_pitch},
        "notes": known.notes,
    }
    sums = {name: each[:, 0, 0] if name == SQUARES else each for name, each in known.sums.items()}
    turns = known.turns if len(known.turns) else None
    with new_file(path) as file:
        fill(file, plane, unsaid=("velocity", "streamwise", "sampling_rate", "name", "area"))
        set_texts(file, schema=KIND.schema)
        for key, value in said.items():
            write_attribute(file, key, value)
        write_variables(file, SimpleNamespace(lines=seen.lines, turns=turns, used=known.used), KNOWN)
        write_variables(file, SimpleNamespace(area=plane.area, **sums), (AREA, *(SUMS[name] for name in sums)))
        write_variables(file, seen, SURVEY)
        write_variables(file, known.cells, CELLS)
        if locked is not None:
            write_variables(file, locked, LOCKED)


def holds_moments(path: str | Path) -> bool:
    """Whether a file says that it holds moments, of whatever format."""
    if not (Path(path).is_file() and h5py.is_hdf5(path)):
        return False
    with open_file(path) as file:
        return (text_attribute(file, "schema") or "").startswith(STEM)


def read_moments(path: str | Path) -> Moments:
    """Read what ``Moments.write`` wrote.

    Args:
        path: netCDF-4 file.
    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: of another kind or format; a dataset is missing, has a wrong shape or unit, or holds what no sums
            over a record can be; the message names FILE:/dataset.
    """
    path = Path(path)
    with open_file(path) as file:
        KIND.require(file, path)
        said, known = KIND.read_head(file, path), _finite(file, KNOWN, path)
        lines, turns = known["lines"], known.get("turns", torch.zeros(0, dtype=torch.float64))
        with _attribute("velocity", path):
            shape = tuple(int(n) for n in said["velocity"]["shape"])
            velocity = ReducedVelocity(shape, PRECISIONS[said["velocity"]["precision"]], str(path))
        with _attribute("blocks", path):
            blocks, harmonics = _blocks_of(said["blocks"], shape[-1], len(lines))
        with _attribute("nodes", path):
            nodes = nodes_of(said["nodes"]) if said["nodes"] else None
        with _attribute("settings", path):
            settings, pitch = _settings_of(said["settings"], nodes)
        places = {axis: read_coordinate(file, axis, shape[:-1], path) for axis in "xz"}
        about = {"velocity": velocity, "streamwise": None, "sampling_rate": blocks.sampling_rate, "name": str(path)}
        about |= places | {"area": None, **read_variables(file, (AREA,), path)}
        plane = take(file, VelocityPlane, path, about, Part())
        locks, nodal = settings["averaging"] == "phase-locked", nodes is not None
        names = [SQUARES, *([*AVERAGINGS][: 3 if locks else 2] if nodal else [])]
        parts = {"survey": SURVEY, "locked": LOCKED if locks else (), "sums": [SUMS[name] for name in names]}
        found = {part: _finite(file, table, path) for part, table in parts.items()}
        cells = Cells(**read_variables(file, CELLS, path))
        count = {"point": plane.probes, "block": blocks.count, "line": len(lines), "cell": cells.count}
        count |= {"row": 1 + 2 * len(lines), "harmonic": 1 + harmonics, "harmonic_row": 1 + 2 * harmonics}
        count |= {"turn_row": 1 + 2 * len(turns)} | ({} if nodes is None else {"node": nodes.count})
        sizes: dict[str, tuple[int, ...]] = {name: (size,) for name, size in count.items()}
        held = [(KNOWN, known), (CELLS, vars(cells)), *((table, found[part]) for part, table in parts.items())]
        for row, value in ((row, values[row.field]) for table, values in held for row in table if row.field in values):
            if value is not None:
                require_shape(row, value.shape, sizes, place(file, row.names[0], path))
        _require_cells(cells, known["used"], place(file, "cell_of_probe", path))
        survey = Survey(blocks, lines, harmonics, **found["survey"], gram=gram_of(blocks, lines))
        tone = {"lines": lines[:harmonics], "sampling_rate": blocks.sampling_rate}
        locked = Drive(**tone, **found["locked"]) if locks else None
        sums = {name: each[:, None, None] if name == SQUARES else each for name, each in found["sums"].items()}
        for name in names[1:]:
            _require_sums(sums[name], nodes, survey.lengths, place(file, SUMS[name].names[0], path))
    return Moments(
        plane=plane,
        settings=settings,
        cell_pitch=pitch,
        cells=cells,
        membership=Membership.of(cells.labels, cells.count, survey.sums.device),
        used=known["used"],
        survey=survey,
        locked=locked,
        nodes=nodes,
        turns=turns,
        sums=sums,
        notes=said["notes"],
    )


@contextmanager
def _attribute(key: str, path: Path) -> Iterator[None]:
    """What is wrong in an attribute names it."""
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, IndexError) as error:
        text = f"has no {error}" if isinstance(error, KeyError) else error
        raise ValueError(f"{path}: attribute {key!r}: {text}; reduce the data again") from error


def _blocks_of(said: dict[str, Any], samples: int, lines: int) -> tuple[Blocks, int]:
    """Blocks, and number of harmonics."""
    borders, harmonics = tuple(int(n) for n in said["borders"]), int(said["harmonics"])
    blocks = Blocks(borders, float(said["sampling_rate"]), int(said["periods"]))
    rising = [*borders] == sorted({*borders}) and borders[0] >= 0 and borders[-1] <= samples
    fitting = 0 < blocks.count <= blocks.periods and 0 <= harmonics <= lines and 0 < blocks.sampling_rate < float("inf")
    if not (rising and fitting):
        raise ValueError(f"{said} are no blocks of {samples} samples with {lines} lines")
    return blocks, harmonics


def _settings_of(said: dict[str, Any], nodes: Nodes | None) -> tuple[dict[str, Any], float | None]:
    """Choices by name, and the pitch of the cells."""
    settings = {name: value for name, value in said.items() if name != "cell_pitch"}
    if {*settings} != {*SETTINGS} or settings["averaging"] not in AVERAGINGS:
        raise ValueError(f"{settings} are not {', '.join(SETTINGS)}")
    if (settings["drive"] == "rms") != (nodes is None):
        raise ValueError(f"drive {settings['drive']!r} does not go with nodes {nodes}")
    return settings, said["cell_pitch"]


def _finite(file: h5py.File, table: Any, path: Path) -> dict[str, Any]:
    """What is there of a table, all of it finite."""
    found = read_variables(file, table, path)
    for row in table:
        value = found.get(row.field)
        if value is not None and not bool(torch.isfinite(value).all()):
            count = int((~torch.isfinite(value)).sum())
            raise ValueError(
                f"{place(file, row.names[0], path)} holds {count} values that are not finite; sums over a record are: "
                "reduce the data again"
            )
    return found


def _require_cells(cells: Cells, used: Tensor, label: str) -> None:
    """Each with a probe that is used, and none with another."""
    labels = cells.labels
    inside = labels[(labels >= 0) & (labels < cells.count)].to(torch.int64)
    sound = bool(((labels >= -1) & (labels < cells.count) & (used | (labels < 0))).all())
    if not (sound and bool((torch.bincount(inside, minlength=cells.count) > 0).all())):
        raise ValueError(
            f"{label} does not sort the {int(used.sum())} probes in use into {cells.count} cells: the file is damaged; "
            "reduce the data again"
        )


def _require_sums(values: Tensor, nodes: Nodes | None, lengths: Tensor, label: str) -> None:
    """T_0, or all functions of a table together, are 1 and sum to the samples of each block."""
    ones = values[:, 0, 0] if isinstance(nodes, Chebyshev) else values[:, 0].sum(1)
    wrong = ((ones / lengths[:, None] - 1).abs() > SLACK).any(0)
    if bool(wrong.any()):
        first = int(wrong.nonzero()[0])
        raise ValueError(
            f"{label} is not the sums of {lengths.tolist()} samples at {int(wrong.sum())} of {len(wrong)} columns, the "
            f"first {first} with {ones[:, first].tolist()}: the file is damaged; reduce the data again"
        )

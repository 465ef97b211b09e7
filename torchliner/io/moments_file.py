"""The record of moments as netCDF-4: all that an eduction takes, to the last bit."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import h5py
import torch
from torch import Tensor

from torchliner.engine.blocks import Blocks
from torchliner.engine.drives import Drive
from torchliner.engine.moments import Moments, ReducedVelocity
from torchliner.engine.nodes import Nodes
from torchliner.engine.survey import Membership, Survey
from torchliner.io.hdf5 import open_file, text_attribute
from torchliner.io.own_file import require_schema, take
from torchliner.io.own_writer import fill, new_file
from torchliner.names import AVERAGINGS
from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells
from torchliner.records.checked import check, require_shapes
from torchliner.records.declared import ANY, flat, part, record, var
from torchliner.records.notes import Note

STEM = "torchliner moments "
SQUARES = "square of cells"  # among the sums of ``Moments``
WEIGHED = ("block", "turn_row", "node")
FIELDS = {name: f"{name.replace('-', '_')}_sums" for name in AVERAGINGS}  # of ``Stored``, by averaging
PRECISIONS = {"float32": torch.float32, "float64": torch.float64}
# Fields of ``Stored`` by what holds them in memory, too.
OF_MOMENTS = ("nodes", "settings", "cell_pitch", "cells", "used", "notes")
OF_SURVEY = ("blocks", "lines", "harmonics", "sums", "squares", "peaks")
OF_DRIVE = ("taken", "share", "scale")


@record
class Stored:
    """What the file holds beside the facts of the plane. A row is that of 1, or of a cosine or sine: of the lines
    (``row``), the tone's harmonics (``harmonic_row``), the waves of the phase rule (``turn_row``).

    Args:
        shape, precision: of the velocity, (..., T); ``float32`` or ``float64``.
    Raises:
        ValueError: something is missing, not finite, or of another shape than blocks, lines and nodes say.
    """

    name: str
    shape: tuple[int, ...]
    precision: str
    blocks: Blocks
    harmonics: int
    nodes: Nodes | None
    settings: Mapping[str, Any]
    cell_pitch: float | None
    notes: tuple[Note | str, ...]
    cells: Cells = part()
    start: float = var(unit="s", text="time of the first sample")
    used: Tensor = var("point", kind="flag")
    lines: Tensor = var("line", unit="Hz", name="line_frequency")
    sums: Tensor = var("block", "row", "point", unit="m/s", name="line_sums", wide=True, range=ANY)
    squares: Tensor = var("block", "point", unit="m2/s2", name="square_sums", wide=True, range=ANY)
    peaks: Tensor = var("block", "point", unit="m/s", text="largest |v|", range=ANY)
    cell_square_sums: Tensor = var("block", "cell", unit="m2/s2", wide=True, range=ANY)
    area: Tensor | None = var("point", unit="m2", default=None)
    turns: Tensor | None = var("turn", unit="Hz", name="turn_frequency", default=None)
    taken: Tensor | None = var("harmonic_row", "point", unit="m/s", range=ANY, default=None)
    share: Tensor | None = var("harmonic", "cell", range=ANY, default=None)
    scale: Tensor | None = var("point", range=ANY, default=None)
    admittance_sums: Tensor | None = var(*WEIGHED, "point", range=ANY, default=None)
    velocity_sums: Tensor | None = var(*WEIGHED, "cell", range=ANY, default=None)
    phase_locked_sums: Tensor | None = var(*WEIGHED, "point", range=ANY, default=None)

    SCHEMA: ClassVar = f"{STEM}1"
    UNSAID: ClassVar = ("name",)

    def __post_init__(self) -> None:
        needed = [*(("taken", "share") if self.locks else ()), *self.weighed.values()]
        if lost := [field for field in needed if getattr(self, field) is None]:
            raise ValueError(f"{self.name}:/{lost[0]} is missing; reduce the data again")
        check(self)
        rows = {"": len(self.lines), "turn_": 0 if self.turns is None else len(self.turns), "harmonic_": self.harmonics}
        sizes = {"point": math.prod(self.shape[:-1]), "block": self.blocks.count, "harmonic": 1 + self.harmonics}
        sizes |= {f"{of}row": 1 + 2 * count for of, count in rows.items()}
        sizes |= {} if self.nodes is None else {"node": self.nodes.count}
        require_shapes(flat(self), self.name, {dim: (count,) for dim, count in sizes.items()})

    @property
    def locks(self) -> bool:
        """Whether there is a phase-locked drive."""
        return bool(self.settings["averaging"] == "phase-locked")

    @property
    def weighed(self) -> dict[str, str]:
        """By averaging, the field with the sums of the nodes' functions; none with drive ``rms``."""
        held = [*FIELDS][: 0 if self.nodes is None else 2 + self.locks]
        return {name: FIELDS[name] for name in held}


def _some(owner: Any, names: Sequence[str]) -> dict[str, Any]:
    return {name: getattr(owner, name) for name in names}


def write_moments(known: Moments, path: str | Path) -> None:
    """Write a record of moments; the old file, if any, is replaced when the new one is whole. A ValueError for moments
    that answer certain frequencies of one liner alone."""
    if known.onto is not None:
        raise ValueError(f"{path}: moments of one liner at certain frequencies have no file; use tl.moments")
    plane, sums = known.plane, dict(known.sums)
    about = {"name": str(path), "shape": plane.velocity.shape, "precision": str(plane.velocity.dtype).partition(".")[2]}
    about |= _some(plane, ("start", "area")) | _some(known, OF_MOMENTS) | _some(known.survey, OF_SURVEY)
    about |= _some(known.locked, OF_DRIVE) if known.locked else {}
    about |= {"turns": known.turns if len(known.turns) else None, "cell_square_sums": sums.pop(SQUARES)[:, 0, 0]}
    about |= {FIELDS[name]: each for name, each in sums.items()}
    with new_file(path) as file:
        fill(file, plane, unsaid=("velocity", "area"))
        fill(file, Stored(**about))


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
    about: dict[str, Any] = {"name": str(path)}
    with open_file(path) as file:
        require_schema(file, path, Stored.SCHEMA)
        kept: Stored = take(file, Stored, path, about)
        left = ReducedVelocity(kept.shape, PRECISIONS[kept.precision], str(path), in_file=True)
        about |= {"velocity": left, "sampling_rate": kept.blocks.sampling_rate}
        plane: VelocityPlane = take(file, VelocityPlane, path, about)
    survey = Survey(**_some(kept, OF_SURVEY))
    tone: dict[str, Any] = {"lines": kept.lines[: kept.harmonics], "sampling_rate": kept.blocks.sampling_rate}
    sums = {SQUARES: kept.cell_square_sums[:, None, None]}
    return Moments(
        **_some(kept, OF_MOMENTS),
        plane=plane,
        membership=Membership.of(kept.cells, kept.used, survey.sums.device),
        survey=survey,
        locked=Drive(**tone, **_some(kept, OF_DRIVE)) if kept.locks else None,
        turns=kept.lines[:0] if kept.turns is None else kept.turns,
        sums=sums | {name: getattr(kept, field) for name, field in kept.weighed.items()},
    )

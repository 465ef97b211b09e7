"""The record of moments as netCDF-4: all that an eduction takes, to the last bit."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import torch

from torchliner.io.axes import read_case, read_coordinate, write_case, write_coordinates
from torchliner.io.hdf5 import (
    is_there,
    open_file,
    place,
    read_attribute,
    text_attribute,
    write_index,
)
from torchliner.io.holes import stored_holes, write_holes
from torchliner.io.moments_checks import PRECISIONS, checked_head, require_sums, require_whole
from torchliner.io.plane_file import NUMBERS
from torchliner.io.result_file import Sizes
from torchliner.io.tables import (
    FileKind,
    Table,
    cartesian,
    numbers,
    read_variables,
    real,
    write_variables,
)
from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells
from torchliner.reduction.basis import Basis
from torchliner.reduction.block_sums import VelocityBlocks
from torchliner.reduction.moments import Moments, PlaneSums, ReducedVelocity
from torchliner.reduction.periodic import Harmonics, PeriodicPart
from torchliner.reduction.plan import PassPlan
from torchliner.reduction.speed_sums import GroupMoments
from torchliner.reduction.survey import Survey

STEM = "torchliner moments "
KIND = FileKind(
    f"{STEM}1", "record of moments",
    {"title": "", "source_side": "unknown", "liner": "", "provenance": {}, "velocity": {},
     "plan": {}, "basis": {}, "settings": {}, "notes": ()},
)  # fmt: skip
ABOUT = NUMBERS + numbers({"start": "s"})
COLUMN = ("column",)
TONES = (real("tones", "Hz", ("tone",)),)
SURVEY = (
    real("mean", "m/s", COLUMN),
    real("mean_square", "m2/s2", COLUMN),
    real("smallest", "m/s", COLUMN),
    real("largest", "m/s", COLUMN),
    real("bad", "1", COLUMN),
    real("first_bad", "1", COLUMN),
    cartesian("line", "line", ("column", "tone"), unit="m/s"),
    real("coherence", "1", ("column", "tone")),
    real("segments", "1", ("tone",)),
)
CELLS = (
    real("cell_of_probe", "1", ("point",), field="labels"),
    real("cell_x", "m", ("cell",), field="x"),
    real("cell_z", "m", ("cell",), field="z"),
    real("cell_weight", "1", ("cell",), field="weight", optional=True),
)
USED = (real("used", "1", ("point",), flag=True),)
PERIODIC = (
    real("fit", "m/s", ("harmonic_row", "point")),
    real("deviation", "m/s", ("harmonic_row", "point")),
    real("share", "1", ("harmonic", "cell")),
    real("scale", "1", ("point",)),
    real("harmonic_sums", "m/s", ("harmonic_row", "point"), field="sums"),
    real("gram", "1", ("harmonic_row", "other_harmonic_row")),
)
HARMONICS = (real("harmonic_frequency", "Hz", ("harmonic_line",), field="lines"),)
GROUPS = {"probe": "point", "cell": "cell", "coherent": "point"}  # and what their columns are


def _block_table(stem: str, columns: str) -> Table:
    """Of ``VelocityBlocks``."""
    return (
        real(f"{stem}block_mean", "m/s", ("block", columns), field="mean"),
        real(f"{stem}block_mean_square", "m2/s2", ("block", columns), field="mean_square"),
        cartesian("line", f"{stem}block_line", ("block", columns, "tone"), unit="m/s"),
    )


BLOCKS = {"blocks": _block_table("", "column"), "cell_blocks": _block_table("cell_", "cell")}


def _group_table(group: str, columns: str) -> Table:
    """Of ``GroupMoments``."""
    own = ("row", "order", columns)
    return (
        real(f"{group}_moments", "1", own, field="totals"),
        real(f"{group}_block_moments", "1", ("block_and_rest", *own), field="of_blocks",
             optional=True),
    )  # fmt: skip


def write_moments(known: Moments, path: str | Path) -> None:
    """Write a record of moments; the old file, if any, is replaced when the new one is whole.

    Raises:
        ValueError: the moments are under a window that has no name.
    """
    sums, plane = known.sums, known.plane
    if not isinstance(known.settings["window"], str):
        raise ValueError(
            f"{path}: window {known.settings['window']!r} has no name that a file could hold; "
            "reduce the data again with a window by name, as 'hann'"
        )
    seen, periodic = sums.survey, sums.periodic
    head = SimpleNamespace(
        **{key: getattr(plane, key) for key in ("title", "source_side", "liner", "provenance")},
        plan=_plan_words(sums.plan), basis={} if sums.basis is None else sums.basis.describe(),
        settings={**known.settings, "cell_pitch": known.cell_pitch},
        velocity={"shape": list(plane.velocity.shape),
                  "precision": str(plane.velocity.dtype).removeprefix("torch.")},
        notes=known.notes,
    )  # fmt: skip
    sizes = _sizes(sums.plan, plane.probes) | {
        "cell": sums.cells.count, "column": len(seen.mean), "tone": len(sums.tones),
    }  # fmt: skip
    if sums.basis is not None:
        sizes["order"] = sums.basis.count
    if periodic is not None:
        lines, rows = len(periodic.harmonics.lines), len(periodic.gram)
        sizes |= {"harmonic": 1 + lines, "harmonic_line": lines, "harmonic_row": rows,
                  "other_harmonic_row": rows}  # fmt: skip
    with KIND.created(path, head) as file:
        write_coordinates(file, plane.probe_shape, plane.x, plane.z)
        write_case(file, plane, ABOUT)
        write_holes(file, plane.holes)
        for name, size in sizes.items():
            write_index(file, name, size)
        write_variables(file, sums, TONES)
        write_variables(file, SimpleNamespace(**vars(seen) | {"segments": torch.tensor(seen.segments)}), SURVEY)
        for name, table in BLOCKS.items():
            if getattr(seen, name) is not None:
                write_variables(file, getattr(seen, name), table)
        write_variables(file, sums.cells, CELLS)
        write_variables(file, sums, USED)
        if periodic is not None:
            file.attrs["has_shares"] = int(periodic.has_shares)
            write_variables(file, periodic, PERIODIC)
            write_variables(file, periodic.harmonics, HARMONICS)
        for (name, columns), group in zip(GROUPS.items(), sums.groups, strict=False):
            write_variables(file, group, _group_table(name, columns))


def _sizes(plan: PassPlan, probes: int) -> dict[str, int]:
    """Lengths of the dimensions that the plan and the plane tell."""
    return {
        "point": probes, "row": 1 + 2 * len(plan.lines), "block": plan.rest,
        "block_and_rest": plan.rest + 1,
    }  # fmt: skip


def _plan_words(plan: PassPlan) -> dict[str, Any]:
    return {
        "samples": plan.samples, "sampling_rate": plan.sampling_rate, "begin": plan.begin,
        "end": plan.end, "borders": list(plan.blocks.borders), "periods": plan.blocks.periods,
        "lines": list(plan.lines),
    }  # fmt: skip


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
        ValueError: of another kind or a newer format; a dataset is missing, has a wrong shape or
            unit, or holds what no sums over a record can be; the message names FILE:/dataset.
    """
    path = Path(path)
    with open_file(path) as file:
        found = text_attribute(file, "schema") or ""
        if found.startswith(STEM) and found != KIND.schema:
            raise ValueError(
                f"{path} has the format {found!r}, and this torchliner reads {KIND.schema!r}; "
                "take the torchliner that wrote it, or reduce the data again"
            )
        KIND.require(file, path)
        about = {"start": 0.0, **read_case(file, KIND, ABOUT, path)}
        words = {key: about.pop(key) for key in ("velocity", "plan", "basis", "settings", "notes")}
        plan, basis, pitch = checked_head(words, path)
        shape = tuple(words["velocity"]["shape"])
        plane = VelocityPlane(
            ReducedVelocity(shape, PRECISIONS[words["velocity"]["precision"]], str(path)),
            sampling_rate=plan.sampling_rate, name=str(path),
            x=read_coordinate(file, "x", shape[:-1], path),
            z=read_coordinate(file, "z", shape[:-1], path),
            holes=stored_holes(file, path), **about,
        )  # fmt: skip
        sums = _read_sums(file, path, plan, basis, plane.probes)
    return Moments(plane, sums, words["settings"], pitch, words["notes"])


def _read_sums(file: h5py.File, path: Path, plan: PassPlan, basis: Basis | None, probes: int) -> PlaneSums:
    sizes: Sizes = {name: (size,) for name, size in _sizes(plan, probes).items()}
    if basis is not None:
        sizes["order"] = (basis.count,)

    def read(table: Table, may_be_nan: bool = False) -> dict[str, Any]:
        found = read_variables(file, table, path, sizes=sizes)
        for row in table:
            value = found.get(row.field)
            if value is not None and not may_be_nan and not bool(torch.isfinite(value).all()):
                raise ValueError(
                    f"{place(file, row.names[0], path)} holds {int((~torch.isfinite(value)).sum())}"
                    " values that are not finite; sums over a record are: reduce the data again"
                )
        return found

    cells = Cells(**read(CELLS, may_be_nan=True))
    tones = read(TONES)["tones"].to(torch.float64)
    kept = read(SURVEY)
    kept["segments"] = tuple(kept["segments"].tolist())
    blocks: dict[str, Any] = {
        name: VelocityBlocks(**read(table)) if is_there(file, table[0].names[0], path) else None
        for name, table in BLOCKS.items()
    }
    used = read(USED)["used"]
    periodic = None
    if is_there(file, PERIODIC[0].names[0], path):
        harmonics = Harmonics(read(HARMONICS)["lines"].to(torch.float64), plan.sampling_rate)
        rows = len(harmonics.owner)
        sizes |= {"harmonic": (1 + len(harmonics.lines),), "harmonic_row": (rows,),
                  "other_harmonic_row": (rows,)}  # fmt: skip
        shares = bool(read_attribute(file, "has_shares", path))
        periodic = PeriodicPart(harmonics, has_shares=shares, **read(PERIODIC))
    groups = []
    for name, columns in GROUPS.items():
        table = _group_table(name, columns)
        if basis is not None and is_there(file, table[0].names[0], path):
            groups.append(GroupMoments(**({"of_blocks": None} | read(table))))
            require_sums(groups[-1], plan, basis, place(file, table[0].names[0], path))
    sums = PlaneSums(plan, tones, Survey(**kept, **blocks), cells, used, periodic, basis, tuple(groups))
    require_whole(sums, probes, path)
    return sums

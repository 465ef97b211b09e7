"""The record of moments as netCDF-4: all that an eduction takes, to the last bit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
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
from torchliner.io.plane_file import NUMBERS
from torchliner.io.tables import FileKind, Table, cartesian, read_variables, real, write_variables
from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells
from torchliner.reduction.basis import Basis, Chebyshev, basis_of
from torchliner.reduction.moments import SETTINGS, Moments, PlaneSums, ReducedVelocity
from torchliner.reduction.periodic import Harmonics, PeriodicPart
from torchliner.reduction.plan import PassPlan
from torchliner.reduction.speed_sums import GroupMoments
from torchliner.reduction.survey import Survey, VelocityBlocks
from torchliner.signals.blocks import Blocks

STEM = "torchliner moments "
KIND = FileKind(
    f"{STEM}1", "record of moments",
    {"title": "", "source_side": "unknown", "liner": "", "provenance": {}, "velocity": {},
     "plan": {}, "basis": {}, "settings": {}, "notes": ()},
)  # fmt: skip
MOST_ORDERS = 1 << 16  # K of tables with many kinks, at most
LARGEST_ERROR = 1e-4  # of a sum, in samples
PRECISIONS = {"float32": torch.float32, "float64": torch.float64}
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
        write_case(file, plane, NUMBERS)
        for name, size in sizes.items():
            write_index(file, name, size)
        write_variables(file, sums, TONES)
        write_variables(
            file, SimpleNamespace(**vars(seen) | {"segments": torch.tensor(seen.segments)}), SURVEY
        )
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
        about = read_case(file, KIND, NUMBERS, path)
        words = {key: about.pop(key) for key in ("velocity", "plan", "basis", "settings", "notes")}
        plan, basis, pitch = _checked_head(words, path)
        shape = tuple(words["velocity"]["shape"])
        plane = VelocityPlane(
            ReducedVelocity(shape, PRECISIONS[words["velocity"]["precision"]], str(path)),
            sampling_rate=plan.sampling_rate, name=str(path),
            **{key: read_coordinate(file, key, shape[:-1], path) for key in "xz"}, **about,
        )  # fmt: skip
        sums = _read_sums(file, path, plan, basis, plane.probes)
    return Moments(plane, sums, words["settings"], pitch, words["notes"])


def _checked_head(words: dict[str, Any], path: Path) -> tuple[PassPlan, Basis | None, float | None]:
    """Plan, basis and pitch of the cells, as the attributes say; ``cell_pitch`` leaves them."""
    said, velocity, settings = words["plan"], words["velocity"], words["settings"]
    with _attribute("plan", path):
        borders = tuple(int(n) for n in said["borders"])
        plan = PassPlan(
            int(said["samples"]), float(said["sampling_rate"]), int(said["begin"]),
            int(said["end"]), Blocks(borders, int(said["periods"])),
            tuple(float(line) for line in said["lines"]),
        )  # fmt: skip
        ends = [0, plan.begin, *borders, plan.samples]
        if not (
            borders
            and ends == sorted(ends)
            and len({*borders}) == len(borders)
            and plan.begin < plan.end <= plan.samples
            and borders[-1] <= plan.end
            and 0 < plan.sampling_rate < float("inf")
            and all(0 < f < float("inf") for f in plan.lines)
        ):
            raise ValueError(f"its samples, {said}, are those of no record")
    with _attribute("velocity", path):
        velocity["shape"] = [int(n) for n in velocity["shape"]]
        if velocity["precision"] not in PRECISIONS or velocity["shape"][-1:] != [plan.samples]:
            raise ValueError(f"{velocity} is no shape of {plan.samples} samples in {[*PRECISIONS]}")
    with _attribute("basis", path):
        basis = basis_of(words["basis"]) if words["basis"] else None
        if basis is not None:
            count, speeds = basis.count, basis.speeds
            if not (
                2 <= count <= MOST_ORDERS
                and bool(torch.isfinite(speeds).all() and (speeds >= 0).all())
            ):
                raise ValueError(f"{words['basis']} are no functions of |v|")
    with _attribute("settings", path):
        pitch = settings.pop("cell_pitch")
        pitch = None if pitch is None else float(pitch)
        if {*settings} != {*SETTINGS}:
            raise ValueError(f"it holds {', '.join(settings)}; {', '.join(SETTINGS)} are needed")
    return plan, basis, pitch


@contextmanager
def _attribute(key: str, path: Path) -> Iterator[None]:
    """What is wrong in an attribute names it."""
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, IndexError) as error:
        text = f"has no {error}" if isinstance(error, KeyError) else error
        raise ValueError(f"{path}: attribute {key!r}: {text}; reduce the data again") from error


def _read_sums(
    file: h5py.File, path: Path, plan: PassPlan, basis: Basis | None, probes: int
) -> PlaneSums:
    sizes = {name: (size,) for name, size in _sizes(plan, probes).items()}
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
    blocks = {
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
            _require_sums(groups[-1], plan, basis, place(file, table[0].names[0], path))
    sums = PlaneSums(
        plan, tones, Survey(**kept, **blocks), cells, used, periodic, basis, tuple(groups)
    )
    _require_whole(sums, probes, path)
    return sums


def _require_sums(group: GroupMoments, plan: PassPlan, basis: Basis, label: str) -> None:
    """The functions T_0, or all levels together, are 1 and sum to the samples; blocks to the whole.

    Raises:
        ValueError: they do not.
    """
    count, own = plan.end - plan.begin, group.totals[0]
    ones = own[0] if isinstance(basis, Chebyshev) else own.sum(0)
    wrong = (ones / count - 1).abs() > LARGEST_ERROR
    if group.of_blocks is not None:
        away = group.of_blocks.to(torch.float64).sum(0) - group.totals
        wrong |= (away.abs() > LARGEST_ERROR * count).any(0).any(0)
    if bool(wrong.any()):
        first = int(wrong.nonzero()[0])
        raise ValueError(
            f"{label} and its blocks are not the sums of {count} samples at {int(wrong.sum())} of "
            f"{len(wrong)} columns, the first {first} with {float(ones[first]):.9g}: the file is "
            "damaged; reduce the data again"
        )


def _require_whole(sums: PlaneSums, probes: int, path: Path) -> None:
    """All parts are there and fit each other.

    Raises:
        ValueError: they do not.
    """
    star, count = sums.periodic is not None, sums.cells.count
    columns, wanted = len(sums.survey.mean), (1 + star) * probes + count
    groups = 0 if sums.basis is None else 2 + star
    labels = sums.cells.labels
    if columns != wanted:
        text = f"mean has {columns} columns; {probes} probes and {count} cells have {wanted}"
    elif len(sums.groups) != groups:
        text = f"there are moments of {len(sums.groups)} groups of columns, and {groups} are needed"
    elif not bool(((labels >= -1) & (labels < count)).all()):
        text = f"cell_of_probe names others than the {count} cells, or -1 for none"
    elif not (bool((sums.tones > 0).all()) and min(sums.survey.segments, default=1) > 0):
        text = "tones and segments are above 0"
    else:
        return
    raise ValueError(f"{path}:/{text}: the file is damaged; reduce the data again")

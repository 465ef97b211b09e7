"""Impedances educed from lines of microphones, one or several eductions in a netCDF-4 file.

Each is a group with a schema of its own, ``eduction_0`` and so on. In it stand the microphones that
were used, a group ``microphones`` as in their own files, and, with draws of their errors, a group
``draws`` with the same variables as the eduction and a leading axis.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import torch

from torchliner.io import microphone_file
from torchliner.io.fields import fill, require_same, take
from torchliner.io.hdf5 import get_group, is_there, open_file, place, text_attribute
from torchliner.io.own_file import OwnFile
from torchliner.io.tables import FileKind, read_attribute, write_attribute, write_variables
from torchliner.records import FieldFit, WallEduction
from torchliner.records.declared import Variable

Educed = WallEduction | FieldFit
COUNT = "eductions"  # attribute of the file
LEVEL = 0.95  # of the interval in the file
STATISTICAL = f"{100 * LEVEL:g} % statistical interval"
INTERVAL = tuple(
    Variable(name, dims=("frequency",), name=f"{{}}_{name}", text=text)
    for name, text in (
        ("low", f"lower bound of its {STATISTICAL}"),
        ("high", f"upper bound of its {STATISTICAL}"),
        ("deviation", "standard deviation, of the draws or to first order"),
    )
)
SHARED = ("method", "x", "source_side", "choices", "notes", "line")  # by an eduction and its draws


class EductionFile(OwnFile):
    """A group of the file: an eduction, its interval, its microphones and its draws."""

    def fill(self, group: h5py.Group, record: Any) -> None:
        """Into the group."""
        self.write_head(group, record)
        microphone_file.FILE.fill(group.create_group("microphones"), record.source_line)
        fill(group, record, axes={"draws": ()}, unsaid=("x", "line", "draws"))
        write_variables(group, _interval(record), INTERVAL)
        if record.draws is not None:
            fill(group.create_group("draws"), record.draws, axes={"draws": ("draw",)}, unsaid=(*SHARED, "draws"))

    def taken(self, group: h5py.Group, path: str | Path, **known: Any) -> Educed:
        """From the group.

        Raises:
            ValueError: as ``OwnFile.read``; frequencies are not those of the microphones.
        """
        self.require(group, path)
        name = str(read_attribute(group, "choices", path, {}).get("source", "microphones"))
        line = microphone_file.FILE.taken(get_group(group, "microphones", path), path, name=name)
        sizes = {"frequency": tuple(line.frequency.shape), "microphone": tuple(line.x.shape), "part": (2,)}
        sizes |= {"with_part": (2,)}
        about = {"line": line, "x": line.x, "draws": None}
        found: Educed = take(group, self.record, path, {**sizes, "draws": ()}, about)
        if not torch.equal(found.frequency, line.frequency):
            own, others = (each.frequency.tolist() for each in (found, line))
            raise ValueError(
                f"{place(group, 'frequency', path)} is {own} Hz, but its microphones' {others} Hz; restore the file"
            )
        if is_there(group, "draws", path):
            shared = {key: getattr(found, key) for key in SHARED} | {"draws": None}
            found = replace(found, draws=take(get_group(group, "draws", path), self.record, path, sizes, shared))
        require_same(group, _interval(found), INTERVAL, path)
        return found


def _interval(found: Educed) -> SimpleNamespace:
    """Of draws, or of a covariance to first order; nothing without either."""
    if found.draws is None and found.covariance is None:
        return SimpleNamespace(low=None, high=None, deviation=None)
    low, high = found.interval(LEVEL)
    spread = found.standard_error if found.draws is None else found.standard_deviation
    return SimpleNamespace(low=low, high=high, deviation=spread)


class WallFile(FileKind):
    """All eductions of a file."""

    def write(self, found: Educed, path: str | Path, *others: Educed) -> None:
        """Eductions, as ``write`` of the first with the others."""
        for one in (found, *others):
            _ = one.source_line  # refused before an old file is replaced
        with self.created(path, None) as file:
            write_attribute(file, COUNT, 1 + len(others))
            for i, one in enumerate((found, *others)):
                KINDS[type(one)].fill(file.create_group(f"eduction_{i}"), one)

    def read(self, path: str | Path) -> tuple[Educed, ...]:
        """Read the eductions that ``WallEduction.write`` or ``torchliner kt -o`` wrote, in order.

        Args:
            path: .h5, .hdf5 or .nc.
        Raises:
            FileNotFoundError, OSError: missing, truncated, not HDF5.
            ValueError: not of this schema; a group or a dataset is missing, or has a wrong shape or
                unit. The message names FILE:/group/dataset.
        """
        path = Path(path)
        with open_file(path) as file:
            self.require(file, path)
            count = read_attribute(file, COUNT, path, None)
            if not isinstance(count, int) or count < 1:
                raise ValueError(f"{path} holds {count} eductions by its own words; at least one is needed")
            groups = [get_group(file, f"eduction_{i}", path) for i in range(count)]
            schemas = {kind.schema: kind for kind in KINDS.values()}
            return tuple(
                schemas.get(text_attribute(each, "schema") or "", KINDS[WallEduction]).taken(each, path)
                for each in groups
            )


KINDS: dict[type, EductionFile] = {
    WallEduction: EductionFile("torchliner waves 1", "eduction by waves", record=WallEduction),
    FieldFit: EductionFile("torchliner field fit 1", "fit of the field", record=FieldFit),
}
FILE = WallFile("torchliner wall 1", "set of impedances educed from microphones")
read_wall, write_wall = FILE.read, FILE.write

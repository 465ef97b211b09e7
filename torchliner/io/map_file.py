"""Impedance maps as netCDF-4 and as CSV. Complex values are stored as two real variables.

Cells and the whole liner have a dimension ``averaging``. Probes are known in two averagings alone, so that these have
names of their own: ``resistance`` as measured, ``phase_locked_resistance``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import torch
from torch import Tensor

from torchliner.io.axes import read_coordinate, write_coordinates
from torchliner.io.csv_rows import Rows, parts_of, rows_of
from torchliner.io.hdf5 import (
    get_group,
    is_there,
    open_file,
    read_references,
    read_texts,
    write_index,
    write_references,
)
from torchliner.io.holes import stored_holes, write_holes
from torchliner.io.point_file import read_alongside, write_alongside
from torchliner.io.result_file import (
    interval_table,
    read_interval,
    read_level_check,
    result_kind,
    words_of_interval,
    write_averagings,
    write_level_check,
)
from torchliner.io.result_writers import ResultFile
from torchliner.io.tables import (
    Sizes,
    Table,
    cartesian,
    described,
    impedance,
    numbers,
    read_variables,
    real,
    write_variables,
)
from torchliner.names import AVERAGINGS
from torchliner.records import ImpedanceMap, Interval
from torchliner.records.averaged import Educed

KIND = result_kind("torchliner map 1", "impedance map", averaging="")
AMPLITUDES, INTERVALS, LEVEL_CHECK = "amplitudes", "intervals", "level_check"  # groups
# "probes" stands for the dimensions of the probes: (z, x), (probe,) or none; "along" for the last of them.
FULL, LINER = ("probes", "frequency"), ("frequency",)
TEXTS = {
    "frequency": "frequency of the tone",
    "cell_x": "streamwise coordinate of the centre of a cell",
    "cell_z": "spanwise coordinate of the centre of a cell",
    "answer": "normalised {part} of the whole liner in the averaging that was chosen",
    "liner_spread": "standard deviation of {part} over the probes: spread over positions, no uncertainty",
    "goodrich": "normalised {part} of the liner without sound under the flow, by Goodrich",
    "velocity_amplitude": "{part} part of the peak amplitude of the velocity into the liner",
    "coherence": "squared coherence of the velocity with the tone",
    "inferred_incident_level": "level of the incident wave that gives the coherent velocity, re 20 uPa rms",
    "phase_rule": "1 where the phase rule was used, 0 where it fell back to averaged",
    "wall": "1 where a probe counts as wall in averages over probes",
    "cell_weight": "share of its probes that a cell has",
    "mean_velocity": "time mean of the velocity away from the liner",
    "velocity_rms": "rms of the velocity about its mean",
    "height": "distance of the plane from the liner",
    "mach": "bulk Mach number",
    "incident_level": "stated level of the incident wave, re 20 uPa rms",
}
FREQUENCY = described((real("frequency", "Hz", LINER),), TEXTS)
CELLS = described((real("cell_x", "m", ("cell",)), real("cell_z", "m", ("cell",))), TEXTS)
FIELDS = described(
    (
        impedance("answer", "answer_", LINER, derived=True),
        impedance("liner_spread", "liner_spread_", LINER, derived=True),
        impedance("goodrich", "goodrich_", LINER, optional=True),
        real("coherence", "1", FULL),
        real("inferred_incident_level", "dB", FULL, derived=True),
        real("phase_rule_used", "1", FULL, field="phase_rule", flag=True),
        real("wall", "1", FULL, flag=True, optional=True),
        real("cell_weight", "1", ("cell",), optional=True),
        real("mean_velocity", "m/s", ("probes",)),
        real("velocity_rms", "m/s", ("probes",)),
        *numbers({"height": "m", "mach": "1", "incident_level": "dB"}),
    ),
    TEXTS,
)
VELOCITY = described((cartesian("velocity_amplitude", "velocity_amplitude", FULL, unit="m/s"),), TEXTS)


@dataclass(frozen=True)
class Place:
    """Where a map has Z, and how that stands in the file.

    Args:
        field: of the map.
        averaging: of it; None: all, along a dimension.
        stem: of the names of the variables.
        dims: dimensions.
        words: what it is.
    """

    field: str
    averaging: str | None
    stem: str
    dims: tuple[str, ...]
    words: str

    @property
    def impedances(self) -> Table:
        """What one looks at first; follows from R."""
        about = {"long_name": f"normalised {{part}} {self.words}"}
        absorbed = {"long_name": f"absorption coefficient {self.words}"}
        return (
            impedance("impedance", self.stem, self.dims, derived=True, attributes=about),
            real(f"{self.stem}absorption", "1", self.dims, field="absorption", derived=True, attributes=absorbed),
        )

    @property
    def reflections(self) -> Table:
        """What is read again."""
        about = {"long_name": f"{{part}} part of the reflection coefficient {self.words}"}
        return (cartesian("reflection", f"{self.stem}reflection", self.dims, attributes=about),)

    @property
    def intervals(self) -> Table:
        """Of the impedance."""
        return interval_table(self.stem, self.dims)

    def of(self, result: ImpedanceMap) -> Educed | None:
        """What the map has there."""
        known: Mapping[str, Educed] = getattr(result, self.field)
        if self.averaging is not None:
            return known.get(self.averaging)
        return _stacked([known[name] for name in result.averagings])


def _places(averagings: Sequence[str]) -> Iterator[Place]:
    yield Place("liner", None, "liner_", ("averaging", "frequency"), "of the whole liner")
    yield Place("cells", None, "cell_", ("averaging", "cell", "frequency"), "of each cell")
    for name in averagings:
        stem, text = ("", "") if name == "admittance" else (f"{name.replace('-', '_')}_", f", averaging {name}")
        yield Place("probes", name, stem, FULL, f"at each probe{text}")
        yield Place("along_x", name, f"{stem}along_x_", ("along", "frequency"), f"averaged over z{text}")


def _stacked(parts: Sequence[Educed]) -> Educed:
    intervals = [each.interval for each in parts if each.interval is not None]
    if len(intervals) not in (0, len(parts)):
        raise ValueError(
            f"{len(intervals)} of {len(parts)} averagings have intervals; all or none are needed in a file"
        )
    bounds = [torch.stack(each) for each in zip(*(vars(one).values() for one in intervals), strict=True)]
    return Educed(torch.stack([each.reflection for each in parts]), Interval(*bounds) if intervals else None)


def write_map(result: ImpedanceMap, path: str | Path) -> None:
    """Write a map by the ending of ``path``, as ``ImpedanceMap.write``."""
    FILE.write(result, path)


def _fill(file: h5py.File, result: ImpedanceMap) -> None:
    """What one looks at first in the file itself, the rest in groups with the same coordinates."""
    shape = tuple(result.mean_velocity.shape)

    def within(name: str) -> tuple[h5py.Group, dict[str, tuple[str, ...]]]:
        group = file.create_group(name) if name else file
        write_variables(group, result, FREQUENCY)
        dims = write_coordinates(group, shape, result.x, result.z, line=False)
        write_index(group, "cell", len(result.cell_x))
        write_variables(group, result, CELLS)
        return group, {"probes": dims, "along": dims[-1:]}

    found = [(place, educed) for place in _places(result.averagings) if (educed := place.of(result)) is not None]
    group, axes = within("")
    write_averagings(group, result.averagings)
    for place, educed in found:
        write_variables(group, educed, place.impedances, axes)
    write_variables(group, result, FIELDS, axes)
    write_references(file, result.reference)
    write_holes(file, result.holes)
    group, axes = within(AMPLITUDES)
    write_averagings(group, result.averagings)
    for place, educed in found:
        write_variables(group, educed, place.reflections, axes)
    write_variables(group, result, VELOCITY, axes)
    known = [(place, educed.interval) for place, educed in found if educed.interval is not None]
    if known:
        group, axes = within(INTERVALS)
        write_averagings(group, result.averagings)
        words = words_of_interval(float(result.choices["interval"]))
        for place, interval in known:
            write_variables(group, interval, place.intervals, axes, words)
    if result.level_check is not None:
        write_level_check(within(LEVEL_CHECK)[0], result.level_check)
    write_alongside(file, result.alongside)


def read_map(path: str | Path) -> ImpedanceMap:
    """Read a map written by ``ImpedanceMap.write`` as netCDF-4.

    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: not a map of this schema; the message names FILE:/variable.
    """
    path = Path(path)
    with open_file(path) as file:
        KIND.require(file, path)
        if not is_there(file, AMPLITUDES, path):
            raise ValueError(
                f"{path} lacks the group {AMPLITUDES!r} of a map, as what xarray writes of one does; read the file "
                "that ImpedanceMap.write or educe --output wrote"
            )
        head, averagings = KIND.read_head(file, path), read_texts(file, "averaging", path)
        if not ({head["averaging"]} <= {*averagings} <= {*AVERAGINGS} and len(averagings) == len({*averagings})):
            raise ValueError(f"{path}:/averaging holds {averagings}, of which {head['averaging']!r} was chosen; "
                             f"{', '.join(AVERAGINGS)} are known")  # fmt: skip
        sizes: Sizes = {"averaging": (len(averagings),)}
        fields = read_variables(file, FREQUENCY + CELLS + FIELDS, path, sizes=sizes)
        shape = tuple(fields["mean_velocity"].shape)
        sizes["along"] = shape[-1:]
        amplitudes = get_group(file, AMPLITUDES, path)
        fields |= read_variables(amplitudes, VELOCITY, path, sizes=sizes)
        fields |= _read_educed(file, amplitudes, averagings, path, sizes)
        for key in ("x", "z"):
            values = read_coordinate(file, key, shape, path)
            fields[key] = None if values is None else torch.from_numpy(values)
        check = None
        if is_there(file, LEVEL_CHECK, path):
            check = read_level_check(get_group(file, LEVEL_CHECK, path), path, sizes)
        return ImpedanceMap(
            **fields,
            **head,
            reference=read_references(file, path),
            alongside=read_alongside(file, path),
            level_check=check,
            holes=stored_holes(file, path),
        )


def _read_educed(
    file: h5py.File, amplitudes: h5py.Group, averagings: Sequence[str], path: Path, sizes: Sizes
) -> dict[str, dict[str, Educed]]:
    """Fields of a map by averaging."""
    intervals = get_group(file, INTERVALS, path) if is_there(file, INTERVALS, path) else None
    found: dict[str, dict[str, Educed]] = {"liner": {}, "cells": {}, "probes": {}, "along_x": {}}
    for place in _places(averagings):
        optional = place.field == "along_x" or place.averaging == "velocity"
        if optional and not is_there(amplitudes, place.reflections[0].names[0], path):
            continue
        reflection = read_variables(amplitudes, place.reflections, path, sizes=sizes)["reflection"]
        bounds = None if intervals is None else read_interval(intervals, place.intervals, path, sizes)
        educed = Educed(reflection, bounds)
        if place.averaging is not None:
            found[place.field][place.averaging] = educed
            continue
        for i, name in enumerate(averagings):
            found[place.field][name] = educed.map(lambda value, i=i: value[i])  # type: ignore[misc]
    return found


def _rows(result: ImpedanceMap) -> Rows:
    """One row a probe and frequency, as measured."""
    shape, probes = tuple(result.mean_velocity.shape), result.mean_velocity.numel()
    measured = result.probes["admittance"]
    x, z = result.x, result.z
    if len(shape) == 2:
        x = None if x is None else x.repeat(shape[0])
        z = None if z is None else z.repeat_interleave(shape[1])

    def flat(values: Tensor) -> Tensor:
        return values.reshape(probes, -1)

    columns: dict[str, Any] = {
        "x (m)": torch.nan if x is None else flat(x),
        "z (m)": torch.nan if z is None else flat(z),
        "frequency (Hz)": result.frequency,
        **parts_of(flat(measured.impedance), "resistance (rho c)", "reactance (rho c)"),
        **parts_of(flat(measured.admittance), "conductance (1/rho c)", "susceptance (1/rho c)"),
        "absorption": flat(measured.absorption),
        "coherence": flat(result.coherence),
        "inferred incident level (dB)": flat(result.inferred_incident_level),
    }
    if measured.interval is not None:
        for name in ("low", "high", "standard error"):
            bound = flat(getattr(measured.interval, name.replace(" ", "_")))
            columns |= parts_of(bound, f"resistance {name} (rho c)", f"reactance {name} (rho c)")
    columns |= {"mean velocity (m/s)": flat(result.mean_velocity), "velocity rms (m/s)": flat(result.velocity_rms)}
    return rows_of(columns, (probes, len(result.frequency)))


def _cell_rows(result: ImpedanceMap) -> Rows:
    """One row a cell and frequency, in all averagings."""
    columns: dict[str, Any] = {
        "x (m)": result.cell_x[:, None],
        "z (m)": result.cell_z[:, None],
        "frequency (Hz)": result.frequency,
    }
    for name, educed in result.cells.items():
        columns |= parts_of(educed.impedance, f"resistance, {name}", f"reactance, {name}")
        if educed.interval is not None:
            for end in ("low", "high"):
                bound = getattr(educed.interval, end)
                columns |= parts_of(bound, f"resistance, {name}, {end}", f"reactance, {name}, {end}")
    return rows_of(columns, (len(result.cell_x), len(result.frequency)))


FILE = ResultFile(KIND, _fill, {"probes": _rows, "cells": _cell_rows}, {"number": ".9g"})

"""Impedances educed from lines of microphones, one or several eductions in a netCDF-4 file.

Each is a group with a schema of its own, ``eduction_0`` and so on. In it stand the microphones that
were used, a group ``microphones`` as in their own files, and, with draws of their errors, a group
``draws`` with the same variables as the eduction and a leading axis.
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import torch

from torchliner.io.hdf5 import get_group, is_there, open_file, place, read_attribute, write_index
from torchliner.io.microphone_file import FREQUENCY, fill_microphones, microphones_of
from torchliner.io.tables import (
    FileKind,
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
from torchliner.records import FieldFit, MicrophoneLine, WallEduction

Educed = WallEduction | FieldFit
KIND = FileKind("torchliner wall 1", "set of impedances educed from microphones", {})
HEAD: dict[str, Any] = {"method": "", "source_side": "unknown", "choices": {}, "notes": ()}
COUNT = "eductions"  # attribute of the file
LEVEL = 0.95  # of the interval in the file
EACH, PARTS = ("draws", "frequency"), ("part", "with_part")
TEXTS = {
    "wavenumber": "{part} part of the wavenumber whose impedance is given, exp(-j alpha x)",
    "impedance": "normalised {part}, exp(+j omega t), velocity into the liner",
    "modes": "{part} part of the wavenumber of each wave",
    "amplitudes": "{part} part of the peak amplitude of each wave at the origin",
    "origin": "x of the microphone nearest the source",
    "residual": "rms of what is left over that of the pressures",
    "energy_share": "energy of the wave whose impedance is given over that of the strongest",
    "singular_values": "singular values of the prediction matrix",
    "covariance": "covariance of resistance (0) and reactance (1)",
    "misfit": "squared residual over that which the assumed errors leave",
    "rank": "waves that were kept",
    "order": "order of the prediction",
    "freedom": "real degrees of freedom of the residuals",
    "rise": "{part} at the liner's downstream edge less that at the upstream one",
    "rise_error": "standard error of the {part} of the rise",
    "amplitude": "{part} part of the peak amplitude of the source's wave",
    "end_reflection": "{part} part of the reflection of the far end",
    "pressure": "{part} part of the fitted pressure at the microphones, peak",
    "along": "places of the fitted pressure",
    "pressure_along": "{part} part of the fitted pressure along the microphones, peak",
    "converged": "1 where the fit settled",
    "low": f"lower bound of the {{part}}'s {100 * LEVEL:g} % statistical interval",
    "high": f"upper bound of the {{part}}'s {100 * LEVEL:g} % statistical interval",
    "deviation": "standard deviation of the {part}, of the draws or to first order",
}
COUNTS = numbers({"rank": "1", "order": "1", "freedom": "1"})
TABLE = described(
    (  # of which a record has its own
        cartesian("wavenumber", "wavenumber", EACH, unit="1/m"),
        impedance("impedance", "", EACH),
        cartesian("modes", "mode_wavenumber", ("draws", "wave", "frequency"), unit="1/m"),
        cartesian("amplitudes", "mode_amplitude", ("draws", "wave", "frequency"), unit="Pa"),
        real("origin", "m", ()),
        real("covariance", "1", (*EACH, *PARTS), optional=True),
        impedance("rise", "rise_of_", EACH),
        impedance("rise_error", "rise_of_{}_error", EACH),
        cartesian("amplitude", "amplitude", EACH, unit="Pa"),
        cartesian("end_reflection", "end_reflection", EACH),
        cartesian("pressure", "fitted_pressure", ("draws", "microphone", "frequency"), unit="Pa"),
        real("along", "m", ("place",)),
        cartesian("pressure_along", "fitted_pressure_along", ("draws", "place", "frequency"), unit="Pa"),
        real("residual", "1", EACH),
        real("misfit", "1", EACH, optional=True),
        real("energy_share", "1", EACH, derived=True),
        real("singular_values", "Pa", ("draws", "singular_value", "frequency"), optional=True),
        real("converged", "1", EACH, flag=True),
        *COUNTS,
    ),
    TEXTS,
)
INTERVAL = described(
    [impedance(name, f"{{}}_{name}", ("frequency",)) for name in ("low", "high", "deviation")],
    TEXTS,
)


UNBOUNDED = ("covariance", "rise_error")  # may be infinite; nan may stand anywhere, where nothing was found
KINDS: dict[type[Educed], FileKind] = {
    WallEduction: FileKind("torchliner waves 1", "eduction by waves", HEAD),
    FieldFit: FileKind("torchliner field fit 1", "fit of the field", HEAD),
}


def _table_of(record: type[Educed]) -> Table:
    """Those variables that a record has."""
    return [row for row in TABLE if hasattr(record, row.field) or row.field in record.__dataclass_fields__]


def write_wall(found: WallEduction | FieldFit, path: str | Path, *others: Educed) -> None:
    """Write eductions, as ``write`` of the first with the others."""
    lines = [one.source_line for one in (found, *others)]  # before an old file is replaced
    with KIND.created(path, None) as file:
        file.attrs[COUNT] = len(lines)
        for i, (one, line) in enumerate(zip((found, *others), lines, strict=True)):
            group = file.create_group(f"eduction_{i}")
            KINDS[type(one)].write_head(group, one)
            fill_microphones(group.create_group("microphones"), line)
            _fill(group, one)
            if one.draws is not None or one.covariance is not None:
                low, high = one.interval(LEVEL)
                spread = one.standard_error if one.draws is None else one.standard_deviation
                write_variables(group, SimpleNamespace(low=low, high=high, deviation=spread), INTERVAL)
            if one.draws is not None:
                _fill(group.create_group("draws"), one.draws)


def _fill(group: h5py.Group, found: Any) -> None:
    """Dimensions and variables of an eduction, or of its draws with a leading axis."""
    table = _table_of(type(found))
    write_variables(group, found, FREQUENCY)
    lead = ["draw"] * (found.impedance.ndim - 1)
    for dim in lead:
        write_index(group, dim, len(found.impedance))
    for row in table:
        value = getattr(found, row.field)
        own = [dim for dim in row.dims if dim != "draws"]
        for dim, count in zip(own, () if value is None or not own else value.shape[-len(own) :], strict=False):
            if dim not in group:
                write_index(group, dim, count)
    write_variables(group, found, table, {"draws": lead})


def read_wall(path: str | Path) -> tuple[WallEduction | FieldFit, ...]:
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
        KIND.require(file, path)
        count = read_attribute(file, COUNT, path)
        if count < 1 or count != int(count):
            raise ValueError(f"{path} holds {count:g} eductions by its own words; at least one is needed")
        return tuple(_read(get_group(file, f"eduction_{i}", path), path) for i in range(int(count)))


def _read(group: h5py.Group, path: Path) -> Educed:
    """One eduction with its line and its draws."""
    schema = group.attrs.get("schema")
    record = next((r for r, kind in KINDS.items() if kind.schema == schema), WallEduction)
    KINDS[record].require(group, path)
    head = KINDS[record].read_head(group, path)
    name = str(head["choices"].get("source", "microphones"))
    line = microphones_of(get_group(group, "microphones", path), path, name=name)
    about = {**head, "line": line, "x": line.x}
    draws: Any = None
    if is_there(group, "draws", path):
        draws = record(**about, **_fields(get_group(group, "draws", path), line, record, path, {}))
    return record(**about, **_fields(group, line, record, path, {"draws": ()}), draws=draws)


def _fields(group: h5py.Group, line: MicrophoneLine, record: type[Educed], path: Path, sizes: Sizes) -> dict[str, Any]:
    """Variables of a table, at the frequencies and microphones of the line.

    Raises:
        ValueError: as ``read_variables``; an infinite value where none can be.
    """
    sizes |= {"frequency": tuple(line.frequency.shape), "microphone": tuple(line.x.shape)}
    sizes |= dict.fromkeys(PARTS, (2,))
    table = _table_of(record)
    whole = read_variables(group, [row for row in COUNTS if row.field in record.__dataclass_fields__], path)
    if "order" in whole:
        sizes["singular_value"] = (int(whole["order"]),)
    found = read_variables(group, (*FREQUENCY, *table), path, sizes=sizes)
    if not torch.equal(found["frequency"], line.frequency):
        own, others = (each.tolist() for each in (found["frequency"], line.frequency))
        raise ValueError(
            f"{place(group, 'frequency', path)} is {own} Hz, but its microphones' {others} Hz; restore the file"
        )
    for row in table:
        value = torch.as_tensor(found.get(row.field, 0.0))
        if row.field not in UNBOUNDED and bool(torch.isinf(value).any()):
            raise ValueError(f"{place(group, row.names[0], path)} or its other part is infinite; restore the file")
    return {"covariance": None} | found | {key: int(value) for key, value in whole.items()}

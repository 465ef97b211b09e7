"""Planes from netCDF-3, read where it lies; zarr stores; datasets of xarray, in memory or opened lazily."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import netcdf_file

from torchliner.file_checks import DAMAGE, require_regular
from torchliner.io.hdf5 import hold_open, open_file
from torchliner.io.plane_format import HDF5_SIGNATURE, PlaneFormat, PlaneRequest
from torchliner.io.points import require_velocity
from torchliner.io.stored_values import PLAIN, Packing
from torchliner.io.to_plane import FORMAT as HDF5
from torchliner.io.to_plane import to_plane
from torchliner.io.variables import Field, Fields, Source, fields_of_hdf5
from torchliner.records import VelocityPlane

# What netCDF-3's library writes into records that nobody writes, unless told otherwise; bytes it leaves.
FILLS = {"i2": -32767, "i4": -2147483647, "f4": 9.969209968386869e36, "f8": 9.969209968386869e36}
ZARR = ("zarr.json", ".zgroup", ".zmetadata")  # in the folder of a store, of version 3 or 2
# As it is stored, and read when it is asked for.
RAW: dict[str, Any] = dict.fromkeys(
    ("decode_times", "decode_timedelta", "decode_coords", "mask_and_scale", "consolidated"), False
)


# netCDF-3


def open_classic(path: Path) -> Any:
    """A netCDF-3 file, mapped; an OSError where it ends before its values do."""
    try:
        with path.open("rb") as raw:  # the map stays
            file: Any = netcdf_file(raw, "r", mmap=True)
    except (ValueError, TypeError, *DAMAGE) as error:
        raise OSError(
            f"{path} is truncated, or its header is damaged: what that names goes beyond the end of the file"
        ) from error
    file._mm_buf = None  # the arrays hold the map, of which closing would warn
    return file


def _classic_arrays(path: Path) -> dict[str, np.ndarray]:
    return {name: each.data for name, each in open_classic(path).variables.items()}


def classic_source(path: Path) -> Source:
    """Variables and attributes of a netCDF-3 file; values that nobody wrote are marked as missing."""
    file, fields = open_classic(path), {}
    for name, each in file.variables.items():
        attrs: dict[str, Any] = dict(each._attributes)
        kind = each.data.dtype.str[1:]
        if kind in FILLS and "_Unsigned" not in attrs:  # of which it lies in the middle
            attrs.setdefault("_FillValue", each.data.dtype.type(FILLS[kind]))
        fields[f"/{name}"] = Field(each.data, path, f"/{name}", attrs, tuple(f"/{dim}" for dim in each.dimensions))
    return Source(path, fields, file._attributes, partial(_classic_arrays, path))


@contextmanager
def netcdf_source(path: Path) -> Iterator[Source]:
    """What a netCDF file of any version holds, while it is open."""
    with path.open("rb") as file:
        classic = file.read(8) != HDF5_SIGNATURE
    if classic:
        yield classic_source(path)
        return
    with open_file(path) as hdf:
        yield Source(path, fields_of_hdf5(hdf, path), hdf.attrs, partial(hold_open, path))


# Datasets of xarray


def from_xarray(data: Any, **stated: Any) -> VelocityPlane:
    """A plane from a DataArray or Dataset; what is lazy there is read by slabs.

    Args:
        data: with dimensions, coordinates and units as CF has them, docs/formats.md.
        stated: what they do not say, fields of ``PlaneRequest``; and fields of ``VelocityPlane``,
            SI, which outweigh those of ``data``.
    Raises:
        TypeError: neither a DataArray nor a Dataset.
        ValueError: as ``to_plane``.
    """
    request = PlaneRequest(**{key: stated.pop(key) for key in (*HDF5.takes, "wall_normal_component") if key in stated})
    if not hasattr(data, "data_vars") and hasattr(data, "dims") and hasattr(data, "coords"):
        name = str(data.name or "velocity")
        data, request = data.rename(name).to_dataset(), replace(request, variable=name)
    if not hasattr(data, "data_vars"):
        raise TypeError(
            f"a DataArray or Dataset of xarray is needed, not {type(data).__name__}; of a table of pandas: "
            "table.set_index(['time', 'x']).to_xarray()"
        )
    path = Path(data.encoding.get("source") or "xarray")
    plane = to_plane(Source(path, _fields(data, path), data.attrs, partial(getattr, data, "variables")), request)
    require_velocity(plane.name, request)
    plane = replace(plane, **stated) if stated else plane
    lazy = data.chunks or any("source" in each.encoding for each in data.variables.values())
    return plane if lazy else plane.load()


def _fields(data: Any, path: Path) -> Fields:
    """All variables of a Dataset by name, dates as ns since 1970."""
    found = {}
    for name, each in data.variables.items():
        attrs = {key: value for key, value in each.attrs.items() if value is not None}
        if each.dtype.kind in "mM":
            attrs["units"] = "ns" if each.dtype.kind == "m" else "ns since 1970-01-01"
            each = each.astype(f"{each.dtype.kind}8[ns]").astype("i8")
        found[f"/{name}"] = Field(each, path, f"/{name}", attrs, tuple(f"/{dim}" for dim in each.dims))
    return found


# Stores of zarr


def open_store(path: Path, group: str | None) -> Any:
    """The dataset of a zarr store, as it is stored; an OSError where a part of it is a pipe or a device."""
    try:
        import xarray
        import zarr  # noqa: F401
    except ImportError as error:
        raise ImportError(f'{path} is a zarr store: pip install "torchliner[zarr]"') from error
    for each in path.rglob("*"):
        if not each.is_dir():
            require_regular(each)
    data = xarray.open_dataset(path, engine="zarr", group=group, chunks=None, **RAW)
    if not (path / ZARR[0]).is_file():
        # Version 2 fills with 0 where nobody says otherwise, which marks nothing unless it is packed.
        for variable in data.variables.values():
            if variable.attrs.get("_FillValue") == 0 and not {"scale_factor", "add_offset"} & set(variable.attrs):
                del variable.attrs["_FillValue"]
    return data


def _stored_variables(path: Path, group: str | None) -> Any:
    return open_store(path, group).variables


def require_written(path: Path, group: str | None, name: str, packing: Packing = PLAIN) -> None:
    """Refuse an array of a store whose chunks are not all there, and would read as numbers: not as marks of what is
    missing, by its packing."""
    import zarr

    folder = path / (group or "").strip("/") / name
    array = zarr.open_array(folder, mode="r")
    fill = 0 if array.fill_value is None else array.fill_value
    if array.size < 2 or np.isnan(packing.unpack(np.full(1, fill), np.float64)).all():
        return  # one single value may be the fill value, which zarr leaves out
    # ``nchunks_initialized`` takes the square of their number.
    there = sum(each.is_file() and not each.name.startswith((".z", "zarr.json")) for each in folder.rglob("*"))
    wanted = math.prod(-(-n // c) for n, c in zip(array.shape, array.shards or array.chunks, strict=True))
    if there < wanted:
        raise ValueError(
            f"{path}:/{name}: {wanted - there} of {wanted} chunks were never written and would read as {fill}: cut the "
            f"record or write the rest; zarr leaves out chunks of {fill} unless written with write_empty_chunks=True"
        )


def open_zarr(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a zarr store; as ``open_store``, ``to_plane`` and ``require_written``."""
    group = request.group
    data = open_store(path, group)
    for name in set(data.dims) & set(data.variables):
        require_written(path, group, str(name))
    source = Source(path, _fields(data, path), data.attrs, partial(_stored_variables, path, group))
    plane = to_plane(source, replace(request, group=None))
    require_written(path, group, plane.velocity.key, plane.velocity.packing)
    return plane


NETCDF3 = PlaneFormat(
    "netCDF-3",
    lambda _, head: head[:4] in (b"CDF\1", b"CDF\2"),  # the version, 2 with large offsets
    lambda path, request: to_plane(classic_source(path), request),
    tuple(each for each in HDF5.takes if each != "group"),
)
STORE = PlaneFormat(
    "zarr", lambda path, head: not head and any((path / name).is_file() for name in ZARR), open_zarr, HDF5.takes
)

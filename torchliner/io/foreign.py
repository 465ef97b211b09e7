"""Planes from HDF5, netCDF, datasets of xarray, zarr, which xarray opens, and arrays of .npy and MATLAB.

All are read by slabs where they lie, as they are stored. MATLAB files may hold X_unique, Y_unique, Z_unique, the
coordinates of the axes x, y and z.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import loadmat, netcdf_file

from torchliner.file_checks import DAMAGE, naming, require_memory, require_regular
from torchliner.io.hdf5 import PLAIN, Packing, hold_open, open_file
from torchliner.io.plane_format import HDF5_SIGNATURE, PlaneFormat, PlaneRequest
from torchliner.io.points import require_velocity
from torchliner.io.to_plane import to_plane
from torchliner.io.variables import Field, Source, hdf5_source
from torchliner.names import ARRAY_ENDINGS, did_you_mean
from torchliner.records import VelocityPlane

# What netCDF-3's library writes into records that nobody writes, unless told otherwise; bytes it leaves.
FILLS = {"i2": -32767, "i4": -2147483647, "f4": 9.969209968386869e36, "f8": 9.969209968386869e36}
ZARR = ("zarr.json", ".zgroup", ".zmetadata")  # in the folder of a store, of version 3 or 2
MATLAB = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")
Arrays = Callable[[Path], Mapping[str, np.ndarray]]


# HDF5 and netCDF-4


def open_hdf5(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a file of our schema, or of another netCDF-4 or HDF5 file; as ``to_plane``."""
    with open_file(path) as file:
        return to_plane(hdf5_source(file, path), request)


HDF5 = PlaneFormat(
    "HDF5 or netCDF-4",
    lambda _, head: head.startswith(HDF5_SIGNATURE),
    open_hdf5,
    ("variable", "group", "axes", "velocity_units", "length_units", "sampling_rate", "normal", "row"),
)
WITHOUT_GROUP = tuple(each for each in HDF5.takes if each != "group")


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
    plane = to_plane(source_of(data, Path(data.encoding.get("source") or "xarray")), request)
    require_velocity(plane.name, request)
    plane = replace(plane, **stated) if stated else plane
    lazy = data.chunks or any("source" in each.encoding for each in data.variables.values())
    return plane if lazy else plane.load()


def source_of(data: Any, path: Path) -> Source:
    """What a Dataset holds; dates as ns since 1970."""
    fields = {}
    for name, each in data.variables.items():
        attrs = {key: value for key, value in each.attrs.items() if value is not None}
        if each.dtype.kind in "mM":
            attrs["units"] = "ns" if each.dtype.kind == "m" else "ns since 1970-01-01"
            each = each.astype(f"{each.dtype.kind}8[ns]").astype("i8")
        fields[f"/{name}"] = Field(each, path, f"/{name}", attrs, tuple(f"/{dim}" for dim in each.dims))
    return Source(path, fields, data.attrs, partial(getattr, data, "variables"))


def open_classic(path: Path) -> Any:
    """A netCDF-3 file, mapped; an OSError where it ends before its values do."""
    try:
        with path.open("rb") as raw:  # the map stays
            file: Any = netcdf_file(raw, "r", mmap=True)
    except (ValueError, TypeError, *DAMAGE) as error:
        raise OSError(f"{path} is truncated, or its header is damaged: it names what is beyond the end") from error
    file._mm_buf = None  # the arrays hold the map, of which closing would warn
    return file


def classic_arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a netCDF-3 file, read as they are used."""
    return {name: each.data for name, each in open_classic(path).variables.items()}


def classic_source(path: Path) -> Source:
    """What a netCDF-3 file holds, values that nobody wrote marked as missing."""
    file, fields = open_classic(path), {}
    for name, each in file.variables.items():
        attrs, kind = dict(each._attributes), each.data.dtype.str[1:]
        if kind in FILLS and "_Unsigned" not in attrs:  # of which it lies in the middle
            attrs.setdefault("_FillValue", each.data.dtype.type(FILLS[kind]))
        fields[f"/{name}"] = Field(each.data, path, f"/{name}", attrs, tuple(f"/{dim}" for dim in each.dimensions))
    return Source(path, fields, file._attributes, partial(classic_arrays, path))


@contextmanager
def netcdf_source(path: Path) -> Iterator[Source]:
    """What a netCDF file of any version holds, while it is open."""
    if h5py.is_hdf5(path):
        with open_file(path) as file:
            yield hdf5_source(file, path)
    else:
        yield classic_source(path)


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
    data = xarray.open_dataset(path, engine="zarr", group=group, chunks=None, decode_cf=False, consolidated=False)
    if not (path / ZARR[0]).is_file():
        # Version 2 fills with 0 where nobody says otherwise, which marks nothing unless it is packed.
        for variable in data.variables.values():
            if variable.attrs.get("_FillValue") == 0 and not {"scale_factor", "add_offset"} & set(variable.attrs):
                del variable.attrs["_FillValue"]
    return data


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
    plane = to_plane(source_of(data, path), replace(request, group=None))
    require_written(path, group, plane.velocity.key, plane.velocity.packing)
    return plane


# Arrays


def _whole_file(path: Path, kind: str, read: Callable[..., Any], **options: Any) -> Any:
    try:
        return read(path, **options)
    except Exception as error:  # whatever it says of damage
        raise ValueError(f"{path} is not a whole {kind} file: {error}") from error


def matlab_arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a MATLAB file before v7.3, read whole."""
    require_memory(path.stat().st_size, f"{path}")
    found = _whole_file(path, "MATLAB", loadmat)
    return {name: values for name, values in found.items() if isinstance(values, np.ndarray)}


def npy_arrays(path: Path) -> dict[str, np.ndarray]:
    """The one array of a .npy file, "", read as it is used."""
    found = _whole_file(path, ".npy", np.load, mmap_mode="c", allow_pickle=False)
    if not isinstance(found, np.ndarray):
        raise ValueError(f"{path} is an archive of arrays (.npz), no .npy file; take one of them out")
    return {"": found}


def read_array(path: str | Path, variable: str | None = None) -> np.ndarray:
    """An array from .npy, .mat (v5 or v7.3) or .h5; v7.3 axes are put back in MATLAB's order.

    Args:
        path: file, of one of the endings in ``names.ARRAY_ENDINGS``.
        variable: name in a .mat or .h5 file; may be left out if the file holds one array.
    Raises:
        ValueError: unknown ending, unknown variable, not numeric.
    """
    path = Path(path)
    require_regular(path)
    ending = path.suffix.lower()
    if ending not in ARRAY_ENDINGS:
        raise ValueError(f"{path}: .npy, .mat or .h5 is needed, not {ending or 'no ending'!r}")
    with naming(path):
        if ending == ".npy":
            values = npy_arrays(path)[""]
        elif ending == ".mat" and not h5py.is_hdf5(path):
            values = _pick(matlab_arrays(path), variable, path)
        else:
            with open_file(path) as file:
                fields = {name[1:]: each for name, each in hdf5_source(file, path).fields.items()}
                values = _pick(fields, variable, path).values()
                values = values.T if ending == ".mat" else values
    if values.dtype.kind not in "fiu":
        raise ValueError(f"{path}: {variable or 'the array'} is {values.dtype}, not real numbers")
    return values


def _pick(arrays: Mapping[str, Any], variable: str | None, path: Path) -> Any:
    held = ", ".join(arrays) or "no array"
    if variable is None:
        if len(arrays) != 1:
            raise ValueError(f"{path} holds {held}; name the one meant")
        (variable,) = arrays
    if variable not in arrays:
        raise ValueError(f"{path} has no variable {variable!r}{did_you_mean(variable, [*arrays])}; it holds {held}")
    return arrays[variable]


def open_arrays(path: Path, request: PlaneRequest, arrays: Arrays) -> VelocityPlane:
    """The plane of arrays that have no names of axes."""
    held = arrays(path)
    fields = {f"/{name}": Field(each, path, name and f"/{name}", {}) for name, each in held.items() if each.size > 1}
    plane = to_plane(Source(path, fields, {}, partial(arrays, path)), request)
    plane.velocity.held = held  # what was read is not read again
    return plane


def open_matlab(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a MATLAB file; v7.3 is HDF5 with reversed axes."""
    if not h5py.is_hdf5(path):
        return open_arrays(path, request, matlab_arrays)
    turned = replace(request, axes=None if request.axis_names is None else request.axis_names[::-1])
    with open_file(path) as file:
        fields = {name: each for name, each in hdf5_source(file, path).fields.items() if each.size > 1}
        return to_plane(Source(path, fields, {}, partial(hold_open, path)), turned)


NETCDF3 = PlaneFormat(
    "netCDF-3",
    lambda _, head: head[:4] in (b"CDF\1", b"CDF\2"),  # the version, 2 with large offsets
    lambda path, request: to_plane(classic_source(path), request),
    WITHOUT_GROUP,
)
STORE = PlaneFormat(
    "zarr", lambda path, head: not head and any((path / name).is_file() for name in ZARR), open_zarr, HDF5.takes
)
MATLAB_FORMAT = PlaneFormat(
    "MATLAB",
    lambda path, head: head.startswith(MATLAB) or (head[:8] == HDF5_SIGNATURE and path.suffix.lower() == ".mat"),
    open_matlab,
    WITHOUT_GROUP,
)
NPY_FORMAT = PlaneFormat(
    "numpy",
    lambda path, head: head[:6] == b"\x93NUMPY",
    partial(open_arrays, arrays=npy_arrays),
    tuple(each for each in WITHOUT_GROUP if each != "variable"),
)

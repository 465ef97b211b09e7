"""Planes from HDF5, netCDF, zarr, arrays of .npy and MATLAB, and datasets of xarray, which opens zarr.

All are read by slabs where they lie, as they are stored. MATLAB files may hold X_unique, Y_unique, Z_unique, the
coordinates of the axes x, y and z.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import loadmat, netcdf_file

from torchliner.file_checks import naming, require_memory, require_regular
from torchliner.io.hdf5 import PLAIN, Packing, open_file
from torchliner.io.plane_format import HDF5_SIGNATURE, PlaneFormat, PlaneRequest
from torchliner.io.points import require_velocity
from torchliner.io.to_plane import to_plane
from torchliner.io.variables import Field, Source, hdf5_source
from torchliner.names import ARRAY_ENDINGS, did_you_mean
from torchliner.records import VelocityPlane

# What netCDF-3's library writes into records that nobody writes, unless told otherwise.
FILLS = {"i2": -32767, "i4": -2147483647, "f4": 9.969209968386869e36, "f8": 9.969209968386869e36}
ZARR = ("zarr.json", ".zgroup", ".zmetadata")  # in the folder of a store, of version 3 or 2
MATLAB = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")
CLASSIC, NUMPY = (b"CDF\1", b"CDF\2"), b"\x93NUMPY"  # netCDF-3, version 2 with large offsets
TAKES = ("variable", "axes", "velocity_units", "length_units", "sampling_rate", "normal")


def _whole(path: Path, kind: str, read: Callable[..., Any], **options: Any) -> Any:
    try:
        return read(path, **options)
    except Exception as error:  # whatever it says of damage
        raise ValueError(f"{path} is not a whole {kind} file: {error}") from error


def npy_arrays(path: Path) -> dict[str, np.ndarray]:
    """The one array of a .npy file, "", read as it is used."""
    return {"": _whole(path, ".npy", np.lib.format.open_memmap, mode="c")}


def _classic(path: Path) -> Any:
    """A netCDF-3 file, mapped."""
    with path.open("rb") as raw:  # the map stays
        file = _whole(path, "netCDF-3", lambda _: netcdf_file(raw, "r", mmap=True))
    file._mm_buf = None  # the arrays hold the map, of which closing would warn
    return file


def classic_arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a netCDF-3 file, read as they are used."""
    return {name: each.data for name, each in _classic(path).variables.items()}


@contextmanager
def open_source(path: Path) -> Iterator[Source]:
    """What a file of variables, or a zarr store, holds, while it is open: by its content HDF5, netCDF-3 or .npy, else
    MATLAB before v7.3, which is read whole."""
    if path.is_dir():
        yield source_of(_open_store(path), path)
        return
    with path.open("rb") as file:
        head = file.read(8)
    if h5py.is_hdf5(path):
        with open_file(path) as hdf:
            yield hdf5_source(hdf, path)
    elif head.startswith(CLASSIC):
        file, fields = _classic(path), {}
        for name, each in file.variables.items():
            attrs, dims = dict(each._attributes), tuple(f"/{dim}" for dim in each.dimensions)
            if fill := FILLS.get(each.data.dtype.str[1:]):
                attrs.setdefault("_FillValue", each.data.dtype.type(fill))
            fields[f"/{name}"] = Field(each.data, path, f"/{name}", attrs, dims)
        yield Source(path, fields, file._attributes, partial(classic_arrays, path))
    else:
        opens = partial(npy_arrays, path)
        if not head.startswith(NUMPY) and path.suffix.lower() != ".npy":
            require_memory(path.stat().st_size, f"{path}")
            found = _whole(path, "MATLAB", loadmat)
            opens = partial(dict, {name: each for name, each in found.items() if isinstance(each, np.ndarray)})
        fields = {f"/{name}": Field(each, path, name and f"/{name}", {}) for name, each in opens().items()}
        yield Source(path, fields, {}, opens)


def open_variables(path: Path, request: PlaneRequest, arrays: bool = False) -> VelocityPlane:
    """The plane of a file of variables, as ``to_plane``. Single numbers beside ``arrays`` are of other things, and the
    axes of MATLAB's v7.3 are reversed."""
    with open_source(path) as source:
        if arrays:
            source = replace(source, fields={name: each for name, each in source.fields.items() if each.size > 1})
            if h5py.is_hdf5(path) and request.axis_names is not None:
                request = replace(request, axes=request.axis_names[::-1])
        plane = to_plane(source, request)
    if path.is_dir():
        _require_written(path, plane.velocity.key, plane.velocity.packing)
    return plane


def read_array(path: str | Path, variable: str | None = None) -> np.ndarray:
    """An array from .npy, .mat (v5 or v7.3) or .h5, whose ``variable`` may be left out if the file holds one; v7.3 axes
    are put back in MATLAB's order. A ValueError where ending or variable are unknown, or it holds no numbers."""
    path = Path(path)
    require_regular(path)
    if path.suffix.lower() not in ARRAY_ENDINGS:
        raise ValueError(f"{path}: .npy, .mat or .h5 is needed, not {path.suffix or 'no ending'!r}")
    with naming(path), open_source(path) as source:
        arrays = {name[1:]: each for name, each in source.fields.items()}
        held, near = ", ".join(arrays) or "no array", did_you_mean(str(variable), [*arrays])
        if variable is None and len(arrays) != 1:
            raise ValueError(f"{path} holds {held}; name the one meant")
        name = next(iter(arrays)) if variable is None or "" in arrays else variable
        if name not in arrays:
            raise ValueError(f"{path} has no variable {variable!r}{near}; it holds {held}")
        values = arrays[name].values()
        return values.T if path.suffix.lower() == ".mat" and h5py.is_hdf5(path) else values


def from_xarray(data: Any, **stated: Any) -> VelocityPlane:
    """A plane from a DataArray or Dataset, as ``VelocityPlane.from_xarray``; what is lazy there is read by slabs."""
    request = PlaneRequest(**{key: stated.pop(key) for key in (*TAKES, "wall_normal_component") if key in stated})
    if hasattr(data, "to_dataset"):
        name = str(data.name or "velocity")
        data, request = data.rename(name).to_dataset(), replace(request, variable=name)
    if not hasattr(data, "data_vars"):
        remedy = "of a table of pandas: table.set_index(['time', 'x']).to_xarray()"
        raise TypeError(f"a DataArray or Dataset of xarray is needed, not {type(data).__name__}; {remedy}")
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


def _open_store(path: Path) -> Any:
    """The dataset of a zarr store, as it is stored; an OSError where a part of it is a pipe or a device."""
    try:
        import xarray
        import zarr  # noqa: F401
    except ImportError as error:
        raise ImportError(f'{path} is a zarr store: pip install "torchliner[zarr]"') from error
    for each in path.rglob("*"):
        if not each.is_dir():
            require_regular(each)
    data = xarray.open_dataset(path, engine="zarr", chunks=None, decode_cf=False, consolidated=False)
    for name, variable in data.variables.items():
        if name in data.dims:
            _require_written(path, str(name))
        # Version 2 fills with 0 where nobody says otherwise, which marks nothing unless it is packed.
        if not (path / ZARR[0]).is_file() and not {"scale_factor", "add_offset"} & set(variable.attrs):
            variable.attrs = {key: value for key, value in variable.attrs.items() if (key, value) != ("_FillValue", 0)}
    return data


def _require_written(path: Path, name: str, packing: Packing = PLAIN) -> None:
    """Refuse an array of a store whose chunks are not all there, and would read as numbers: not as marks of what is
    missing, by its packing."""
    import zarr

    array = zarr.open_array(path / name, mode="r")
    fill = 0 if array.fill_value is None else array.fill_value
    if array.size < 2 or np.isnan(packing.unpack(np.full(1, fill), np.float64)).all():
        return  # one single value may be the fill value, which zarr leaves out
    # ``nchunks_initialized`` takes the square of their number.
    there = sum(each.is_file() and not each.name.startswith((".z", "zarr.json")) for each in (path / name).rglob("*"))
    wanted = math.prod(-(-n // c) for n, c in zip(array.shape, array.shards or array.chunks, strict=True))
    if there < wanted:
        raise ValueError(
            f"{path}:/{name}: {wanted - there} of {wanted} chunks were never written and would read as {fill}: write "
            f"them, and chunks of {fill} with write_empty_chunks=True"
        )


HDF5 = PlaneFormat("HDF5 or netCDF-4", lambda _, head: head.startswith(HDF5_SIGNATURE), open_variables, TAKES)
NETCDF3 = PlaneFormat("netCDF-3", lambda _, head: head.startswith(CLASSIC), open_variables, TAKES)
MATLAB_FORMAT = PlaneFormat(
    "MATLAB",
    lambda path, head: head.startswith(MATLAB) or (head[:8] == HDF5_SIGNATURE and path.suffix.lower() == ".mat"),
    partial(open_variables, arrays=True),
    TAKES,
)
NPY_FORMAT = PlaneFormat(
    "numpy", lambda _, head: head.startswith(NUMPY), partial(open_variables, arrays=True), TAKES[1:]
)
STORE = PlaneFormat("zarr", lambda path, _: any((path / name).is_file() for name in ZARR), open_variables, TAKES)

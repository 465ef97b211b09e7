"""Classic netCDF (netCDF-3), as older solvers and exporters write it; read where it lies."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import netcdf_file

from torchliner.file_checks import DAMAGE, naming
from torchliner.io.fields import Field
from torchliner.io.plane_file import FORMAT as HDF5
from torchliner.io.plane_file import to_plane
from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.records import VelocityPlane

# What the library writes into records that nobody writes, unless told otherwise; bytes it leaves.
FILLS = {"i2": -32767, "i4": -2147483647, "f4": 9.969209968386869e36, "f8": 9.969209968386869e36}


def recognises(_: Path, head: bytes) -> bool:
    """CDF and its version: 1, or 2 with large offsets."""
    return head[:4] in (b"CDF\1", b"CDF\2")


def open_classic(path: Path) -> Any:
    """The file, mapped.

    Raises:
        OSError: it ends before its values do.
    """
    try:
        file: Any = netcdf_file(path, "r", mmap=True)
        file._mm_buf = None  # the arrays hold the map, of which closing would warn
        return file
    except (ValueError, TypeError, *DAMAGE) as error:
        raise OSError(
            f"{path} is truncated, or its header is damaged: what that names goes beyond "
            "the end of the file; copy or write it again"
        ) from error


def _arrays(path: Path) -> dict[str, np.ndarray]:
    return {name: each.data for name, each in open_classic(path).variables.items()}


def open_plane(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a netCDF-3 file.

    Raises:
        OSError: the file ends before its values do.
        ValueError: as ``to_plane``.
    """
    with naming(path):
        file = open_classic(path)
        fields = {}
        for name, each in file.variables.items():
            attrs: dict[str, Any] = dict(each._attributes)
            kind = each.data.dtype.str[1:]
            if kind in FILLS and "_Unsigned" not in attrs:  # of which it lies in the middle
                attrs.setdefault("_FillValue", each.data.dtype.type(FILLS[kind]))
            dims = tuple(f"/{dim}" for dim in each.dimensions)
            fields[f"/{name}"] = Field(each.data, path, f"/{name}", attrs, dims)
        return to_plane(fields, file._attributes, path, request, partial(_arrays, path))


FORMAT = PlaneFormat("netCDF-3", recognises, open_plane, tuple(t for t in HDF5.takes if t != "group"))

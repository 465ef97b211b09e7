"""Planes from xarray: datasets in memory or opened lazily, and zarr stores."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.file_checks import naming
from torchliner.io.fields import fields_of_xarray
from torchliner.io.plane_file import FORMAT as HDF5
from torchliner.io.plane_file import to_plane
from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.io.point_layout import require_velocity
from torchliner.io.stored_values import PLAIN, Packing
from torchliner.records import VelocityPlane

ZARR = ("zarr.json", ".zgroup", ".zmetadata")  # in the folder of a store, of version 3 or 2
# As it is stored, and read when it is asked for.
RAW: dict[str, Any] = {
    "decode_times": False,
    "decode_timedelta": False,
    "decode_coords": False,
    "mask_and_scale": False,
    "chunks": None,
    "consolidated": False,
}


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
            f"a DataArray or Dataset of xarray is needed, not {type(data).__name__}; of a table "
            "of pandas: VelocityPlane.from_xarray(table.set_index(['time', 'x']).to_xarray(), "
            "variable=..., velocity_units=..., length_units=..., sampling_rate=...)"
        )
    path = Path(data.encoding.get("source") or "xarray")
    plane = to_plane(fields_of_xarray(data, path), data.attrs, path, request, partial(getattr, data, "variables"))
    require_velocity(plane.name, request)
    plane = replace(plane, **stated) if stated else plane
    lazy = data.chunks or any("source" in each.encoding for each in data.variables.values())
    return plane if lazy else plane.load()


def open_store(path: Path, group: str | None) -> Any:
    """The dataset of a zarr store, as it is stored.

    Raises:
        ImportError: xarray or zarr is not installed.
    """
    try:
        import xarray
        import zarr  # noqa: F401
    except ImportError as error:
        raise ImportError(f'{path} is a zarr store; xarray is needed: pip install "torchliner[xarray]"') from error
    return xarray.open_dataset(path, engine="zarr", group=group, **RAW)


def _variables(path: Path, group: str | None) -> Any:
    return open_store(path, group).variables


def require_written(path: Path, group: str | None, name: str, packing: Packing = PLAIN) -> None:
    """Refuse an array of a store whose chunks are not all there, and would read as numbers.

    Args:
        path, group, name: of it.
        packing: how it is stored; a fill value that it marks as missing is no number.
    Raises:
        ValueError: some are not; one single value may be the fill value, which zarr leaves out.
    """
    import zarr

    folder = path / (group or "").strip("/") / name
    array = zarr.open_array(folder, mode="r")
    fill = 0 if array.fill_value is None else array.fill_value
    if array.size < 2 or np.isnan(packing.unpack(np.full(1, fill), np.float64)).all():
        return
    # ``nchunks_initialized`` takes the square of their number.
    there = sum(each.is_file() and not each.name.startswith((".z", "zarr.json")) for each in folder.rglob("*"))
    wanted = math.prod(-(-n // c) for n, c in zip(array.shape, array.shards or array.chunks, strict=True))
    if there < wanted:
        raise ValueError(
            f"{path}:/{name}: {wanted - there} of {wanted} chunks were never written and would read as {fill}, as "
            "after a run that was broken off. Cut the record to what is there, or write the rest; if they are "
            f"{fill} indeed, which zarr leaves out, write them with write_empty_chunks=True"
        )


def recognises(path: Path, head: bytes) -> bool:
    """A folder with the index of a zarr group."""
    return not head and any((path / name).is_file() for name in ZARR)


def open_plane(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a zarr store.

    Raises:
        ImportError: xarray or zarr is not installed.
        OSError, ValueError: as ``to_plane`` and ``require_written``.
    """
    data = open_store(path, request.group)
    with naming(path):
        if not (path / ZARR[0]).is_file():
            # Version 2 fills with 0 where nobody says otherwise, which marks nothing unless it is packed.
            for each in data.variables.values():
                if each.attrs.get("_FillValue") == 0 and not {"scale_factor", "add_offset"} & set(each.attrs):
                    del each.attrs["_FillValue"]
        for name in set(data.dims) & set(data.variables):
            require_written(path, request.group, str(name))
        opens = partial(_variables, path, request.group)
        plane = to_plane(fields_of_xarray(data, path), data.attrs, path, replace(request, group=None), opens)
        require_written(path, request.group, plane.velocity.source.key, plane.velocity.source.packing)
    return plane


FORMAT = PlaneFormat("zarr", recognises, open_plane, HDF5.takes)

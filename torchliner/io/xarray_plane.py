"""Planes from xarray: datasets in memory or opened lazily, and zarr stores."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.file_checks import naming
from torchliner.io.hdf5_velocity import numpy_kind, time_first, time_part
from torchliner.io.netcdf_terms import NamedArray, in_terms_of_hdf5
from torchliner.io.plane_file import FORMAT as HDF5
from torchliner.io.plane_file import plane_from
from torchliner.io.plane_format import FrameVelocity, PlaneFormat, PlaneRequest, exact_type
from torchliner.io.point_layout import require_velocity
from torchliner.io.stored_values import Packing, packing_of
from torchliner.records import VelocityPlane

EXTRA = 'xarray is needed: pip install "torchliner[xarray]"'
ZARR = ("zarr.json", ".zgroup", ".zmetadata")  # in the folder of a store, of version 3 or 2
FILL, PACKED = "_FillValue", {"scale_factor", "add_offset"}
UNPACKED = Packing()
# As it is stored, and read when it is asked for.
RAW: dict[str, Any] = {
    "decode_times": False, "decode_timedelta": False, "decode_coords": False,
    "mask_and_scale": False, "chunks": None, "consolidated": False,
}  # fmt: skip


def from_xarray(data: Any, **stated: Any) -> VelocityPlane:
    """A plane from a DataArray or Dataset; what is lazy there is read by slabs.

    Args:
        data: with dimensions, coordinates and units as CF has them, docs/formats.md.
        stated: what they do not say, fields of ``PlaneRequest``; and fields of ``VelocityPlane``,
            SI, which outweigh those of ``data``.
    Raises:
        TypeError: neither a DataArray nor a Dataset.
        ValueError: as ``read_plane``; a Dataset that has no wall-normal velocity, or several.
    """
    request = PlaneRequest(**{key: stated.pop(key) for key in (*HDF5.takes, "wall_normal_component") if key in stated})
    if not hasattr(data, "data_vars") and hasattr(data, "dims") and hasattr(data, "coords"):
        name = str(data.name or "velocity")
        data = data.rename(name).to_dataset()
        request = replace(request, variable=name)
    if not hasattr(data, "data_vars"):
        raise TypeError(
            f"a DataArray or Dataset of xarray is needed, not {type(data).__name__}; of a table "
            "of pandas: VelocityPlane.from_xarray(table.set_index(['time', 'x']).to_xarray(), "
            "variable=..., velocity_units=..., length_units=..., sampling_rate=...)"
        )
    source = data.encoding.get("source") or "xarray"
    plane = _open(data, Path(source), request, None)
    require_velocity(plane.name, request)
    plane = replace(plane, **stated) if stated else plane
    lazy = data.chunks or any("source" in each.encoding for each in data.variables.values())
    return plane if lazy else plane.load()


def _open(data: Any, path: Path, request: PlaneRequest, store: Store | None) -> VelocityPlane:
    """Of a dataset in memory, or of one in a store that workers open themselves."""
    variables = {
        str(name): NamedArray(
            tuple(map(str, each.dims)), tuple(each.shape), each.dtype, _attributes(each, store),
            lambda each=each: np.asarray(each.values),  # type: ignore[misc]
        )
        for name, each in data.variables.items()
    }  # fmt: skip
    # The places along an axis differ, so that one of them at most can be the fill value.
    for name in data.dims:
        if store is not None and name in data.variables:
            store.require_written(str(name), f"{path}:/{name}", most=1)

    def stored(path: Path, key: str, order: tuple[int, ...], factor: float) -> FrameVelocity:
        label, name = f"{path}:{key}", key.lstrip("/")
        array, kind = data[name], exact_type(data[name].dtype)
        shape = (*(array.shape[i] for i in order[1:]), array.shape[order[0]])
        packing = packing_of(terms[key], label)
        if store is not None:
            store.require_written(name, label, packing, order[0])
        slab = Slabs(store or data, name, order, packing, numpy_kind(kind))
        chunks = array.encoding.get("preferred_chunks") or {}
        rows = int(chunks.get(array.dims[order[0]], 1))
        tile = array.dtype.itemsize * int(np.prod(list(chunks.values()))) if chunks else 0
        return FrameVelocity(slab, shape, label, factor, kind, max(1, rows), tile)

    with in_terms_of_hdf5(variables, data.attrs) as terms:
        return plane_from(terms, path, request, stored)


def _attributes(variable: Any, store: Store | None) -> Mapping[str, Any]:
    """With the unit of times that xarray has decoded; it stands with the encoding then. Version 2
    of zarr fills with 0 where nobody says otherwise, which marks nothing unless it is packed."""
    found = {k: v for k, v in variable.attrs.items() if not (k == "units" and v is None)}
    if store is not None and store.old and not PACKED & set(found) and not found.get(FILL, 1):
        del found[FILL]
    return found


@dataclass(frozen=True)
class Store:
    """A zarr store and a group of it."""

    path: Path
    group: str | None

    def open(self) -> Any:
        """The dataset, as it is stored.

        Raises:
            ImportError: xarray or zarr is not installed.
        """
        try:
            import xarray
            import zarr  # noqa: F401
        except ImportError as error:
            raise ImportError(f"{self.path} is a zarr store; {EXTRA}") from error
        return xarray.open_dataset(self.path, engine="zarr", group=self.group, **RAW)

    @property
    def old(self) -> bool:
        """Whether it is of version 2."""
        return not (self.path / ZARR[0]).is_file()

    def require_written(self, name: str, label: str, packing: Packing = UNPACKED, time: int = 0, most: int = 0) -> None:
        """Refuse an array whose chunks are not all there, and would read as numbers.

        Args:
            name: of the array.
            label: of it, for messages.
            packing: how it is stored; a fill value that it marks as missing is no number.
            time: its axis of time.
            most: values that may be missing.
        Raises:
            ValueError: more are.
        """
        import zarr

        folder = self.path / (self.group or "").strip("/") / name
        array = zarr.open_array(folder, mode="r")
        fill = 0 if array.fill_value is None else array.fill_value
        if fill != fill or packing.lost(np.array([fill])) is not None:
            return
        tile = array.shards or array.chunks
        grid = [-(-n // c) for n, c in zip(array.shape, tile, strict=True)]
        # ``nchunks_initialized`` takes the square of their number.
        there = {each.relative_to(folder).as_posix() for each in folder.rglob("*")}
        lost = [at for at in np.ndindex(*grid) if array.metadata.encode_chunk_key(at) not in there]
        sizes = [math.prod(min(c, n - i * c) for i, n, c in zip(at, array.shape, tile, strict=True))
                 for at in lost]  # fmt: skip
        if sum(sizes) <= most:
            return
        begin, last = (f(at[time] for at in lost) * tile[time] for f in (min, max))
        end = min(last + tile[time], array.shape[time]) - 1
        raise ValueError(
            f"{label}: {len(lost)} of {math.prod(grid)} chunks were never written and would read "
            f"as {fill}, as after a run that was broken off: {'values' if most else 'samples'} "
            f"{begin} to {end}. Cut the record to what is there, or write the rest; if they are "
            f"{fill} indeed, which zarr leaves out, write them with write_empty_chunks=True"
        )


@dataclass
class Slabs:
    """Samples of a variable of a dataset, unpacked; a store is opened by whoever reads it."""

    data: Any
    name: str
    order: tuple[int, ...]
    packing: Any
    kind: Any
    _open: Any = field(default=None, repr=False)

    def __call__(self, begin: int, end: int) -> np.ndarray:
        """Samples begin .. end - 1, (t, ...)."""
        if self._open is None:
            self._open = self.data.open() if isinstance(self.data, Store) else self.data
        part = np.asarray(self._open[self.name][time_part(self.order, begin, end)].values)
        values = time_first(part, self.order).astype(self.kind, order="C")
        self.packing.unpack_floats(values)
        return values

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_open": None}


def recognises(path: Path, head: bytes) -> bool:
    """A folder with the index of a zarr group."""
    return not head and any((path / name).is_file() for name in ZARR)


def open_plane(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a zarr store.

    Raises:
        ImportError: xarray or zarr is not installed.
        OSError, ValueError: as ``read_plane``.
    """
    store = Store(path, request.group)
    data = store.open()
    with naming(path):
        return _open(data, path, replace(request, group=None), store)


FORMAT = PlaneFormat("zarr", recognises, open_plane, HDF5.takes)

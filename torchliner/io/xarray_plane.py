"""Planes from xarray: datasets in memory or opened lazily, and zarr stores."""

from __future__ import annotations

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
from torchliner.io.stored_values import packing_of
from torchliner.records import VelocityPlane

EXTRA = 'xarray is needed: pip install "torchliner[xarray]"'
ZARR = ("zarr.json", ".zgroup", ".zmetadata")  # in the folder of a store, of version 3 or 2
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
    request = PlaneRequest(**{key: stated.pop(key) for key in HDF5.takes if key in stated})
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
    plane = replace(plane, **stated) if stated else plane
    lazy = data.chunks or any("source" in each.encoding for each in data.variables.values())
    return plane if lazy else plane.load()


def _open(data: Any, path: Path, request: PlaneRequest, store: Store | None) -> VelocityPlane:
    """Of a dataset in memory, or of one in a store that workers open themselves."""
    variables = {
        str(name): NamedArray(
            tuple(map(str, each.dims)), tuple(each.shape), each.dtype, _attributes(each),
            lambda each=each: np.asarray(each.values),  # type: ignore[misc]
        )
        for name, each in data.variables.items()
    }  # fmt: skip

    def stored(path: Path, key: str, order: tuple[int, ...], factor: float) -> FrameVelocity:
        label, name = f"{path}:{key}", key.lstrip("/")
        array, kind = data[name], exact_type(data[name].dtype)
        shape = (*(array.shape[i] for i in order[1:]), array.shape[order[0]])
        slab = Slabs(store or data, name, order, packing_of(terms[key], label), numpy_kind(kind))
        chunks = array.encoding.get("preferred_chunks") or {}
        rows = int(chunks.get(array.dims[order[0]], 1))
        tile = array.dtype.itemsize * int(np.prod(list(chunks.values()))) if chunks else 0
        return FrameVelocity(slab, shape, label, factor, kind, max(1, rows), tile)

    with in_terms_of_hdf5(variables, data.attrs) as terms:
        return plane_from(terms, path, request, stored)


def _attributes(variable: Any) -> Mapping[str, Any]:
    """With the unit of times that xarray has decoded; it stands with the encoding then."""
    return {k: v for k, v in variable.attrs.items() if not (k == "units" and v is None)}


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

"""Classic netCDF (netCDF-3), as older solvers and exporters write it; read where it lies."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import netcdf_file

from torchliner.file_checks import DAMAGE, naming
from torchliner.io.hdf5_velocity import numpy_kind, time_first, time_part
from torchliner.io.netcdf_terms import NamedArray, in_terms_of_hdf5
from torchliner.io.plane_file import FORMAT as HDF5
from torchliner.io.plane_file import plane_from
from torchliner.io.plane_format import FrameVelocity, PlaneFormat, PlaneRequest, exact_type
from torchliner.io.stored_values import Packing, packing_of
from torchliner.records import VelocityPlane

# What the library writes into records that nobody writes, unless told otherwise; bytes it leaves.
FILLS = {"i2": -32767, "i4": -2147483647, "f4": 9.969209968386869e36, "f8": 9.969209968386869e36}


@dataclass(frozen=True)
class Layout:
    """Where the values of a variable lie in its file, in bytes; records may be interleaved."""

    dims: tuple[str, ...]
    attributes: dict[str, Any]
    dtype: np.dtype[Any]
    offset: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]

    @property
    def end(self) -> int:
        """First byte behind the values."""
        steps = sum((n - 1) * s for n, s in zip(self.shape, self.strides, strict=True))
        return self.offset + (0 if 0 in self.shape else steps + self.dtype.itemsize)

    def within(self, content: np.ndarray) -> np.ndarray:
        """The values, a view of the bytes of the file."""
        return np.ndarray(self.shape, self.dtype, content.data, self.offset, self.strides)


@dataclass
class Region:
    """Samples of a variable where they lie, unpacked.

    Args:
        path: of the file.
        layout: of the variable.
        order: axes as of ``cf.Axes``.
        packing: how the values are stored.
        kind: of the result.
    """

    path: Path
    layout: Layout
    order: tuple[int, ...]
    packing: Packing
    kind: Any
    _content: np.ndarray | None = field(default=None, repr=False)

    def __call__(self, begin: int, end: int) -> np.ndarray:
        """Samples begin .. end - 1, (t, ...)."""
        each = self.layout
        if self.order[0] == 0:
            span = dataclasses.replace(each, shape=(end - begin, *each.shape[1:]), offset=0)
            with self.path.open("rb") as file:
                file.seek(each.offset + begin * each.strides[0])
                content: np.ndarray = np.frombuffer(file.read(span.end), np.uint8)
            if len(content) < span.end:
                raise OSError("the file ends before; nothing of it can be used")
            part = time_first(span.within(content), self.order)
        else:
            if self.path.stat().st_size < each.end:  # where a map of it would end the process
                raise OSError("the file ends before; nothing of it can be used")
            if self._content is None:
                self._content = np.memmap(self.path, np.uint8, "r")
            whole = each.within(self._content)
            part = time_first(whole[time_part(self.order, begin, end)], self.order)
        values = part.astype(self.kind, order="C")
        self.packing.unpack_floats(values)
        return values

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_content": None}


def recognises(_: Path, head: bytes) -> bool:
    """CDF and its version: 1, or 2 with large offsets."""
    return head[:4] in (b"CDF\1", b"CDF\2")


def open_plane(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a netCDF-3 file.

    Raises:
        OSError: the file ends before its values do.
        ValueError: as ``plane_file.open_plane``.
    """
    with naming(path):
        layouts, attributes = read_header(path)
        content = np.memmap(path, np.uint8, "r")
        for name, each in layouts.items():
            if each.end > len(content):
                raise OSError(f"{path} is truncated: {name} ends at byte {each.end}, the file at "
                              f"{len(content)}")  # fmt: skip
        variables = {
            name: NamedArray(each.dims, each.shape, each.dtype, each.attributes,
                             functools.partial(each.within, content))
            for name, each in layouts.items()
        }  # fmt: skip

        def stored(path: Path, key: str, order: tuple[int, ...], factor: float) -> FrameVelocity:
            each, label = layouts[key.lstrip("/")], f"{path}:{key}"
            kind = exact_type(each.dtype)
            source = Region(path, each, order, packing_of(terms[key], label), numpy_kind(kind))
            shape = (*(each.shape[i] for i in order[1:]), each.shape[order[0]])
            return FrameVelocity(source, shape, label, factor, kind)

        with in_terms_of_hdf5(variables, attributes) as terms:
            return plane_from(terms, path, request, stored)


def read_header(path: Path) -> tuple[dict[str, Layout], dict[str, Any]]:
    """Layouts of the variables by name, and the attributes of the file.

    Raises:
        OSError: the file ends before they do.
    """
    try:
        file: Any = netcdf_file(path, "r", mmap=True)
    except (ValueError, TypeError, *DAMAGE) as error:
        raise OSError(f"{path} is truncated, or its header is damaged: what that names goes beyond "
                      "the end of the file; copy or write it again") from error  # fmt: skip
    found = {name: _layout(each) for name, each in file.variables.items()}
    attributes = dict(file._attributes)
    file.close()
    return found, attributes


def _layout(each: Any) -> Layout:
    array = whole = each.data
    while isinstance(whole.base, np.ndarray):
        whole = whole.base
    offset = array.__array_interface__["data"][0] - whole.__array_interface__["data"][0]
    attributes = dict(each._attributes)
    fill = FILLS.get(array.dtype.str[1:])
    if fill is not None and "_Unsigned" not in attributes:  # of which it lies in the middle
        attributes.setdefault("_FillValue", array.dtype.type(fill))
    return Layout(tuple(each.dimensions), attributes, array.dtype, offset,
                  tuple(int(n) for n in array.shape), tuple(array.strides))  # fmt: skip


FORMAT = PlaneFormat("netCDF-3", recognises, open_plane, tuple(t for t in HDF5.takes if t != "group"))

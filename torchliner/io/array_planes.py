"""Arrays of MATLAB and numpy as planes that stay in their files; the user states what they are.

MATLAB files may hold X_unique, Y_unique, Z_unique beside XVelocity, YVelocity, ZVelocity; these are
then the coordinates of the axes x, y and z.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from scipy.io import loadmat, whosmat

from torchliner.file_checks import naming, require_memory
from torchliner.io.arrays import _mat5, _pick, read_npy, require_axes
from torchliner.io.hdf5 import open_file
from torchliner.io.plane_format import FrameVelocity, PlaneFormat, PlaneRequest
from torchliner.io.point_layout import (
    AXES,
    all_rows,
    component_of,
    length_factor,
    named,
    velocity_factor,
)
from torchliner.io.stored_values import read_values
from torchliner.records import VelocityPlane

TAKES = ("variable", "axes", "velocity_units", "length_units", "sampling_rate", "normal")
MATLAB = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")


@dataclass
class ArrayFile:
    """Arrays of a file: shapes and types by name, and parts of them.

    Args:
        path: file.
        shapes: by name; "" of a file of one array without a name.
        kinds: numpy's types.
    """

    path: Path
    shapes: dict[str, tuple[int, ...]] = field(default_factory=dict)
    kinds: dict[str, np.dtype[Any]] = field(default_factory=dict)

    def read(self, name: str, part: tuple[slice, ...]) -> np.ndarray:
        """A part of an array."""
        raise NotImplementedError


class NpyFile(ArrayFile):
    """One array, mapped."""

    def __init__(self, path: Path) -> None:
        whole = read_npy(path, None)
        super().__init__(path, {"": whole.shape}, {"": whole.dtype})

    def read(self, name: str, part: tuple[slice, ...]) -> np.ndarray:
        """From the map of the file."""
        return np.array(read_npy(self.path, None)[part])


class Matlab73File(ArrayFile):
    """HDF5, with reversed axes."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        with open_file(path) as file:
            for name, each in file.items():
                if isinstance(each, h5py.Dataset) and each.shape:
                    self.shapes[name], self.kinds[name] = each.shape[::-1], each.dtype

    def read(self, name: str, part: tuple[slice, ...]) -> np.ndarray:
        """A hyperslab, turned back."""
        with open_file(self.path) as file:
            return read_values(file[name], f"{self.path}:/{name}", self.path, part[::-1]).T


class Matlab5File(ArrayFile):
    """Before v7.3: an array is read whole, when its first part is asked for, and kept."""

    def __init__(self, path: Path) -> None:
        found = _mat5(whosmat, path)
        kinds = {"single": "f4", "double": "f8", "char": "O", "cell": "O", "struct": "O"}
        types = {name: np.dtype(kinds.get(kind, "i8")) for name, _, kind in found}
        super().__init__(path, {name: shape for name, shape, _ in found}, types)
        self._whole: dict[str, np.ndarray] = {}

    def read(self, name: str, part: tuple[slice, ...]) -> np.ndarray:
        """From the array in memory."""
        if name not in self._whole:
            size = self.kinds[name].itemsize * math.prod(self.shapes[name])
            require_memory(size, f"{self.path}: {name}, {self.shapes[name]},")
            found = np.asarray(_mat5(loadmat, self.path, variable_names=[name])[name])
            if found.dtype.kind not in "fiu" or found.shape != self.shapes[name]:
                raise ValueError(f"{self.path}: {name} is {found.dtype} of shape {found.shape}, "
                                 "not real numbers")  # fmt: skip
            self._whole = {name: found}
        return self._whole[name][part]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_whole": {}}


@dataclass
class ArrayFrames:
    """Samples of an array: ``order`` of its axes, time first; axes of one value left out."""

    file: ArrayFile
    name: str
    order: tuple[int, ...]

    def __call__(self, begin: int, end: int) -> np.ndarray:
        """Values, (t, ...)."""
        shape = self.file.shapes[self.name]
        part = [slice(None)] * len(shape)
        part[self.order[0]] = slice(begin, end)
        with naming(self.file.path):
            found = self.file.read(self.name, tuple(part))
        rest = [i for i in range(len(shape)) if i not in self.order]
        found = all_rows(found.transpose([*self.order, *rest]), begin, end, self.file.path)
        return found.reshape(end - begin, -1)


def _matlab(path: Path) -> ArrayFile:
    return (Matlab73File if h5py.is_hdf5(path) else Matlab5File)(path)


def plane_of_array(file: ArrayFile, request: PlaneRequest) -> VelocityPlane:
    """The plane of a file of arrays.

    Args:
        file: opened.
        request: axes, velocity_units and sampling_rate must be stated, length_units where the file
            has coordinates.
    Raises:
        ValueError: one is not; as ``arrays.require_axes``; no such variable; no real numbers;
            coordinates that do not fit.
    """
    path = file.path
    for option, example in (("axes", "time,z,x"), ("sampling_rate", "HZ")):
        if getattr(request, option) is None:
            dashed = option.replace("_", "-")
            raise ValueError(f"{path}: an array says nothing of its {dashed}; state {option} "
                             f"(--{dashed} {example})")  # fmt: skip
    factor = velocity_factor(request, f"{path}")
    stated = request.normal or ""
    name = _velocity(file, request, stated.strip("+-"))
    label, shape, kind = f"{path}:/{name}".rstrip("/:"), file.shapes[name], file.kinds[name]
    if kind.kind not in "fiu":
        raise ValueError(f"{label} is {kind}, not real numbers")
    words = request.axes
    axes = [word.strip() for word in (words.split(",") if isinstance(words, str) else words or ())]
    kept = list(range(len(shape)))
    if len(shape) > len(axes):
        kept = [i for i in kept if shape[i] != 1]
    require_axes(axes, [shape[i] for i in kept], label)
    component = component_of(name)
    normal = AXES.index(stated[-1]) if stated[-1:] in tuple(AXES) else component
    if component not in (None, normal):
        raise ValueError(f"{label} is the velocity along {AXES[component or 0]}, but normal is "
                         f"{stated!r}; name the variable of that direction")  # fmt: skip
    plane_axes = {"x": "y" if normal == 0 else "x", "z": "y" if normal == 2 else "z"}
    if "y" in axes and "y" not in plane_axes.values():
        raise ValueError(f"{label} has an axis y, of several heights; state normal='z' where y "
                         "lies along the wall, or take one height: torchliner convert --layout "
                         "array --row I")  # fmt: skip
    names = ["time", *(n for n in ("probe", plane_axes["z"], plane_axes["x"]) if n in axes)]
    if len(names) != len(axes):
        raise ValueError(f"{label}: axes {','.join(axes)} are none of a wall whose normal is "
                         f"{AXES[normal or 0]}")  # fmt: skip
    order = tuple(kept[axes.index(each)] for each in names)
    places: dict[str, Any] = {own: _places(file, theirs, shape[kept[axes.index(theirs)]], request)
              for own, theirs in plane_axes.items() if theirs in axes}  # fmt: skip
    exact = torch.float32 if kind.itemsize <= (4 if kind.kind == "f" else 2) else torch.float64
    velocity = FrameVelocity(
        ArrayFrames(file, name, order), (*(shape[i] for i in order[1:]), shape[order[0]]), label,
        -factor if stated.startswith("-") else factor, exact,
        # Where time runs fastest, one long slab is read at once.
        tile_rows=1 if order[0] == 0 or isinstance(file, Matlab73File) else shape[order[0]],
    )  # fmt: skip
    assert request.sampling_rate is not None
    return VelocityPlane(velocity, sampling_rate=request.sampling_rate, name=label, title=path.stem, **places)


def _velocity(file: ArrayFile, request: PlaneRequest, normal: str) -> str:
    """Name of the velocity: that stated, that along the normal, or the only array."""
    names = list(file.shapes)
    found = [name for name in names if component_of(name) is not None
             and AXES[component_of(name) or 0] == normal]  # fmt: skip
    if request.variable is None and len(found) == 1:
        return found[0]
    if names == [""]:
        if request.variable is not None:
            raise ValueError(f"{file.path} holds one array, without a name; leave out variable "
                             f"{request.variable!r}")  # fmt: skip
        return ""
    return _pick(names, request.variable, file.path)


def _places(file: ArrayFile, axis: str, count: int, request: PlaneRequest) -> np.ndarray | None:
    """Coordinates along an axis, m, in whichever direction they run; None if there are none."""
    name = f"{axis.upper()}_unique"
    if name not in file.shapes:
        return None
    factor = length_factor(request, f"{file.path}:/{name}")
    values = file.read(name, (slice(None),) * len(file.shapes[name])).astype(float).reshape(-1)
    if len(values) != count:
        raise ValueError(f"{file.path}:/{name} has {len(values)} values for {count} along {axis}; "
                         "check the order of axes")  # fmt: skip
    return values * factor


MATLAB_FORMAT = PlaneFormat(
    "MATLAB",
    lambda path, head: head.startswith(MATLAB) or (
        head[:8] == b"\x89HDF\r\n\x1a\n" and path.suffix.lower() == ".mat"
    ),
    named(lambda path, request: plane_of_array(_matlab(path), request)), TAKES,
)  # fmt: skip
NPY_FORMAT = PlaneFormat(
    "numpy", lambda path, head: head[:6] == b"\x93NUMPY",
    named(lambda path, request: plane_of_array(NpyFile(path), request)),
    tuple(each for each in TAKES if each != "variable"),
)  # fmt: skip

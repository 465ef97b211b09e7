"""Arrays of .npy, MATLAB and HDF5: one by its name, or a plane of which the user states axes, units and rate.

MATLAB files may hold X_unique, Y_unique, Z_unique, the coordinates of the axes x, y and z.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import loadmat, whosmat

from torchliner.file_checks import naming, require_memory, require_regular
from torchliner.io.hdf5 import hold_open, open_file
from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.io.to_plane import FORMAT as HDF5
from torchliner.io.to_plane import HDF5_SIGNATURE, to_plane
from torchliner.io.variables import Field, fields_of_hdf5
from torchliner.names import ARRAY_ENDINGS, did_you_mean
from torchliner.records import VelocityPlane

MATLAB = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")
NUMBERS = {"double": "f8", "single": "f4"} | {f"{sign}int{n}": "i8" for sign in ("", "u") for n in (8, 16, 32, 64)}


@dataclass
class MatlabArray:
    """An array of a MATLAB file before v7.3: read whole when a part of it is asked for, and kept."""

    path: Path
    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    _whole: np.ndarray | None = field(default=None, repr=False)

    def __getitem__(self, part: Any) -> np.ndarray:
        if self._whole is None:
            require_memory(self.dtype.itemsize * math.prod(self.shape), f"{self.path}: {self.name}, {self.shape},")
            found = np.asarray(_matlab(loadmat, self.path, variable_names=[self.name])[self.name])
            if found.dtype.kind not in "fiu" or found.shape != self.shape:
                raise ValueError(f"{self.path}: {self.name} is {found.dtype}, {found.shape}, not real numbers")
            self._whole = found
        return self._whole[part]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_whole": None}


def _matlab(function: Callable[..., Any], path: Path, **options: Any) -> Any:
    try:
        return function(path, **options)
    except Exception as error:  # whatever it says of damage
        raise ValueError(f"{path} is not a whole MATLAB file: {error}") from error


def matlab_arrays(path: Path) -> dict[str, MatlabArray]:
    """The arrays of a MATLAB file before v7.3."""
    return {
        name: MatlabArray(path, name, tuple(shape), np.dtype(NUMBERS.get(kind, "O")))
        for name, shape, kind in _matlab(whosmat, path)
    }


def npy_arrays(path: Path) -> dict[str, np.ndarray]:
    """The one array of a .npy file, "", read as it is used."""
    try:
        found = np.load(path, mmap_mode="c", allow_pickle=False)
    except Exception as error:  # whatever it says of damage
        raise ValueError(f"{path} is not a whole .npy file: {error}") from error
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
            arrays = matlab_arrays(path)
            values = arrays[_pick([*arrays], variable, path)][()]
        else:
            with open_file(path) as file:
                fields = {name[1:]: each for name, each in fields_of_hdf5(file, path).items()}
                values = fields[_pick([*fields], variable, path)].values()
                values = values.T if ending == ".mat" else values
    if values.dtype.kind not in "fiu":
        raise ValueError(f"{path}: {variable or 'the array'} is {values.dtype}, not real numbers")
    return values


def _pick(names: Sequence[str], variable: str | None, path: Path) -> str:
    if variable is None:
        if len(names) != 1:
            raise ValueError(f"{path} holds {', '.join(names) or 'no array'}; name the one meant")
        return names[0]
    if variable not in names:
        near = did_you_mean(variable, list(names))
        raise ValueError(f"{path} has no variable {variable!r}{near}; it holds {', '.join(names)}")
    return variable


def _open(path: Path, request: PlaneRequest, arrays: Callable[[Path], dict[str, Any]]) -> VelocityPlane:
    with naming(path):
        fields = {
            f"/{name}": Field(each, path, name and f"/{name}", {}, ("",) * len(each.shape))
            for name, each in arrays(path).items()
            if math.prod(each.shape) > 1
        }
        return to_plane(fields, {}, path, request, partial(arrays, path))


def open_matlab(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a MATLAB file; v7.3 is HDF5 with reversed axes."""
    if not h5py.is_hdf5(path):
        return _open(path, request, matlab_arrays)
    turned = replace(request, axes=None if request.axis_names is None else request.axis_names[::-1])
    with open_file(path) as file:
        fields = {name: each for name, each in fields_of_hdf5(file, path).items() if each.size > 1}
        return to_plane(fields, {}, path, turned, partial(hold_open, path))


MATLAB_FORMAT = PlaneFormat(
    "MATLAB",
    lambda path, head: head.startswith(MATLAB) or (head[:8] == HDF5_SIGNATURE and path.suffix.lower() == ".mat"),
    open_matlab,
    tuple(each for each in HDF5.takes if each != "group"),
)
NPY_FORMAT = PlaneFormat(
    "numpy",
    lambda path, head: head[:6] == b"\x93NUMPY",
    partial(_open, arrays=npy_arrays),
    tuple(each for each in MATLAB_FORMAT.takes if each != "variable"),
)

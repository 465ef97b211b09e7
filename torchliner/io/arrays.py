"""Arrays of .npy, MATLAB and HDF5: one by its name, or a plane of which the user states axes, units and rate.

MATLAB files may hold X_unique, Y_unique, Z_unique, the coordinates of the axes x, y and z.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import loadmat

from torchliner.file_checks import naming, require_memory, require_regular
from torchliner.io.hdf5 import hold_open, open_file
from torchliner.io.plane_format import HDF5_SIGNATURE, PlaneFormat, PlaneRequest
from torchliner.io.to_plane import FORMAT as HDF5
from torchliner.io.to_plane import to_plane
from torchliner.io.variables import Field, Source, fields_of_hdf5
from torchliner.names import ARRAY_ENDINGS, did_you_mean
from torchliner.records import VelocityPlane

MATLAB = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")
Arrays = Callable[[Path], Mapping[str, np.ndarray]]


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
                fields = {name[1:]: each for name, each in fields_of_hdf5(file, path).items()}
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
        fields = {name: each for name, each in fields_of_hdf5(file, path).items() if each.size > 1}
        return to_plane(Source(path, fields, {}, partial(hold_open, path)), turned)


MATLAB_FORMAT = PlaneFormat(
    "MATLAB",
    lambda path, head: head.startswith(MATLAB) or (head[:8] == HDF5_SIGNATURE and path.suffix.lower() == ".mat"),
    open_matlab,
    tuple(each for each in HDF5.takes if each != "group"),
)
NPY_FORMAT = PlaneFormat(
    "numpy",
    lambda path, head: head[:6] == b"\x93NUMPY",
    partial(open_arrays, arrays=npy_arrays),
    tuple(each for each in MATLAB_FORMAT.takes if each != "variable"),
)

"""Plain arrays, .npy and MATLAB files, with every unit and axis stated by the user."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import loadmat, whosmat

from torchliner.checks import plain_array
from torchliner.file_checks import naming, require_memory, require_regular
from torchliner.io.hdf5 import open_file
from torchliner.io.stored_values import read_values
from torchliner.names import ARRAY_ENDINGS, did_you_mean, resolve
from torchliner.records import VelocityPlane
from torchliner.units import si_factor

AXES = ("time", "z", "x", "y", "probe")


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
        values: np.ndarray = resolve(ARRAY_ENDINGS[ending])(path, variable)
    if values.dtype.kind not in "fiu":
        raise ValueError(f"{path}: {variable or 'the array'} is {values.dtype}, not real numbers")
    return values


def read_npy(path: Path, variable: str | None) -> np.ndarray:
    """The array of a .npy file, read as it is used."""
    try:
        found = np.load(path, mmap_mode="c", allow_pickle=False)
    except Exception as error:  # whatever it says of damage
        raise ValueError(f"{path} is not a whole .npy file: {error}") from error
    if not isinstance(found, np.ndarray):
        raise ValueError(f"{path} is an archive of arrays (.npz), no .npy file; take one of them out")
    return found


def read_matlab(path: Path, variable: str | None) -> np.ndarray:
    """An array of a MATLAB file, v7.3 (HDF5) or before."""
    if h5py.is_hdf5(path):
        return read_hdf5(path, variable).T
    there = {name: shape for name, shape, _ in _mat5(whosmat, path)}
    chosen = _pick(list(there), variable, path)
    require_memory(8 * math.prod(there[chosen]), f"{path}: {chosen}, {there[chosen]},")
    return np.asarray(_mat5(loadmat, path, variable_names=[chosen])[chosen])


def read_hdf5(path: Path, variable: str | None) -> np.ndarray:
    """An array of an HDF5 file."""
    with open_file(path) as file:
        names = [k for k in file if isinstance(file.get(k), h5py.Dataset)]
        inside: list[str] = []  # of groups
        file.visititems(lambda k, v: inside.append(k) if isinstance(v, h5py.Dataset) else None)
        names += [k for k in inside if k not in names]
        name = _pick(names, variable, path)
        return read_values(file[name], f"{path}:/{name}", path)


def _mat5(function: Callable[..., Any], path: Path, **options: Any) -> Any:
    try:
        return function(path, **options)
    except Exception as error:  # whatever it says of damage
        raise ValueError(f"{path} is not a whole MATLAB file: {error}") from error


def _pick(names: Sequence[str], variable: str | None, path: Path) -> str:
    if variable is None and len(names) == 1:
        return names[0]
    if variable is None:
        raise ValueError(f"{path} holds {', '.join(names) or 'no array'}; name the one meant")
    if variable not in names:
        raise ValueError(
            f"{path} has no variable {variable!r}{did_you_mean(variable, list(names))}; it holds {', '.join(names)}"
        )
    return variable


def plane_from_array(
    values: np.ndarray,
    axes: Sequence[str],
    velocity_units: str,
    sampling_rate: float,
    *,
    towards_liner: bool = False,
    x: Any = None,
    z: Any = None,
    y: Any = None,
    row: int | None = None,
    length_units: str = "m",
    name: str = "array",
    **about: Any,
) -> VelocityPlane:
    """A plane from an array whose axes and units are stated, not guessed.

    Args:
        values: real array.
        axes: one name per axis of ``values``: ``time`` and ``probe``, or any of ``z``, ``x``; also
            ``y``, the heights of particle images, of which one is taken.
        velocity_units: "m/s", "mm/s", ...
        sampling_rate: Hz.
        towards_liner: the data are positive INTO the liner; they are turned.
        x, z, y: coordinates in ``length_units``; that of ``row`` becomes the plane's height.
        row: which y, from 0; needed with an axis y.
        about: further arguments of ``VelocityPlane``, in SI.
    Raises:
        TypeError: complex or not numeric.
        ValueError: axes do not fit the array, unknown unit.
    """
    values = plain_array(values, name, missing=True)
    if values.dtype.kind not in "fiu":
        raise TypeError(f"{name} is {values.dtype}; real numbers are needed")
    values = np.squeeze(values) if values.ndim > len(axes) else np.asarray(values)
    require_axes(axes, values.shape, name)
    values, axes, height = _one_height(values, axes, y, row, name)
    order = [axis for axis in ("probe", "z", "x", "time") if axis in axes]
    arranged = values.transpose([list(axes).index(axis) for axis in order])
    if values.dtype.kind != "f":
        arranged = arranged.astype(np.float64)
    factor = si_factor("velocity", velocity_units, f"{name} velocity")
    factor = -factor if towards_liner else factor
    scaled = arranged if factor == 1 else (arranged * arranged.dtype.type(factor))
    metre = si_factor("length", length_units, f"{name} coordinates")
    if height is not None:
        about = {"height": height * metre, **about}
    return VelocityPlane(
        scaled,
        sampling_rate=sampling_rate,
        x=None if x is None else np.asarray(plain_array(x, f"{name}: x"), float).reshape(-1) * metre,
        z=None if z is None else np.asarray(plain_array(z, f"{name}: z"), float).reshape(-1) * metre,
        name=name,
        **about,
    )


def require_axes(axes: Sequence[str], shape: Sequence[int], name: str) -> None:
    """Refuse names of axes that are no plane's, or not as many as an array has.

    Raises:
        ValueError: they are.
    """
    unknown = [axis for axis in axes if axis not in AXES]
    mixed = "probe" in axes and len(axes) > 2
    if unknown or mixed or len(set(axes)) != len(axes) or "time" not in axes:
        raise ValueError(
            f"axes are {','.join(axes)}; 'time' and probe, or any of z and x, each once, are needed"
            ", or x and y with a row of y"
        )
    if len(axes) != len(shape):
        raise ValueError(f"{name} has shape {tuple(shape)}, but {len(axes)} axes are named: {','.join(axes)}")


def read_array_plane(
    path: str | Path, variable: str | None = None, *, axes: Any = None, velocity_units: Any = None,
    sampling_rate: Any = None, towards_liner: bool = False, x: str | None = None,
    z: str | None = None, y: str | None = None, row: int | None = None, length_units: str = "m",
) -> VelocityPlane:  # fmt: skip
    """The plane in a file of arrays: ``torchliner convert --layout array``.

    Args:
        path, variable: as for ``read_array``.
        axes: names separated by commas.
        x, z, y: FILE or FILE:VARIABLE.
        velocity_units, ...: as for ``plane_from_array``.
    Raises:
        ValueError: axes, unit or rate is None; as ``read_array`` and ``plane_from_array``.
    """
    needed = {"axes": axes, "velocity_units": velocity_units, "sampling_rate": sampling_rate}
    for name, value in needed.items():
        if value is None:
            raise ValueError(f"--{name.replace('_', '-')} is needed for an array: nothing about it is guessed")
    coordinates = {}
    for name, where in (("x", x), ("z", z), ("y", y)):
        if where is not None:
            file, _, inside = where.partition(":")
            coordinates[name] = read_array(file, inside or None)
    return plane_from_array(
        read_array(path, variable), axes.split(","), velocity_units, sampling_rate,
        towards_liner=towards_liner, row=row, length_units=length_units, name=str(path),
        **coordinates,
    )  # fmt: skip


def _one_height(
    values: np.ndarray, axes: Sequence[str], y: Any, row: int | None, name: str
) -> tuple[np.ndarray, list[str], float | None]:
    """The array at one y, its axes, and that y where it is known."""
    if "y" not in axes:
        if row is not None or y is not None:
            raise ValueError(f"{name}: row and y are for an array with an axis y; name it in axes")
        return values, list(axes), None
    axis = list(axes).index("y")
    count = values.shape[axis]
    if row is None or not 0 <= row < count:
        stated = "which is not stated" if row is None else f"not {row}"
        raise ValueError(f"{name} has {count} heights; row is 0 to {count - 1}, {stated}")
    heights = None if y is None else np.asarray(y, float).reshape(-1)
    if heights is not None and len(heights) != count:
        raise ValueError(f"{name} has {count} heights, y has {len(heights)} values")
    kept = [each for each in axes if each != "y"]
    height = None if heights is None else float(heights[row])
    return values.take(row, axis=axis), kept, height

"""Plain arrays, .npy and MATLAB files, with every unit and axis stated by the user."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import loadmat, whosmat
from scipy.io.matlab import MatReadError

from torchliner.io.hdf5 import open_file
from torchliner.names import did_you_mean
from torchliner.records import VelocityPlane
from torchliner.units import si_factor

AXES = ("time", "z", "x", "y", "probe")


def read_array(path: str | Path, variable: str | None = None) -> np.ndarray:
    """An array from .npy, .mat (v5 or v7.3) or .h5; v7.3 axes are put back in MATLAB's order.

    Args:
        path: file.
        variable: name in a .mat or .h5 file; may be left out if the file holds one array.
    Raises:
        ValueError: unknown ending, unknown variable, not numeric.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file")
    kind = path.suffix.lower()
    if kind == ".npy":
        try:
            values = np.load(path, mmap_mode="c", allow_pickle=False)
        except (ValueError, EOFError) as error:
            raise ValueError(f"{path} is not a whole .npy file: {error}") from error
    elif kind == ".mat" and not h5py.is_hdf5(path):
        chosen = _pick([name for name, _, _ in _mat5(whosmat, path)], variable, path)
        values = _mat5(loadmat, path, variable_names=[chosen])[chosen]
    elif kind in (".mat", ".h5", ".hdf5", ".nc"):
        with open_file(path) as file:
            names = [k for k, v in file.items() if isinstance(v, h5py.Dataset)]
            values = file[_pick(names, variable, path)][()]
        if kind == ".mat":
            values = values.T
    else:
        raise ValueError(f"{path}: .npy, .mat or .h5 is needed, not {kind or 'no ending'!r}")
    if values.dtype.kind not in "fiu":
        raise ValueError(f"{path}: {variable or 'the array'} is {values.dtype}, not real numbers")
    return values


def _mat5(function: Callable[..., Any], path: Path, **options: Any) -> Any:
    try:
        return function(path, **options)
    except (ValueError, OSError, MatReadError, zlib.error) as error:
        raise ValueError(f"{path} is not a whole MATLAB file: {error}") from error


def _pick(names: Sequence[str], variable: str | None, path: Path) -> str:
    if variable is None and len(names) == 1:
        return names[0]
    if variable is None:
        raise ValueError(f"{path} holds {', '.join(names) or 'no array'}; name the one meant")
    if variable not in names:
        raise ValueError(
            f"{path} has no variable {variable!r}{did_you_mean(variable, list(names))}; it holds "
            f"{', '.join(names)}"
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
    if values.dtype.kind not in "fiu":
        raise TypeError(f"{name} is {values.dtype}; real numbers are needed")
    values = np.squeeze(values) if values.ndim > len(axes) else np.asarray(values)
    unknown = [axis for axis in axes if axis not in AXES]
    mixed = "probe" in axes and len(axes) > 2
    if unknown or mixed or len(set(axes)) != len(axes) or "time" not in axes:
        raise ValueError(
            f"axes are {','.join(axes)}; 'time' and probe, or any of z and x, each once, are needed"
            ", or x and y with a row of y"
        )
    if len(axes) != values.ndim:
        raise ValueError(
            f"{name} has shape {values.shape}, but {len(axes)} axes are named: {','.join(axes)}"
        )
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
        x=None if x is None else np.asarray(x, float).reshape(-1) * metre,
        z=None if z is None else np.asarray(z, float).reshape(-1) * metre,
        name=name,
        **about,
    )


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
        said = "which is not stated" if row is None else f"not {row}"
        raise ValueError(f"{name} has {count} heights; row is 0 to {count - 1}, {said}")
    heights = None if y is None else np.asarray(y, float).reshape(-1)
    if heights is not None and len(heights) != count:
        raise ValueError(f"{name} has {count} heights, y has {len(heights)} values")
    kept = [each for each in axes if each != "y"]
    height = None if heights is None else float(heights[row])
    return values.take(row, axis=axis), kept, height

"""Results as VTKHDF, which ParaView and pyvista open: a picture of values over (x, z)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.file_names import frequency_ends
from torchliner.io.own_file import OwnFile
from torchliner.io.result_writers import ResultWriter
from torchliner.io.whole_file import written_whole

UNIFORM = 1e-6  # of a spacing, that places of an image may be off
Fields = dict[str, np.ndarray]


def write_vtkhdf(file: OwnFile, record: Any, path: str | Path) -> None:
    """The rows of the CSV at their places: an image where x and z are uniform, else points,
    with quadrilaterals between them where rows and columns form a grid.

    Lengths in m; ``height`` of a plane is y; a coordinate that is unknown is 0. Each column is an
    array, with several frequencies one each ("resistance_1400Hz").

    Raises:
        ValueError: no place has a coordinate.
    """
    rows = file.rows(record, next(iter(file.places)))
    frequencies = list(dict.fromkeys(row["frequency (Hz)"] for row in rows))
    height = getattr(record, "height", None) or 0.0
    unknown = {"x (m)": np.nan, "y (m)": height, "z (m)": np.nan}
    places = np.array([[row.get(axis, unknown[axis]) for axis in unknown] for row in rows[:: len(frequencies)]])
    WRITER.require(path, len(frequencies), bool(np.isfinite(places[:, (0, 2)]).any()))
    places = np.nan_to_num(places)
    fields: Fields = {}
    for heading in rows[0]:
        name = heading.split(" (")[0].replace(" ", "_").replace(",", "")
        if "(m)" in heading or "(Hz)" in heading or isinstance(rows[0][heading], str | None):
            continue
        values = np.array([row[heading] for row in rows], dtype=np.float64)
        for i, end in enumerate(frequency_ends(frequencies)):
            fields[name + end] = values[i :: len(frequencies)]
    with written_whole(path, ".vtkhdf") as temporary, h5py.File(temporary, "w") as whole:
        root = whole.create_group("VTKHDF", track_order=True)
        root.attrs["Version"] = (2, 2)
        grid = _grid(places)
        spacings = [] if grid is None else [*map(_spacing, grid)]
        if grid is not None and all(spacings):
            _image(root, places, (len(grid[0]), len(grid[1])), spacings, fields)
        else:
            _points(root, places, grid, fields)


def _grid(places: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Columns x and rows z of places that lie z outside x on a grid, or None."""
    x, z = places[:, 0], places[:, 2]
    across = int(np.argmax(z != z[0])) or len(z)
    if len(x) % across:
        return None
    columns, lines = x[:across], z[::across]
    whole = np.array_equal(x, np.tile(columns, len(lines))) and np.array_equal(z, np.repeat(lines, across))
    flat = bool((places[:, 1] == places[0, 1]).all())
    return (columns, lines) if whole and flat else None


def _spacing(values: np.ndarray) -> float:
    """Of uniform increasing values; 1 m for a single one, 0 where there is none."""
    steps = np.diff(values)
    if not len(steps):
        return 1.0
    even = steps.mean() > 0 and np.ptp(steps) <= UNIFORM * steps.mean()
    return float(steps.mean()) if even else 0.0


def _image(root: h5py.Group, places: np.ndarray, size: tuple[int, int], spacing: list[float], fields: Fields) -> None:
    columns, lines = size
    root.attrs["Type"] = np.bytes_("ImageData")
    root.attrs["WholeExtent"] = (0, columns - 1, 0, 0, 0, lines - 1)
    root.attrs["Origin"] = places[0]
    root.attrs["Spacing"] = (spacing[0], 1.0, spacing[1])
    root.attrs["Direction"] = np.eye(3).reshape(-1)
    point = root.create_group("PointData")
    # VTK takes as many axes as the image has: two of a plane, one of a line.
    shape = [count for count in (lines, columns) if count > 1] or [1]
    for name, values in fields.items():
        point[name] = values.reshape(shape)


def _points(root: h5py.Group, places: np.ndarray, grid: tuple[np.ndarray, np.ndarray] | None, fields: Fields) -> None:
    root.attrs["Type"] = np.bytes_("PolyData")
    root["NumberOfPoints"] = [len(places)]
    root["Points"] = places
    number = np.arange(len(places))
    corners, kind = number[:, None], "Vertices"
    if grid is not None and min(map(len, grid)) > 1:
        at = number.reshape(len(grid[1]), len(grid[0]))
        corners = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], -1)
        kind = "Polygons"
    corners = corners.reshape(-1, corners.shape[-1])
    for name in ("Vertices", "Lines", "Polygons", "Strips"):
        own = corners if name == kind else corners[:0]
        part = root.create_group(name)
        part["NumberOfCells"] = [len(own)]
        part["NumberOfConnectivityIds"] = [own.size]
        part["Connectivity"] = own.reshape(-1)
        part["Offsets"] = own.shape[1] * np.arange(len(own) + 1)
    point = root.create_group("PointData")
    for label, values in fields.items():
        point[label] = values


WRITER = ResultWriter(write_vtkhdf, places=True)

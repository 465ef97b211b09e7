"""Results for ParaView and pyvista, a picture of values over (x, z): .vtp, which every version opens, and .vtkhdf, for
ParaView 5.12, VTK 9.3 and later."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import h5py
import numpy as np

from torchliner.file_names import frequency_ends
from torchliner.io.own_file import OwnFile
from torchliner.io.result_writers import require_result
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
    places, fields = _at_places(file, record, path)
    with written_whole(path, ".vtkhdf") as temporary, h5py.File(temporary, "w") as whole:
        root = whole.create_group("VTKHDF", track_order=True)
        root.attrs["Version"] = (2, 2)
        grid = _grid(places)
        spacings = [] if grid is None else [*map(_spacing, grid)]
        if grid is not None and all(spacings):
            _image(root, places, (len(grid[0]), len(grid[1])), spacings, fields)
        else:
            _points(root, places, grid, fields)


def write_vtp(file: OwnFile, record: Any, path: str | Path) -> None:
    """The same as points, with quadrilaterals where rows and columns form a grid, in VTK's XML."""
    places, fields = _at_places(file, record, path)
    kind, corners = _cells(places, _grid(places))
    parts = {
        "PointData": fields,
        "Points": {"Points": places},
        {"Vertices": "Verts", "Polygons": "Polys"}[kind]: {
            "connectivity": corners.reshape(-1),
            "offsets": corners.shape[1] * np.arange(1, len(corners) + 1),
        },
    }
    cells = f'NumberOf{"Verts" if kind == "Vertices" else "Polys"}="{len(corners)}"'
    lines = ['<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64"><PolyData>']
    lines.append(f'<Piece NumberOfPoints="{len(places)}" {cells}>')
    for part, arrays in parts.items():
        lines += [f"<{part}>", *(_array(name, values) for name, values in arrays.items()), f"</{part}>"]
    with written_whole(path, ".vtp") as temporary:
        temporary.write_text("\n".join([*lines, "</Piece></PolyData></VTKFile>\n"]), encoding="utf-8")


def _array(name: str, values: np.ndarray) -> str:
    """One array, in base64 behind its length in bytes."""
    kind = "Int64" if values.dtype.kind == "i" else "Float64"
    raw = values.astype("<i8" if kind == "Int64" else "<f8").tobytes()
    text = base64.b64encode(np.uint64(len(raw)).astype("<u8").tobytes() + raw).decode("ascii")
    width = f' NumberOfComponents="{values.shape[1]}"' if values.ndim > 1 else ""
    return f'<DataArray type="{kind}" Name={quoteattr(name)}{width} format="binary">{text}</DataArray>'


def _at_places(file: OwnFile, record: Any, path: str | Path) -> tuple[np.ndarray, Fields]:
    """Places, m, (P, 3), and the columns of the CSV there."""
    rows = file.rows(record, next(iter(file.places)))
    frequencies = list(dict.fromkeys(row["frequency (Hz)"] for row in rows))
    height = getattr(record, "height", None) or 0.0
    unknown = {"x (m)": np.nan, "y (m)": height, "z (m)": np.nan}
    places = np.array([[row.get(axis, unknown[axis]) for axis in unknown] for row in rows[:: len(frequencies)]])
    require_result(path, len(frequencies), bool(np.isfinite(places[:, (0, 2)]).any()))
    places = np.nan_to_num(places)
    fields: Fields = {}
    for heading in rows[0]:
        name = heading.split(" (")[0].replace(" ", "_").replace(",", "")
        if "(m)" in heading or "(Hz)" in heading or isinstance(rows[0][heading], str | None):
            continue
        values = np.array([row[heading] for row in rows], dtype=np.float64)
        for i, end in enumerate(frequency_ends(frequencies)):
            fields[name + end] = values[i :: len(frequencies)]
    return places, fields


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
    kind, corners = _cells(places, grid)
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


def _cells(places: np.ndarray, grid: tuple[np.ndarray, np.ndarray] | None) -> tuple[str, np.ndarray]:
    """Quadrilaterals of a grid, (C, 4), else a vertex each point, (P, 1)."""
    number = np.arange(len(places))
    if grid is None or min(map(len, grid)) < 2:
        return "Vertices", number[:, None]
    at = number.reshape(len(grid[1]), len(grid[0]))
    return "Polygons", np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], -1).reshape(-1, 4)

"""Results for ParaView and pyvista, values over (x, z): .vtp, which every version opens, and .vtkhdf, for ParaView
5.12, VTK 9.3 and later."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import h5py
import numpy as np

from torchliner.io.csv_rows import result_rows
from torchliner.io.result_writers import require_result
from torchliner.io.whole_file import written_whole
from torchliner.names import frequency_ends


def write_vtkhdf(record: Any, path: str | Path) -> None:
    """The rows of the CSV at their places, as points, with quadrilaterals where probes are (z, x).

    Lengths in m; ``height`` of a plane is y; a coordinate that is unknown is 0. Each column is an
    array, with several frequencies one each ("resistance_1400Hz").

    Raises:
        ValueError: no place has a coordinate.
    """
    places, fields, corners = _at_places(record, path)
    kind = "Vertices" if corners.shape[1] == 1 else "Polygons"
    with written_whole(path, ".vtkhdf") as temporary, h5py.File(temporary, "w") as file:
        root = file.create_group("VTKHDF", track_order=True)
        root.attrs["Version"], root.attrs["Type"] = (2, 0), np.bytes_("PolyData")
        root["NumberOfPoints"], root["Points"] = [len(places)], places
        for name in ("Vertices", "Lines", "Polygons", "Strips"):
            own = corners if name == kind else corners[:0]
            part = root.create_group(name)
            part["NumberOfCells"], part["NumberOfConnectivityIds"] = [len(own)], [own.size]
            part["Connectivity"], part["Offsets"] = own.reshape(-1), own.shape[1] * np.arange(len(own) + 1)
        for label, values in fields.items():
            root[f"PointData/{label}"] = values


def write_vtp(record: Any, path: str | Path) -> None:
    """The same in VTK's XML."""
    places, fields, corners = _at_places(record, path)
    kind = "Verts" if corners.shape[1] == 1 else "Polys"
    offsets = corners.shape[1] * np.arange(1, len(corners) + 1)
    cells = {"connectivity": corners.reshape(-1), "offsets": offsets}
    lines = ['<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64"><PolyData>']
    lines.append(f'<Piece NumberOfPoints="{len(places)}" NumberOf{kind}="{len(corners)}">')
    for part, arrays in {"PointData": fields, "Points": {"Points": places}, kind: cells}.items():
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


def _at_places(record: Any, path: str | Path) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
    """Places, m, (P, 3), the columns of the CSV there, and the corners of the cells: of quadrilaterals between probes
    (z, x), (C, 4), else a vertex each place, (P, 1)."""
    rows = result_rows(record)
    frequencies = list(dict.fromkeys(row["frequency (Hz)"] for row in rows))
    unknown = {"x (m)": np.nan, "y (m)": getattr(record, "height", None) or 0.0, "z (m)": np.nan}
    places = np.array([[row.get(axis, unknown[axis]) for axis in unknown] for row in rows[:: len(frequencies)]])
    require_result(path, len(frequencies), bool(np.isfinite(places[:, (0, 2)]).any()))
    fields: dict[str, np.ndarray] = {}
    for heading, first in rows[0].items():
        if "(m)" not in heading and "(Hz)" not in heading and not isinstance(first, str):
            name = heading.split(" (")[0].replace(" ", "_").replace(",", "")
            values = np.array([row[heading] for row in rows], dtype=np.float64)
            ends = frequency_ends(frequencies)
            fields |= {name + end: values[i :: len(frequencies)] for i, end in enumerate(ends)}
    number = np.arange(len(places))[:, None]
    if getattr(record, "axes", {}).get("probes") == ("z", "x") and min(record.mean_velocity.shape) > 1:
        at = number.reshape(record.mean_velocity.shape)
        number = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], -1).reshape(-1, 4)
    return np.nan_to_num(places), fields, number

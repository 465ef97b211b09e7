"""Results for other programs: MATLAB; ParaView and pyvista; solvers that read columns of text, or poles and
residues."""

import base64
import json
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import h5py
import numpy as np
from torch import Tensor

from torchliner.io.csv_rows import result_rows
from torchliner.io.hdf5 import text_attribute
from torchliner.io.own_writer import complex_names, fill, in_memory
from torchliner.io.whole_file import printable, written_whole
from torchliner.liners.multipole import Multipole
from torchliner.names import __version__, frequency_ends

AT_PLACES = (".vtp", ".vtkhdf")
MULTIPOLE = "torchliner multipole 1"
REAL = 1e-8  # relative: an imaginary part below it is rounding
POLES = """\
// {title}
// torchliner {version}; fitted from {low:g} to {high:g} Hz, R within {error:.2g}; stable, |R| <= 1 at every frequency
// Z = p/(rho c v) and R = (Z - 1)/(Z + 1), v into the wall, s = j omega with exp(+j omega t); in 1/s:
// constant + sum A/(s + lambda) + sum 1/2 [(B + jC)/(s + alpha + j beta) + (B - jC)/(s + alpha - j beta)]
"""


def require_places(path: str | Path, places: bool) -> None:
    """Refuse a name in whose format a result without ``places``, x or z, could not be written, also before the work."""
    ending = Path(path).suffix.lower()
    if ending in AT_PLACES and not places:
        raise ValueError(
            f"{path}: a {ending} needs places and the result has no x or z; state them in the data, or write .csv"
        )


def write_matlab(record: Any, path: str | Path) -> None:
    """One struct ``result`` (MATLAB v5), groups as structs within it, ``choices`` as JSON."""
    from scipy.io import savemat

    with in_memory() as (buffer, file):
        fill(file, record)
    with h5py.File(buffer) as whole:
        found = _plain(whole)
    with written_whole(path, ".mat") as temporary:
        savemat(str(temporary), {"result": found}, appendmat=False, long_field_names=True, oned_as="column")


def _plain(group: h5py.Group) -> dict[str, Any]:
    """Variables and texts of a group; a real and an imaginary part become one array."""
    said = {key: text_attribute(group, key) for key in group.attrs if not key.startswith("_")}
    found: dict[str, Any] = {key: text for key, text in said.items() if text is not None}
    for name, each in group.items():
        if isinstance(each, h5py.Group):
            found[name] = _plain(each)
        elif "units" in each.attrs or each.dtype.kind == "O":  # not the length of a dimension alone
            texts = h5py.check_string_dtype(each.dtype)
            found[name] = np.array(each.asstr()[()], dtype=object) if texts else each[()]
    for name, (real, imaginary) in complex_names(found).items():
        found[name] = found.pop(real) + 1j * found.pop(imaginary)
    return found


def write_solver_table(record: Any, path: str | Path) -> None:
    """f, R, X of the whole liner in the order of f, a line each, after comments that begin with ``%``, as COMSOL reads
    them; a ValueError where Z is not finite somewhere: a solver would interpolate over it."""
    value = record.answer.detach().cpu().numpy()
    table = np.stack([record.frequency.numpy(), value.real, value.imag], 1)
    if (bad := ~np.isfinite(table).all(1)).any():
        at = table[bad, 0].tolist()
        raise ValueError(f"{path}: Z of the whole liner is not finite at {at} Hz; educe without these frequencies")
    title = " ".join(printable(getattr(record, "title", "") or getattr(record, "name", "")).split())
    said = "Z = R + jX of the whole liner, normalised by rho c, exp(+j omega t), v into the liner"
    heading = "\n".join([*filter(None, [title]), said, "frequency (Hz), resistance (rho c), reactance (rho c)"])
    with written_whole(path, ".txt") as temporary:
        rows = table[table[:, 0].argsort()]
        np.savetxt(temporary, rows, fmt="%.10g", comments="% ", header=heading, encoding="utf-8")


# For ParaView and pyvista, values over (x, z)


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
    require_places(path, bool(np.isfinite(places[:, (0, 2)]).any()))
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


# Poles and residues, as JSON or as the coefficient lists that solvers in the time domain take


def coefficients_of(poles: Tensor, residues: Tensor) -> dict[str, list[list[float]]]:
    """Real poles as (lambda, A), conjugate pairs as (alpha, beta, B, C), all in 1/s; see ``POLES``."""
    real, pairs = [], []
    for p, r in zip(poles.tolist(), residues.tolist(), strict=True):
        if abs(p.imag) <= REAL * abs(p):
            real.append([-p.real, r.real])
        elif p.imag > 0:
            pairs.append([-p.real, p.imag, 2 * r.real, -2 * r.imag])
    return {"real_poles": real, "complex_poles": pairs}


def plain_multipole(model: Multipole) -> dict[str, Any]:
    """What is written as JSON."""
    return {
        "schema": MULTIPOLE,
        "version": __version__,
        "convention": "Z = p/(rho c v), R = (Z - 1)/(Z + 1), exp(+j omega t), v into the wall, 1/s",
        "band": list(model.band),
        "error": model.error,
        "correction": model.correction,
        "reflection": {"constant": 1.0, **coefficients_of(model.poles, model.residues)},
        "admittance": {"constant": 0.0, **coefficients_of(*model.admittance())},
        "about": model.about,
    }


def write_multipole(model: Multipole, path: str | Path) -> None:
    """Write one file: ``.json``, or ``.txt`` with the lists of R and of the admittance as dictionaries of OpenFOAM.

    Raises:
        ValueError, OSError: as ``written_whole``.
    """
    plain = plain_multipole(model)
    with written_whole(path, ".json", ".txt") as temporary:
        if Path(path).suffix.lower() == ".json":
            temporary.write_text(json.dumps(plain, indent=1), encoding="utf-8")
            return
        title = printable(str(model.about.get("source", ""))) or "impedance as poles and residues"
        low, high = model.band
        text = POLES.format(title=title, version=__version__, low=low, high=high, error=model.error)
        parts = [_dictionary(name, plain[name]) for name in ("reflection", "admittance")]
        temporary.write_text("\n".join([text, *parts]), encoding="utf-8")


def _dictionary(name: str, held: dict[str, Any]) -> str:
    lines = [name, "{", f"    constant      {held['constant']:.17g};"]
    for key, rows in (("realPoles", held["real_poles"]), ("complexPoles", held["complex_poles"])):
        numbers = [f"        ({' '.join(f'{value:.17g}' for value in row)})" for row in rows]
        lines += [f"    {key}", "    (", *numbers, "    );"]
    return "\n".join([*lines, "}", ""])

"""Results for other programs: MATLAB, ParaView, solvers that read columns of text, or poles and residues."""

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from torch import Tensor

from torchliner.io.csv_rows import result_rows
from torchliner.io.own_writer import complex_names, to_xarray
from torchliner.io.whole_file import printable, written_whole
from torchliner.liners.multipole import Multipole
from torchliner.names import __version__, frequency_ends

AT_PLACES = (".vtp", ".vtkhdf")
REAL = 1e-8  # relative: an imaginary part below it is rounding
ROUND = str.maketrans("[]", "()")
FORMULA = (
    "constant + sum A/(s + lambda) + sum 1/2 [(B + jC)/(s + alpha + j beta) + (B - jC)/(s + alpha - j beta)], "
    "real_poles: (lambda, A), complex_poles: (alpha, beta, B, C)"
)


def write_matlab(record: Any, path: str | Path) -> None:
    """One struct ``result`` (MATLAB v5) of variables and attributes, ``choices`` as JSON."""
    from scipy.io import savemat

    data = to_xarray(record)
    data = data.drop_vars([part for both in complex_names(data.variables).values() for part in both])
    held = dict(data.attrs)
    for name, each in data.variables.items():
        held[name] = each.values if each.dtype.kind in "iufc" else each.values.astype(object)  # texts: a cell array
    with written_whole(path, ".mat") as temporary:
        savemat(str(temporary), {"result": held}, appendmat=False, long_field_names=True, oned_as="column")


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


def require_places(path: str | Path, places: bool) -> None:
    """Refuse a name in whose format a result without ``places``, x or z, could not be written, also before the work."""
    ending = Path(path).suffix.lower()
    if ending in AT_PLACES and not places:
        raise ValueError(
            f"{path}: a {ending} needs places and the result has no x or z; state them in the data, or write .csv"
        )


def write_vtk(record: Any, path: str | Path) -> None:
    """The rows of the usual places, as points, with quadrilaterals where probes are (z, x); a ValueError where no place
    has a coordinate.

    Lengths in m; ``height`` of a plane is y; a coordinate that is unknown is 0. Each column is an array, with several
    frequencies one each ("resistance_1400Hz").
    """
    import pyvista

    rows = result_rows(record, next(iter(record.PLACES)))
    frequencies = list(dict.fromkeys(row["frequency (Hz)"] for row in rows))
    unknown = {"x (m)": np.nan, "y (m)": getattr(record, "height", None) or 0.0, "z (m)": np.nan}
    places = np.array([[row.get(axis, unknown[axis]) for axis in unknown] for row in rows[:: len(frequencies)]])
    require_places(path, bool(np.isfinite(places[:, (0, 2)]).any()))
    number, kind = np.arange(len(places))[:, None], "verts"
    if getattr(record, "axes", {}).get("probes") == ("z", "x") and min(record.mean_velocity.shape) > 1:
        at, kind = number.reshape(record.mean_velocity.shape), "faces"
        number = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], -1).reshape(-1, 4)
    cells: Any = {kind: np.insert(number, 0, number.shape[1], axis=1)}
    mesh = pyvista.PolyData(np.nan_to_num(places), **cells)
    for heading, first in rows[0].items():
        if "(m)" not in heading and "(Hz)" not in heading and not isinstance(first, str):
            name = heading.split(" (")[0].replace(" ", "_").replace(",", "")
            values = np.array([row[heading] for row in rows], dtype=np.float64)
            for i, end in enumerate(frequency_ends(frequencies)):
                mesh.point_data[name + end] = values[i :: len(frequencies)]
    with written_whole(path, *AT_PLACES) as temporary, TemporaryDirectory() as folder:
        mesh.save(named := Path(folder) / f"mesh{Path(path).suffix.lower()}")
        temporary.write_bytes(named.read_bytes())


# Poles and residues, for solvers in the time domain


def coefficients_of(poles: Tensor, residues: Tensor) -> dict[str, list[list[float]]]:
    """Real poles as (lambda, A), conjugate pairs as (alpha, beta, B, C), all in 1/s; see ``plain_multipole``."""
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
        "schema": "torchliner multipole 1",
        "version": __version__,
        "convention": "Z = p/(rho c v), R = (Z - 1)/(Z + 1), s = j omega with exp(+j omega t), v into the wall, 1/s",
        "formula": FORMULA,
        "band": list(model.band),
        "error": model.error,
        "correction": model.correction,
        "reflection": {"constant": 1.0, **coefficients_of(model.poles, model.residues)},
        "admittance": {"constant": 0.0, **coefficients_of(*model.admittance())},
        "about": model.about,
    }


def write_multipole(model: Multipole, path: str | Path) -> None:
    """Write one file: ``.json``, or ``.txt`` with the lists as dictionaries of OpenFOAM, the rest in comments."""
    plain = plain_multipole(model)
    lines = [f"// {key}: {printable(str(value))}" for key, value in plain.items() if not isinstance(value, dict)]
    for name in ("reflection", "admittance"):
        rows = {key: str(value).replace(",", "").translate(ROUND) for key, value in plain[name].items()}
        lines += [name, "{", *(f"    {key} {row};" for key, row in rows.items()), "}"]
    with written_whole(path, ".json", ".txt") as temporary:
        text = "\n".join([*lines, ""]) if Path(path).suffix.lower() == ".txt" else json.dumps(plain, indent=1)
        temporary.write_text(text, encoding="utf-8")

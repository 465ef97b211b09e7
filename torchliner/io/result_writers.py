"""Results as rows of tables, one a place and frequency, and for other programs: ParaView, solvers that read columns of
text, or poles and residues."""

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TextIO

import numpy as np
from torch import Tensor

from torchliner.io.own_writer import dims_of, to_xarray
from torchliner.io.whole_file import printable, written_whole
from torchliner.liners.multipole import Multipole
from torchliner.names import __version__, frequency_ends
from torchliner.records.outlets import Result

Rows = list[dict[str, Any]]
DIGITS = ".9g"  # of numbers in the CSV of a result
BOUNDS = [f"{part}_{end}" for part in ("resistance", "reactance") for end in ("low", "high")]
LEADING = ("name", "x (m)", "y (m)", "z (m)", "frequency (Hz)", "resistance", "reactance", *BOUNDS)
AT_PLACES = (".vtp", ".vtkhdf")
REAL = 1e-8  # relative: an imaginary part below it is rounding
ROUND = str.maketrans("[]", "()")
FORMULA = (
    "constant + sum A/(s + lambda) + sum 1/2 [(B + jC)/(s + alpha + j beta) + (B - jC)/(s + alpha - j beta)], "
    "real_poles: (lambda, A), complex_poles: (alpha, beta, B, C)"
)


def write_result_csv(record: Result, path: str | Path) -> None:
    """The rows of the usual place."""
    write_rows(result_rows(record), path, DIGITS)


def to_dataframe(record: Result, of: str | None = None) -> Any:
    """The rows of the CSV, or those of another place; a ValueError where there are no such rows."""
    import pandas

    return pandas.DataFrame(result_rows(record, of))


def result_rows(record: Result, of: str | None = None) -> Rows:
    """One row a place and frequency: coordinates, then what stands along them; ``of``: a key of its ``PLACES``, default
    the first, or all of them; a ValueError for others.

    Names without the noun that they begin with; with several averagings a column each.
    """
    if of not in (None, *record.PLACES):
        raise ValueError(f"no rows of {of!r}; there are those of {', '.join(record.PLACES)}")
    data = to_xarray(record)
    if not record.TOGETHER:
        return _rows_of(data, record, of or next(iter(record.PLACES)))
    several = {each: _rows_of(data, record, each) for each in record.PLACES if of in (None, each)}
    return [{"place": each.removesuffix("s"), **row} for each, rows in several.items() for row in rows]


def _rows_of(data: Any, record: Result, of: str) -> Rows:
    noun, places = of.removesuffix("s"), dims_of(record.PLACES[of], getattr(record, "axes", {}))
    sizes = {dim: data.sizes.get(dim, 1) for dim in (*places, "frequency")}
    columns: dict[str, list[Any]] = {}
    for name, each in data.variables.items():
        own = {*each.dims} - {"averaging"}
        of_all = own == {"frequency"} and not name.startswith((f"{noun}_", "frequency"))  # not of these places
        if not own or not own <= {*sizes} or of_all or np.iscomplexobj(each):
            continue
        label = name.removeprefix(f"{noun}_") + ("" if (unit := each.attrs.get("units", "1")) == "1" else f" ({unit})")
        several = {label: each}
        if "averaging" in each.dims:
            several = {f"{label}, {one}": each[{"averaging": i}] for i, one in enumerate(data["averaging"].values)}
        columns |= {key: one.set_dims(sizes).values.ravel().tolist() for key, one in several.items()}
    order = [*(key for key in LEADING if key in columns), *(key for key in columns if key not in LEADING)]
    return [dict(zip(order, row, strict=True)) for row in zip(*(columns[key] for key in order), strict=True)]


def write_rows(rows: Sequence[Mapping[str, Any]], path: str | Path, number: str = "") -> None:
    """A CSV file with the headings of all rows, at least one, whole or not at all; ``number``: format, as ".9g",
    default as many digits as they have."""
    with written_whole(path, ".csv") as temporary, temporary.open("w", newline="") as file:
        fill_csv(file, rows, number)


def fill_csv(file: TextIO, rows: Sequence[Mapping[str, Any]], number: str = "") -> None:
    """Into what is open, in memory too; arguments as for ``write_rows``."""

    def cell(value: Any) -> Any:
        if isinstance(value, str):
            return printable(value)
        return value if value is None or not number else f"{value:{number}}"

    writer = csv.writer(file)
    headings = dict.fromkeys(key for row in rows for key in row)
    writer.writerow(map(cell, headings))
    writer.writerows([cell(row.get(key)) for key in headings] for row in rows)


# For other programs


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

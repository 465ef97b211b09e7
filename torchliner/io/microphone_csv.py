"""A line of microphones as CSV: '# key = value unit' lines, a header with units, the values.

Columns ``x``, ``frequency`` (unless one is stated above), ``spl`` and ``phase``, in any order, one
row for each microphone and frequency.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchliner.checks import plain_number
from torchliner.fluid import Fluid
from torchliner.io.axes import FLUID
from torchliner.io.hdf5 import written_whole
from torchliner.records import MicrophoneLine
from torchliner.text_columns import (
    header_line,
    named_columns,
    read_lines,
    si_value,
    stated_text,
    stated_values,
)

Array = NDArray[np.float64]
SCALARS = {
    "duct_height": ("length", "m"),
    "duct_width": ("length", "m"),
    "mach": ("number", "1"),
    "liner_start": ("length", "m"),
    "liner_end": ("length", "m"),
}
TEXTS = ("title", "source_side", "liner")
COLUMNS = {"x": "length", "frequency": "frequency", "spl": "level", "phase": "phase"}
EXAMPLE = "x [mm], frequency [Hz], SPL [dB], phase [deg]"
SAME_X = 1e-9  # m
STATED = {**SCALARS, **FLUID, "frequency": ("frequency", "Hz"), "temperature": ("temperature", "K")}


def write_microphone_csv(line: MicrophoneLine, path: str | Path) -> None:
    """Write one line. References, provenance, notes and coherence need the HDF5 file.

    Raises:
        ValueError: the line has leading axes.
    """
    if line.pressure.ndim > 2:
        raise ValueError(
            f"{path}: a .csv holds one line, not {tuple(line.pressure.shape[:-2])}; write .h5"
        )
    with written_whole(path) as temporary, temporary.open("w", newline="") as file:
        for key, (_, unit) in SCALARS.items():
            if getattr(line, key) is not None:
                file.write(f"# {key} = {plain_number(getattr(line, key))!r} {unit}\n")
        for key, (_, unit) in FLUID.items():
            file.write(f"# {key} = {plain_number(getattr(line.fluid, key))!r} {unit}\n")
        for key in TEXTS:
            if getattr(line, key):
                file.write(stated_text(key, getattr(line, key), path))
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["frequency [Hz]", "x [mm]", "SPL [dB]", "phase [deg]"])
        level, phase = line.level.detach().cpu(), line.phase.detach().cpu()
        for f, hertz in enumerate(line.frequency.tolist()):
            for n, x in enumerate(line.x.tolist()):
                row = (hertz, 1e3 * x, float(level[n, f]), float(phase[n, f]))
                writer.writerow([repr(value) for value in row])


def read_microphone_csv(path: str | Path, **about: Any) -> MicrophoneLine:
    """One line.

    Args:
        path: text; columns separated by comma, semicolon or tab (a decimal comma needs one of the
            latter two).
        about: fields of the record instead of those of the file.
    Raises:
        FileNotFoundError, OSError: no such file, a folder.
        ValueError: a column missing, unknown or without a unit, an unknown key, a cell that is no
            number, frequencies whose microphones differ, a duct height that is not stated.
    Warns:
        DataWarning: levels that look like pascals, phases that look like radians.
    """
    path = Path(path)
    lines = read_lines(path)
    start = header_line(lines, path)
    stated = _stated(lines[:start], path)
    columns = named_columns(
        lines[start:], start + 1, COLUMNS, path, example=EXAMPLE, optional=["frequency"]
    )
    single = stated.pop("frequency", None)
    if single is not None and "frequency" in columns:
        raise ValueError(f"{path} states a frequency above a column of frequencies; keep one")
    if "frequency" not in columns:
        if single is None:
            raise ValueError(
                f"{path}: no column 'frequency [Hz]' and no line '# frequency = ... Hz'; add one"
            )
        columns["frequency"] = np.full(len(columns["x"]), single)
    given = {"title": path.stem, "provenance": {"file": path.name, "format": "csv"},
             "name": str(path), **stated, **about}  # fmt: skip
    if "duct_height" not in given:
        raise ValueError(f"{path}: the duct height is missing; add '# duct_height = 50 mm'")
    return MicrophoneLine.from_levels(*_grid(columns, path), **given)


def _grid(columns: dict[str, Array], path: Path) -> tuple[Array, Array, Array, Array]:
    """x, levels and phases (N, F), frequencies, from rows in any order."""
    frequency = np.unique(columns["frequency"])
    parts: list[tuple[Array, ...]] = []
    for hertz in frequency:
        rows = np.flatnonzero(columns["frequency"] == hertz)
        rows = rows[np.argsort(columns["x"][rows], kind="stable")]
        x = columns["x"][rows]
        if parts and (len(x) != len(parts[0][0]) or np.abs(x - parts[0][0]).max() > SAME_X):
            raise ValueError(
                f"{path}: {hertz:g} Hz has {len(x)} microphones, {frequency[0]:g} Hz "
                f"{len(parts[0][0])}, or they stand elsewhere; the frequencies of a line share "
                "their microphones: write two files"
            )
        parts.append((x, columns["spl"][rows], columns["phase"][rows]))
    x, level, phase = (np.stack(each, -1) for each in zip(*parts, strict=True))
    return x[:, 0], level, phase, frequency


def _stated(lines: list[str], path: Path) -> dict[str, Any]:
    """What the lines before the header say, as fields of the record and ``frequency``."""
    said: dict[str, Any] = {}
    for key, value, label in stated_values(lines, [*STATED, *TEXTS], path):
        said[key] = value if key in TEXTS else si_value(value, STATED[key][0], label)
    return _with_fluid(said, path)


def _with_fluid(said: dict[str, Any], path: Path) -> dict[str, Any]:
    """The gas, from its properties or from a temperature."""
    gas = {key: said.pop(key) for key in FLUID if key in said}
    temperature = said.pop("temperature", None)
    if temperature is not None and gas:
        raise ValueError(
            f"{path} states a temperature and {', '.join(gas)}; state one or the other"
        )
    try:
        if temperature is not None:
            said["fluid"] = Fluid.from_temperature(temperature)
        elif gas:
            said["fluid"] = Fluid(**gas)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return said

"""A line of microphones as CSV: '# key = value unit' lines, a header with units, the values.

Columns ``x``, ``frequency`` (unless one is stated above), ``spl`` and ``phase``, in any order, one
row for each microphone and frequency.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.fluid import Fluid
from torchliner.io.axes import FLUID_UNITS
from torchliner.io.stated_lines import read_stated, write_stated
from torchliner.io.whole_file import written_whole
from torchliner.records import MicrophoneLine
from torchliner.text_columns import Array, header_line, read_lines, read_table

TEXT_ENDINGS = (".csv", ".txt", ".tsv", ".dat")
UNITS = {"duct_height": "m", "duct_width": "m", "mach": "1", "liner_start": "m", "liner_end": "m"}
TEXTS = dict.fromkeys(("title", "source_side", "liner"), "text")
COLUMNS = {"x": "length", "frequency": "frequency", "spl": "level", "phase": "phase"}
EXAMPLE = "x [mm], frequency [Hz], SPL [dB], phase [deg]"
SAME_X = 1e-9  # m
STATED = {**UNITS, **FLUID_UNITS, "frequency": "Hz", "temperature": "K", **TEXTS}


def write_microphone_csv(line: MicrophoneLine, path: str | Path) -> None:
    """Write one line. References, provenance, notes and coherence need the HDF5 file.

    Raises:
        ValueError: the line has leading axes.
    """
    if line.pressure.ndim > 2:
        raise ValueError(f"{path}: a .csv holds one line, not {tuple(line.pressure.shape[:-2])}; write .h5")
    with written_whole(path, *TEXT_ENDINGS) as temporary, temporary.open("w", newline="") as file:
        write_stated(file, line, UNITS, path)
        write_stated(file, line.fluid, FLUID_UNITS, path)
        write_stated(file, line, TEXTS, path)
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
    stated = read_stated(lines[: header_line(lines, path)], STATED, path)
    stated = _with_fluid(stated, path)
    columns = read_table(lines, COLUMNS, path, example=EXAMPLE, optional=["frequency"])
    single = stated.pop("frequency", None)
    if single is not None and "frequency" in columns:
        raise ValueError(f"{path} states a frequency above a column of frequencies; keep one")
    if "frequency" not in columns:
        if single is None:
            raise ValueError(f"{path}: no column 'frequency [Hz]' and no line '# frequency = ... Hz'; add one")
        columns["frequency"] = np.full(len(columns["x"]), single)
    fields = {"title": path.stem, "provenance": {"file": path.name, "format": "csv"},
             "name": str(path), **stated, **about}  # fmt: skip
    if "duct_height" not in fields:
        raise ValueError(f"{path}: the duct height is missing; add '# duct_height = 50 mm'")
    return MicrophoneLine.from_levels(*_grid(columns, path), **fields)


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


def _with_fluid(stated: dict[str, Any], path: Path) -> dict[str, Any]:
    """The gas, from its properties or from a temperature."""
    gas = {key: stated.pop(key) for key in FLUID_UNITS if key in stated}
    temperature = stated.pop("temperature", None)
    if temperature is not None and gas:
        raise ValueError(f"{path} states a temperature and {', '.join(gas)}; state one or the other")
    try:
        if temperature is not None:
            stated["fluid"] = Fluid.from_temperature(temperature)
        elif gas:
            stated["fluid"] = Fluid(**gas)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return stated

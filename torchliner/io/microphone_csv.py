"""A line of microphones as CSV: '# key = value unit' lines, a header with units, the values.

Columns ``x``, ``frequency`` (unless one is stated above), ``spl`` and ``phase``, in any order, one
row for each microphone and frequency.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchliner.checks import plain_number
from torchliner.fluid import Fluid
from torchliner.io.axes import FLUID
from torchliner.io.burst_text import read_lines
from torchliner.io.hdf5 import written_whole
from torchliner.io.units import si_factor
from torchliner.records import MicrophoneLine
from torchliner.words import did_you_mean

Array = NDArray[np.float64]
SCALARS = {
    "duct_height": ("length", "m"),
    "duct_width": ("length", "m"),
    "mach": ("number", "1"),
    "liner_start": ("length", "m"),
    "liner_end": ("length", "m"),
}
TEXTS = ("title", "source_side", "liner")
COLUMNS = {"x": "length", "frequency": "frequency", "spl": "level", "phase": "angle"}
SEPARATORS = (";", "\t", ",")
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
                file.write(f"# {key} = {getattr(line, key)}\n")
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
    start = next((i for i, text in enumerate(lines) if text.strip() and text[0] != "#"), None)
    if start is None:
        raise ValueError(f"{path} has no header line with the names of the columns")
    stated = _stated(lines[:start], path)
    columns = _columns(lines[start:], start + 1, path)
    single = stated.pop("frequency", None)
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


def _columns(lines: list[str], first: int, path: Path) -> dict[str, Array]:
    """SI values (phases in degrees) by column; ``first`` is the number of the header line."""
    separator = next((s for s in SEPARATORS if s in lines[0]), ",")
    found: dict[str, tuple[int, float]] = {}
    for index, label in enumerate(cell.strip() for cell in lines[0].split(separator)):
        match = re.fullmatch(r"(\w+)\s*(?:\[(.*)\])?", label)
        name = match.group(1).lower() if match else label
        if match is None or name not in COLUMNS:
            raise ValueError(
                f"{path}: unknown column {label!r}{did_you_mean(name, list(COLUMNS))}; write "
                "x [mm], frequency [Hz], SPL [dB], phase [deg]"
            )
        if match.group(2) is None:
            raise ValueError(f"{path}: column {label!r} has no unit; write e.g. 'x [mm]'")
        if name in found:
            raise ValueError(f"{path}: column {name!r} is named twice")
        found[name] = (index, _factor(COLUMNS[name], match.group(2), f"{path}: column {name!r}"))
    for name in ("x", "spl", "phase"):
        if name not in found:
            raise ValueError(f"{path}: column {name!r} is missing; there are: {', '.join(found)}")
    rows = [(first + i, text) for i, text in enumerate(lines) if i and text.strip()]
    rows = [(number, text) for number, text in rows if text[0] != "#"]
    if not rows:
        raise ValueError(f"{path} holds no values: the file ends at line {first}")
    return {name: np.array([_cell(text, separator, at, f"{path}: line {number}, column {name!r}")
                            for number, text in rows]) * factor
            for name, (at, factor) in found.items()}  # fmt: skip


def _factor(quantity: str, unit: str, name: str) -> float:
    """To SI, but phases in degrees."""
    factor = si_factor(quantity, unit, name)
    return float(np.degrees(factor)) if quantity == "angle" else factor


def _cell(text: str, separator: str, index: int, name: str) -> float:
    cells = text.split(separator)
    try:
        cell = cells[index].strip()
        return float(cell.replace(",", ".") if separator != "," else cell)
    except (ValueError, IndexError):
        shown = cells[index].strip() if index < len(cells) else ""
        raise ValueError(f"{name} is {shown!r}; a number is needed") from None


def _stated(lines: list[str], path: Path) -> dict[str, Any]:
    """What the lines before the header say, as fields of the record and ``frequency``."""
    said: dict[str, Any] = {}
    known = [*STATED, *TEXTS]
    for number, line in enumerate(lines, 1):
        found = re.fullmatch(r"#\s*(\w+)\s*=\s*(.*?)\s*", line)
        if found is None:
            continue  # a remark
        key, value = found.groups()
        if key not in known:
            raise ValueError(
                f"{path}: line {number} states {key!r}{did_you_mean(key, known)}; known are "
                f"{', '.join(known)}"
            )
        if key in TEXTS:
            said[key] = value
            continue
        label = f"{path}: line {number}, {key}"
        amount, _, unit = value.partition(" ")
        try:
            said[key] = float(amount) * si_factor(STATED[key][0], unit, label)
        except ValueError as error:
            if "could not convert" not in str(error):
                raise
            raise ValueError(f"{label} is {value!r}; it cannot be read") from error
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

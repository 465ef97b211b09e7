"""Lines of microphones, one file each: HDF5 that is valid netCDF-4, or a table of text (docs/wall_pressure.md).

The pressure is complex, as two reals ``pressure_real`` and ``pressure_imaginary`` of dimensions (..., microphone,
frequency); or it is a signal ``pressure`` (microphone, time) beside ``reference`` (time), of which the reader keeps the
tones that are coherent with the reference. A table has columns ``x``, ``frequency`` (unless one is stated above),
``spl`` and ``phase``, in any order, one row for each microphone and frequency.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch

from torchliner.file_checks import naming
from torchliner.fluid import Fluid
from torchliner.io.axes import FLUID_UNITS, read_case, read_signal, read_times
from torchliner.io.flow_noise import reject_flow_noise
from torchliner.io.hdf5 import get_dataset, is_there, open_file, place
from torchliner.io.pressure_file import read_pressure
from torchliner.io.stated_lines import read_stated
from torchliner.io.stored_values import read_values
from torchliner.io.tables import FileKind
from torchliner.records import MicrophoneLine, PressureRecord
from torchliner.records.declared import variables_of
from torchliner.text_columns import Array, header_line, read_lines, read_table

TEXT_ENDINGS = (".csv", ".txt", ".tsv", ".dat")
KIND = FileKind(
    MicrophoneLine.SCHEMA,
    "line of microphones",
    {"title": "", "source_side": "unknown", "liner": "", "provenance": {}, "notes": ()},
)
COLUMNS = {"x": "length", "frequency": "frequency", "spl": "level", "phase": "phase"}
EXAMPLE = "x [mm], frequency [Hz], SPL [dB], phase [deg]"
STATED = {
    **{"duct_height": "m", "duct_width": "m", "mach": "1", "liner_start": "m", "liner_end": "m", "frequency": "Hz"},
    **FLUID_UNITS,
    "temperature": "K",
    **dict.fromkeys(("title", "source_side", "liner"), "text"),
}
SAME_X = 1e-9  # m


def read_microphones(
    path: str | Path,
    frequency: Any = None,
    *,
    segment: float | None = None,
    window: Any = "hann",
    start: float = 0.0,
    **about: Any,
) -> MicrophoneLine:
    """A line from a file of any of the three layouts.

    Args:
        path: .h5, .nc or text (.csv, .txt, .tsv, .dat).
        frequency: Hz; default all that the file states. Amplitudes must be there at these.
        segment, window, start: of time signals alone, as in ``reject_flow_noise``.
        about: fields of the record instead of those of the file, e.g. ``source_side``.
    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: another schema, a dataset missing, of a wrong shape or unit; a frequency that is not there;
            ``segment`` or ``start`` for a file without signals. The message names FILE:/dataset or FILE: line.
    Warns:
        DataWarning: units that look wrong, coherences that are low.
    """
    path = Path(path)
    if path.suffix.lower() in TEXT_ENDINGS:
        line = _of_text(path, about)
    else:
        with open_file(path) as file:
            if "schema" in file.attrs:
                KIND.require(file, path)
            amplitudes = is_there(file, "pressure_real", path)
            unread = set() if amplitudes else {"pressure", "coherence", "wall_impedance"}
            if not (amplitudes or is_there(file, "frequency", path)):
                unread.add("frequency")
            table = [row for row in variables_of(MicrophoneLine) if row.field not in {*about, *unread}]
            head = {**read_case(file, KIND, table, path), "name": str(path), **about}
            if not amplitudes:
                head |= {} if frequency is None else {"frequency": frequency}
                signals = _from_signals(file, path, head, segment=segment, window=window, start=start)
                return MicrophoneLine(**head | signals)
            line = MicrophoneLine(**head)
    if segment is not None or start != 0.0:
        raise ValueError(f"{path} holds amplitudes, no time signals; leave segment and start out")
    return line if frequency is None else line.at(frequency)


def read_wall_pressure(path: str | Path) -> MicrophoneLine | PressureRecord:
    """Microphones along the wall of a duct, or a pressure record: what has no duct is the latter."""
    if Path(path).suffix.lower() in TEXT_ENDINGS:
        return read_microphones(path)
    with open_file(path) as file:
        along = "duct_height" in file
    return read_microphones(path) if along else read_pressure(path)


def _from_signals(file: h5py.File, path: Path, head: dict[str, Any], **options: Any) -> dict[str, Any]:
    """Pressure, coherence, provenance and notes from signals."""
    if "frequency" not in head:
        raise ValueError(f"{path} states no frequency; give frequency=..., in Hz")
    rate, samples = read_times(file, path)
    signals = read_signal(file, "pressure", "Pa", samples, path).astype(np.float64)
    reference = read_values(get_dataset(file, "reference", path), place(file, "reference", path), path)
    found = reject_flow_noise(
        torch.from_numpy(np.ascontiguousarray(signals)),
        torch.from_numpy(reference.astype(np.float64).reshape(-1)),
        torch.as_tensor(head["frequency"], dtype=torch.float64).reshape(-1),
        rate,
        name=str(path),
        **options,
    )
    report = {
        "segments": found.segments,
        "lowest_coherence": float(found.coherence.min()),
        "largest_rejected_level_db": float(found.rejected_level.max()),
        "largest_relative_error": float(found.relative_error.max()),
    }
    return {
        "pressure": found.amplitude,
        "coherence": found.coherence,
        "provenance": {**head["provenance"], "flow_noise": report},
        "notes": (*head["notes"], *found.notes),
    }


def _of_text(path: Path, about: dict[str, Any]) -> MicrophoneLine:
    """A line from a table: '# key = value unit' lines, a header with units, the values."""
    lines = read_lines(path)
    stated = read_stated(lines[: header_line(lines, path)], STATED, path)
    gas = {key: stated.pop(key) for key in FLUID_UNITS if key in stated}
    temperature, single = stated.pop("temperature", None), stated.pop("frequency", None)
    columns = read_table(lines, COLUMNS, path, example=EXAMPLE, optional=["frequency"])
    if temperature is not None and gas:
        raise ValueError(f"{path} states a temperature and {', '.join(gas)}; state one or the other")
    if (single is None) != ("frequency" in columns):
        raise ValueError(f"{path} needs either a column 'frequency [Hz]' or a line '# frequency = ... Hz'")
    columns.setdefault("frequency", np.full(len(columns["x"]), single))
    with naming(path):
        fluid = Fluid(**gas) if temperature is None else Fluid.from_temperature(temperature)
    fields = {"title": path.stem, "provenance": {"file": path.name, "format": "csv"}, "fluid": fluid, "name": str(path)}
    fields |= stated | about
    if "duct_height" not in fields:
        raise ValueError(f"{path}: the duct height is missing; add '# duct_height = 50 mm'")
    return MicrophoneLine.from_levels(*_grid(columns, path), **fields)


def _grid(columns: dict[str, Array], path: Path) -> tuple[Array, Array, Array, Array]:
    """x, levels and phases (N, F), frequencies, from rows in any order."""
    order = np.lexsort((columns["x"], columns["frequency"]))
    frequency, counts = np.unique(columns["frequency"], return_counts=True)
    shape = (len(frequency), int(counts[0]))
    if not (counts == counts[0]).all() or np.ptp(x := columns["x"][order].reshape(shape), axis=0).max() > SAME_X:
        raise ValueError(
            f"{path} has {counts.tolist()} microphones at {frequency.tolist()} Hz, or they stand elsewhere; the "
            "frequencies of a line share their microphones: write two files"
        )
    level, phase = (columns[name][order].reshape(shape).T for name in ("spl", "phase"))
    return x[0], level, phase, frequency

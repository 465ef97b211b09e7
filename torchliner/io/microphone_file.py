"""Lines of microphones, one file each: HDF5 that is valid netCDF-4, or CSV (docs/wall_pressure.md).

The pressure is complex, as two reals ``pressure_real`` and ``pressure_imag`` of dimensions (...,
microphone, frequency); or it is a signal ``pressure`` (microphone, time) beside ``reference``
(time), of which the reader keeps the tones that are coherent with the reference.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch

from torchliner.io.axes import find_time_axis, read_case, read_times, write_case
from torchliner.io.flow_noise import reject_flow_noise
from torchliner.io.hdf5 import (
    get_dataset,
    is_there,
    open_file,
    place,
    read_si,
    text_attribute,
    write_index,
)
from torchliner.io.microphone_csv import (
    TEXT_ENDINGS,
    UNITS,
    read_microphone_csv,
    write_microphone_csv,
)
from torchliner.io.pressure_file import read_pressure
from torchliner.io.stored_values import read_values
from torchliner.io.tables import FileKind, Variable, impedance, numbers, read_variables, real, write_variables
from torchliner.records import MicrophoneLine, PressureRecord

KIND = FileKind(
    "torchliner microphones 1", "line of microphones",
    {"title": "", "source_side": "unknown", "liner": "", "provenance": {}, "notes": ()},
    others=TEXT_ENDINGS,
)  # fmt: skip
DUCT = (real("x", "m", ("microphone",)), *numbers(UNITS))
FREQUENCY = (real("frequency", "Hz", ("frequency",)),)
AMPLITUDES = (
    Variable("pressure", ("pressure_real", "pressure_imag"), "Pa",
             ("draws", "microphone", "frequency"),
             attributes={"amplitude": "peak, exp(+j omega t)"}),
    real("coherence", "1", ("microphone", "frequency"), optional=True),
    impedance("wall_impedance", "wall_", ("frequency",), optional=True),
)  # fmt: skip


def write_microphones(line: MicrophoneLine, path: str | Path) -> None:
    """Write a line; the old file, if any, is replaced only when the new one is whole.

    Args:
        line: record.
        path: .h5 or .nc; .csv for a line without leading axes.
    """
    if Path(path).suffix.lower() in TEXT_ENDINGS:
        write_microphone_csv(line, path)
        return
    with KIND.created(path, line) as file:
        fill_microphones(file, line)


def fill_microphones(group: h5py.Group, line: MicrophoneLine) -> None:
    """A line into an open file or a group of one."""
    KIND.write_head(group, line)
    write_index(group, "microphone", line.microphones)
    write_case(group, line, DUCT)
    write_variables(group, line, FREQUENCY)
    draws = []
    for axis, count in enumerate(line.pressure.shape[:-2]):
        draws.append("draw" if axis == 0 else f"draw_{axis}")
        write_index(group, draws[-1], count)
    write_variables(group, line, AMPLITUDES, {"draws": draws})


def microphones_of(group: h5py.Group, path: Path, name: str) -> MicrophoneLine:
    """The amplitudes that ``fill_microphones`` wrote into a group of a file."""
    KIND.require(group, path)
    case = read_case(group, KIND, DUCT, path)
    case["title"] = text_attribute(group, "title") or ""  # the file's name is another's
    if "duct_height" not in case:
        get_dataset(group, "duct_height", path)
    return MicrophoneLine(**case, **read_variables(group, FREQUENCY + AMPLITUDES, path), name=name)


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
        ValueError: another schema, a dataset missing, of a wrong shape or unit; a frequency that is
            not there; ``segment`` or ``start`` for a file without signals. The message names
            FILE:/dataset or FILE: line.
    Warns:
        DataWarning: units that look wrong, coherences that are low.
    """
    path = Path(path)
    signals = {"segment": segment, "window": window, "start": start}
    if path.suffix.lower() in TEXT_ENDINGS:
        return _selected(read_microphone_csv(path, **about), frequency, signals)
    with open_file(path) as file:
        if "schema" in file.attrs:
            KIND.require(file, path)
        head = {**read_case(file, KIND, DUCT, path), "name": str(path)}
        if "duct_height" not in head | about:
            get_dataset(file, "duct_height", path)  # says what is there instead
        amplitudes = is_there(file, AMPLITUDES[0].names[0], path)
        if amplitudes or is_there(file, "frequency", path):
            head |= read_variables(file, FREQUENCY, path)
        if amplitudes:
            head |= read_variables(file, AMPLITUDES, path)
            return _selected(MicrophoneLine(**{**head, **about}), frequency, signals)
        if frequency is not None:
            head["frequency"] = frequency
        head |= _from_signals(file, path, head, **signals)
    return MicrophoneLine(**{**head, **about})


def read_wall_pressure(path: str | Path) -> MicrophoneLine | PressureRecord:
    """Microphones along the wall of a duct, or a pressure record: what has no duct is the latter.

    Raises:
        As ``read_microphones`` and ``read_pressure``.
    """
    if Path(path).suffix.lower() in TEXT_ENDINGS:
        return read_microphones(path)
    with open_file(path) as file:
        along = "duct_height" in file
    return read_microphones(path) if along else read_pressure(path)


def _selected(line: MicrophoneLine, frequency: Any, signals: dict[str, Any]) -> MicrophoneLine:
    """Amplitudes at some frequencies; what only signals know is refused."""
    if signals["segment"] is not None or signals["start"] != 0.0:
        raise ValueError(f"{line.name} holds amplitudes, no time signals; leave segment and start out")
    return line if frequency is None else line.at(frequency)


def _from_signals(file: h5py.File, path: Path, head: dict[str, Any], **options: Any) -> dict[str, Any]:
    """Pressure, coherence, provenance and notes from signals."""
    dataset = get_dataset(file, "pressure", path)
    channel = get_dataset(file, "reference", path)
    reference = read_values(channel, place(file, "reference", path), path)
    rate, samples = read_times(file, path)
    if "frequency" not in head:
        raise ValueError(f"{path} states no frequency; give frequency=..., in Hz")
    axis = find_time_axis(dataset, samples, path)
    signals = np.moveaxis(read_si(file, "pressure", "Pa", path), axis, -1).astype(np.float64)
    if signals.shape[:-1] != tuple(head["x"].shape):
        raise ValueError(f"{path}:/pressure has {signals.shape[:-1]} microphones, /x {len(head['x'])} values")
    found = reject_flow_noise(
        torch.from_numpy(np.ascontiguousarray(signals)),
        torch.from_numpy(reference.astype(np.float64).reshape(-1)),
        torch.as_tensor(head["frequency"], dtype=torch.float64).reshape(-1),
        rate, name=str(path), **options,
    )  # fmt: skip
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

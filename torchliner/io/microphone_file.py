"""Lines of microphones, one file each: HDF5 that is valid netCDF-4, or CSV (docs/wall_pressure.md).

The pressure is complex, as two reals ``pressure_real`` and ``pressure_imaginary`` of dimensions (...,
microphone, frequency); or it is a signal ``pressure`` (microphone, time) beside ``reference``
(time), of which the reader keeps the tones that are coherent with the reference.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch

from torchliner.io.axes import find_time_axis, read_case, read_times
from torchliner.io.flow_noise import reject_flow_noise
from torchliner.io.hdf5 import get_dataset, is_there, open_file, place, read_si
from torchliner.io.microphone_csv import TEXT_ENDINGS, read_microphone_csv, write_microphone_csv
from torchliner.io.own_file import OwnFile
from torchliner.io.pressure_file import read_pressure
from torchliner.io.stored_values import read_values
from torchliner.records import MicrophoneLine, PressureRecord
from torchliner.records.declared import variables_of


class MicrophoneFile(OwnFile):
    """CSV for a line without leading axes."""

    def write(self, record: MicrophoneLine, path: str | Path) -> None:
        """One file, by its ending."""
        if Path(path).suffix.lower() in TEXT_ENDINGS:
            write_microphone_csv(record, path)
        else:
            super().write(record, path)


def _axes(line: MicrophoneLine) -> dict[str, tuple[str, ...]]:
    return {"draws": tuple(f"draw_{axis}" if axis else "draw" for axis in range(line.pressure.ndim - 2))}


FILE = MicrophoneFile(
    "torchliner microphones 1",
    "line of microphones",
    record=MicrophoneLine,
    axes=_axes,
    unsaid=("name",),
    attributes={"title": "", "source_side": "unknown", "liner": "", "provenance": {}, "notes": ()},
    others=TEXT_ENDINGS,
)


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
            FILE.require(file, path)
        amplitudes = is_there(file, "pressure_real", path)
        table = [
            row
            for row in variables_of(MicrophoneLine)
            if row.field not in about
            and (
                amplitudes
                or not {"draws", "frequency"} & {*row.dims}
                or (row.field == "frequency" and is_there(file, "frequency", path))
            )
        ]
        head = {**read_case(file, FILE, table, path), "name": str(path)}
        if amplitudes:
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

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

from torchliner.io.axes import find_time_axis, read_fluid, read_times, write_fluid
from torchliner.io.hdf5 import (
    get_dataset,
    open_file,
    place,
    read_json,
    read_references,
    read_scalars,
    read_si,
    require_schema,
    text_attribute,
    to_json,
    write_dimension,
    write_references,
    write_scalars,
    write_variable,
    written_whole,
)
from torchliner.io.microphone_csv import SCALARS, TEXTS, read_microphone_csv, write_microphone_csv
from torchliner.records import MicrophoneLine
from torchliner.signals.reference_coherence import RejectedFlow, reject_flow_noise
from torchliner.units import si_factor

SCHEMA = "torchliner microphones 1"
PARTS = ("pressure_real", "pressure_imag")
TEXT_ENDINGS = (".csv", ".txt", ".tsv", ".dat")


def write_microphones(line: MicrophoneLine, path: str | Path) -> None:
    """Write a line; the old file, if any, is replaced only when the new one is whole.

    Args:
        line: record.
        path: .h5 or .nc; .csv for a line without leading axes.
    """
    if Path(path).suffix.lower() in TEXT_ENDINGS:
        write_microphone_csv(line, path)
        return
    with written_whole(path) as temporary, h5py.File(temporary, "w") as file:
        _write_head(file, line)
        write_dimension(file, "frequency", line.frequency.numpy(), "Hz")
        dims = ["microphone", "frequency"]
        for axis, count in enumerate(line.pressure.shape[:-2]):
            name = "draw" if axis == 0 else f"draw_{axis}"
            write_dimension(file, name, np.arange(count), "1")
            dims.insert(axis, name)
        values = line.pressure.detach().cpu().numpy()
        for name, part in zip(PARTS, (values.real, values.imag), strict=True):
            write_variable(file, name, part, "Pa", tuple(dims))
            file[name].attrs["amplitude"] = "peak, exp(+j omega t)"
        if line.coherence is not None:
            write_variable(
                file, "coherence", line.coherence.numpy(), "1", ("microphone", "frequency")
            )


def write_signals(
    line: MicrophoneLine, pressure: Any, reference: Any, sampling_rate: float, path: str | Path
) -> None:
    """Write time signals and their reference channel with what a line says of its duct.

    Args:
        line: x, frequencies that were played, duct and flow; its own pressure is not written.
        pressure: Pa, (N, T).
        reference: of any unit, (T,).
        sampling_rate: Hz.
        path: .h5 or .nc.
    Raises:
        ValueError: shapes disagree.
    """
    signals, channel = np.asarray(pressure), np.asarray(reference)
    if signals.ndim != 2 or signals.shape != (line.microphones, len(channel)):
        raise ValueError(
            f"{path}: pressure has shape {signals.shape}, reference {channel.shape}; "
            f"({line.microphones}, T) and (T,) are needed"
        )
    with written_whole(path) as temporary, h5py.File(temporary, "w") as file:
        _write_head(file, line)
        write_dimension(file, "time", np.arange(len(channel)) / sampling_rate, "s")
        write_dimension(file, "frequency", line.frequency.numpy(), "Hz")
        write_variable(file, "pressure", signals, "Pa", ("microphone", "time"))
        write_variable(file, "reference", channel, "1", ("time",))


def _write_head(file: h5py.File, line: MicrophoneLine) -> None:
    file.attrs["Conventions"] = "CF-1.8"
    file.attrs["schema"] = SCHEMA
    for key in TEXTS:
        file.attrs[key] = getattr(line, key)
    file.attrs["provenance"] = to_json(dict(line.provenance))
    file.attrs["notes"] = to_json(list(line.notes))
    write_dimension(file, "microphone", np.arange(line.microphones), "1")
    write_variable(file, "x", line.x.numpy(), "m", ("microphone",))
    write_scalars(file, line, SCALARS)
    write_fluid(file, line.fluid)
    write_references(file, line.reference)


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
        DataWarning: units or coherences in doubt.
    """
    path = Path(path)
    signals = {"segment": segment, "window": window, "start": start}
    if path.suffix.lower() in TEXT_ENDINGS:
        return _selected(read_microphone_csv(path, **about), frequency, signals)
    with open_file(path) as file:
        if "schema" in file.attrs:
            require_schema(file, SCHEMA, "line of microphones", path)
        head: dict[str, Any] = {
            "x": read_si(file, "x", "length", path).reshape(-1),
            **read_scalars(file, SCALARS, path),
            **{key: text_attribute(file, key) or "" for key in TEXTS},
            "fluid": read_fluid(file, path),
            "reference": read_references(file, path),
            "provenance": read_json(file, "provenance", path, {}),
            "notes": tuple(read_json(file, "notes", path, [])),
            "name": str(path),
        }
        head["source_side"] = head["source_side"] or "unknown"
        head["title"] = head["title"] or path.stem
        if "duct_height" not in head | about:
            get_dataset(file, "duct_height", path)  # says what is there instead
        wanted = read_si(file, "frequency", "frequency", path) if "frequency" in file else None
        if PARTS[0] in file:
            head["frequency"] = wanted
            head["pressure"] = _complex_pressure(file, path)
            if "coherence" in file:
                head["coherence"] = read_si(file, "coherence", "number", path)
            return _selected(MicrophoneLine(**{**head, **about}), frequency, signals)
        head["frequency"] = wanted if frequency is None else frequency
        head |= _from_signals(file, path, head, **signals)
    return MicrophoneLine(**{**head, **about})


def _selected(line: MicrophoneLine, frequency: Any, signals: dict[str, Any]) -> MicrophoneLine:
    """Amplitudes at some frequencies; what only signals know is refused."""
    if signals["segment"] is not None or signals["start"] != 0.0:
        raise ValueError(
            f"{line.name} holds amplitudes, no time signals; leave segment and start out"
        )
    return line if frequency is None else line.at(frequency)


def _complex_pressure(file: h5py.File, path: Path) -> np.ndarray:
    get_dataset(file, "frequency", path)
    real, imaginary = (read_si(file, name, "pressure", path) for name in PARTS)
    if real.shape != imaginary.shape:
        raise ValueError(
            f"{place(file, PARTS[1], path)} has shape {imaginary.shape}, {PARTS[0]} {real.shape}; "
            "they are two parts of one array"
        )
    return np.asarray(real + 1j * imaginary)


def _from_signals(
    file: h5py.File, path: Path, head: dict[str, Any], **options: Any
) -> dict[str, Any]:
    """Pressure, coherence, provenance and notes from signals."""
    dataset = get_dataset(file, "pressure", path)
    get_dataset(file, "reference", path)
    rate, samples = read_times(file, path)
    if head["frequency"] is None:
        raise ValueError(f"{path} states no frequency; give frequency=..., in Hz")
    factor = si_factor("pressure", text_attribute(dataset, "units"), f"{path}:/pressure")
    axis = find_time_axis(dataset, samples, path)
    signals = np.moveaxis(np.asarray(dataset[()], dtype=np.float64), axis, -1) * factor
    if signals.shape[:-1] != head["x"].shape:
        raise ValueError(
            f"{path}:/pressure has {signals.shape[:-1]} microphones, /x {len(head['x'])} values"
        )
    channel = np.asarray(file["reference"][()], dtype=np.float64).reshape(-1)
    frequency = torch.as_tensor(head["frequency"], dtype=torch.float64).reshape(-1)
    found = reject_flow_noise(
        torch.from_numpy(np.ascontiguousarray(signals)), torch.from_numpy(channel), frequency,
        rate, name=str(path), **options,
    )  # fmt: skip
    return {
        "pressure": found.amplitude,
        "coherence": found.coherence,
        "provenance": {**head["provenance"], "flow_noise": _report(found)},
        "notes": (*head["notes"], *found.notes),
    }


def _report(found: RejectedFlow) -> dict[str, Any]:
    """What the rejection did, for the provenance."""
    return {
        "segments": found.segments,
        "lowest_coherence": float(found.coherence.min()),
        "largest_rejected_level_db": float(found.rejected_level.max()),
        "largest_relative_error": float(found.relative_error.max()),
    }

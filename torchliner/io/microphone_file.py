"""Pressures, one file each: HDF5 that is valid netCDF-4, or a table of text (docs/formats.md, docs/wall_pressure.md).

Along a duct, a line of microphones: complex pressure, as two reals ``pressure_real`` and ``pressure_imaginary`` of
dimensions (..., microphone, frequency); or a signal ``pressure`` (microphone, time) beside ``reference`` (time), of
which the reader keeps the tones that are coherent with the reference. A table has columns ``x``, ``frequency`` (unless
one is stated above), ``spl`` and ``phase``, in any order, one row for each microphone and frequency.

Around a liner: the facesheet's pressure is (time, z, x), (time, x) or (time, probe), the backplate's (time),
(time, cell) or like the facesheet's, the microphones' (time, microphone).

And recorded incident signals: WAV, or a plain array whose rate the user states.
"""

import struct
import warnings
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch

from torchliner.file_checks import naming, require_regular
from torchliner.fluid import Fluid
from torchliner.io.flow_noise import reject_flow_noise
from torchliner.io.foreign import read_array
from torchliner.io.hdf5 import is_there, open_file, text_attribute
from torchliner.io.own_file import (
    get_field,
    read_attribute,
    read_clock,
    read_coordinate,
    read_row,
    require_schema,
    take,
)
from torchliner.io.own_writer import FLUID_UNITS
from torchliner.io.variables import field_of, time_axis
from torchliner.records import MicrophoneLine, PressureRecord
from torchliner.records.declared import table_of
from torchliner.records.incident import Recorded
from torchliner.records.pressure_record import SIGNALS
from torchliner.text_columns import Array, header_line, read_lines, read_stated, read_table

TEXT_ENDINGS = (".csv", ".txt", ".tsv", ".dat")
COLUMNS = {"x": "length", "frequency": "frequency", "spl": "level", "phase": "phase"}
EXAMPLE = "x [mm], frequency [Hz], SPL [dB], phase [deg]"
STATED = {
    **{"duct_height": "m", "duct_width": "m", "mach": "1", "liner_start": "m", "liner_end": "m", "frequency": "Hz"},
    **FLUID_UNITS,
    "temperature": "K",
    **dict.fromkeys(("title", "source_side", "liner"), "text"),
}
SAME_X = 1e-9  # m
HEAD = 1 << 16  # bytes, in which a .wav says what it is
(FREQUENCY,) = table_of(MicrophoneLine, "frequency")


def read_pressure(path: str | Path) -> PressureRecord:
    """A record from a file of ours, or of anyone who follows the schema.

    Args:
        path: .h5, .hdf5 or .nc.
    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: not of this schema; a variable is missing, has another shape, unit or size than it can have. The
            message names FILE:/variable.
    """
    path = Path(path)
    with open_file(path) as file:
        if "schema" in file.attrs:
            require_schema(file, path, PressureRecord.SCHEMA)
        rows = table_of(PressureRecord, *SIGNALS)
        if not any(there := [is_there(file, row.names[0], path) for row in rows]):
            get_field(file, rows[0].names[0], path)  # says what is there instead
        rate, samples, start = read_clock(file, path)
        known: dict[str, Any] = {"sampling_rate": rate, "start": start, "name": str(path)}
        for row, found in zip(rows, there, strict=True):
            known[row.field] = _signal(file, row.names[0], row.unit, samples, path) if found else None
        shape = () if known["facesheet"] is None else known["facesheet"].shape[:-1]
        known |= {key: read_coordinate(file, key, shape, path) for key in ("x", "z")}
        known["title"] = text_attribute(file, "title") or path.stem
        cells = get_field(file, "probe_cell", path).values() if is_there(file, "probe_cell", path) else None
        made: PressureRecord = take(file, PressureRecord, path, {**known, "probe_cell": cells})
        return made


def read_microphones(
    path: str | Path,
    frequency: Any = None,
    *,
    segment: float | None = None,
    **about: Any,
) -> MicrophoneLine:
    """A line from a file of any of the three layouts.

    Args:
        path: .h5, .nc or text (.csv, .txt, .tsv, .dat).
        frequency: Hz; default all that the file states. Amplitudes must be there at these.
        segment: s, of time signals alone, as in ``reject_flow_noise``.
        about: fields of the record instead of those of the file, e.g. ``source_side``.
    Raises:
        FileNotFoundError, OSError: missing, truncated, not HDF5.
        ValueError: another schema, a dataset missing, of a wrong shape or unit; a frequency that is not there;
            ``segment`` for a file without signals. The message names FILE:/dataset or FILE: line.
    Warns:
        DataWarning: units that look wrong, coherences that are low.
    """
    path = Path(path)
    if path.suffix.lower() in TEXT_ENDINGS:
        line = _of_text(path, about)
    else:
        with open_file(path) as file:
            if "schema" in file.attrs:
                require_schema(file, path, MicrophoneLine.SCHEMA)
            known = {"title": text_attribute(file, "title") or path.stem, "name": str(path), **about}
            signals = not is_there(file, "pressure_real", path)
            if signals:
                known |= {} if frequency is None else {"frequency": frequency}
                known |= _from_signals(file, path, known, segment)
            line = take(file, MicrophoneLine, path, known)
            if signals:
                return line
    if segment is not None:
        raise ValueError(f"{path} holds amplitudes, no time signals; leave segment out")
    return line if frequency is None else line.at(frequency)


def read_wall_pressure(path: str | Path) -> MicrophoneLine | PressureRecord:
    """Microphones along the wall of a duct, or a pressure record: what has no duct is the latter."""
    if Path(path).suffix.lower() in TEXT_ENDINGS:
        return read_microphones(path)
    with open_file(path) as file:
        along = "duct_height" in file
    return read_microphones(path) if along else read_pressure(path)


def _signal(file: h5py.File, key: str, unit: str, samples: int, path: Path) -> np.ndarray:
    """A signal in an SI unit, time last, float32 or float64 as in the file.

    Raises:
        ValueError: as ``Field.signal_factor`` and ``time_axis``.
    """
    get_field(file, key, path)  # says what is there instead
    signal = field_of(file, key, path)
    factor, axis, values = signal.signal_factor(unit), time_axis(signal, samples), signal.values()
    values = values if values.dtype in (np.float32, np.float64) else values.astype(np.float32)
    moved = np.ascontiguousarray(np.moveaxis(values, axis, -1))
    return moved if factor == 1 else moved * moved.dtype.type(factor)


def _from_signals(file: h5py.File, path: Path, known: dict[str, Any], segment: float | None) -> dict[str, Any]:
    """Fields of a line that follow from signals; of the others some are ``known``."""
    if "frequency" not in known and not is_there(file, "frequency", path):
        raise ValueError(f"{path} states no frequency; give frequency=..., in Hz")
    frequency = known["frequency"] if "frequency" in known else read_row(file, FREQUENCY, path)
    rate, samples, _ = read_clock(file, path)
    signals = _signal(file, "pressure", "Pa", samples, path).astype(np.float64)
    reference = get_field(file, "reference", path).values().astype(np.float64)
    found = reject_flow_noise(
        torch.from_numpy(np.ascontiguousarray(signals)),
        torch.from_numpy(reference.reshape(-1)),
        torch.as_tensor(frequency, dtype=torch.float64).reshape(-1),
        rate,
        segment=segment,
        name=str(path),
    )
    report = {
        "segments": found.segments,
        "lowest_coherence": float(found.coherence.min()),
        "largest_rejected_level_db": float(-10 * found.coherence.min().log10()),
        "largest_relative_error": float(found.relative_error.max()),
    }
    said = {"provenance": dict[str, Any], "notes": tuple[str, ...]}
    own = {key: known.get(key) or read_attribute(file, key, hint, path) or hint() for key, hint in said.items()}
    return {
        "frequency": frequency,
        "pressure": found.amplitude,
        "coherence": known.get("coherence", found.coherence),
        "wall_impedance": known.get("wall_impedance"),
        "provenance": {**own["provenance"], "flow_noise": report},
        "notes": (*own["notes"], *found.notes),
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


# Recorded incident signals


def read_signal(path: str | Path, sampling_rate: float | None = None, channel: int | None = None) -> Recorded:
    """A recorded incident signal.

    Args:
        path: .wav (integers become fractions of full scale; only ratios matter), or .npy, .mat, .h5 of one array.
        sampling_rate: Hz; a .wav states its own, other files do not.
        channel: of several; may be left out if there is one.
    Raises:
        FileNotFoundError, ValueError: missing, not readable, no rate, several channels.
    """
    path = Path(path)
    require_regular(path)
    if path.suffix.lower() == ".wav":
        rate, values = _read_wav(path)
        if sampling_rate is not None and abs(sampling_rate / rate - 1) > 1e-6:
            raise ValueError(f"{path} says {rate:g} Hz, sampling_rate {sampling_rate:g} Hz; one of them is wrong")
    else:
        if sampling_rate is None:
            raise ValueError(f"{path} does not state its sampling rate; give sampling_rate in Hz")
        rate, values = sampling_rate, np.asarray(read_array(path), dtype=np.float64)
        values = values.squeeze() if values.ndim == 2 and 1 in values.shape else values
    columns = values[:, None] if values.ndim == 1 else values
    if columns.ndim != 2 or not 0 <= (channel or 0) < columns.shape[1] or (channel is None and columns.shape[1] > 1):
        raise ValueError(f"{path} has shape {values.shape}, (samples, channels); choose one channel, not {channel}")
    with naming(path):
        return Recorded(columns[:, channel or 0], rate, path.name)


def _read_wav(path: Path) -> tuple[float, np.ndarray]:
    """Rate and samples by scipy, which believes a header whose bits do not fill its bytes."""
    from scipy.io import wavfile

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # scipy only warns of a file that ends too soon
            warnings.filterwarnings("ignore", message="Chunk .* not understood")
            rate, values = wavfile.read(path)
        head = path.read_bytes()[:HEAD]
        form = "<HIIHH" if head[:4] == b"RIFF" else ">HIIHH"
        channels, _, _, block, bits = struct.unpack_from(form, head, head.index(b"fmt ") + 10)
        if 8 * block != bits * channels:
            raise ValueError(f"{bits} bits a sample do not fill the {block} bytes of its {channels} channel(s)")
        if values.ndim == 0 or 0 in values.shape:
            raise ValueError("it holds no samples, as one that was streamed or broken off")
    except Exception as error:  # whatever it says of damage
        raise ValueError(f"{path} is not a whole .wav file: {error}") from error
    offset = 128 if values.dtype == np.uint8 else 0
    scale = -float(np.iinfo(values.dtype).min) if values.dtype.kind == "i" else float(offset or 1)
    return float(rate), (values.astype(np.float64) - offset) / scale

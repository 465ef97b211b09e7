"""Pressures, one file each: HDF5 that is valid netCDF-4, or a table of text (docs/formats.md, docs/wall_pressure.md).

Along a duct, a line of microphones: complex pressures, or signals beside a ``reference``, of which the reader keeps the
tones that are coherent with the reference. Around a liner, signals of facesheet, backplate and microphones. And
recorded incident signals: WAV, or a plain array whose rate the user states.
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
from torchliner.io.foreign import read_array
from torchliner.io.hdf5 import is_there, open_file, text_attribute
from torchliner.io.own_file import get_field, read_attribute, read_row, require_schema, take
from torchliner.io.variables import read_times, time_axis
from torchliner.pressure.spectra import reject_flow_noise
from torchliner.records import MicrophoneLine, PressureRecord
from torchliner.records.declared import table_of, variables_of
from torchliner.records.incident import Recorded
from torchliner.text_columns import header_line, read_lines, read_stated, read_table

TEXT_ENDINGS = (".csv", ".txt", ".tsv", ".dat")
COLUMNS = {"x": "length", "frequency": "frequency", "spl": "level", "phase": "phase"}
EXAMPLE = "x [mm], frequency [Hz], SPL [dB], phase [deg]"
STATED = {"duct_height": "m", "duct_width": "m", "mach": "1", "liner_start": "m", "liner_end": "m", "temperature": "K"}
STATED |= dict.fromkeys(("title", "source_side", "liner"), "text")
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
        rows = [row for row in variables_of(PressureRecord) if row.kind == "signal"]
        if not any(there := [is_there(file, row.names[0], path) for row in rows]):
            get_field(file, rows[0].names[0], path)  # says what is there instead
        rate, samples, start = read_times(get_field(file, "time", path))
        known: dict[str, Any] = {"sampling_rate": rate, "start": start, "name": str(path)}
        known["title"] = text_attribute(file, "title") or path.stem
        for row, found in zip(rows, there, strict=True):
            known[row.field] = _signal(file, row.names[0], row.unit, samples, path) if found else None
        made: PressureRecord = take(file, PressureRecord, path, known)
        return made


def read_microphones(
    path: str | Path, frequency: Any = None, *, segment: float | None = None, **about: Any
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
            if not is_there(file, "pressure_real", path):
                return take(file, MicrophoneLine, path, known | _of_signals(file, path, known, frequency, segment))
            line = take(file, MicrophoneLine, path, known)
    if segment is not None:
        raise ValueError(f"{path} holds amplitudes, no time signals; leave segment out")
    return line if frequency is None else line.at(frequency)


def _signal(file: h5py.File, key: str, unit: str, samples: int, path: Path) -> np.ndarray:
    """A signal in an SI unit, time last, float32 or float64 as in the file."""
    signal = get_field(file, key, path)
    factor, axis, values = signal.signal_factor(unit), time_axis(signal, samples), signal.values()
    values = values if values.dtype in (np.float32, np.float64) else values.astype(np.float32)
    moved = np.ascontiguousarray(np.moveaxis(values, axis, -1))
    return moved if factor == 1 else moved * moved.dtype.type(factor)


def _of_signals(
    file: h5py.File, path: Path, known: dict[str, Any], frequency: Any, segment: float | None
) -> dict[str, Any]:
    """Fields of a line that follow from signals; of the others some are ``known``."""
    if frequency is None:
        if not is_there(file, FREQUENCY.names[0], path):
            raise ValueError(f"{path} states no frequency; give frequency=..., in Hz")
        frequency = read_row(file, FREQUENCY, path)
    rate, samples, _ = read_times(get_field(file, "time", path))
    signals = torch.from_numpy(_signal(file, "pressure", "Pa", samples, path).astype(np.float64))
    reference = torch.from_numpy(get_field(file, "reference", path).values().astype(np.float64)).reshape(-1)
    wanted = torch.as_tensor(frequency, dtype=torch.float64).reshape(-1)
    tones, coherence, told = reject_flow_noise(signals, reference, wanted, rate, segment=segment, name=str(path))
    notes = (*(read_attribute(file, "notes", tuple[str, ...], path) or ()), *told)
    fields = {"frequency": wanted, "pressure": tones, "coherence": coherence, "notes": notes}
    return fields | {"wall_impedance": known.get("wall_impedance")}


def _of_text(path: Path, about: dict[str, Any]) -> MicrophoneLine:
    """A line from a table: '# key = value unit' lines, a header with units, the values in any order."""
    from pandas import DataFrame  # takes a third of a second to import

    lines = read_lines(path)
    stated = read_stated(lines[: header_line(lines, path)], STATED, path)
    columns = read_table(lines, COLUMNS, path, example=EXAMPLE)
    with naming(path):
        fluid = Fluid.from_temperature(stated.pop("temperature")) if "temperature" in stated else Fluid()
        table = DataFrame(columns).pivot(index="x", columns="frequency")
        if table.isna().any(axis=None):
            raise ValueError("the frequencies of a line share their microphones; write two files")
    fields = {"title": path.stem, "provenance": {"file": path.name, "format": "csv"}, "fluid": fluid, "name": str(path)}
    fields |= stated | about
    if "duct_height" not in fields:
        raise ValueError(f"{path}: the duct height is missing; add '# duct_height = 50 mm'")
    x, frequency = table.index.to_numpy(), table["spl"].columns.to_numpy()
    return MicrophoneLine.from_levels(x, table["spl"].to_numpy(), table["phase"].to_numpy(), frequency, **fields)


def read_signal(path: str | Path, sampling_rate: float | None = None, channel: int | None = None) -> Recorded:
    """A recorded incident signal.

    Args:
        path: .wav (integers become fractions of full scale; only ratios matter), or .npy, .mat, .h5 of one array.
        sampling_rate: Hz, of files other than .wav, which states its own.
        channel: of several; may be left out if there is one.
    Raises:
        FileNotFoundError, ValueError: missing, not readable, no rate, several channels.
    """
    path = Path(path)
    require_regular(path)
    if path.suffix.lower() == ".wav":
        sampling_rate, values = _read_wav(path)
    else:
        values = np.asarray(read_array(path), dtype=np.float64)
        values = values.squeeze() if values.ndim == 2 and 1 in values.shape else values
    columns = values[:, None] if values.ndim == 1 else values
    if columns.ndim != 2 or not 0 <= (channel or 0) < columns.shape[1] or (channel is None and columns.shape[1] > 1):
        raise ValueError(f"{path} has shape {values.shape}, (samples, channels); choose one channel, not {channel}")
    if sampling_rate is None:
        raise ValueError(f"{path} does not state its sampling rate; give sampling_rate in Hz")
    with naming(path):
        return Recorded(columns[:, channel or 0], sampling_rate, path.name)


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
        if 8 * block != bits * channels or 0 in values.shape:
            raise ValueError(
                f"{bits} bits a sample of its {channels} channel(s) do not fill {block} bytes, or are none"
            )
    except Exception as error:  # whatever it says of damage
        raise ValueError(f"{path} is not a whole .wav file: {error}") from error
    if values.dtype.kind == "f":
        return float(rate), values.astype(np.float64)
    offset = 128 if values.dtype == np.uint8 else 0
    return float(rate), (values.astype(np.float64) - offset) / (offset or -float(np.iinfo(values.dtype).min))

"""Recorded incident signals: WAV, or a plain array whose rate the user states."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path

import numpy as np

from torchliner.file_checks import naming, require_regular
from torchliner.io.foreign import read_array
from torchliner.records.incident import Recorded

HEAD = 1 << 16  # bytes, in which a .wav says what it is


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

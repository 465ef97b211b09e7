"""What a station's result follows from, as a key under which finished stations are kept."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import torch

from torchliner.io.burst_sources import StationSource
from torchliner.liners.model import LinerModel
from torchliner.records import BurstRecord, ReferenceChannel
from torchliner.version import __version__


def station_key(
    station: BurstRecord | StationSource, reference: ReferenceChannel | None, choices: list[Any]
) -> str:
    """Hash of the data, the reference channel and all choices: 32 hexadecimal digits."""
    if isinstance(station, StationSource):
        source = f"{station.digest()} {station.name}"
    else:
        source = _hash(list(vars(station).values()))
    channel = (
        [] if reference is None else [reference.values, reference.sampling_rate, reference.start]
    )
    text = json.dumps([__version__, source, _hash(channel), *choices], default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def liner_fingerprint(liner: LinerModel) -> str:
    """Hash of a liner's description and impedances: the name of a table says too little."""
    low, high = liner.frequency_range or (300.0, 3500.0)
    top = min(20.0, liner.speed_max or 20.0)
    speeds = torch.linspace(0, top, 41, dtype=torch.float64)
    with torch.no_grad():
        values = [
            torch.as_tensor(liner.impedance(float(f), speeds)).to(torch.complex128)
            for f in torch.linspace(float(low), float(high), 9)
        ]
    about = json.dumps(liner.describe(), default=str)
    return _hash([torch.view_as_real(torch.stack(values)), about])


def _hash(values: list[Any]) -> str:
    digest = hashlib.sha256()
    for value in values:
        digest.update(value.numpy().tobytes() if hasattr(value, "numpy") else repr(value).encode())
    return digest.hexdigest()

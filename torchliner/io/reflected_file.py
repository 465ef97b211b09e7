"""The reflected signal of every probe, written as it is formed (docs/formats.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.io.fields import write_times
from torchliner.io.hdf5 import attach_scales, set_texts, write_index
from torchliner.io.tables import FileKind, write_variables
from torchliner.records import VelocityPlane
from torchliner.records.declared import Variable

TABLE = (Variable("incident", dims=("time",)), *(Variable(axis, "m", ("probe",), optional=True) for axis in "xz"))
KIND = FileKind("torchliner reflected 1", "reflected signal", {"title": "", "choices": {}})


@contextmanager
def reflected_file(
    path: str | Path, plane: VelocityPlane, incident: Tensor, used: Tensor, choices: dict[str, Any]
) -> Iterator[Callable[[Tensor, int], None]]:
    """netCDF-4 with ``incident`` (time) and ``reflected`` (time, probe), in the same unit.

    A crash leaves the old file, if any, as it was.

    Args:
        path, plane, incident, choices: what is written.
        used: probes that were not left out, (P,); the others are written as nan.
    Yields:
        ``store(signal, begin)`` for the samples from ``begin`` on, (t, N); columns beyond the probes are averages.
    """
    with KIND.created(path, SimpleNamespace(title=plane.title, choices=choices)) as file:
        write_times(file, plane)
        write_index(file, "probe", plane.probes)
        places = dict(zip("xz", plane.probe_coordinates(), strict=True))
        write_variables(file, SimpleNamespace(incident=incident, **places), TABLE)
        data = file.create_dataset("reflected", (plane.samples, plane.probes), np.float32)
        set_texts(data, units="1")
        attach_scales(data, file, ("time", "probe"))

        def store(signal: Tensor, begin: int) -> None:
            part = torch.where(used, signal[:, : plane.probes].detach().cpu(), torch.nan)
            data[begin : begin + len(part)] = part.numpy()

        yield store

"""The reflected signal of every probe, written as it is formed (docs/formats.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from torch import Tensor

from torchliner.io.hdf5 import attach_scales, set_texts, write_index
from torchliner.io.own_writer import write_times
from torchliner.io.plane_writer import reserve
from torchliner.io.tables import write_attribute, write_row
from torchliner.io.whole_file import HDF5, written_whole
from torchliner.records import VelocityPlane
from torchliner.records.declared import Variable


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
    with h5py.File.in_memory() as file:
        set_texts(file, Conventions="CF-1.8", schema="torchliner reflected 1", title=plane.title)
        write_attribute(file, "choices", choices)
        write_times(file, plane)
        write_index(file, "probe", plane.probes)
        write_row(file, Variable("incident", dims=("time",)), incident)
        for axis, places in zip("xz", plane.probe_coordinates(), strict=True):
            if places is not None:
                write_row(file, Variable(axis, "m", ("probe",)), places)
        data = file.create_dataset("reflected", (plane.samples, plane.probes), np.float32)
        set_texts(data, units="1")
        attach_scales(data, file, ("time", "probe"))
        file.flush()
        image = file.id.get_file_image()
    with written_whole(path, *HDF5) as temporary:
        reserve(temporary, image, 4 * plane.samples * plane.probes)
        with h5py.File(temporary, "r+") as file:

            def store(signal: Tensor, begin: int) -> None:
                part = torch.where(used, signal[:, : plane.probes].detach().cpu(), torch.nan)
                file["reflected"][begin : begin + len(part)] = part.numpy()

            yield store

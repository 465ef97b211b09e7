"""The reflected signal of every probe, written as it is formed (docs/formats.md)."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.io.axes import write_times
from torchliner.io.hdf5 import attach_scales, write_index, write_variable
from torchliner.io.tables import FileKind
from torchliner.records import VelocityPlane

KIND = FileKind("torchliner reflected 1", "reflected signal", {"title": "", "choices": {}})


class ReflectedFile:
    """netCDF-4 with ``incident`` (time) and ``reflected`` (time, probe), in the same unit.

    A crash leaves the old file, if any, as it was.
    """

    def __init__(
        self,
        path: str | Path,
        plane: VelocityPlane,
        incident: Tensor,
        used: Tensor,
        choices: dict[str, Any],
    ) -> None:
        """``used``: probes that were not left out, (P,); the others are written as nan."""
        self.path, self.plane, self.incident = path, plane, incident
        self.title, self.choices = plane.title, choices
        self.used = used.cpu()
        self.stack = ExitStack()

    def __enter__(self) -> ReflectedFile:
        plane = self.plane
        file = self.stack.enter_context(KIND.created(self.path, self))
        write_times(file, plane.samples, plane.sampling_rate)
        write_index(file, "probe", plane.probes)
        for name, values in zip(("x", "z"), plane.probe_coordinates(), strict=True):
            if values is not None:
                write_variable(file, name, values.numpy(), "m", ("probe",))
        write_variable(file, "incident", self.incident.numpy(), "1", ("time",))
        self.data = file.create_dataset("reflected", (plane.samples, plane.probes), np.float32)
        self.data.attrs["units"] = "1"
        attach_scales(self.data, file, ("time", "probe"))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stack.__exit__(kind, error, trace)

    def store(self, signal: Tensor, columns: slice, begin: int) -> None:
        """Samples ``begin`` .. of some columns, (t, p); those beyond the probes are averages."""
        stop = min(columns.stop, self.plane.probes)
        if columns.start < stop:
            part = signal[:, : stop - columns.start].cpu()
            part = torch.where(self.used[columns.start : stop], part, torch.nan)
            self.data[begin : begin + len(part), columns.start : stop] = part.numpy()

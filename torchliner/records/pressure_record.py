"""Pressure in: on the facesheet, at the cavity bottom, along a line of microphones."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import Any, ClassVar

import torch
from torch import Tensor

from torchliner.checks import make_plain, plain_array, require_positive_where_stated
from torchliner.records.declared import record, require_shapes, table_of, var
from torchliner.records.outlets import Written
from torchliner.records.probes import AtProbes, finite_places, signal_tensor

LARGEST = 1e9  # of a signal, Pa or m/s: beyond any gas


@record
class PressureRecord(Written, AtProbes):
    """Pressures around a liner on one time base, for the in situ method and for microphones.

    Facesheet and backplate go together; a record may hold them, microphones, or both. The facesheet's probe axes are
    (z, x), (x) or (probe). The backplate is (T,), one for all probes, (C, T), one per cell by the numbers of
    ``probe_cell``, else in rising z, then x, or of the facesheet's shape, one per probe.

    Raises:
        TypeError: a signal is not real floating point.
        ValueError: a signal is missing, has another time base, is not finite or exceeds 1e9; a
            length, share or Mach number is out of range.
    """

    facesheet: Any = var("facesheet", "time", unit="Pa", name="facesheet_pressure", text="on the surface", default=None)
    backplate: Any = var(
        "backplate", "time", unit="Pa", name="backplate_pressure", text="at the cavity bottom", default=None
    )
    _: KW_ONLY
    cavity_depth: float | None = var(unit="m", text="from the mouth of the cavity to the backplate", default=None)
    cavity_porosity: float = var(text="share of the liner's surface that is cavity, 0 to 1", default=1.0)
    cavity_hydraulic_radius: float | None = var(
        unit="m", text="for losses in the cavity; D/2 for a square of side D", default=None
    )
    cell_pitch: float | None = var(
        unit="m", text="by which probes are sorted into cells, as those of planes are", default=None
    )
    probe_cell: Any = var("facesheet", text="cell of each probe instead, from 0, -1 for none", default=None)
    microphones: Any = var(
        "microphone", "time", unit="Pa", name="microphone_pressure", text="along a line", default=None
    )
    microphone_y: Any = var(
        "microphone", unit="m", text="distances from the surface whose impedance is wanted", default=None
    )
    microphone_velocity: Any = var(
        "microphone", "time", unit="m/s", text="away from the surface", default=None, positive="away from the liner"
    )
    microphone_mach: float = var(text="of a flow along the microphones' axis, away from the surface", default=0.0)
    name: str = "pressure"

    FILE: ClassVar = "torchliner.io.pressure_file:FILE"

    def __post_init__(self) -> None:
        make_plain(self)
        for label, unit in SIGNALS.items():
            value = getattr(self, label)
            if value is not None:
                tensor = signal_tensor(value, label, self.name, unit)
                _require_finite(tensor, label, self.name)
                object.__setattr__(self, label, tensor)
        self._check_pressures()
        self._check_case()
        require_positive_where_stated(self, "cavity_depth", "cavity_hydraulic_radius", "cell_pitch", "cavity_porosity")
        if self.cavity_porosity > 1:
            raise ValueError(
                f"{self.name}: cavity_porosity is {self.cavity_porosity:g}; it is the share of the "
                "surface that is cavity, at most 1 (80 % is 0.8)"
            )
        self._check_cells()
        self._check_microphones()
        require_shapes(self, self.name)

    def _check_pressures(self) -> None:
        """Facesheet and backplate, or neither but microphones; one time base."""
        if (self.facesheet is None) != (self.backplate is None):
            there, missing = ("facesheet", "backplate") if self.backplate is None else ("backplate", "facesheet")
            raise ValueError(
                f"{self.name}: {missing} pressure is missing; the in situ method needs it beside the {there} pressure"
            )
        if self.facesheet is None and self.microphones is None:
            raise ValueError(f"{self.name}: no pressure is given; give facesheet and backplate, or microphones")
        for label, most in (("facesheet", 3), ("backplate", 3), ("microphones", 2)):
            value = getattr(self, label)
            if value is not None and (value.ndim not in range(1, most + 1) or 0 in value.shape):
                raise ValueError(
                    f"{self.name}: {label} has shape {tuple(value.shape)}; it needs at least one "
                    f"sample, time last, and at most {most - 1} axes before it"
                )
        face, back = self.facesheet, self.backplate
        if back is not None and back.ndim == 3 and back.shape != face.shape:
            raise ValueError(
                f"{self.name}: backplate has shape {tuple(back.shape)}, facesheet "
                f"{tuple(face.shape)}; it is (time), (cell, time) or like the facesheet"
            )

    def _check_cells(self) -> None:
        if self.probe_cell is None:
            return
        labels = torch.as_tensor(plain_array(self.probe_cell, f"{self.name}: probe_cell")).reshape(-1)
        if labels.is_floating_point() or labels.is_complex():
            raise TypeError(f"{self.name}: probe_cell is {labels.dtype}; whole numbers are needed")
        labels = labels.to(torch.int64)
        if len(labels) != self.probes:
            raise ValueError(f"{self.name}: probe_cell has {len(labels)} values for {self.probes} probes")
        inside = torch.unique(labels[labels >= 0])
        if not len(inside) or int(labels.min()) < -1 or len(inside) <= int(inside.max()):
            raise ValueError(
                f"{self.name}: probe_cell holds {torch.unique(labels).tolist()}; cells are "
                "numbered 0, 1, 2, ... without gaps, -1 stands for no cell"
            )
        object.__setattr__(self, "probe_cell", labels)

    def _check_microphones(self) -> None:
        if not abs(self.microphone_mach) < 1:
            raise ValueError(
                f"{self.name}: microphone_mach is {self.microphone_mach:g}; plane waves run both ways only below Mach 1"
            )
        if self.microphones is None:
            if self.microphone_y is not None or self.microphone_velocity is not None:
                raise ValueError(f"{self.name}: microphones have no pressure; give microphones")
            return
        if self.microphones.ndim == 1:
            object.__setattr__(self, "microphones", self.microphones[None])
        if self.microphone_y is None:
            raise ValueError(f"{self.name}: microphone_y is missing, the {len(self.microphones)} distances in m")
        object.__setattr__(self, "microphone_y", finite_places(self.microphone_y, "microphone_y", self.name))
        if self.microphone_velocity is not None and self.microphone_velocity.ndim == 1:
            object.__setattr__(self, "microphone_velocity", self.microphone_velocity[None])

    @property
    def samples(self) -> int:
        """T."""
        first = self.microphones if self.facesheet is None else self.facesheet
        return int(first.shape[-1])

    @property
    def probe_shape(self) -> tuple[int, ...]:
        """Shape of the facesheet's probe axes: (z, x), (probe,) or ()."""
        return () if self.facesheet is None else tuple(self.facesheet.shape[:-1])


SIGNALS = {
    row.field: row.unit
    for row in table_of(PressureRecord, "facesheet", "backplate", "microphones", "microphone_velocity")
}


def _require_finite(signal: Tensor, label: str, name: str) -> None:
    bad = ~torch.isfinite(signal)
    if bool(bad.any()):
        place = tuple(bad.nonzero()[0].tolist())
        raise ValueError(
            f"{name}: {label} holds {int(bad.sum())} nan or inf, the first at probe {place[:-1]}, "
            f"sample {place[-1]}; repair it or leave that probe out"
        )
    # Their squares are summed; static pressures are allowed.
    if signal.numel() and float(signal.abs().max()) > LARGEST:
        raise ValueError(
            f"{name}: {label} reaches {float(signal.abs().max()):.3g}, above {LARGEST:g}; give it in {SIGNALS[label]}"
        )

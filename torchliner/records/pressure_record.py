"""Pressure in: on the facesheet, at the cavity bottom, along a line of microphones."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import (
    make_plain,
    plain_array,
    require_positive,
    require_positive_where_stated,
)
from torchliner.fluid import Fluid
from torchliner.records.outlets import Written
from torchliner.records.probes import AtProbes, checked_coordinate, finite_places, signal_tensor
from torchliner.records.unit_checks import require_flow_and_level

SIGNALS = {
    "facesheet": "Pa",
    "backplate": "Pa",
    "microphones": "Pa",
    "microphone_velocity": "m/s",
}
LARGEST = 1e9  # of a signal, Pa or m/s: beyond any gas


@dataclass(frozen=True, eq=False)
class PressureRecord(Written, AtProbes):
    """Pressures around a liner on one time base, for the in situ method and for microphones.

    Facesheet and backplate go together; a record may hold them, microphones, or both.

    Args:
        facesheet: Pa, on the surface, (..., T) with probe axes (z, x), (x) or (probe).
        backplate: Pa, at the cavity bottom: (T,) one for all probes, (C, T) one per cell, by the
            numbers of ``probe_cell``, else in rising z, then x, or of the facesheet's shape, one
            per probe.
        sampling_rate: Hz.
        x, z: coordinates of the facesheet probes, m, as in ``VelocityPlane``.
        cavity_depth: H, m, from the mouth of the cavity to the backplate.
        cavity_porosity: share of the liner's surface that is cavity, 0 to 1.
        cavity_hydraulic_radius: m, for losses in the cavity; D/2 for a square of side D.
        cell_pitch: m; probes are sorted into cells by it, as those of planes are.
        probe_cell: cell of each probe instead, whole numbers from 0, -1 for none, (P,).
        microphones: Pa, (M, T).
        microphone_y: their distances from the surface whose impedance is wanted, m, (M,).
        microphone_velocity: m/s, positive AWAY from the surface, (M, T).
        microphone_mach: of a flow along the microphones' axis, positive AWAY from the surface.
        fluid: gas of the data.
        start: time of the first sample, s, on the clock of the planes beside it.
        frequency: tone, Hz.  incident_level: nominal SPL, dB.  mach: bulk, along the liner.
        reference: independent impedances of the same case, normalised, by name.
        title, provenance: where the data come from.
        name: how messages call it (a file's name).
    Raises:
        TypeError: a signal is not real floating point.
        ValueError: a signal is missing, has another time base, is not finite or exceeds 1e9; a
            length, share or Mach number is out of range.
    """

    facesheet: Any = None
    backplate: Any = None
    sampling_rate: float = field(kw_only=True)
    x: Any = field(default=None, kw_only=True)
    z: Any = field(default=None, kw_only=True)
    cavity_depth: float | None = field(default=None, kw_only=True)
    cavity_porosity: float = field(default=1.0, kw_only=True)
    cavity_hydraulic_radius: float | None = field(default=None, kw_only=True)
    cell_pitch: float | None = field(default=None, kw_only=True)
    probe_cell: Any = field(default=None, kw_only=True)
    microphones: Any = field(default=None, kw_only=True)
    microphone_y: Any = field(default=None, kw_only=True)
    microphone_velocity: Any = field(default=None, kw_only=True)
    microphone_mach: float = field(default=0.0, kw_only=True)
    fluid: Fluid = field(default_factory=Fluid, kw_only=True)
    start: float = field(default=0.0, kw_only=True)
    frequency: float | None = field(default=None, kw_only=True)
    incident_level: float | None = field(default=None, kw_only=True)
    mach: float | None = field(default=None, kw_only=True)
    reference: Mapping[str, complex] = field(default_factory=dict, kw_only=True)
    title: str = field(default="", kw_only=True)
    provenance: Mapping[str, Any] = field(default_factory=dict, kw_only=True)
    name: str = field(default="pressure", kw_only=True)

    def __post_init__(self) -> None:
        make_plain(self)
        for label, unit in SIGNALS.items():
            value = getattr(self, label)
            if value is not None:
                tensor = signal_tensor(value, label, self.name, unit)
                _require_finite(tensor, label, self.name)
                object.__setattr__(self, label, tensor)
        require_positive(f"{self.name}: sampling_rate (Hz)", self.sampling_rate)
        if not math.isfinite(self.start):
            raise ValueError(f"{self.name}: start is {self.start:g} s; it must be finite")
        self._check_pressures()
        for label in ("x", "z"):
            value = checked_coordinate(getattr(self, label), label, self.probe_shape, self.name)
            object.__setattr__(self, label, value)
        require_positive_where_stated(self, "cavity_depth", "cavity_hydraulic_radius", "cell_pitch", "frequency")
        require_positive(f"{self.name}: cavity_porosity", self.cavity_porosity)
        if self.cavity_porosity > 1:
            raise ValueError(
                f"{self.name}: cavity_porosity is {self.cavity_porosity:g}; it is the share of the "
                "surface that is cavity, at most 1 (80 % is 0.8)"
            )
        require_flow_and_level(self)
        self._check_cells()
        self._check_microphones()

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
        samples = self.samples
        for label in SIGNALS:
            value = getattr(self, label)
            if value is not None and value.shape[-1] != samples:
                first = "microphones" if self.facesheet is None else "facesheet"
                raise ValueError(
                    f"{self.name}: {label} has {value.shape[-1]} samples, {first} {samples}; they "
                    "share one time base: resample or cut them to the same times"
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
        count = len(self.microphones)
        if self.microphone_y is None:
            raise ValueError(f"{self.name}: microphone_y is missing, the {count} distances in m")
        places = finite_places(self.microphone_y, "microphone_y", self.name)
        if len(places) != count:
            raise ValueError(f"{self.name}: microphone_y has {len(places)} values for {count}")
        velocity = self.microphone_velocity
        if velocity is not None:
            velocity = velocity[None] if velocity.ndim == 1 else velocity
            if velocity.shape != self.microphones.shape:
                raise ValueError(
                    f"{self.name}: microphone_velocity has shape {tuple(velocity.shape)}, "
                    f"microphones {tuple(self.microphones.shape)}; they go together"
                )
            object.__setattr__(self, "microphone_velocity", velocity)
        object.__setattr__(self, "microphone_y", places)

    @property
    def samples(self) -> int:
        """T."""
        first = self.microphones if self.facesheet is None else self.facesheet
        return int(first.shape[-1])

    @property
    def probe_shape(self) -> tuple[int, ...]:
        """Shape of the facesheet's probe axes: (z, x), (probe,) or ()."""
        return () if self.facesheet is None else tuple(self.facesheet.shape[:-1])


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

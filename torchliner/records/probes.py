"""What records of signals at probes share: tensors in, coordinates checked against the axes."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, field
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import plain_array, real_tensor, require_positive
from torchliner.records.case import OfOneTone
from torchliner.records.declared import ANY, check, record, var
from torchliner.units import require_plausible


@record
class AtProbes(OfOneTone):
    """Uniform samples at probes, and the coordinates of these.

    ``samples`` is T, ``probe_shape`` the shape of the probe axes, (z, x), (probe,) or (), ``probes`` their number, 1
    without axes.

    Args:
        sampling_rate: Hz.
    """

    _: KW_ONLY
    sampling_rate: float
    start: float = var(unit="s", text="time of the first sample", range=ANY, default=0.0)
    x: Any = var("columns", unit="m", default=None, text="streamwise coordinate, of each column or probe")
    z: Any = var("rows", unit="m", text="spanwise coordinate, of each row or probe", default=None)

    samples: int = field(init=False)
    probe_shape: tuple[int, ...] = field(init=False)
    probes: int = field(init=False)

    UNSAID: ClassVar = ("sampling_rate", "start", "name")  # in its file: times and the file's name

    def _check(self, signal: Any) -> None:
        """Shapes from one of the signals, coordinates as tensors; refuse what no such record has."""
        require_positive(f"{self.name}: sampling_rate (Hz)", self.sampling_rate)
        shape = tuple(signal.shape[:-1])
        known = {"samples": int(signal.shape[-1]), "probe_shape": shape, "probes": math.prod(shape)}
        for label, found in known.items():
            object.__setattr__(self, label, found)
        for label in ("x", "z"):
            if (value := getattr(self, label)) is not None:
                values = finite_places(value, label, self.name)
                wanted = self.probes if len(shape) < 2 else shape[-1] if label == "x" else shape[0]
                if len(values) != wanted:
                    raise ValueError(
                        f"{self.name}: {label} has {len(values)} values; probes of shape {shape} need {wanted}"
                    )
                object.__setattr__(self, label, values)
        check(self)

    @property
    def duration(self) -> float:
        """T / sampling_rate, s."""
        return self.samples / self.sampling_rate

    @property
    def axes(self) -> dict[str, tuple[str, ...]]:
        """Dimensions of its file; probes whose x rises, without z, are a line."""
        line = self.x is not None and self.z is None and bool((self.x.diff() > 0).all())
        return probe_axes(self.probe_shape, line)

    def probe_coordinates(self) -> tuple[Tensor | None, Tensor | None]:
        """x and z of every probe, m, each (P,) or None."""
        x, z = self.x, self.z
        if len(self.probe_shape) == 2:
            rows, columns = self.probe_shape
            x = None if x is None else x.repeat(rows)
            z = None if z is None else z.repeat_interleave(columns)
        return x, z


def probe_axes(shape: tuple[int, ...], line: bool = False) -> dict[str, tuple[str, ...]]:
    """Dimensions of probes: z and x of a surface, else ``probe``, or x along a ``line``; none of a single probe."""
    if len(shape) == 2:
        return {"probes": ("z", "x"), "columns": ("x",), "rows": ("z",)}
    return dict.fromkeys(("probes", "columns", "rows"), () if not shape else ("x",) if line else ("probe",))


def signal_tensor(value: Any, label: str, name: str, unit: str) -> Tensor:
    """A signal as a tensor, without a copy where possible.

    Args:
        value: tensor or array, time last; masked values become nan.
        label, name: of the signal and of its record, for messages.
        unit: the unit it must be in.
    Raises:
        TypeError: not float32 or float64; an array whose axes have names.
    """
    if not isinstance(value, Tensor):
        _require_plain(value, f"{name}: {label}", unit)
        array = plain_array(value, f"{name}: {label}", missing=True)
        array = array.astype(array.dtype.newbyteorder("="), copy=False)
        if array.dtype not in (np.float32, np.float64):
            raise TypeError(f"{name}: {label} is {array.dtype}; floating-point {unit}, float32 or float64, are needed")
        # torch knows no negative strides; only such an array is copied.
        value = torch.as_tensor(array.copy() if any(stride < 0 for stride in array.strides) else array)
    if value.dtype not in (torch.float32, torch.float64) or value.layout != torch.strided or value.is_meta:
        kind = "meta" if value.is_meta else f"{value.dtype}, {value.layout}"
        raise TypeError(f"{name}: {label} is {kind}; a dense tensor of float32 or float64 in {unit} is needed")
    return value


def finite_places(value: Any, label: str, name: str) -> Tensor:
    """Coordinates as float64, (N,), a copy: the caller may fill his array again.

    Raises:
        TypeError: not real numbers; an array whose axes have names.
        ValueError: values that are not finite, masked, or beyond any duct.
    """
    _require_plain(value, f"{name}: {label}", "m")
    values = real_tensor(value, name=f"{name}: {label}").cpu().reshape(-1).clone()
    if not bool(torch.isfinite(values).all()):
        raise ValueError(f"{name}: {label} holds values that are not finite")
    require_plausible(values.numpy(), "length", f"{name}: {label}")
    return values


def _require_plain(value: Any, label: str, unit: str) -> None:
    """Refuse an array whose axes, sign and unit are said beside its numbers, where they would go by unseen."""
    if hasattr(value, "dims") or hasattr(value, "dimensions"):
        raise TypeError(
            f"{label} is a {type(value).__name__} whose axes have names; read a plane by VelocityPlane.from_xarray, or "
            f"give its plain values, time last, in {unit}"
        )

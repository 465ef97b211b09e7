"""What records of signals at probes share: tensors in, coordinates checked against the axes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import KW_ONLY
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import plain_array, real_tensor, require_positive
from torchliner.records.case import OfOneTone
from torchliner.records.declared import record, var
from torchliner.units import SI_QUANTITY, require_plausible, si_factor


@record
class AtProbes(OfOneTone):
    """Uniform samples at probes, and the coordinates of these.

    Args:
        sampling_rate: Hz.
    """

    _: KW_ONLY
    sampling_rate: float
    start: float = var(unit="s", text="time of the first sample on the clock of the data", default=0.0)
    x: Any = var("columns", unit="m", default=None, text="streamwise coordinate, of each column or probe")
    z: Any = var("rows", unit="m", text="spanwise coordinate, of each row or probe", default=None)

    def _check_case(self) -> None:
        super()._check_case()
        require_positive(f"{self.name}: sampling_rate (Hz)", self.sampling_rate)
        if not math.isfinite(self.start):
            raise ValueError(f"{self.name}: start is {self.start:g} s; it must be finite")
        for label in ("x", "z"):
            if getattr(self, label) is not None:
                values = finite_places(getattr(self, label), label, self.name)
                shape = self.probe_shape
                wanted = self.probes if len(shape) < 2 else shape[-1] if label == "x" else shape[0]
                if len(values) != wanted:
                    raise ValueError(
                        f"{self.name}: {label} has {len(values)} values; probes of shape {shape} need {wanted}"
                    )
                object.__setattr__(self, label, values)

    @property
    def samples(self) -> int:
        """T."""
        raise NotImplementedError

    @property
    def probe_shape(self) -> tuple[int, ...]:
        """Shape of the probe axes: (z, x), (probe,) or ()."""
        raise NotImplementedError

    @property
    def probes(self) -> int:
        """Number of probes; 1 without probe axes."""
        return int(np.prod(self.probe_shape, dtype=np.int64))

    @property
    def duration(self) -> float:
        """T / sampling_rate, s."""
        return self.samples / self.sampling_rate

    def probe_coordinates(self) -> tuple[Tensor | None, Tensor | None]:
        """x and z of every probe, m, each (P,) or None."""
        x, z = self.x, self.z
        if len(self.probe_shape) == 2:
            rows, columns = self.probe_shape
            x = None if x is None else x.repeat(rows)
            z = None if z is None else z.repeat_interleave(columns)
        return x, z


def signal_tensor(value: Any, label: str, name: str, unit: str) -> Tensor:
    """A signal as a tensor, without a copy where possible.

    Args:
        value: tensor or array; masked values become nan. Where its axes have names, as those of
            xarray, that called ``time`` is moved to the end, x behind the others.
        label, name: of the signal and of its record, for messages.
        unit: the unit it must be in.
    Raises:
        TypeError: not float32 or float64; a table; names of axes without a ``time``.
        ValueError: it states another unit.
    """
    if isinstance(value, Tensor):
        tensor = value
        if tensor.layout != torch.strided or tensor.is_meta:
            kind = "meta" if tensor.is_meta else str(tensor.layout).removeprefix("torch.")
            raise TypeError(f"{name}: {label} is a {kind} tensor; give a dense one, in memory")
    else:
        array = _time_last(value, f"{name}: {label}", unit)
        if array.dtype.kind not in "fiuc":
            raise TypeError(f"{name}: {label} is {array.dtype}; floating-point {unit} are needed")
        if array.dtype.itemsize > 8 and array.dtype.kind == "f":  # torch has no such type
            raise TypeError(f"{name}: {label} is {array.dtype}; convert it to float64 first")
        native = array.astype(array.dtype.newbyteorder("="), copy=False)
        # torch knows no negative strides; only such an array is copied.
        backwards = any(stride < 0 for stride in native.strides)
        tensor = torch.as_tensor(native.copy() if backwards else native)
    if tensor.dtype not in (torch.float32, torch.float64):
        raise TypeError(
            f"{name}: {label} is {tensor.dtype}; float32 or float64 in {unit} is needed "
            "(convert and scale it first, so that no unit is guessed)"
        )
    return tensor


def _time_last(value: Any, name: str, unit: str) -> np.ndarray:
    """An array whose axes may have names and which may state its unit."""
    array = plain_array(value, name, missing=True)
    _require_unit(value, name, unit)
    axes = getattr(value, "dims", getattr(value, "dimensions", None))
    if not isinstance(axes, tuple) or len(axes) != array.ndim or array.ndim == 0:
        return array
    if axes.count("time") != 1:
        raise TypeError(
            f"{name} has the axes {axes}, none of them 'time'; rename one, or give a plain array, time last"
        )
    order = sorted((axis for axis in axes if axis != "time"), key=lambda axis: axis == "x")
    return array.transpose([axes.index(axis) for axis in (*order, "time")])


def _require_unit(value: Any, name: str, unit: str) -> None:
    """Refuse an array that states another unit than the SI unit it must be in."""
    stated = getattr(value, "unit", getattr(value, "units", None))
    if stated is None and isinstance(about := getattr(value, "attrs", None), Mapping):
        stated = about.get("units")
    if stated is not None and unit in SI_QUANTITY:
        factor = si_factor(SI_QUANTITY[unit], str(stated), name)
        if factor != 1:
            raise ValueError(f"{name} is in {stated}; multiply it by {factor:g}: {unit} is needed")


def finite_places(value: Any, label: str, name: str) -> Tensor:
    """Coordinates as float64, (N,), a copy: the caller may fill his array again.

    Raises:
        TypeError: not real numbers.
        ValueError: values that are not finite, masked, in another unit, or beyond any duct.
    """
    if not isinstance(value, Tensor):
        _require_unit(value, f"{name}: {label}", "m")
    values = real_tensor(value, name=f"{name}: {label}").cpu().reshape(-1).clone()
    if not bool(torch.isfinite(values).all()):
        raise ValueError(f"{name}: {label} holds values that are not finite")
    require_plausible(values.numpy(), "length", f"{name}: {label}")
    return values

"""What records of signals at probes share: tensors in, coordinates checked against the axes."""

from __future__ import annotations

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
    start: float = var(
        unit="s", text="time of the first sample on the clock of the data", range="(-inf, inf)", default=0.0
    )
    x: Any = var("columns", unit="m", default=None, text="streamwise coordinate, of each column or probe")
    z: Any = var("rows", unit="m", text="spanwise coordinate, of each row or probe", default=None)

    def _check_case(self, *, tensors: bool = False) -> None:
        require_positive(f"{self.name}: sampling_rate (Hz)", self.sampling_rate)
        for label in ("x", "z"):
            if getattr(self, label) is not None:
                values, shape = finite_places(getattr(self, label), label, self.name), self.probe_shape
                wanted = self.probes if len(shape) < 2 else shape[-1] if label == "x" else shape[0]
                if len(values) != wanted:
                    raise ValueError(
                        f"{self.name}: {label} has {len(values)} values; probes of shape {shape} need {wanted}"
                    )
                object.__setattr__(self, label, values)
        super()._check_case(tensors=tensors)

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
        value: tensor or array; masked values become nan. Where its axes have names, as those of xarray, that called
            ``time`` is moved to the end, x behind the others.
        label, name: of the signal and of its record, for messages.
        unit: the unit it must be in.
    Raises:
        TypeError: not float32 or float64; a table; names of axes without a ``time``.
        ValueError: it states another unit.
    """
    name = f"{name}: {label}"
    if not isinstance(value, Tensor):
        array = _time_last(value, name, unit)
        array = array.astype(array.dtype.newbyteorder("="), copy=False)
        if array.dtype not in (np.float32, np.float64):
            raise TypeError(f"{name} is {array.dtype}; floating-point {unit}, float32 or float64, are needed")
        # torch knows no negative strides; only such an array is copied.
        value = torch.as_tensor(array.copy() if any(stride < 0 for stride in array.strides) else array)
    if value.dtype not in (torch.float32, torch.float64) or value.layout != torch.strided or value.is_meta:
        kind = "meta" if value.is_meta else f"{value.dtype}, {value.layout}"
        raise TypeError(f"{name} is {kind}; a dense tensor of float32 or float64 in {unit} is needed")
    return value


def _time_last(value: Any, name: str, unit: str) -> np.ndarray:
    """An array whose axes may have names and which may state its unit."""
    array = plain_array(value, name, missing=True)
    _require_unit(value, name, unit)
    axes = getattr(value, "dims", getattr(value, "dimensions", None))
    if not isinstance(axes, tuple) or len(axes) != array.ndim or array.ndim == 0:
        return array
    if axes.count("time") != 1:
        raise TypeError(f"{name} has the axes {axes}, none of them 'time'; rename one, or give an array, time last")
    order = sorted((axis for axis in axes if axis != "time"), key=lambda axis: axis == "x")
    return array.transpose([axes.index(axis) for axis in (*order, "time")])


def _require_unit(value: Any, name: str, unit: str) -> None:
    """Refuse an array that states another unit than the SI unit it must be in."""
    stated = getattr(value, "unit", getattr(value, "units", None)) or getattr(value, "attrs", {}).get("units")
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

"""What records of signals at probes share: tensors in, coordinates checked against the axes."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor


class AtProbes:
    """What follows from samples, rate and the shape and coordinates of the probe axes."""

    sampling_rate: float
    x: Any
    z: Any

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
        value: tensor or array.
        label, name: of the signal and of its record, for messages.
        unit: the unit it must be in.
    Raises:
        TypeError: not float32 or float64.
    """
    if isinstance(value, Tensor):
        tensor = value
        if tensor.layout != torch.strided or tensor.is_meta:
            kind = "meta" if tensor.is_meta else str(tensor.layout).removeprefix("torch.")
            raise TypeError(f"{name}: {label} is a {kind} tensor; give a dense one, in memory")
    else:
        array = np.asarray(value)
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


def finite_places(value: Any, label: str, name: str) -> Tensor:
    """Coordinates as float64, (N,).

    Raises:
        ValueError: values that are not finite.
    """
    values = torch.as_tensor(np.asarray(value, dtype=np.float64)).reshape(-1)
    if not bool(torch.isfinite(values).all()):
        raise ValueError(f"{name}: {label} holds values that are not finite")
    return values


def checked_coordinate(
    value: Any, label: str, probe_shape: tuple[int, ...], name: str
) -> Tensor | None:
    """x or z as float64: one value per column (row) of a (z, x) plane, else one per probe.

    Raises:
        ValueError: a wrong number of values, or values that are not finite.
    """
    if value is None:
        return None
    values = finite_places(value, label, name)
    probes = int(np.prod(probe_shape, dtype=np.int64))
    wanted = probes if len(probe_shape) < 2 else probe_shape[-1] if label == "x" else probe_shape[0]
    if len(values) != wanted:
        raise ValueError(
            f"{name}: {label} has {len(values)} values; probes of shape {probe_shape} need {wanted}"
        )
    return values

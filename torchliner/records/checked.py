"""What users hand in, made tensors and plain numbers of the kinds, ranges and shapes that its fields declare."""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import make_plain, plain_array, real_tensor, require_choice, require_complex
from torchliner.records.declared import ANY, Variable, variables_of

SEVERAL = ("probes", "columns", "rows", "draws", "facesheet", "backplate", "places")  # for several axes or none
OF_TWO = {"part": (2,), "with_part": (2,)}  # dimensions of real and imaginary part


def check(record: Any, *, tensors: bool = False) -> None:
    """Make signals, places and numbers of a record tensors and plain, and refuse values beyond their ranges and shapes
    that disagree, by a TypeError or ValueError that names field, value, place and range; ``tensors``: scalar ones stay,
    as derivatives may pass through them."""
    make_plain(record, tensors=tensors)
    for each in dataclasses.fields(record):
        if "choices" in each.metadata:
            require_choice(f"{record.name}: {each.name}", getattr(record, each.name), each.metadata["choices"])
    there = [(row, value) for row in variables_of(type(record)) if (value := getattr(record, row.field)) is not None]
    for i, (row, value) in enumerate(there):
        label = f"{record.name}: {row.field}"
        if row.kind in ("signal", "places"):
            value = signal_tensor(value, label) if row.kind == "signal" else places_tensor(value, label)
            object.__setattr__(record, row.field, value)
            there[i] = row, value
        if row.range:
            _require_range(row, torch.as_tensor(value).detach(), label)
    require_shapes(there, record.name)


def _require_range(row: Variable, values: Tensor, label: str) -> None:
    low, high = (float(end) for end in row.range[1:-1].split(","))
    values = values.abs() if values.is_complex() else values
    good = (values >= low if row.range[0] == "[" else values > low) & (
        values <= high if row.range[-1] == "]" else values < high
    )
    if not bool(good.all()):
        place = tuple((~good).nonzero()[0].tolist())
        where = f" at {', '.join(map(str, place))} and {int((~good).sum()) - 1} more" if place else ""
        unit = "" if row.unit == "1" else f" {row.unit}"
        needed = "finite values are" if row.range == ANY else f"{row.range}{unit} is"
        text = f" ({row.text})" if row.text else ""
        raise ValueError(f"{label} is {float(values[place]):g}{unit}{where}; {needed} needed{text}")


def require_shapes(
    rows: Iterable[tuple[Variable, Any]], name: str, sizes: Mapping[str, tuple[int, ...]] = OF_TWO
) -> None:
    """Refuse values, as of ``flat``, whose axes are not those that they say, or are longer than in the values before;
    ``sizes``: lengths of dimensions that are known, () for those of no axis."""
    known = dict(sizes)
    for row, value in rows:
        if not row.dims:
            continue
        if row.kind == "complex" or "{}" in row.name:
            require_complex(f"{name}: {row.field}", value)
        shape = (len(value),) if isinstance(value, tuple | list) else tuple(value.shape)
        own = sum(dim not in SEVERAL for dim in row.dims)
        free, at = len(shape) - own, 0
        fits = free >= 0 and (free == 0 or own < len(row.dims))
        for dim in row.dims if fits else ():
            length = shape[at : at + (free if dim in SEVERAL else 1)]
            at += len(length)
            fits &= known.setdefault(dim, length) == length
        if not fits:
            needed = ", ".join(f"{'x'.join(map(str, known[dim]))} {dim}" if known.get(dim) else dim for dim in row.dims)
            raise ValueError(f"{name}: {row.field} has shape {shape}; ({needed}) is needed")


def signal_tensor(value: Any, label: str) -> Tensor:
    """A signal, time last, as a tensor of float32 or float64, without a copy where possible; masked values become nan.
    A TypeError for other kinds, and for an array whose axes have names."""
    if not isinstance(value, Tensor):
        array = plain_array(_nameless(value, label), label, missing=True)
        array = array.astype(array.dtype.newbyteorder("="), copy=False)
        # torch knows no negative strides; only such an array is copied.
        value = torch.as_tensor(array.copy() if any(stride < 0 for stride in array.strides) else array)
    if value.dtype not in (torch.float32, torch.float64):
        raise TypeError(f"{label} is {value.dtype}; floating-point numbers, float32 or float64, are needed")
    return value


def places_tensor(value: Any, label: str) -> Tensor:
    """A list of numbers as float64, (N,), a copy: the caller may fill his array again. TypeError as
    ``signal_tensor``."""
    return real_tensor(_nameless(value, label), name=label).cpu().reshape(-1).clone()


def _nameless(value: Any, label: str) -> Any:
    """Refuse an array whose axes, sign and unit are said beside its numbers, where they would go by unseen."""
    if hasattr(value, "dims") or hasattr(value, "dimensions"):
        raise TypeError(
            f"{label} is a {type(value).__name__} whose axes have names; read a plane by VelocityPlane.from_xarray, or "
            "give its plain values, time last, in SI units"
        )
    return value

"""Input checks whose messages name the value, the limit and the remedy."""

import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache, partial
from typing import Any, get_type_hints

import numpy as np
import torch
from torch import Tensor

from torchliner.names import did_you_mean

SAME_FREQUENCY = 1e-6  # relative
FEWEST_PERIODS = 4.0  # of a tone in a record, unless shorter ones are asked for
FEEDS = -1e-9  # resistance below which a wall feeds sound; nearer to 0 it is rounding


class DataWarning(UserWarning):
    """The answer stands, but the data make it doubtful; the text says by how much."""


_heard: ContextVar[tuple[list[str], ...]] = ContextVar("heard", default=())


@contextmanager
def noted() -> Iterator[list[str]]:
    """A list that takes what is told within the block, for the notes of a record."""
    notes: list[str] = []
    token = _heard.set((*_heard.get(), notes))
    try:
        yield notes
    finally:
        _heard.reset(token)


def tell(notes: str | Iterable[str], depth: int = 1) -> None:
    """Warn of each note as a ``DataWarning``; ``depth``: how far above the caller is the line that it names."""
    for note in [notes] if isinstance(notes, str) else notes:
        for heard in _heard.get():
            heard.append(note)
        warnings.warn(note, DataWarning, stacklevel=depth + 2)


def plain_number(value: Any) -> float:
    """A number or 0-d tensor as a float, outside any gradient."""
    return float(value.detach() if isinstance(value, Tensor) else value)


def _plain(kinds: tuple[type, ...], needed: str, name: str, value: Any) -> Any:
    """What is one of these kinds, or an array or tensor of one element that is; else a TypeError."""
    plain = value.item() if hasattr(value, "item") and math.prod(value.shape) == 1 else value
    if not isinstance(plain, kinds) or (isinstance(plain, bool) and bool not in kinds):
        raise TypeError(f"{name} is {value!r}; {needed} is needed")
    return kinds[-1](plain)


# Python's, NumPy's, or an array or tensor of one; TypeError for text, truth values, and 200.0 as a whole number.
one_number: Callable[[str, Any], float] = partial(_plain, (int, float), "one number")
whole_number: Callable[[str, Any], int] = partial(_plain, (int,), "a whole number")
_complex = partial(_plain, (int, float, complex), "one number, complex or real,")
_READERS: dict[Any, Callable[[str, Any], Any]] = {
    float: one_number,
    int: whole_number,
    bool: partial(_plain, (bool,), "True or False"),
    complex | Tensor: _complex,
    Mapping[str, complex]: lambda name, values: {k: _complex(f"{name}[{k!r}]", v) for k, v in dict(values).items()},
}
_OPTIONAL = {kind | None: read for kind, read in _READERS.items()}


@cache
def type_hints(kind: Any) -> dict[str, Any]:
    """The annotations of a class, evaluated."""
    return get_type_hints(kind)


def make_plain(record: Any, prefix: str = "", *, tensors: bool = False) -> None:
    """Numbers, whole numbers and switches of a frozen dataclass, by its annotations, as Python's own; None stays None.

    A NumPy scalar computes in its own precision: a sampling rate in float32 moves phases by 1e-3 within a second.
    ``prefix``: of names in messages; default the record's own name. ``tensors``: leave these, through which derivatives
    may pass. TypeError for a field of another kind.
    """
    prefix = prefix or (f"{record.name}: " if getattr(record, "name", "") else "")
    for name, kind in type_hints(record.__class__).items():
        read, value = _READERS.get(kind) or _OPTIONAL.get(kind), getattr(record, name, None)
        known = value is not None or kind not in _OPTIONAL
        if read is not None and known and not (tensors and isinstance(value, Tensor)):
            object.__setattr__(record, name, read(f"{prefix}{name}", value))


def require_positive(name: str, value: Any) -> None:
    """Refuse what is not a finite number above zero."""
    number = one_number(name, value)
    if not (math.isfinite(number) and number > 0):
        raise ValueError(f"{name} is {number:g}; it must be finite and above 0")


def require_complex(name: str, value: Tensor) -> None:
    """Refuse a real tensor where a complex one is meant."""
    if not (isinstance(value, Tensor) and value.is_complex()):
        raise TypeError(f"{name} is {getattr(value, 'dtype', type(value).__name__)}; a complex tensor is needed")


def require_choice(name: str, value: str, choices: Iterable[str]) -> str:
    """Return ``value`` if it is one of ``choices``; else say which one is nearest."""
    if value not in (known := list(choices)):
        near = did_you_mean(str(value), known)
        raise ValueError(f"unknown {name} {value!r}{near}; choose one of: {', '.join(known)}")
    return value


def plain_array(value: Any, name: str, *, missing: bool = False) -> np.ndarray:
    """An array, list or number as an array; ``missing``: masked real numbers become nan, else they are refused."""
    if hasattr(value, "iloc") and value.ndim != 1:  # a table, whose rows are often times
        raise TypeError(f"{name} is a {type(value).__name__}; give .to_numpy(), its axes as documented")
    if not np.ma.is_masked(value):
        return np.asarray(value)
    if not missing or value.dtype.kind not in "fiu":
        raise ValueError(f"{name} has {np.ma.count_masked(value)} masked values; fill them or leave them out")
    return value.astype(value.dtype if value.dtype.kind == "f" else np.float64).filled(np.nan)


def real_tensor(value: Any, name: str = "the array") -> Tensor:
    """A float, list, array or tensor as a real tensor of float64; gradients are kept, arrays copied; TypeError for
    complex numbers, truth values, text, None."""
    found = value if isinstance(value, Tensor) else plain_array(value, name)
    if found.is_complex() if isinstance(found, Tensor) else found.dtype.kind not in "fiu":
        raise TypeError(f"{name}: a real number is needed, not {found.dtype}")
    return found.double() if isinstance(found, Tensor) else torch.as_tensor(found.astype(np.float64))


def frequency_tensor(frequency: Any, sampling_rate: float | None = None, *, record: Any = None) -> Tensor:
    """Frequencies in Hz as a float64 tensor, (F,); for None the tone that a ``record`` states. ValueError for none, for
    one that is not finite and positive, or at or above half the sampling rate."""
    if frequency is None and record is not None:
        frequency = record.frequency
        if frequency is None:
            raise ValueError(f"{record.name} states no frequency; give frequency=... (--frequency), in Hz")
    wanted = real_tensor(frequency, name="frequency (Hz)").reshape(-1)
    if wanted.numel() == 0:
        raise ValueError("no frequency is given; name at least one, in Hz")
    for value in wanted.tolist():
        require_positive("frequency (Hz)", value)
        if sampling_rate is not None and value >= sampling_rate / 2:
            raise ValueError(
                f"frequency {value:g} Hz is at or above Nyquist, {sampling_rate / 2:g} Hz for a sampling rate of "
                f"{sampling_rate:g} Hz; lower the frequency or use finer data"
            )
    return wanted


def index_of_frequency(known: Tensor, frequency: float) -> int | None:
    """Where a frequency (Hz) stands among those of a record, (F,); None if it is not there."""
    close = (known / frequency - 1).abs() < SAME_FREQUENCY
    return int(close.nonzero()[0]) if bool(close.any()) else None

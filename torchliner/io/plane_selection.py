"""A part of a plane: a stretch of time, every n-th sample, a region."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import whole_number
from torchliner.io.plane_format import Stored
from torchliner.records import VelocityPlane

Limits = tuple[float | None, float | None]


@dataclass
class SelectedVelocity(Stored):
    """Some samples and probes, all without ``columns``, of a velocity that stays in its file."""

    stored: Any
    shape: tuple[int, ...]
    begin: int = 0
    every: int = 1
    columns: Tensor | None = None

    def __post_init__(self) -> None:
        self.dtype, self.label = self.stored.dtype, getattr(self.stored, "label", "velocity")
        self.files = getattr(self.stored, "files", ())

    def fill(self, begin: int, end: int, out: Tensor) -> None:
        """As ``Stored.fill``."""
        rows, low = end - begin, self.begin + begin * self.every
        if self.every == 1 and self.columns is None:
            self.stored.read(low, low + rows, out)
        else:
            # As many samples at once as are wanted, so that memory does not grow with the step.
            most = max(1, rows // self.every)
            for first in range(0, rows, most):
                last = min(first + most, rows)
                slab = self.stored.read(low + first * self.every, low + (last - 1) * self.every + 1)[:: self.every]
                out[first:last] = slab if self.columns is None else slab[:, self.columns]


def select(
    plane: VelocityPlane,
    start: float | None = None,
    stop: float | None = None,
    every: int = 1,
    region: Sequence[Limits] | str | None = None,
) -> VelocityPlane:
    """A part of a plane; nothing is read.

    Args:
        plane, start, stop, every, region: in memory or in its file; as for ``read_plane``.
    Raises:
        ValueError: nothing is selected; a region of a plane without coordinates.
    """
    every = whole_number("every", every)
    if every < 1:
        raise ValueError(f"every is {every}; keep every n-th sample, n at least 1")
    stated = {"start": start, "stop": stop, "region": region, "every": None if every == 1 else every}
    chosen = {name: value for name, value in stated.items() if value is not None}
    if not chosen:
        return plane
    begin, end = _samples(plane, start, stop)
    samples = len(range(begin, end, every))
    about = {} if region is None else _region(plane, region)
    columns, shape = about.pop("columns", None), about.pop("shape", plane.probe_shape)
    for name in ("velocity", "streamwise"):
        value = getattr(plane, name)
        if isinstance(value, Tensor):
            part = value[..., begin:end:every].reshape(-1, samples)
            about[name] = (part if columns is None else part[columns]).reshape(*shape, samples)
        elif value is not None:
            about[name] = SelectedVelocity(value, (*shape, samples), begin, every, columns)
    return replace(
        plane,
        sampling_rate=plane.sampling_rate / every,
        start=plane.start + begin / plane.sampling_rate,
        provenance={**plane.provenance, "selected": chosen},
        **about,
    )


def _samples(plane: VelocityPlane, start: float | None, stop: float | None) -> tuple[int, int]:
    """First sample, and that behind the last; a time stamp's rounding does not shut out the sample that it names."""
    times = (plane.start if start is None else float(start), math.inf if stop is None else float(stop))
    at = [(time - plane.start) * plane.sampling_rate - 1e-3 for time in times]
    low, high = (math.ceil(min(max(each, 0), plane.samples)) for each in at)
    if high <= low:
        last = plane.start + (plane.samples - 1) / plane.sampling_rate
        raise ValueError(
            f"{plane.name} has no sample from {times[0]:g} to {times[1]:g} s; it runs from {plane.start:.9g} to "
            f"{last:.9g} s"
        )
    return low, high


def _region(plane: VelocityPlane, region: Sequence[Limits] | str) -> dict[str, Any]:
    """Numbers of the probes in a region, their ``shape``, and what else of the plane goes with them."""
    limits = parse_region(region) if isinstance(region, str) else [tuple(each) for each in region]
    on_grid = len(plane.probe_shape) == 2
    lengths = dict(zip("zx", plane.probe_shape if on_grid else (plane.probes,) * 2, strict=True))
    inside = {name: torch.ones(count, dtype=torch.bool) for name, count in lengths.items()}
    for name, (low, high) in zip("xz", limits, strict=False):
        values = getattr(plane, name)
        if (low, high) == (None, None):
            continue
        if values is None:
            raise ValueError(f"{plane.name} states no {name}, so that no region of it is known")
        inside[name] = (values >= (-math.inf if low is None else low)) & (
            values <= (math.inf if high is None else high)
        )
    if not on_grid:
        inside = dict.fromkeys("zx", inside["z"] & inside["x"])
    if not all(bool(each.any()) for each in inside.values()):
        where = [(name, each) for name in "xz" if (each := getattr(plane, name)) is not None]
        runs = ", ".join(f"{name} from {float(each.min()):g} to {float(each.max()):g} m" for name, each in where)
        raise ValueError(f"{plane.name} has no probe in the region {region}; it has {runs}")
    chosen = (inside["z"][:, None] & inside["x"]).reshape(-1) if on_grid else inside["x"]
    counts = [int(each.sum()) for each in inside.values()]
    about = {name: value[inside[name]] for name in "xz" if (value := getattr(plane, name)) is not None}
    if plane.area is not None:
        about["area"] = plane.area[chosen]
    if plane.holes is not None:
        about["holes"] = plane.holes.within(about.get("x"), about.get("z"))
    return {"columns": chosen.nonzero()[:, 0], "shape": tuple(counts if on_grid else counts[:1]), **about}


def parse_region(text: str) -> list[Limits]:
    """Limits of x and of z, m, from "0:0.1,-0.01:0.01"; a side that is left out has no limit."""
    found: list[Limits] = []
    try:
        for part in text.split(","):
            low, high = (float(each) if each.strip() else None for each in part.split(":"))
            found.append((low, high))
        if len(found) > 2 or "nan" in text:
            raise ValueError
    except ValueError:
        raise ValueError(f"region {text!r} cannot be read; write X0:X1 or X0:X1,Z0:Z1, in m") from None
    for low, high in found:
        if low is not None and high is not None and low > high:
            raise ValueError(f"region {text!r} is upside down: {low:g} is above {high:g}")
    return found

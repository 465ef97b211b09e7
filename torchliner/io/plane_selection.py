"""A part of a plane: a stretch of time, every n-th sample, a region; in other units."""

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
from torchliner.records.velocity_plane import scaled_numbers

Limits = tuple[float | None, float | None]


@dataclass
class SelectedVelocity(Stored):
    """Some samples and probes of a velocity that stays in its file.

    Args:
        stored: all of it.
        shape: of what is selected, (..., T).
        begin, every: first sample, and step.
        columns: numbers of the probes; None for all.
        factor: on the velocity.
    """

    stored: Any
    shape: tuple[int, ...]
    begin: int = 0
    every: int = 1
    columns: Tensor | None = None
    factor: float = 1.0

    def __post_init__(self) -> None:
        self.dtype, self.label = self.stored.dtype, getattr(self.stored, "label", "velocity")
        self.tile_rows = max(1, getattr(self.stored, "tile_rows", 1) // self.every)
        self.tile_bytes = getattr(self.stored, "tile_bytes", 0)

    def read(self, begin: int, end: int, out: Tensor | None = None) -> Tensor:
        """Samples begin .. end - 1 of every probe selected, m/s, (t, P)."""
        end = min(end, self.shape[-1])
        out = self.rows(begin, end, out)
        rows = len(out)
        low = self.begin + begin * self.every
        if self.every == 1 and self.columns is None:
            self.stored.read(low, low + rows, out)
        else:
            # As many samples at once as are wanted, so that memory does not grow with the step.
            most = max(1, rows // self.every)
            for first in range(0, rows, most):
                last = min(first + most, rows)
                slab = self.stored.read(low + first * self.every, low + (last - 1) * self.every + 1)[:: self.every]
                out[first:last] = slab if self.columns is None else slab[:, self.columns]
        return out if self.factor == 1 else out.mul_(self.factor)


def select(
    plane: VelocityPlane, start: float | None = None, stop: float | None = None, every: int = 1,
    region: Sequence[Limits] | str | None = None, factor: float = 1.0,
) -> VelocityPlane:  # fmt: skip
    """A part of a plane; nothing is read.

    Args:
        plane: in memory or in its file.
        start, stop: s, on the clock of the plane: samples from ``start`` on, before ``stop``.
        every: keep every n-th sample in time.
        region: (low, high) of x and of z, m, as for ``read_plane``.
        factor: on the wall-normal velocity.
    Raises:
        ValueError: nothing is selected; a region of a plane without coordinates.
    """
    every = whole_number("every", every)
    if every < 1:
        raise ValueError(f"every is {every}; keep every n-th sample, n at least 1")
    begin, end = _samples(plane, start, stop)
    samples = len(range(begin, end, every))
    columns, about = _region(plane, region)
    if samples < 1:
        raise ValueError(f"{plane.name}: every {every}-th sample leaves none")
    chosen = {name: value for name, value in (("start", start), ("stop", stop), ("region", region))
              if value is not None} | ({} if every == 1 else {"every": every})  # fmt: skip
    if not chosen and factor == 1.0:
        return plane
    shape = about.pop("shape", plane.probe_shape)
    for name in ("velocity", "streamwise"):
        value, sign = getattr(plane, name), factor if name == "velocity" else 1.0
        if isinstance(value, Tensor):
            part = value[..., begin:end:every]
            part = part if columns is None else part.reshape(-1, samples)[columns]
            about[name] = sign * part.reshape(*shape, samples) if sign != 1 else (
                part.reshape(*shape, samples))  # fmt: skip
        elif value is not None:
            about[name] = SelectedVelocity(value, (*shape, samples), begin, every, columns, sign)
    provenance = {**plane.provenance, **({"selected": chosen} if chosen else {})}
    return replace(
        plane, sampling_rate=plane.sampling_rate / every, provenance=provenance,
        start=plane.start + begin / plane.sampling_rate, **about,
    )  # fmt: skip


def _samples(plane: VelocityPlane, start: float | None, stop: float | None) -> tuple[int, int]:
    """First sample, and that behind the last."""
    last = plane.start + (plane.samples - 1) / plane.sampling_rate

    def sample(time: float) -> int:
        # A time stamp's rounding does not shut out the sample that it names.
        place = math.ceil((time - plane.start) * plane.sampling_rate - 1e-3)
        return min(max(place, 0), plane.samples)

    low = 0 if start is None else sample(float(start))
    high = plane.samples if stop is None else sample(float(stop))
    if high <= low:
        raise ValueError(
            f"{plane.name} has no sample from {'its start' if start is None else f'{start:g} s'} "
            f"to {'its end' if stop is None else f'{stop:g} s'}; it runs from {plane.start:.9g} to "
            f"{last:.9g} s"
        )
    return low, high


def _region(plane: VelocityPlane, region: Sequence[Limits] | str | None) -> tuple[Tensor | None, dict[str, Any]]:
    """Numbers of the probes, and shape and coordinates that go with them."""
    if region is None:
        return None, {}
    limits = parse_region(region) if isinstance(region, str) else [tuple(each) for each in region]
    inside: dict[str, Tensor] = {}
    for name, (low, high) in zip(("x", "z"), limits, strict=False):
        values = getattr(plane, name)
        if (low, high) == (None, None):
            continue
        if values is None:
            raise ValueError(f"{plane.name} states no {name}, so that no region of it is known")
        low, high = (-math.inf if low is None else low, math.inf if high is None else high)
        inside[name] = (values >= low) & (values <= high)
        if not bool(inside[name].any()):
            raise ValueError(
                f"{plane.name} has no probe with {name} from {low:g} to {high:g} m; its {name} "
                f"runs from {float(values.min()):g} to {float(values.max()):g} m"
            )
    everywhere = torch.ones(1, dtype=torch.bool)
    if len(plane.probe_shape) == 2:
        rows, columns = plane.probe_shape
        keep = {"z": inside.get("z", everywhere.expand(rows)),
                "x": inside.get("x", everywhere.expand(columns))}  # fmt: skip
        shape: tuple[int, ...] = (int(keep["z"].sum()), int(keep["x"].sum()))
        chosen = (keep["z"][:, None] & keep["x"]).reshape(-1)
    else:
        chosen = everywhere.expand(plane.probes)
        for each in inside.values():
            chosen = chosen & each
        shape = (int(chosen.sum()),)
        keep = {"x": chosen, "z": chosen}
        if not shape[0]:
            raise ValueError(f"{plane.name} has no probe in the region {region}")
    about = {name: getattr(plane, name)[keep[name]] for name in ("x", "z")
             if getattr(plane, name) is not None}  # fmt: skip
    if plane.area is not None:
        about["area"] = plane.area[chosen]
    if plane.holes is not None:
        about["holes"] = plane.holes.within(about.get("x"), about.get("z"))
    return chosen.nonzero()[:, 0], {"shape": shape, **about}


def parse_region(text: str) -> list[Limits]:
    """Limits of x and of z, m, from "0:0.1,-0.01:0.01"; a side that is left out has no limit.

    Raises:
        ValueError: it cannot be read, or is upside down.
    """
    found: list[Limits] = []
    for part in text.split(","):
        low, colon, high = part.partition(":")
        try:
            sides = tuple(float(each) if each.strip() else None for each in (low, high))
            if not colon or len(found) == 2 or any(s is not None and s != s for s in sides):
                raise ValueError
        except ValueError:
            raise ValueError(f"region {text!r} cannot be read; write X0:X1 or X0:X1,Z0:Z1, in m") from None
        if None not in sides and sides[0] > sides[1]:  # type: ignore[operator]
            raise ValueError(f"region {text!r} is upside down: {low} is above {high}")
        found.append((sides[0], sides[1]))
    return found


def scaled(plane: VelocityPlane, length: float, velocity: float) -> VelocityPlane:
    """The same flow in other units, as ``VelocityPlane.scaled``, with the velocity in its file."""
    numbers = scaled_numbers(plane, length, velocity)
    return replace(select(plane, factor=velocity), **numbers)

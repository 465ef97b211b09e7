"""Parts of one record in time, reduced apart: files, restarts, workers. Their sums add.

A part knows where it lies in the record, whose plan it shares: blocks, rows, pieces. The totals of
the moments are exact in any order; all else is added in the order of time, whatever the order in
which parts arrive.
"""

from __future__ import annotations

import copy
import dataclasses
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor

from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells
from torchliner.records.same_case import OF_ONE_PLANE, require_same_case
from torchliner.reduction.moments import PlaneSums
from torchliner.reduction.readings import Wanted
from torchliner.reduction.speed_sums import SpeedSums
from torchliner.reduction.survey import SurveySums


class PartVelocity:
    """The samples from ``first`` on of a record of ``samples``, as if they were all of it."""

    def __init__(self, plane: VelocityPlane, first: int, samples: int) -> None:
        self.plane, self.first = plane, first
        self.shape = (*plane.velocity.shape[:-1], samples)
        self.dtype = plane.velocity.dtype
        stored = plane.stored
        self.tile_rows = getattr(stored, "tile_rows", 1)
        self.tile_bytes = getattr(stored, "tile_bytes", 0)

    def read(self, begin: int, end: int, out: Tensor | None = None) -> Tensor:
        """Samples of the record that lie within the part."""
        begin, end = begin - self.first, end - self.first
        stored = self.plane.stored
        return self.plane.read(begin, end).cpu() if stored is None else stored.read(begin, end, out)

    def load(self) -> Tensor:
        """Refused.

        Raises:
            ValueError: always.
        """
        raise ValueError(f"{self.plane.name} is a part of a record, of which the rest is elsewhere")


@dataclass(frozen=True, eq=False)
class MomentsPart:
    """What ``torchliner.moments_part`` leaves of some samples of a record.

    Args:
        plane: of the whole record, without its velocity.
        first, end: samples of the record that are in here, first .. end - 1.
        wanted: plan of the whole record, and what is summed.
        cells, used: as in ``PlaneSums``.
        surveys: of the first reading, by group; none of a second reading.
        sums: of the moments, by group.
        settings, cell_pitch: as in ``Moments``.
        after: ``first_reading`` of the sum that a second reading was given.
    """

    plane: VelocityPlane
    first: int
    end: int
    wanted: Wanted
    cells: Cells
    used: Tensor
    surveys: tuple[SurveySums, ...]
    sums: tuple[SpeedSums, ...]
    settings: dict[str, Any]
    cell_pitch: float | None
    after: str = ""

    def __add__(self, other: MomentsPart) -> MomentsPart:
        """Two neighbours as one part."""
        if not isinstance(other, MomentsPart):
            return NotImplemented
        return joined([self, other])


def first_reading(sums: PlaneSums) -> str:
    """What tells the sum of one first reading from another: a hash of what a second one uses."""
    seen, periodic = sums.survey, sums.periodic
    used = [seen.mean, seen.mean_square]
    used += [] if periodic is None else [periodic.deviation, periodic.scale]
    found = hashlib.blake2b(digest_size=16)
    for each in used:
        found.update(each.detach().cpu().contiguous().numpy().tobytes())
    return found.hexdigest()


def joined(parts: Sequence[MomentsPart]) -> MomentsPart:
    """Neighbours as one part, added in the order of time.

    Raises:
        TypeError: no parts.
        ValueError: of another plane, other choices, samples that overlap or are missing.
    """
    for part in parts:
        if not isinstance(part, MomentsPart):
            raise TypeError(f"{type(part).__name__} is no part of moments; make it by moments_part")
    if not parts:
        raise ValueError("no part is given")
    rising = sorted(parts, key=lambda part: part.first)
    start = rising[0]
    for before, part in pairwise(rising):
        _require_alike(start, part)
        if part.first != before.end:
            kind = "overlap" if part.first < before.end else "are missing"
            low, high = sorted((before.end, part.first))
            raise ValueError(
                f"{part.plane.name}: samples {low} to {high - 1} {kind} between the parts of "
                f"{before.first} to {before.end - 1} and {part.first} to {part.end - 1}; each "
                "sample of the record is in one part"
            )
    plan, end = start.wanted.plan, rising[-1].end
    # A whole record has its rest, empty or not.
    whole = (start.first, end) == (0, plan.samples)
    numbers = range(plan.rest + 1) if whole else plan.numbers(start.first, end)
    sums = tuple(_joined_sums([part.sums[i] for part in rising], numbers)
                 for i in range(len(start.sums)))  # fmt: skip
    surveys = tuple(copy.deepcopy(each) for each in start.surveys)
    for part in rising[1:]:
        for own, other in zip(surveys, part.surveys, strict=True):
            own.follow(other)
    return dataclasses.replace(start, end=end, surveys=surveys, sums=sums)


def _joined_sums(parts: Sequence[SpeedSums], numbers: range) -> SpeedSums:
    own = parts[0]
    found = SpeedSums(
        own.plan, own.basis, own.width, own.dtype, own.totals.device, own.of_blocks is not None,
        numbers,
    )  # fmt: skip
    for part in parts:
        found.follow(part)
    return found


def _require_alike(one: MomentsPart, other: MomentsPart) -> None:
    """Refuse parts of other records.

    Raises:
        ValueError: they are; what differs is told.
    """
    require_same_case(one.plane, other.plane, OF_ONE_PLANE, "parts of one record state the same")

    def facts(part: MomentsPart) -> dict[str, Any]:
        plane, wanted = part.plane, part.wanted
        plan, basis = wanted.plan, wanted.basis
        return {
            "probes": plane.probe_shape, "x (m)": plane.x, "z (m)": plane.z,
            "sampling rate (Hz)": float(plane.sampling_rate),
            "precision": part.plane.velocity.dtype,
            "samples of the record": plan.samples, "blocks": plan.blocks,
            "weighed samples": (plan.begin, plan.end), "rows (Hz)": plan.lines,
            "functions of |v|": None if basis is None else basis.describe(),
            "tones (Hz)": wanted.tones, "settings": part.settings,
            "cell pitch (m)": part.cell_pitch, "error bars": wanted.keeps_blocks,
            "reading": "first" if part.surveys else "second", "first sum": part.after,
            "probes without faults": part.used,
        }  # fmt: skip

    mine, theirs = facts(one), facts(other)
    for name, value in mine.items():
        found = theirs[name]
        if isinstance(value, Tensor) and isinstance(found, Tensor):
            same = value.shape == found.shape and bool(torch.equal(value, found))
        else:
            same = not isinstance(value, Tensor) and not isinstance(found, Tensor) and value == found
        if not same:
            raise ValueError(
                f"parts of one record share their {name}: {_short(value)} from sample {one.first} "
                f"on, {_short(found)} from sample {other.first} on; reduce all of them alike"
                + (", with samples of those probes set to nan in every part"
                   if name == "probes without faults" else "")
            )  # fmt: skip


def _short(value: Any) -> str:
    if isinstance(value, Tensor) and value.dtype == torch.bool:
        return f"{int(value.sum())} of {len(value)}"
    return str(value.tolist() if isinstance(value, Tensor) else value)[:80]

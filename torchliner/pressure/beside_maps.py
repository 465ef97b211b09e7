"""In situ impedances of a pressure record beside the maps of velocity planes of the same run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torchliner.checks import tell
from torchliner.pressure.dean import in_situ
from torchliner.records import ImpedanceMap, PressureRecord, VelocityPlane
from torchliner.records.same_case import require_same_run

SAME_DURATION = 0.01  # relative; warned of beyond


def with_in_situ(
    maps: Sequence[ImpedanceMap], planes: Sequence[VelocityPlane], record: PressureRecord
) -> list[ImpedanceMap]:
    """Maps with the in situ impedances at their frequencies beside them, with intervals of the maps' own level.

    Args:
        maps: one a plane.  planes: what they were educed from.  record: of the same case.
    Raises:
        ValueError: the record states another case, tone, level or flow.
    Warns:
        DataWarning: record and plane differ in duration by more than ``SAME_DURATION``.
    """
    made: dict[tuple[float | None, ...], Any] = {}
    found = []
    for result, plane in zip(maps, planes, strict=True):
        require_same_run(plane, record)
        level = result.level
        key = (*result.frequency.tolist(), level)
        if key not in made:
            made[key] = in_situ(record, result.frequency, interval=level)
        if abs(record.duration / plane.duration - 1) > SAME_DURATION:
            tell(
                f"{record.name} lasts {1e3 * record.duration:.4g} ms, {plane.name} "
                f"{1e3 * plane.duration:.4g} ms: the two impedances are of different times"
            )
        found.append(result.with_alongside(made[key]))
    return found

"""Whether several records belong to the same case."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

from torchliner.records import VelocityPlane

STATED = ("liner", "mach", "incident_level", "source_side")
OF_ONE_PLANE = (*STATED, "height", "frequency", "holes")
SAME_PLACE = 1e-6  # m


def require_same_case(first: Any, other: Any, names: Sequence[str], remedy: str, *, where_stated: bool = False) -> None:
    """Refuse two records that state different things.

    Args:
        first, other: planes or pressure records.
        names: attributes that must agree, besides the case in the provenance.
        remedy: last words of the message.
        where_stated: let an attribute that one of them does not state pass.
    Raises:
        ValueError: they differ; what differs is named.
    """
    pairs = {name: (getattr(first, name), getattr(other, name)) for name in names}
    pairs["case"] = (first.provenance.get("case"), other.provenance.get("case"))
    for name, (mine, theirs) in pairs.items():
        if mine != theirs and not (where_stated and None in (mine, theirs)):
            raise ValueError(
                f"{first.name} and {other.name} are not one case: {name} is {mine!r} and {theirs!r}; {remedy}"
            )


def require_same_run(plane: Any, record: Any) -> None:
    """Refuse a pressure record that states another case, tone, level or flow than the plane."""
    names = ("frequency", "incident_level", "mach")
    require_same_case(plane, record, names, "name the pressure record of the same run", where_stated=True)


def require_same_probes(first: VelocityPlane, other: VelocityPlane) -> None:
    """Refuse files of one plane whose probes or stated case differ, by a ValueError that names what does."""
    both = f"{first.name} and {other.name} cannot be joined"
    if other.probe_shape != first.probe_shape:
        raise ValueError(f"{both}: their probes have shapes {first.probe_shape} and {other.probe_shape}")
    for name in ("x", "z"):
        mine, theirs = getattr(first, name), getattr(other, name)
        if (mine is None) != (theirs is None):
            raise ValueError(f"{both}: one of them states no {name}")
        if mine is not None and (off := float((mine - theirs).abs().max())) > SAME_PLACE:
            raise ValueError(f"{both}: their probes are apart in {name} by up to {1e3 * off:.4g} mm")
    require_same_case(first, other, OF_ONE_PLANE, "restarts of one run state the same")


def planes_by_height(planes: Sequence[VelocityPlane]) -> list[VelocityPlane]:
    """The planes, lowest first.

    Raises:
        ValueError: no plane, one without a height, two at one height, or planes of several cases.
    """
    if not planes:
        raise ValueError("no plane is given")
    for plane in planes:
        if plane.height is None:
            raise ValueError(
                f"{plane.name} states no height; set 'height' (m) in the file, or convert it with --height"
            )
    ordered = sorted(planes, key=lambda plane: plane.height or 0.0)
    for before, plane in itertools.pairwise(ordered):
        if (plane.height or 0.0) - (before.height or 0.0) < SAME_PLACE:
            raise ValueError(
                f"{before.name} and {plane.name} are both at {1e3 * (plane.height or 0.0):g} mm; give one another"
            )
        require_same_case(ordered[0], plane, STATED, "give the heights of one case")
    return ordered

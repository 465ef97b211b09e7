"""What is stated of a measurement or a result beside its numbers, and whether several records belong to one case."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, field
from typing import Any

from torch import Tensor

from torchliner.fluid import Fluid
from torchliner.names import SOURCE_SIDES
from torchliner.records.declared import part, record, var
from torchliner.records.level_check import UNKNOWN, LevelCheck
from torchliner.records.notes import Note

LOUDEST = 194.0  # dB: one atmosphere rms
QUIETEST = -126.0  # dB: its last digit in double precision
LEVELS = f"[{QUIETEST:g}, {LOUDEST:g}]"
SAME_PLACE = 1e-6  # m
STATED = ("liner", "mach", "incident_level", "source_side")  # the same at all heights above one liner
OF_ONE_PLANE = (*STATED, "height", "frequency", "holes")
OF_ONE_RUN = ("frequency", "incident_level", "mach")


@record
class Stated:
    """Facts of a case.

    Args:
        fluid: gas of the data.
        source_side: where the sound comes from, one of ``SOURCE_SIDES``.
        reference: independent impedances of the same case, normalised, by name ("true", "in situ").
        title: where the data come from.
    """

    _: KW_ONLY
    fluid: Fluid = field(default_factory=Fluid)
    mach: float | None = var(text="bulk Mach number, x counting along the flow", range="[0, 1)", default=None)
    source_side: str = field(default="unknown", metadata={"choices": SOURCE_SIDES})
    reference: Mapping[str, complex] = field(default_factory=dict)
    title: str = ""


@record
class Case(Stated):
    """Facts of a measurement.

    Args:
        liner: name of the liner below, if one is known; "hard wall" is a liner too.
        provenance: where the data come from.
        name: how messages call it (a file's name).
    """

    _: KW_ONLY
    liner: str = ""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    name: str = "record"


@record
class OfOneTone(Case):
    """Facts of a measurement with one tone."""

    _: KW_ONLY
    frequency: float | None = var(unit="Hz", text="of the tone", range="(0, inf)", default=None)
    incident_level: float | None = var(unit="dB", text="nominal SPL, re 20 uPa", range=LEVELS, default=None)
    displacement_thickness: float | None = var(unit="m", text="delta* of the flow", range="[0, inf)", default=None)


@record
class Found(Stated):
    """What every educed result holds.

    Args:
        choices: every option and what followed from it.
        notes: warnings.
        level_check: whether Z and the phase-locked velocity give the pressure that is known; None where that is not
            checked, see ``level_check_words``.
    """

    _: KW_ONLY
    incident_level: float | None = var(unit="dB", text="stated level of the incident wave", default=None)
    goodrich: Tensor | None = var("frequency", name="goodrich_{}", default=None, text="without sound, by Goodrich")
    choices: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    level_check: LevelCheck | None = part(default=None)

    @property
    def level_check_words(self) -> str:
        """What the whole is compared with, or why it is not, which the choices say."""
        check = self.level_check
        if check is None:
            return str(self.choices.get("level_check", UNKNOWN))
        return f"off {check.known}, limit {check.limit:.2g} dB"


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
    require_same_case(plane, record, OF_ONE_RUN, "name the pressure record of the same run", where_stated=True)


def require_same_probes(first: Any, other: Any) -> None:
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


def planes_by_height(planes: Sequence[Any]) -> list[Any]:
    """The planes, lowest first.

    Raises:
        ValueError: no plane, one without a height, two at one height, or planes of several cases.
    """
    if not planes:
        raise ValueError("no plane is given")
    for plane in planes:
        if plane.height is None:
            raise ValueError(f"{plane.name} states no height; set 'height' (m) in the file, or convert with --height")
    ordered = sorted(planes, key=lambda plane: plane.height)
    for before, plane in itertools.pairwise(ordered):
        if plane.height - before.height < SAME_PLACE:
            raise ValueError(f"{before.name} and {plane.name} are both at {1e3 * plane.height:g} mm; give one another")
        require_same_case(ordered[0], plane, STATED, "give the heights of one case")
    return ordered

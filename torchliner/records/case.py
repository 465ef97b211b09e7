"""What is stated of a measurement or a result beside its numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, field
from typing import Any

from torch import Tensor

from torchliner.checks import require_choice
from torchliner.fluid import Fluid
from torchliner.names import SOURCE_SIDES
from torchliner.records.declared import check, part, record, var
from torchliner.records.level_check import UNKNOWN, LevelCheck
from torchliner.records.notes import Note

LOUDEST = 194.0  # dB: one atmosphere rms
QUIETEST = -126.0  # dB: its last digit in double precision


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
    source_side: str = "unknown"
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

    def _check_case(self, *, tensors: bool = False) -> None:
        """Refuse what no case has."""
        check(self, tensors=tensors)
        require_choice(f"{self.name}: source_side", self.source_side, SOURCE_SIDES)


@record
class OfOneTone(Case):
    """Facts of a measurement with one tone."""

    _: KW_ONLY
    frequency: float | None = var(unit="Hz", text="of the tone", range="(0, inf)", default=None)
    incident_level: float | None = var(
        unit="dB", text="nominal SPL, re 20 uPa rms", range=f"[{QUIETEST:g}, {LOUDEST:g}]", default=None
    )
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
    goodrich: Tensor | None = var(
        "frequency", name="goodrich_{}", default=None, text="without sound under the flow, by Goodrich"
    )
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

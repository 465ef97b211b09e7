"""How far each choice that the paper leaves open moves the answer, beside its statistical interval."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import tell
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, as_liner
from torchliner.records import VelocityPlane
from torchliner.records.same_case import planes_by_height
from torchliner.studies.factors import FACTORS, Base, models_of
from torchliner.studies.reference_cases import nearest_case
from torchliner.studies.variants import Evaluated, Records, Source, Variant, plane_of
from torchliner.velocity.answer import answer
from torchliner.velocity.reading import Progress


@dataclass(frozen=True)
class AuditRow:
    """One choice changed.

    Args:
        factor, variant: what was changed, and to what.
        impedance: whole liner, normalised, in the averaging of the audit.
        change: what that is off the base.
        level_check: dB that it is off the known pressure with the velocity; None where none is known.
    """

    factor: str
    variant: str
    impedance: complex
    change: complex
    level_check: float | None = None


@dataclass(frozen=True)
class Audit:
    """All rows, the largest mover first, beside the statistical interval.

    Args:
        title, frequency, averaging: of the plane; Hz; one of ``names.AVERAGINGS``.
        base: whole liner, with the choices as they are.
        low, high: of its statistical interval (real part: R, imaginary: X); None without one.
        level: of the interval.
        rows: grouped by factor.
        skipped: factors that cannot be varied with these data, and why.
        readings: how often the velocity was read through, over all planes.
        choices: behind the base.
        notes: warnings about the base.
        level_check, level_check_words: of the base, dB, and what it rests on, or why there is none.
        nearest_case: what came out in the shipped case most like this one, whose impedance is known.
    """

    title: str
    frequency: float
    averaging: str
    base: complex
    low: complex | None
    high: complex | None
    level: float | None
    rows: tuple[AuditRow, ...]
    skipped: dict[str, str]
    readings: int
    choices: dict[str, Any]
    notes: tuple[str, ...]
    level_check: float | None = None
    level_check_words: str = ""
    nearest_case: str = ""

    @property
    def factors(self) -> list[str]:
        """Names, the largest mover first."""
        return list(dict.fromkeys(row.factor for row in self.rows))

    def of(self, factor: str) -> list[AuditRow]:
        """The rows of one factor."""
        return [row for row in self.rows if row.factor == factor]


def audit(
    planes: VelocityPlane | Moments | Sequence[VelocityPlane | Moments],
    liner: Liner,
    frequency: float | None = None,
    *,
    averaging: str = "phase-locked",
    progress: Progress | None = None,
    **choices: Any,
) -> Audit:
    """Vary every open choice by itself and see what it does to the impedance of the whole liner.

    Args:
        planes: the plane, or several of one case, of which the first is audited and the others are its other heights.
            What ``Moments`` do not hold is left out, with the reason.
        liner: as for ``educe``.
        frequency: Hz, one; default the plane's own tone.
        averaging: one of ``names.AVERAGINGS``.
        progress: called with numbers of samples read.
        choices: of the base, see ``torchliner.velocity.choices.Choices``; its phase rule is ``averaged``.
    Raises:
        ValueError: as ``educe``; several frequencies; a choice that an audit varies itself.
    """
    several = [planes] if isinstance(planes, Records) else list(planes)
    for each in several:
        if not isinstance(each, Records):
            raise TypeError(f"planes holds {type(each).__name__}; VelocityPlane is needed")
    if len(several) > 1:
        planes_by_height([plane_of(each) for each in several])
    base = Base.of(several[0], as_liner(liner), frequency, averaging, choices, progress)
    source, model = base.source, base.source.liner
    with torch.no_grad():
        found = answer(source.known, model, source.frequency, base.stated)
    z = found.liner[averaging].impedance
    if not bool(torch.isfinite(z.abs()).all()):
        raise ValueError(
            f"{source.plane.name}: the base has no admittance, since every probe counts as wall; lower or leave out "
            "wall_filter"
        )
    variants, skipped = list(base.liners), base.skipped
    for factor, make in FACTORS.items():
        try:
            variants += make(base)  # those before a reason stay
        except ValueError as reason:
            skipped[factor] = str(reason)
    rows = [_row(each, z) for each in source.evaluate(variants)]
    readings = source.readings
    if len(several) == 1:
        skipped["height"] = "one plane is given; name the other heights too"
    for other in several[1:]:
        plane = plane_of(other)
        name = plane.name if plane.height is None else f"y = {1e3 * plane.height:.3g} mm"
        above = Source(other, [model, *models_of(base.liners)], frequency, base.stated, progress=progress)
        variant = Variant("height", name, averaging, base.chosen)
        rows += [_row(each, z) for each in above.evaluate([variant])]
        readings += above.readings
    tell([note.text for note in found.notes])
    size = {row.factor: max(abs(each.change) for each in rows if each.factor == row.factor) for row in rows}
    low, high = found.bounds_of_liner(averaging) or (None, None)
    return Audit(
        title=found.title or source.plane.name,
        frequency=float(source.frequency[0]),
        averaging=averaging,
        base=complex(z[0]),
        low=low,
        high=high,
        level=found.level,
        rows=tuple(sorted(rows, key=lambda row: (-size[row.factor], row.factor, -abs(row.change)))),
        skipped=skipped,
        readings=readings,
        choices=dict(found.choices),
        notes=tuple(note.text for note in found.notes),
        level_check=_decibels(source.level_of(z)),
        level_check_words=found.level_check_words,
        nearest_case=nearest_case(found),
    )


def _row(found: Evaluated, base: Tensor) -> AuditRow:
    z, variant = complex(found.impedance[0]), found.variant
    return AuditRow(variant.factor, variant.name, z, z - complex(base[0]), _decibels(found.level_check))


def _decibels(level: Tensor) -> float | None:
    return float(level[0]) if math.isfinite(float(level[0])) else None

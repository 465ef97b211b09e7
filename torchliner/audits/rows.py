"""What an audit found: how far each choice moves the impedance of the whole liner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


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
        level: of the interval.  rows: grouped by factor.
        skipped: factors that cannot be varied with these data, and why.
        readings: how often the velocity was read through, over all planes.
        choices: behind the base.  notes: warnings about the base.
        level_check, level_check_words: of the base, dB, and what it rests on, or why there is none.
        nearest_truth: what came out in the shipped case most like this one, whose impedance is known.
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
    nearest_truth: str = ""

    @property
    def factors(self) -> list[str]:
        """Names, the largest mover first."""
        return list(dict.fromkeys(row.factor for row in self.rows))

    def of(self, factor: str) -> list[AuditRow]:
        """The rows of one factor."""
        return [row for row in self.rows if row.factor == factor]

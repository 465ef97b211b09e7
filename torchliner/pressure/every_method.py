"""Every in situ and microphone method that a record has signals for, beside the file's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from torchliner.pressure.dean import in_situ
from torchliner.pressure.in_situ_intervals import LEVEL
from torchliner.pressure.plane_wave_fit import WaveDecomposition, decompose_waves
from torchliner.records import PointImpedances, PressureRecord

ORDERS = (("", "admittance over points"), ("_pressure_first", "pressure first"))
NOWHERE = float("nan")


@dataclass(frozen=True)
class InSituRow:
    """One impedance of one method, normalised.

    Args:
        method, place: what and where.  frequency: Hz.  impedance: Z.
        own: what the file states for this method, if anything.
        true: the file's truth, if it states one.
        coherence: of the two pressures; nan for microphones.
        residual: share of the microphones' signals that two waves leave; nan for the others, and
            for two pressures alone, which two waves always fit.
        incident_level: dB, from the microphones; nan for the others.
        interval: statistical, real parts bound R, imaginary parts X; None without any.
    """

    method: str
    place: str
    frequency: float
    impedance: complex
    own: complex | None
    true: complex | None
    coherence: float = NOWHERE
    residual: float = NOWHERE
    incident_level: float = NOWHERE
    interval: tuple[complex, complex] | None = None

    def distance(self, other: complex | None) -> float:
        """|Z - other|, nan without another."""
        return NOWHERE if other is None else abs(self.impedance - other)


@dataclass(frozen=True)
class InSituReport:
    """All that a pressure record tells: rows, the in situ result behind them if any, the level of
    the statistical intervals."""

    rows: tuple[InSituRow, ...]
    points: PointImpedances | None
    notes: tuple[str, ...]
    level: float | None = LEVEL


def in_situ_report(
    record: PressureRecord, frequency: Any = None, *, losses: str = "none",
    pair: Sequence[int] | str = "pair", **options: Any,
) -> InSituReport:  # fmt: skip
    """Every method the record has signals for, beside the file's own values.

    Args:
        pair: the two microphones of the two-microphone row.
        options: ``window``, ``segment``, ``start``, ``allow_short``, ``interval`` of ``in_situ``.
    Raises:
        ValueError: losses without a cavity, a pair of fewer than two microphones; as ``in_situ``
            and ``decompose_waves``.
    """
    if losses != "none" and record.facesheet is None:
        raise ValueError(
            f"{record.name} holds microphones alone; losses {losses!r} are those of a cavity: leave them out"
        )
    count = 0 if record.microphones is None else len(record.microphones)
    if pair != "pair" and count < 2:
        raise ValueError(f"{record.name} holds {count} microphones; there is no pair to choose: leave microphones out")
    rows: list[InSituRow] = []
    notes: tuple[str, ...] = ()
    points = None
    if record.facesheet is not None:
        points = in_situ(record, frequency, losses=losses, **options)
        rows += _dean_rows(record, points)
        notes += points.notes
    if record.microphones is not None:
        several: list[tuple[str, dict[str, Any]]] = []
        if count > 1 or record.microphone_velocity is None:
            several.append(("two microphones", {"microphones": pair}))
        if count > 2:
            several.append(("waves", {}))
        if record.microphone_velocity is not None:
            several.append(("pressure and velocity", {"velocities": True}))
        for own, chosen in several:
            found = decompose_waves(record, frequency, **chosen, **options)
            rows += _wave_rows(record, found, own)
            notes += found.notes
    return InSituReport(tuple(rows), points, notes, options.get("interval", LEVEL))


def stated_impedance(record: PressureRecord, name: str, frequency: float) -> complex | None:
    """A reference of the file, which belongs to the record's tone alone."""
    same = record.frequency is not None and abs(frequency / record.frequency - 1) < 1e-6
    return record.reference.get(name) if same else None


def _dean_rows(record: PressureRecord, points: PointImpedances) -> list[InSituRow]:
    """The cells, where there are several, then the surface; each in both orders."""
    rows = []
    for f, frequency in enumerate(points.frequency.tolist()):
        true, own = (stated_impedance(record, name, frequency) for name in ("true", "Dean"))
        coherence = points.coherence[:, f]
        for c, x in enumerate(1e3 * points.cell_x if len(points.cell_x) > 1 else ()):
            place = f"cell {c + 1}" + (f", x = {float(x):.1f} mm" if x == x else "")
            for end, order in ORDERS:
                value = complex(getattr(points, f"cell_impedance{end}")[c, f])
                rows.append(InSituRow(f"in situ, {order}", place, frequency, value, None, true,
                                      float(coherence[c]),
                                      interval=points.bounds_of_cell(c, end, f)))  # fmt: skip
        for end, order in ORDERS:
            value = complex(getattr(points, f"liner_impedance{end}")[f])
            rows.append(InSituRow(f"in situ, {order}", "surface", frequency, value, own, true,
                                  float(coherence.mean()),
                                  interval=points.bounds_of_liner(end, f)))  # fmt: skip
    return rows


def _wave_rows(record: PressureRecord, found: WaveDecomposition, own: str) -> list[InSituRow]:
    first, last = (1e3 * float(record.microphone_y[i]) for i in
                   (found.microphones[0], found.microphones[-1]))  # fmt: skip
    return [
        InSituRow(
            found.name, f"y = {first:.1f}, {last:.1f} mm" if len(found.microphones) == 2
            else f"y = {first:.1f} to {last:.1f} mm", frequency, complex(found.impedance[f]),
            stated_impedance(record, own, frequency), stated_impedance(record, "true", frequency),
            residual=float(found.residual[f]), incident_level=float(found.incident_level[f]),
            interval=None if found.interval is None else found.interval.bounds(f),
        )
        for f, frequency in enumerate(found.frequency.tolist())
    ]  # fmt: skip

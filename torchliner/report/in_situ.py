"""In situ and microphone impedances beside a file's own: the rows behind ``torchliner insitu``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torchliner.in_situ_method.dean import in_situ
from torchliner.in_situ_method.plane_wave_fit import WaveDecomposition, decompose_waves
from torchliner.records import PointImpedances, PressureRecord
from torchliner.report.alongside import ORDERS, draw_cells, points_along_x
from torchliner.report.figure import COLOURS, PARTS, finish, styled, subplots
from torchliner.report.table import COMPLEX_PART, format_complex

NOWHERE = float("nan")


@dataclass(frozen=True)
class InSituRow:
    """One impedance of one method, normalised.

    Args:
        method, place: what and where.
        frequency: Hz.
        impedance: Z.
        own: what the file states for this method, if anything.
        true: the file's truth, if it states one.
        coherence: of the two pressures; nan for microphones.
        residual: share of the microphones' signals that two waves leave; nan for the others.
        incident_level: dB, from the microphones; nan for the others.
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

    def distance(self, other: complex | None) -> float:
        """|Z - other|, nan without another."""
        return NOWHERE if other is None else abs(self.impedance - other)

    def plain(self) -> dict[str, Any]:
        """For CSV and JSON: complex values as two numbers, nan where there is none."""
        row: dict[str, Any] = {
            "method": self.method, "place": self.place, "frequency": self.frequency
        }  # fmt: skip
        for name in ("impedance", "own", "true"):
            value = getattr(self, name)
            value = complex(NOWHERE, NOWHERE) if value is None else value
            stem = "" if name == "impedance" else f"{name}_"
            row[f"{stem}resistance"], row[f"{stem}reactance"] = value.real, value.imag
        return row | {
            "distance_to_own": self.distance(self.own),
            "distance_to_true": self.distance(self.true),
            "coherence": self.coherence,
            "residual": self.residual,
            "incident_level": self.incident_level,
        }


@dataclass(frozen=True)
class InSituReport:
    """All that a pressure record tells: rows, and the in situ result behind them if any."""

    rows: tuple[InSituRow, ...]
    points: PointImpedances | None
    notes: tuple[str, ...]


def in_situ_report(
    record: PressureRecord,
    frequency: Any = None,
    *,
    losses: str = "none",
    pair: Sequence[int] | str = "pair",
    **options: Any,
) -> InSituReport:
    """Every method the record has signals for, beside the file's own values.

    Args:
        record: pressures.
        frequency: Hz; default the record's tone.
        losses: in the cavity; see ``in_situ``.
        pair: the two microphones of the two-microphone row.
        options: ``window``, ``segment``, ``start``, ``allow_short``.
    """
    rows: list[InSituRow] = []
    notes: tuple[str, ...] = ()
    points = None
    if record.facesheet is not None:
        points = in_situ(record, frequency, losses=losses, **options)
        rows += _dean_rows(record, points)
        notes += points.notes
    if record.microphones is not None:
        count = len(record.microphones)
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
    return InSituReport(tuple(rows), points, notes)


def _stated(record: PressureRecord, name: str, frequency: float) -> complex | None:
    """A reference belongs to the record's tone alone."""
    same = record.frequency is not None and abs(frequency / record.frequency - 1) < 1e-6
    return record.reference.get(name) if same else None


def _dean_rows(record: PressureRecord, points: PointImpedances) -> list[InSituRow]:
    rows = []
    cells = len(points.cell_x)
    for f, frequency in enumerate(points.frequency.tolist()):
        true = _stated(record, "true", frequency)
        for c in range(cells if cells > 1 else 0):
            x = 1e3 * float(points.cell_x[c])
            place = f"cell {c + 1}" + (f", x = {x:.1f} mm" if x == x else "")
            for end, order in ORDERS:
                value = complex(getattr(points, f"cell_impedance{end}")[c, f])
                coherence = float(points.coherence[c, f])
                method = f"in situ, {order}"
                rows.append(InSituRow(method, place, frequency, value, None, true, coherence))
        for end, order in ORDERS:
            value = complex(getattr(points, f"liner_impedance{end}")[f])
            own = _stated(record, "Dean", frequency)
            coherence = float(points.coherence[:, f].mean())
            method = f"in situ, {order}"
            rows.append(InSituRow(method, "surface", frequency, value, own, true, coherence))
    return rows


def _wave_rows(record: PressureRecord, found: WaveDecomposition, own: str) -> list[InSituRow]:
    first, last = (1e3 * float(record.microphone_y[i]) for i in
                   (found.microphones[0], found.microphones[-1]))  # fmt: skip
    return [
        InSituRow(
            found.name, f"y = {first:.1f}, {last:.1f} mm" if len(found.microphones) == 2
            else f"y = {first:.1f} to {last:.1f} mm", frequency, complex(found.impedance[f]),
            _stated(record, own, frequency), _stated(record, "true", frequency),
            residual=float(found.residual[f]), incident_level=float(found.incident_level[f]),
        )
        for f, frequency in enumerate(found.frequency.tolist())
    ]  # fmt: skip


def format_in_situ(record: PressureRecord, report: InSituReport) -> str:
    """A text table."""
    lines = [record.title or record.name]
    if record.facesheet is not None:
        lines[0] += (
            f"; cavity {1e3 * (record.cavity_depth or 0):.4g} mm deep, "
            f"{100 * record.cavity_porosity:.3g} % of the surface"
        )
    if "true" in record.reference:
        lines[0] += f"; true Z = {format_complex(record.reference['true'])}"
    lines.append(f"{'method':36s} {'place':22s} {'f Hz':>7s} {'Z':>15s} {'file own':>15s} "
                 f"{'|dZ|':>6s} {'|Z-true|':>8s} {'coh.':>5s} {'resid.':>8s}")  # fmt: skip
    for row in report.rows:
        own = "-" if row.own is None else format_complex(row.own)
        lines.append(
            f"{row.method:36s} {row.place:22s} {row.frequency:7.1f} "
            f"{format_complex(row.impedance):>15s} {own:>15s} "
            f"{_number(row.distance(row.own)):>6s} {_number(row.distance(row.true)):>8s} "
            f"{_number(row.coherence, 2):>5s} {_number(row.residual, 5):>8s}"
        )
    lines.append(
        "Z is p/(rho c v), exp(+jwt). Pressure first: what the reflected plane wave knows; "
        "admittance over points: the paper's order"
    )
    return "\n".join(lines)


def _number(value: float, digits: int = 3) -> str:
    return "-" if value != value else f"{value:.{digits}f}"


@styled
def draw_in_situ(
    record: PressureRecord,
    points: PointImpedances,
    path: str | Path | None = None,
    frequency_index: int = 0,
) -> Any:
    """R and X of the in situ method along x: points, cells in both orders, the file's truth."""
    figure, axes = subplots(1, 2, 3.0)
    profile = points_along_x(points, frequency_index)
    known = bool((points.point_x == points.point_x).all())
    frequency = float(points.frequency[frequency_index])
    true = _stated(record, "true", frequency)
    for axis, (part, label) in zip(axes[0], PARTS, strict=True):
        x = 1e3 * profile.x if known else profile.x
        axis.plot(x, profile.values[part], color=COLOURS[0], label="points")
        if known:
            draw_cells(axis, points, part, frequency_index, "cells, ")
        if true is not None:
            axis.axhline(getattr(true, COMPLEX_PART[part]), color="k", linewidth=0.9, label="true")
        axis.set_xlabel("$x$ (mm)" if known else "probe")
        axis.set_ylabel(label)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    title = record.title or record.name
    figure.suptitle(f"{title}, in situ (Dean), {frequency:g} Hz", fontsize=9)
    return finish(figure, path)

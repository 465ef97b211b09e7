"""Every in situ and microphone method that a record has signals for, beside its own values: ``torchliner insitu``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from torchliner.pressure.dean import in_situ
from torchliner.pressure.plane_waves import decompose_waves
from torchliner.pressure.tones import LEVEL
from torchliner.records import PointImpedances, PressureRecord
from torchliner.records.notes import Note
from torchliner.report.alongside import ORDERS, draw_cells, points_along_x
from torchliner.report.figure import COLOURS, ONE_ROW, REFERENCES, draw_curve, finish, impedance_panels, styled
from torchliner.report.numbers import part_of
from torchliner.report.table import Column, Table, format_bounds, format_complex, plain_columns, real_and_imaginary

Row = dict[str, Any]


def every_method(
    record: PressureRecord,
    frequency: Any = None,
    *,
    losses: str = "none",
    pair: Sequence[int] | str = "pair",
    **options: Any,
) -> tuple[list[Row], PointImpedances | None, tuple[Note | str, ...]]:
    """A row a method, place and frequency; the in situ result behind them, if any; warnings.

    A row has method, place, frequency (Hz), impedance and its interval, the file's own value for this method and its
    reference ("true"), the coherence of the two pressures, what two waves leave, and the level of the incident
    one (dB); None or nan where there is none.

    Args:
        pair: the two microphones of the two-microphone row.
        options: ``window``, ``segment``, ``start``, ``allow_short``, ``interval`` of ``in_situ``.
    Raises:
        ValueError: losses without a cavity, a pair of fewer than two microphones; as ``in_situ`` and
            ``decompose_waves``.
    """
    if losses != "none" and record.facesheet is None:
        raise ValueError(
            f"{record.name} holds microphones alone; losses {losses!r} are those of a cavity: leave them out"
        )
    count = 0 if record.microphones is None else len(record.microphones)
    if pair != "pair" and count < 2:
        raise ValueError(f"{record.name} holds {count} microphones; there is no pair to choose: leave microphones out")
    rows: list[Row] = []
    notes: tuple[Note | str, ...] = ()
    points = None
    if record.facesheet is not None:
        points = in_situ(record, frequency, losses=losses, **options)
        rows += _point_rows(record, points)
        notes += points.notes
    several: dict[str, dict[str, Any]] = {}  # by the name of the file's own value
    if count > 1 or (count and record.microphone_velocity is None):
        several["two microphones"] = {"microphones": pair}
    if count > 2:
        several["waves"] = {}
    if count and record.microphone_velocity is not None:
        several["pressure and velocity"] = {"velocities": True}
    for own, chosen in several.items():
        found = decompose_waves(record, frequency, **chosen, **options)
        ends = [f"{1e3 * float(found.microphones[i]):.1f}" for i in (0, -1)]
        place = f"y = {(', ' if len(found.microphones) == 2 else ' to ').join(ends)} mm"
        for f, z in enumerate(found.impedance.tolist()):
            bounds = None if found.interval is None else found.interval.bounds(f)
            about = {"residual": float(found.residual[f]), "incident_level": float(found.incident_level[f])}
            rows.append(_row(record, found.name, place, float(found.frequency[f]), z, own, bounds, **about))
        notes += found.notes
    return rows, points, notes


def _point_rows(record: PressureRecord, points: PointImpedances) -> list[Row]:
    """The cells, where there are several, then the surface; each in both orders."""
    rows = []
    for f, frequency in enumerate(points.frequency.tolist()):
        coherence = points.coherence[:, f]
        for c, x in enumerate(1e3 * points.cell_x if len(points.cell_x) > 1 else ()):
            place = f"cell {c + 1}" + (f", x = {float(x):.1f} mm" if x == x else "")
            for end, order in ORDERS:
                z, bounds = getattr(points, f"cell_impedance{end}")[c, f], points.bounds_of_cell(c, end, f)
                about = {"coherence": float(coherence[c])}
                rows.append(_row(record, f"in situ, {order}", place, frequency, complex(z), "", bounds, **about))
        for end, order in ORDERS:
            z, bounds = getattr(points, f"liner_impedance{end}")[f], points.bounds_of_liner(end, f)
            about = {"coherence": float(coherence.mean())}
            rows.append(_row(record, f"in situ, {order}", "surface", frequency, complex(z), "Dean", bounds, **about))
    return rows


def _row(
    record: PressureRecord, method: str, place: str, frequency: float, z: complex, own: str, bounds: Any, **about: float
) -> Row:
    """One row; ``own`` names the file's value for the method."""
    stated, true = (stated_impedance(record, name, frequency) for name in (own, "true"))
    off = {
        f"distance_to_{name}": math.nan if value is None else abs(z - value)
        for name, value in (("own", stated), ("true", true))
    }
    unknown = dict.fromkeys(("coherence", "residual", "incident_level"), math.nan)
    low, high = bounds or (None, None)
    return {
        "method": method,
        "place": place,
        "frequency": frequency,
        "impedance": z,
        "own": stated,
        "true": true,
        "interval": bounds,
        "low": low,
        "high": high,
        **off,
        **unknown,
        **about,
    }


def stated_impedance(record: PressureRecord, name: str, frequency: float) -> complex | None:
    """A reference of the file, which belongs to the record's tone alone."""
    same = record.frequency is not None and abs(frequency / record.frequency - 1) < 1e-6
    return record.reference.get(name) if same else None


COLUMNS = (
    Column("method", heading="method"),
    Column("place", heading="place"),
    Column("frequency", heading="f Hz", text=".1f"),
    *real_and_imaginary("resistance", "reactance", "impedance"),
    *plain_columns("own* true*"),
    Column("", "impedance", "Z", format_complex),
    Column("", "own", "file own", format_complex),
    Column("", "interval", "statistical interval", format_bounds),
    Column("distance_to_own", heading="|dZ|", text=".3f"),
    Column("distance_to_true", heading="|Z-true|", text=".3f"),
    Column("coherence", heading="coherence", text=".2f"),
    Column("residual", heading="residual", text=".5f"),
    Column("incident_level"),
    *real_and_imaginary("resistance_low", "reactance_low", "low"),
    *real_and_imaginary("resistance_high", "reactance_high", "high"),
)


def in_situ_table(rows: Sequence[Row]) -> Table:
    """Complex values as two numbers in CSV and JSON, nan where there is none."""
    return Table(rows, COLUMNS)


def format_in_situ(record: PressureRecord, rows: Sequence[Row], level: float | None = LEVEL) -> str:
    """What was measured, then one row per method and place; ``level`` of the intervals."""
    head = record.title or record.name
    if record.facesheet is not None:
        depth, share = 1e3 * (record.cavity_depth or 0), 100 * record.cavity_porosity
        head += f"; cavity {depth:.4g} mm deep, {share:.3g} % of the surface"
    if "true" in record.reference:
        head += f"; reference Z = {format_complex(record.reference['true'])}"
    words = "" if level is None else f"{100 * level:g} % "
    return (
        f"{head}\n{in_situ_table(rows).as_text()}\n"
        f"Z is p/(rho c v), exp(+jwt); {words}statistical interval: because the record is finite, not the errors of "
        "formula, cavity or microphones.\nPressure first: the average that the reflected plane wave sees; admittance "
        "over points: the paper's way"
    )


@styled
def draw_in_situ(
    record: PressureRecord, points: PointImpedances, path: str | Path | None = None, frequency_index: int = 0
) -> Any:
    """R and X of the in situ method along x: points, cells in both ways of averaging, the file's reference."""
    profile = points_along_x(points, frequency_index)
    known = bool((points.point_x == points.point_x).all())
    figure, panels = impedance_panels(3.0, "$x$ (mm)" if known else "probe")
    frequency = float(points.frequency[frequency_index])
    true = stated_impedance(record, "true", frequency)
    for axis, part in panels:
        draw_curve(axis, profile, part, COLOURS[0], 1e3 if known else 1.0, label="points")
        if known:
            draw_cells(axis, points, part, frequency_index, "cells, ")
        if true is not None:
            axis.axhline(part_of(true, part), label="reference", **REFERENCES[0])
    title = f"{record.title or record.name}, in situ (Dean), {frequency:g} Hz"
    return finish(figure, path, title, legend=ONE_ROW)

"""In situ and microphone impedances beside a file's own: ``torchliner insitu``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from torchliner.pressure.every_method import InSituReport, InSituRow, stated_impedance
from torchliner.records import PointImpedances, PressureRecord
from torchliner.report.alongside import draw_cells, points_along_x
from torchliner.report.figure import (
    COLOURS,
    ONE_ROW,
    REFERENCES,
    draw_curve,
    finish,
    impedance_panels,
    styled,
)
from torchliner.report.numbers import part_of
from torchliner.report.table import (
    Column,
    Table,
    format_bounds,
    format_complex,
    plain_columns,
    real_and_imaginary,
)

COLUMNS = (
    Column("method", heading="method"),
    Column("place", heading="place"),
    Column("frequency", heading="f Hz", text=".1f"),
    *real_and_imaginary("resistance", "reactance", "impedance"),
    *plain_columns("own* true*"),
    Column("", "impedance", "Z", format_complex),
    Column("", "own", "file own", format_complex),
    Column("", "interval", "statistical interval", format_bounds),
    Column("distance_to_own", lambda row: row.distance(row.own), "|dZ|", ".3f"),
    Column("distance_to_true", lambda row: row.distance(row.true), "|Z-true|", ".3f"),
    Column("coherence", heading="coherence", text=".2f"),
    Column("residual", heading="residual", text=".5f"),
    Column("incident_level"),
    *real_and_imaginary("resistance_low", "reactance_low", lambda r: r.interval and r.interval[0]),
    *real_and_imaginary("resistance_high", "reactance_high", lambda r: r.interval and r.interval[1]),
)


def in_situ_table(rows: Sequence[InSituRow]) -> Table:
    """Complex values as two numbers in CSV and JSON, nan where there is none."""
    return Table(rows, COLUMNS)


def format_in_situ(record: PressureRecord, report: InSituReport) -> str:
    """What was measured, then one row per method and place."""
    head = record.title or record.name
    if record.facesheet is not None:
        head += (
            f"; cavity {1e3 * (record.cavity_depth or 0):.4g} mm deep, "
            f"{100 * record.cavity_porosity:.3g} % of the surface"
        )
    if "true" in record.reference:
        head += f"; reference Z = {format_complex(record.reference['true'])}"
    level = "" if report.level is None else f"{100 * report.level:g} % "
    return (
        f"{head}\n{in_situ_table(report.rows).as_text()}\n"
        f"Z is p/(rho c v), exp(+jwt); {level}statistical interval: because the record is finite, "
        "not the errors of formula, cavity or microphones.\nPressure first: the average that the "
        "reflected plane wave sees; admittance over points: the paper's way"
    )


@styled
def draw_in_situ(
    record: PressureRecord, points: PointImpedances, path: str | Path | None = None,
    frequency_index: int = 0,
) -> Any:  # fmt: skip
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

"""The answers of lines of stations, of impedances at points, and of every method a pressure record has signals for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import torch

from torchliner.pressure.dean import in_situ
from torchliner.pressure.plane_waves import decompose_waves
from torchliner.pressure.tones import LEVEL
from torchliner.records import ImpedanceLine, PointImpedances, PressureRecord
from torchliner.records.notes import Note
from torchliner.report.answer import (
    Answer,
    Grid,
    Picture,
    difference_grid,
    difference_row,
    impedance_words,
    plain_of,
    row_words,
)
from torchliner.report.bursts import draw_lines
from torchliner.report.curves import ORDERS, draw_points
from torchliner.report.numbers import points_along_x
from torchliner.report.of_map import level_line, state_of
from torchliner.report.table import if_known, table_of

CHOICES = ("method", "correction", "segment", "overlap", "window", "phase", "drive")
Row = dict[str, Any]


def of_line(lines: Sequence[ImpedanceLine], source: Path | None = None) -> Answer:
    """Of a line of stations: its average, its stations, what is known of the case."""
    (line,) = lines
    rows, known = _averages(line), list[Row]()
    if rows:
        first = rows[0]
        bounds = None if first["low"] is None else (first["low"], first["high"])
        beside = dict(line.reference)
        beside |= {} if line.goodrich is None else {"Goodrich (2.7), linear liner": complex(line.goodrich[0])}
        about = first["frequency"], first["impedance"], bounds
        known = [difference_row(*about, name, complex(z), None) for name, z in beside.items()]
    level = None if line.interval is None else float(line.choices["interval"])
    flags = [f"{name}: {flag}" for name, flags in zip(line.names, line.flags, strict=True) for flag in flags]
    answer = f"{line.stations} stations that have not been joined: no impedance of the line."
    if line.average is not None:
        answer = (
            f"{row_words(rows[0], level)} in units of ρc at {one_of(line.frequency.tolist())}, from "
            f"{line.average.stations} of {line.stations} stations."
        )
    chosen = ", ".join(f"{key} {line.choices[key]}" for key in CHOICES if key in line.choices)
    caption = (
        f"Impedance of the stations at {float(line.frequency[0]):g} Hz. Light: three standard deviations over the "
        "segments; dark: interval of the mean; crosses: stations that are in no average."
    )
    rows_of_stations = _stations(line)
    stations = table_of(rows_of_stations, _SHOWN + ",interval" * (level is not None) + _MORE)
    return Answer(
        title=f"Impedance line: {line.title or (source.name if source else 'in memory')}",
        lines=[answer, level_line(line, 0)],
        table=table_of(rows, f"frequency,impedance{if_known(rows, 'low').replace('low', 'interval')},spread"),
        brief=None if len(rows) > 1 else table_of([]),
        caption="Z = 1/mean(1/Z) over ρc over the stations that count, eq. (5.2); spread: along the line.",
        plain={
            "title": line.title,
            "average": None if line.average is None else {"stations": line.average.stations, "rows": rows},
            "level_check": {"checked": line.level_check is not None, "words": line.level_check_words}
            | ({} if line.level_check is None else line.level_check.plain(line.frequency.tolist())),
            "rows": rows_of_stations,
            "stations": [
                {"flags": list(flags), "dropped": dict(dropped), "notes": list(notes)}
                for flags, dropped, notes in zip(line.flags, line.dropped, line.station_notes, strict=True)
            ],
            "reference": dict(line.reference),
            "choices": plain_of(line.choices),
            "notes": [vars(note) for note in line.notes],
        },
        grids=[Grid("stations", "A row a station and frequency.", stations), difference_grid(known)],
        remarks=[f"Z is p/(ρc v), exp(+jωt); {chosen}."],
        notes=[*line.notes, *flags],
        state=state_of(line, 0),
        pictures=[Picture("along-x", caption, partial(draw_lines, line), lambda: stations)],
        results=[line],
        source=source,
    )


_SHOWN, _MORE = (
    "station,x,y,frequency,impedance",
    (",segment_spread,mean_velocity,velocity_rms,tone_velocity,coherence,attenuation,rate,flags"),
)


def _averages(line: ImpedanceLine) -> list[Row]:
    """A row a frequency: what is interval, spread along the line, spread of the draws has its own name."""
    found, rows = line.average, list[Row]()
    for f, frequency in enumerate(line.frequency.tolist() if found is not None else ()):
        assert found is not None
        low, high = (None, None) if found.interval is None else found.interval.bounds(f)
        row: Row = {"frequency": frequency, "impedance": complex(found.impedance[f]), "low": low, "high": high}
        row |= {"spread": complex(found.spatial_spread[f]), "monte_carlo": complex(found.monte_carlo[f])}
        row |= {"monte_carlo_spread": complex(found.monte_carlo_spread[f])}
        rows.append(row | {"goodrich": None if line.goodrich is None else complex(line.goodrich[f])})
    return rows


def _stations(line: ImpedanceLine) -> list[Row]:
    """A row a station and frequency."""
    rows = []
    for i, name in enumerate(line.names):
        place = {"station": name, "x": float(line.x[i]), "y": float(line.y[i]), "rate": float(line.rate[i])}
        place |= {"mean_velocity": float(line.mean_velocity[i]), "velocity_rms": float(line.velocity_rms[i])}
        for f, frequency in enumerate(line.frequency.tolist()):
            low, high = (None, None) if line.interval is None else line.interval.bounds(i, f)
            row = {"frequency": frequency, "impedance": complex(line.impedance[i, f]), "low": low, "high": high}
            row |= {"segment_spread": complex(line.segment_spread[i, f]), "flags": len(line.flags[i])}
            row |= {"tone_velocity": float(line.velocity_level[i, f]), "coherence": float(line.coherence[i, f])}
            rows.append(place | row | {"attenuation": float(line.attenuation[i, f].abs())})
    return rows


def one_of(values: Sequence[float]) -> str:
    """'900 Hz' or '900 Hz, the first of 3 frequencies'."""
    return f"{values[0]:g} Hz" + (f", the first of {len(values)} frequencies" if len(values) > 1 else "")


def of_points(several: Sequence[PointImpedances], source: Path | None = None) -> Answer:
    """Of impedances at points and cells, as an in situ measurement gives them."""
    (found,) = several
    frequency, rows = found.frequency.tolist(), point_rows(found)
    level = None if found.uncertainty is None else float(found.uncertainty.settings["level"])
    words = impedance_words(complex(found.answer[0]), found.bounds_of_liner(), level)
    caption = f"Impedance along x at {frequency[0]:g} Hz; crosses: cells, filled, admittance over points, and open, "
    picture = Picture(
        "along-x",
        f"{caption}pressure first.",
        partial(draw_points, found),
        lambda: points_along_x(found).table,
    )
    several_points = int(torch.isfinite(found.point_impedance[:, 0].real).sum()) > 1
    return Answer(
        title=f"Impedances: {found.name}",
        lines=[f"{words} in units of ρc at {one_of(frequency)}, whole surface ({found.name}, admittance over points)."],
        table=table_of(rows, "place,order,frequency,impedance" + ",interval" * (level is not None)),
        caption="Z over ρc of the whole surface and of each cell, by order of averaging.",
        plain={"name": found.name, "rows": rows, "choices": plain_of(found.choices), "notes": plain_of(found.notes)},
        notes=found.notes,
        pictures=[picture] if several_points else [],
        results=[found],
        source=source,
    )


def point_rows(found: PointImpedances) -> list[Row]:
    """The whole surface and the cells, each in both orders, a row a frequency."""
    rows = []
    for f, frequency in enumerate(found.frequency.tolist()):
        for end, order in ORDERS:
            places = [("surface", getattr(found, f"liner_impedance{end}")[f], found.bounds_of_liner(end, f))]
            for c, z in enumerate(getattr(found, f"cell_impedance{end}")[:, f]):
                at = "" if (x := 1e3 * float(found.cell_x[c])) != x else f", x = {x:.1f} mm"
                places.append((f"cell {c + 1}{at}", z, found.bounds_of_cell(c, end, f)))
            for number, (place, z, bounds) in enumerate(places):
                low, high = bounds or (None, None)
                seen = found.coherence[:, f] if number == 0 else found.coherence[number - 1, f]
                row = {"place": place, "order": order, "frequency": frequency, "impedance": complex(z)}
                rows.append(row | {"low": low, "high": high, "coherence": float(seen.mean())})
    return rows


def of_pressures(
    record: PressureRecord,
    frequency: Any = None,
    *,
    losses: str = "none",
    pair: Sequence[int] | str = "pair",
    **options: Any,
) -> tuple[Answer, PointImpedances | None]:
    """Every in situ and microphone method that a record has signals for, beside its own values; the in situ result
    behind the answer, if any.

    A row has method, place, frequency (Hz), impedance and its interval, the file's own value for this method and its
    reference ("true"), the coherence of the two pressures, what two waves leave, and the level of the incident one
    (dB); None where there is none.

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
    rows, notes, points = list[Row](), list[Note | str](), None
    if record.facesheet is not None:
        points = in_situ(record, frequency, losses=losses, **options)
        several_cells = len(points.cell_x) > 1
        for row in point_rows(points):
            whole = row["place"] == "surface"
            if whole or several_cells:
                rows.append(_row(record, f"in situ, {row.pop('order')}", row, "Dean" if whole else ""))
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
            low, high = (None, None) if found.interval is None else found.interval.bounds(f)
            row = {"place": place, "frequency": float(found.frequency[f]), "impedance": z, "low": low, "high": high}
            row |= {"residual": float(found.residual[f]), "incident_level": float(found.incident_level[f])}
            rows.append(_row(record, found.name, row, own))
        notes += found.notes
    head = [record.title or record.name]
    if record.facesheet is not None:
        share = 100 * record.cavity_porosity
        head.append(f"cavity {1e3 * (record.cavity_depth or 0):.4g} mm deep, {share:.3g} % of the surface")
    level = options.get("interval", LEVEL)
    shown = "method,place,frequency,impedance" + if_known(rows, "low").replace("low", "interval")
    shown += if_known(rows, "own", "distance_to_own", "true", "distance_to_true", "coherence", "residual")
    brief = "method,place,frequency,impedance" + if_known(rows, "low").replace("low", "interval")
    true = _stated(record, "true", rows[0]["frequency"]) if rows else None
    whole = [row for row in rows if row["place"] == "surface" and row["frequency"] == rows[0]["frequency"]] or rows
    lines = [f"{row_words(row, level)} in units of ρc at {row['frequency']:g} Hz, {row['method']}." for row in whole]
    picture = [] if points is None else [_picture(record, points, true)]
    return Answer(
        title="; ".join(head),
        lines=[*lines[:2], *([f"Reference Z = {true:.3f}."] if true is not None else [])],
        table=table_of(rows, shown),
        brief=table_of(rows, brief + if_known(rows, "distance_to_true")),
        plain={"title": record.title, "interval_level": level, "rows": rows, "notes": [str(note) for note in notes]},
        remarks=[
            "Z is p/(ρc v), exp(+jωt). Intervals: because the record is finite, not the errors of formula, cavity or "
            "microphones. Pressure first: the average that the reflected plane wave sees; admittance over points: the "
            "paper's way."
        ],
        notes=notes,
        step="torchliner educe PLANE --in-situ of this file puts these beside the educed Z" if points else "",
        pictures=picture,
    ), points


def _picture(record: PressureRecord, points: PointImpedances, true: complex | None) -> Picture:
    title = f"{record.title or record.name}, in situ (Dean)"
    draw = partial(draw_points, points, true=true, title=title)
    return Picture("in-situ", title, draw, lambda: points_along_x(points).table)


def _row(record: PressureRecord, method: str, row: Row, own: str) -> Row:
    """With the file's own value for the method, its reference, and the distances to them."""
    stated, true = (_stated(record, name, row["frequency"]) for name in (own, "true"))
    z, unknown = row["impedance"], dict.fromkeys(("coherence", "residual", "incident_level"), math.nan)
    off = {
        f"distance_to_{name}": math.nan if value is None else abs(z - value)
        for name, value in (("own", stated), ("true", true))
    }
    return {"method": method, **unknown, **row, "own": stated, "true": true, **off}


def _stated(record: PressureRecord, name: str, frequency: float) -> complex | None:
    """A reference of the file, which belongs to the record's tone alone."""
    same = record.frequency is not None and abs(frequency / record.frequency - 1) < 1e-6
    return record.reference.get(name) if same else None

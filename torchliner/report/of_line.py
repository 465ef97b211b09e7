"""The answers of lines of stations, of their bursts, of points, and of all that a pressure record has signals for."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import torch

from torchliner.bursts.stations import Station
from torchliner.pressure.dean import in_situ
from torchliner.pressure.plane_waves import decompose_waves
from torchliner.pressure.tones import LEVEL
from torchliner.records import ImpedanceLine, PointImpedances, PressureRecord
from torchliner.records.notes import Note
from torchliner.report.answer import Answer, Grid, Picture, impedance_words, row_words
from torchliner.report.curves import ORDERS, draw_points, points_along_x
from torchliner.report.fields import draw_lines
from torchliner.report.table import Row, table_of
from torchliner.studies.variants import rows_of

OF_STATION = ("x", "y", "rate", "mean_velocity", "velocity_rms")
STATIONS = "station,x,y,frequency,impedance,interval,segment_spread,mean_velocity,velocity_rms,coherence,flags,dropped"
COMPONENTS = {"v": "wall_normal", "u": "streamwise"}
MOMENTS = ("mean", "rms", "weighted_mean", "weighted_rms")
WHY = "Intervals are statistical. Pressure first: as the reflected plane wave sees it; admittance: the paper's order."


def of_line(line: ImpedanceLine) -> Answer:
    """Of a line of stations: its average and its stations."""
    found, rows = line.average, list[Row]()
    stations = rows_of(
        station=np.array(line.names, object)[:, None],
        flags=np.array([len(each) for each in line.flags])[:, None],
        dropped=np.array([sum(each.values()) for each in line.dropped])[:, None],
        **{name: getattr(line, name)[:, None] for name in OF_STATION},
        frequency=line.frequency,
        impedance=line.impedance,
        interval=line.interval,
        segment_spread=line.segment_spread,
        tone_velocity=line.velocity_amplitude.abs(),
        coherence=line.coherence,
        attenuation=line.attenuation.abs(),
    )
    words = f"{line.stations} stations that have not been joined: no impedance of the line."
    if found is not None:
        rows = rows_of(
            frequency=line.frequency,
            impedance=found.impedance,
            interval=found.interval,
            spread=found.spatial_spread,
            monte_carlo=found.monte_carlo,
            monte_carlo_spread=found.monte_carlo_spread,
            goodrich=line.goodrich,
        )
        at, level = one_of(line.frequency.tolist()), line.choices["interval"]
        count = f"{found.stations} of {line.stations} stations"
        words = f"{row_words(rows[0], level)} in units of ρc at {at}, from {count}."
    caption = f"At {float(line.frequency[0]):g} Hz. Light: three standard deviations over segments; dark: interval."
    flags = [f"{name}: {flag}" for name, several in zip(line.names, line.flags, strict=True) for flag in several]
    return Answer(
        title=f"Impedance line: {line.title}" if line.title else "Impedance line",
        lines=[words],
        table=table_of(rows, "frequency,impedance,interval,spread,goodrich"),
        brief=rows if len(rows) > 1 else [],
        caption="Z = 1/mean(1/Z) over ρc over the stations that count, eq. (5.2); spread: along the line.",
        grids=[Grid("stations", "A row a station and frequency.", table_of(stations, STATIONS))],
        remarks=["Z is p/(ρc v), exp(+jωt).", *(f"{name}: Z = {z:.3f}." for name, z in line.reference.items())],
        notes=[*line.notes, *flags],
        pictures=[Picture("along_x", caption, partial(draw_lines, line), lambda: stations)],
        results=[line],
    )


def one_of(values: Sequence[float]) -> str:
    """'900 Hz' or '900 Hz, the first of 3 frequencies'."""
    return f"{values[0]:g} Hz" + (f", the first of {len(values)} frequencies" if len(values) > 1 else "")


def of_stations(*stations: Station) -> Answer:
    """One row per station of bursts; what was dropped and why; flags and notes."""
    rows, remarks = list[Row](), list[str]()
    for one in stations:
        kept, seen = one.kept, one.moments
        row: Row = {"station": one.name, "x": kept.x, "y": kept.y, "z": kept.z}
        row |= {"bursts": kept.bursts, "dropped": kept.received - kept.bursts}
        row |= {name: getattr(seen, name) for name in ("duration", "rate", "longest_gap", "irregularity")}
        for short, name in COMPONENTS.items():
            values = {key: getattr(seen.components.get(name), key, None) for key in MOMENTS}
            row |= {f"{short} {key} (m/s)": math.nan if v is None else float(v) for key, v in values.items()}
        rows.append(row | {"flags": list(one.flags), "flagged": "; ".join(one.flags)})
        remarks += [f"{one.name}: {n} dropped: {why}" for why, n in kept.dropped.items()]
    shown = "station,x,y,z,bursts,dropped,duration,rate,longest_gap,v mean (m/s),v rms (m/s),u mean (m/s),u rms (m/s)"
    return Answer(
        title=f"{len(stations)} stations of bursts",
        lines=[f"{sum(bool(one.flags) for one in stations)} of {len(stations)} stations are flagged"],
        table=table_of(rows, shown),
        remarks=remarks,
        notes=[f"{one.name}: {text}" for one in stations for text in (*one.flags, *one.kept.notes)],
    )


def of_points(found: PointImpedances) -> Answer:
    """Of impedances at points and cells, as an in situ measurement gives them."""
    words = impedance_words(complex(found.answer[0]), found.bounds_of_liner(), found.level)
    at, several_points = found.frequency.tolist(), int(torch.isfinite(found.points.impedance[:, 0]).sum()) > 1
    return Answer(
        title=f"Impedances: {found.name}",
        lines=[f"{words} in units of ρc at {one_of(at)}, whole surface ({found.name}, admittance over points)."],
        table=table_of(point_rows(found), "place,order,frequency,impedance,interval"),
        caption="Z over ρc of the whole surface and of each cell, by order of averaging.",
        notes=found.notes,
        pictures=[_along_x(found, f"Impedance along x at {at[0]:g} Hz")] if several_points else [],
        results=[found],
    )


def _along_x(found: PointImpedances, what: str, **about: Any) -> Picture:
    words = f"{what}; crosses: cells, filled, admittance over points, and open, pressure first."
    return Picture("along_x", words, partial(draw_points, found, **about), partial(points_along_x, found))


def point_rows(found: PointImpedances) -> list[Row]:
    """The whole surface and the cells, each in both orders, a row a frequency."""
    x = [f", x = {1e3 * at:.1f} mm" if at == at else "" for at in found.cell_x.tolist()]
    names = [f"cell {c}{at}" for c, at in enumerate(x, 1)]
    rows, mean = list[Row](), found.coherence.mean(0, keepdim=True)
    for name, order in ORDERS.items():
        surface, cells = found.liner[name].map(lambda value: value[None]), found.cells[name]
        bounded = surface.interval is not None
        ends = {e: torch.cat([getattr(surface, e), getattr(cells, e)]) if bounded else None for e in ("low", "high")}
        rows += rows_of(
            place=np.array(["surface", *names], object)[:, None],
            order=order,
            frequency=found.frequency,
            impedance=torch.cat([surface.impedance, cells.impedance]),
            **ends,
            coherence=torch.cat([mean, found.coherence]),
        )
    return rows


def of_pressures(
    record: PressureRecord,
    frequency: Any = None,
    *,
    losses: str = "none",
    pair: Sequence[int] | str = "pair",
    **options: Any,
) -> tuple[Answer, PointImpedances | None]:
    """Every in situ and microphone method that a record has signals for; the in situ result behind the answer, if any.

    A row has method, place, frequency (Hz), impedance and its interval, the file's reference ("true") and the distance
    to it, the coherence of the two pressures, what two waves leave, and the level of the incident one (dB). ``pair``:
    the microphones of the two-microphone row; ``options``: those of ``Tones``.
    """
    rows, notes, points = list[Row](), list[Note | str](), None
    if record.facesheet is not None:
        points = in_situ(record, frequency, losses=losses, **options)
        every = [row for row in point_rows(points) if row["place"] == "surface" or len(points.cell_x) > 1]
        rows += [{"method": f"in situ, {row.pop('order')}"} | row for row in every]
        notes += points.notes
    elif losses != "none":
        raise ValueError(f"{record.name} holds microphones alone; losses {losses!r} are those of a cavity")
    count = 0 if record.microphones is None else len(record.microphones)
    known = record.microphone_velocity is not None
    ways: list[Row] = [{"microphones": pair}] * (count > 1 or pair != "pair" or not (known or points))
    for chosen in [*ways, *[Row()] * (count > 2), *[Row(velocities=True)] * (count > 0 and known)]:
        found = decompose_waves(record, frequency, **chosen, **options)
        ends = [f"{1e3 * float(found.microphones[i]):.1f}" for i in (0, -1)]
        names = ("frequency", "impedance", "interval", "residual", "incident_level")
        place = f"y = {(', ' if len(found.microphones) == 2 else ' to ').join(ends)} mm"
        rows += rows_of(method=found.name, place=place, **{name: getattr(found, name) for name in names})
        notes += found.notes
    true, tone = record.reference.get("true"), record.frequency
    for row in rows if true is not None and tone is not None else []:
        if abs(row["frequency"] / tone - 1) < 1e-6:
            row |= {"true": true, "distance_to_true": abs(row["impedance"] - true)}
    first = [row for row in rows if all(row[key] == rows[0][key] for key in ("frequency", "place"))]
    level, name = options.get("interval", LEVEL), record.title or record.name
    lines = [f"{row_words(row, level)} in units of ρc at {row['frequency']:g} Hz, {row['method']}." for row in first]
    return Answer(
        title=name,
        lines=lines + ([] if true is None else [f"Reference Z = {true:.3f}."]),
        table=table_of(rows, "method,place,frequency,impedance,interval,distance_to_true,coherence,residual"),
        remarks=[WHY],
        notes=notes,
        step="put this beside an educed Z: torchliner educe PLANE --in-situ RECORD" if points else "",
        pictures=[] if points is None else [_along_x(points, f"{name}, in situ (Dean)", true=true, title=name)],
    ), points

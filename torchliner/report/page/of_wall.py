"""The pages of eductions from microphones and of solved ducts."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import torch

from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.duct.settled import SETTLED
from torchliner.records import MicrophoneLine
from torchliner.report.figure import (
    COLOURS,
    LINES,
    MARKERS,
    finish,
    label_axes,
    styled,
    subplots,
)
from torchliner.report.figure import Figure as Drawing
from torchliner.report.page.blocks import Block, Figure, Grid, Section, shown
from torchliner.report.page.render import Page
from torchliner.report.page.sections import FOOTER, asked, changed, citation, origin, warned
from torchliner.report.page.tables import (
    compared,
    difference,
    joint,
    off,
)
from torchliner.report.table import Column, Table, format_bounds, format_complex
from torchliner.report.typesetting import typeset
from torchliner.report.wall_pressure import draw_along, draw_phases, draw_spectra, spectrum_of
from torchliner.report.wall_table import COLUMNS, FIELD, LEVEL, WAVES, Educed, wall_rows

IN_CSV = {"deviation", "energy", "singular values"}  # headings that a page is too narrow for
MOST_DRAWN = 6  # frequencies along a wall
MESH = "mesh difference (dB)"
LABELS = ((0,), (1,), (2,), (0, 1), (0, 2), (0, 1, 2))  # parts of a label, the fewest first


def page_of_wall(found: Sequence[Educed], path: Path | None = None) -> Page:
    """Of impedances educed from microphones: lines and methods side by side."""
    lines = [one.source_line for one in found]
    labels = labels_of(found, lines)
    rows = [
        [row | {"label": label, "low": _known(row["low"]), "high": _known(row["high"])} for row in wall_rows(line, one)]
        for one, line, label in zip(found, lines, labels, strict=True)
    ]
    every = [row for several in rows for row in several]
    kinds = [WAVES if hasattr(one, "wavenumber") else FIELD for one in found]
    common = set.intersection(*({column.heading for column in columns} for columns in kinds)) - IN_CSV
    columns = [Column("", "label", "eduction"), *(column for column in kinds[0] if column.heading in common)]
    caption = (
        "Z = p/(ρc v) with exp(jωt − jαx), x along the flow. Residual: rms of what is left over that of the pressures. "
        "Over errors: residuals over the stated errors of the microphones, 1 if the duct is right."
    )
    main = _best_fitted(found)
    at = [(i, row) for i, several in enumerate(rows) for row in several if row["frequency"] == main]
    known, parts = [], []
    for (_, one), (_, other) in itertools.combinations(at, 2):
        known.append(difference(main, one, other["label"], other["impedance"], joint(one, other)) | _named(one, other))
    for i, row in at:
        bounds = None if row["low"] is None else (row["low"], row["high"])
        level = f"{100 * LEVEL:g} % interval: {format_bounds(bounds)}" if bounds else "without a statistical interval"
        parts.append(f"Z = {format_complex(row['impedance'])} ({labels[i]}; {level})")
        for name, z in _walls_of(lines[i], main).items():
            known.append(difference(main, row, name, z, off(row, z)) | {"name": f"{row['label']} less {name}"})
    values, apart = [row["impedance"] for _, row in at], ""
    if len(values) == 2 and not math.isnan(abs(sum(values))):
        apart = f"; the two are {200 * abs(values[0] - values[1]) / sum(map(abs, values)):.3g} % apart"
    escaped = [label.replace("$", r"\$") for label in labels]
    pictures: list[Block] = []
    if any(len(one.frequency) > 1 for one in found):
        drawn, beyond = draw_spectra(found, escaped)
        curves = [spectrum_of(one, label) for one, label in zip(found, labels, strict=True)]
        listed = [{"eduction": label} | row for each, label in zip(curves, labels, strict=True)
                  for row in each.table.as_rows()]  # fmt: skip
        words = "Impedance over frequency; shaded: 95 % statistical intervals."
        words += " They go on beyond the axes; the CSV has them whole." * beyond
        names = dict.fromkeys(name for row in listed for name in row)
        full = [dict.fromkeys(names) | row for row in listed]
        pictures.append(Figure("spectrum", drawn, words, Table(full, list(map(Column, names)))))
    there = [(i, one.frequency.tolist().index(main)) for i, one in enumerate(found) if main in one.frequency.tolist()]
    pressures = [row for i, f in there for row in _pressures(labels[i], main, lines[i].x, lines[i].pressure[:, f])]
    words = f"Sound pressure along the wall at {main:g} Hz: markers, the microphones; lines, what was fitted."
    pictures.append(Figure("along-wall", draw_along(found, there, escaped), words,
                           Table(pressures, list(map(Column, pressures[0])))))  # fmt: skip
    notes = [note for one, line in zip(found, lines, strict=True) for note in (*line.notes, *one.notes)]
    choices = {labels[i]: dict(one.choices) for i, one in enumerate(found)}
    for label, line in zip(labels, lines, strict=True):
        choices[label] |= {"line": line.name, "microphones": line.microphones, "duct height": float(line.duct_height)}
    titles = dict.fromkeys(shown(line.title or line.name) for line in lines)
    return Page(
        f"Impedance from microphones: {'; '.join(titles)}",
        typeset(f"At {main:g} Hz, in units of ρc: {'; '.join(parts)}{apart}."),
        "",
        [
            Section("answers", "Answer", [Grid("answer-table", caption, Table(every, [*COLUMNS, *columns], ".9g"))]),
            warned([*changed(*found), *notes]),
            Section("pictures", "Pictures", pictures),
            Section("comparison", "Comparison", [compared(known, "Two lines' errors are taken as independent.")]),
            asked(choices),
            origin(found, path),
            citation(),
        ],
        FOOTER,
    )


def labels_of(found: Sequence[Educed], lines: Sequence[MicrophoneLine]) -> list[str]:
    """As few words as tell eductions apart, the method among them if there are several."""
    parts = [
        (f"source {one.source_side}", shown(one.method), shown(line.title or Path(line.name).stem))
        for one, line in zip(found, lines, strict=True)
    ]
    several = len({one.method for one in found}) > 1
    texts: list[str] = []
    for kept in LABELS:
        if 1 in kept or not several:
            texts = [", ".join(each[i] for i in kept) for each in parts]
            if len({*texts}) == len(texts):
                return texts
    return [f"{text}, {i}" for i, text in enumerate(texts, 1)]


def _known(value: complex | None) -> complex | None:
    return None if value is None or value != value else value


def _named(one: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, str]:
    return {"name": f"{one['label']} less {other['label']}"}


def _best_fitted(found: Sequence[Educed]) -> float:
    """The frequency of all, Hz, at which the worst fitted is fitted best."""
    residuals: dict[float, list[float]] = {}
    for one in found:
        for f, residual, z in zip(one.frequency.tolist(), one.residual.tolist(), one.impedance.tolist(), strict=True):
            residuals.setdefault(f, []).append(residual if z == z else math.inf)
    return min(residuals, key=lambda f: (-len(residuals[f]), max(residuals[f])))


def _walls_of(line: MicrophoneLine, frequency: float) -> dict[str, complex]:
    """What is known of the wall; impedances that a line names stand for its tone, where it has one alone."""
    known = {shown(name): complex(z) for name, z in line.reference.items()} if len(line.frequency) == 1 else {}
    wall = math.nan if line.wall_impedance is None else line.wall_impedance[line.frequency.tolist().index(frequency)]
    return known if wall != wall else known | {"the solved wall": complex(wall)}


def _pressures(label: str, frequency: float, x: Any, pressure: Any) -> list[dict[str, Any]]:
    """Level and phase at places, a row each; pressure complex, Pa, (X,)."""
    level, phase = spl_from_pressure_amplitude(pressure), torch.rad2deg(torch.angle(pressure))
    return [
        {"eduction": label, "frequency (Hz)": frequency, "x (m)": at, "SPL (dB)": spl, "phase (deg)": angle}
        for at, spl, angle in zip(x.tolist(), level.tolist(), phase.tolist(), strict=True)
    ]


def page_of_duct(line: MicrophoneLine, path: Path | None = None) -> Page:
    """Of a solved duct, from the line of microphones that ``torchliner duct solve`` writes.

    Raises:
        ValueError: microphones that were measured: no result, but what one is educed from.
    """
    solved, modes = (line.provenance.get(key) for key in ("solved", "plane_mode"))
    if not isinstance(solved, Mapping) or not isinstance(modes, list) or len(modes) != len(line.frequency):
        raise ValueError(
            f"{line.name} holds microphones, from which an impedance is yet to be educed: report what torchliner kt "
            "FILE -o writes"
        )
    row = max(modes, key=lambda each: each.get(MESH) or 0.0)
    moved = row.get(MESH)
    check = "no second mesh was solved"
    if moved is not None:
        within = "within" if moved <= SETTLED else "above"
        check = f"a finer mesh moves it by {moved:.2g} dB, {within} the {SETTLED:g} dB asked for"
    answer = (
        f"At {row['frequency (Hz)']:g} Hz the duct takes {row['transmission loss (dB)']:.2f} dB from the plane wave of "
        f"a source {line.source_side}; {check}."
    )
    columns = [Column(key, heading=key, text=".4g") for key in modes[0]]
    caption = "The plane-like mode sent back and let through, and where its energy goes, in shares of that coming in."
    at = [round(i * (len(modes) - 1) / max(1, MOST_DRAWN - 1)) for i in range(min(len(modes), MOST_DRAWN))]
    rows = [row for f, hertz in enumerate(line.frequency.tolist())
            for row in _pressures("solved", hertz, line.x, line.pressure[:, f])]  # fmt: skip
    words = "Sound pressure at the microphones, phase of exp(+jωt); grey: liner."
    walls = Figure("along-wall", _draw_walls(line, at, solved), words, Table(rows, list(map(Column, rows[0]))))
    made = SimpleNamespace(choices=line.provenance)
    about = {key: value for key, value in line.provenance.items() if key != "plane_mode"}
    return Page(
        f"Solved duct: {line.title}",
        typeset(answer),
        "",
        [
            Section("answers", "Answer", [Grid("answer-table", caption, Table(modes, columns))]),
            warned([*changed(made), *line.notes]),
            Section("along", "Along the wall", [walls]),
            asked(about),
            origin([made], path),
            citation(),
        ],
        FOOTER,
    )


@styled
def _draw_walls(line: MicrophoneLine, at: Sequence[int], solved: Mapping[str, Any]) -> Drawing:
    figure, axes = subplots(1, 2, 3.2)
    for i, f in enumerate(dict.fromkeys(at)):
        looks = {"color": COLOURS[i], "marker": MARKERS[i], "markersize": 3}
        label = f"{float(line.frequency[f]):g} Hz"
        axes[0, 0].plot(1e3 * line.x, line.level[:, f], linestyle=LINES[i], label=label, **looks)
        draw_phases(axes[0, 1], line.x.numpy(), line.pressure[:, f].numpy(), LINES[i], **looks)
    for axis, text in zip(axes[0], ("SPL (dB re 20 µPa)", "phase (degrees)"), strict=True):
        for start, end in (solved.get("duct") or {}).get("liner") or []:
            axis.axvspan(1e3 * start, 1e3 * end, color="0.9", zorder=0)
        label_axes(axis, "$x$ (mm)", text)
    return finish(figure, None, legend=3)

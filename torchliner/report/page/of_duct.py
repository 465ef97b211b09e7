"""The page of a solved duct, from the line of microphones that ``torchliner duct solve`` writes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import torch

from torchliner.checks import SAME_FREQUENCY
from torchliner.duct.field import DuctField
from torchliner.duct.settled import SETTLED, SettledField
from torchliner.duct.solved_line import setup_of, solved_line
from torchliner.file_checks import naming
from torchliner.io.whole_file import writable
from torchliner.records import MicrophoneLine
from torchliner.report.figure import (
    COLOURS,
    LINES,
    MARKERS,
    draw_curve,
    finish,
    label_axes,
    panels_of,
    styled,
    subplots,
)
from torchliner.report.figure import Figure as Drawing
from torchliner.report.numbers import Curves
from torchliner.report.page.asked import _words
from torchliner.report.page.blocks import Block, Facts, Figure, Grid, Section, Text, shown
from torchliner.report.page.of_map import FOOTER
from torchliner.report.page.origin import citation, files_of, typed, versions
from torchliner.report.page.render import ENDING, Page, require_report
from torchliner.report.page.subject import inputs_of
from torchliner.report.page.wall_pictures import ALONG, pressure_rows
from torchliner.report.page.warned import warnings_of
from torchliner.report.table import Column, Table, format_complex
from torchliner.report.typesetting import typeset
from torchliner.report.wall_pressure import draw_phases

MOST_DRAWN = 6  # frequencies along the wall
FREQUENCY, MESH = "frequency (Hz)", "mesh difference (dB)"
PLANE_MODE = {  # key of a row: heading and format on the page
    FREQUENCY: ("f (Hz)", ".1f"), "reflection": ("|R|", ".4f"), "transmission": ("|T|", ".4f"),
    "transmission loss (dB)": ("loss (dB)", ".2f"),
    "energy out": ("energy out", ".4f"), "energy absorbed": ("absorbed", ".4f"),
    "energy missing": ("missing", ".2g"), "growth over the liner (dB)": ("growth (dB)", ".3g"),
    MESH: ("finer mesh (dB)", ".2g"),
}  # fmt: skip
ENERGY = ("energy out", "energy absorbed", "energy missing")


def report_field(found: DuctField | SettledField, path: str | Path) -> None:
    """One page of a solved field in memory."""
    require_report()
    writable(path, ENDING)
    field = found.field if isinstance(found, SettledField) else found
    page_of_duct(solved_line(setup_of(field), found)).write(path)


def page_of_duct(line: MicrophoneLine, path: Path | None = None) -> Page:
    """The page of a solved duct.

    Raises:
        ValueError: microphones that were measured: no result, but what one is educed from.
    """
    solved, rows = (line.provenance.get(key) for key in ("solved", "plane_mode"))
    if not isinstance(solved, Mapping) or not rows:
        raise ValueError(
            f"{line.name} holds microphones, from which an impedance is yet to be educed: report "
            "what torchliner kt LINE -o FILE.h5 writes, or the duct that torchliner duct solve "
            "DUCT -o FILE.h5 writes"
        )
    if len(rows) != len(line.frequency):
        raise ValueError(
            f"{line.name}: attribute 'provenance' has {len(rows)} rows of the plane mode for "
            f"{len(line.frequency)} frequencies; solve the duct again"
        )
    with naming(line.name) if path else nullcontext():  # what a file says of itself may be damaged
        return _page(line, solved, rows, path)


def _page(line: MicrophoneLine, solved: Any, rows: Any, path: Path | None) -> Page:
    """The whole page of what is a solved duct."""
    _require_sound(line, rows)
    sections = [
        Section("answers", "Answer", _answers(rows)),
        Section("warnings", "Warnings", warnings_of(line.notes)),
        Section("asked", "What was asked", _asked(line, solved)),
        Section("along", "Along the wall", _along(line)),
        Section("frequencies", "Spectrum", _spectrum(rows)),
        Section("mesh", "Mesh and its check", [Text(_mesh(line, rows))]),
        Section("origin", "Inputs and provenance", _origin(line, path)),
        Section("cite", "Citation", citation()),
    ]
    return Page(f"Solved duct: {line.title}", _sentence(line, rows), "", sections, FOOTER)


def _require_sound(line: MicrophoneLine, rows: Any) -> None:
    """Refuse rows of other frequencies than the microphones', and numbers that are none."""
    for row, frequency in zip(rows, line.frequency.tolist(), strict=True):
        if abs(row[FREQUENCY] - frequency) > SAME_FREQUENCY * frequency:
            raise ValueError(
                f"the plane mode is told of at {row[FREQUENCY]:g} Hz, but the microphones are at "
                f"{frequency:g} Hz; solve the duct again"
            )
        for key, value in row.items():
            if isinstance(value, float) and math.isnan(value):
                raise ValueError(f"{key} at {frequency:g} Hz is nan; solve the duct again")


def _walls(line: MicrophoneLine, index: int) -> list[str]:
    """Z of each patch in words; empty where it varies along x."""
    walls = line.provenance.get("impedance") or []
    row = walls[index] if index < len(walls) else []
    return [each if isinstance(each, str) else format_complex(complex(*each)) for each in row]


def _sentence(line: MicrophoneLine, rows: Any) -> str:
    """Loss of the plane wave, where a finer mesh moves it most if one was solved."""
    first = max(range(len(rows)), key=lambda i: rows[i].get(MESH) or 0.0)
    row, walls = rows[first], _walls(line, first)
    wall = f" lined with Z = {' and '.join(walls)} in units of ρc" if walls else ""
    lead = f"At {row[FREQUENCY]:g} Hz"
    if len(rows) > 1:
        lead += f", one of {len(rows)} frequencies from {rows[0][FREQUENCY]:g} to "
        lead += f"{rows[-1][FREQUENCY]:g} Hz,"
    moved = row.get(MESH)
    check = "no second mesh was solved"
    if moved is not None:
        within = "within" if moved <= SETTLED else "above"
        check = f"a finer mesh moves it by {moved:.2g} dB, {within} the {SETTLED:g} dB asked for"
    return typeset(
        f"{lead} the duct{wall} takes {row['transmission loss (dB)']:.2f} dB from the plane wave "
        f"of a source {line.source_side}; {check}."
    )


def _answers(rows: Any) -> list[Block]:
    """A row a frequency."""
    caption = (
        "Plane-like mode sent back, R, and let through, T, as wall pressures at its ends; energy "
        "in shares of that coming in; growth of a hydrodynamic wave over the liner; by how much a "
        "finer mesh moves transmission and levels."
    )
    shown_keys = [key for key in PLANE_MODE if any(row.get(key) for row in rows)]
    others = [key for key in rows[0] if key not in shown_keys]
    columns = [Column(key, heading=PLANE_MODE[key][0], text=PLANE_MODE[key][1])
               for key in shown_keys]  # fmt: skip
    return [Grid("answer-table", caption, Table(rows, [*columns, *map(Column, others)]))]


def _asked(line: MicrophoneLine, solved: Mapping[str, Any]) -> list[Block]:
    """The impedance of each patch, then every key of the duct's file."""
    walls = [
        {FREQUENCY: frequency, "patch": patch, "impedance": text}
        for i, frequency in enumerate(line.frequency.tolist())
        for patch, text in enumerate(_walls(line, i), 1)
    ]
    columns = [Column(FREQUENCY, heading="f (Hz)", text=".1f"), Column("patch", heading="patch"),
               Column("impedance", heading="Z", text=str)]  # fmt: skip
    keys = [
        {"table": table, "key": key, "value": _words(value)}
        for table, inner in solved.items() if isinstance(inner, Mapping)
        for key, value in inner.items() if value is not None
    ]  # fmt: skip
    facts = [(key, shown(text)) for key, text in solved.items() if isinstance(text, str) and text]
    wall = shown(line.provenance.get("wall", ""))
    facts.append(("pressures", f"at {line.microphones} places on the {wall} wall"))
    columns_ = [Column(name, heading=name) for name in ("table", "key", "value")]
    blocks: list[Block] = [
        Facts(facts), Grid("duct", "The duct, by the keys of its file.", Table(keys, columns_)),
    ]  # fmt: skip
    if walls:
        return [Grid("walls", "Impedance asked, normalised by ρc.", Table(walls, columns)), *blocks]
    return [Text("The impedance is that of the duct's file, or varies along x."), *blocks]


def _drawn(line: MicrophoneLine) -> list[int]:
    """Indices of frequencies that are drawn: all, or some from the lowest to the highest."""
    count = len(line.frequency)
    few = min(count, MOST_DRAWN)
    return [round(i * (count - 1) / max(1, few - 1)) for i in range(few)]


def _along(line: MicrophoneLine) -> list[Block]:
    """SPL and phase at the microphones."""
    at, level = _drawn(line), line.level
    frequencies = ", ".join(f"{float(line.frequency[f]):g}" for f in at)
    rows = [row for f, hertz in enumerate(line.frequency.tolist())
            for row in pressure_rows("", "solved", hertz, line.x, line.pressure[:, f])]  # fmt: skip
    alt = (
        f"Level and phase at {line.microphones} microphones from {1e3 * float(line.x[0]):.4g} to "
        f"{1e3 * float(line.x[-1]):.4g} mm at {frequencies} Hz: "
        + "; ".join(f"{float(level[:, f].min()):.1f} to {float(level[:, f].max()):.1f} dB"
                    for f in at) + "."
    )  # fmt: skip
    caption = (
        f"Sound pressure at the microphones at {frequencies} Hz, phase of exp(+jωt); grey: liner."
        + (f" {len(at)} of {len(line.frequency)} frequencies are drawn, all are in the CSV."
           if len(at) < len(line.frequency) else "")
    )  # fmt: skip
    return [Figure("along-wall", _draw_along(line, at), typeset(alt), typeset(caption),
                   Table(rows, ALONG[2:]))]  # fmt: skip


@styled
def _draw_along(line: MicrophoneLine, at: list[int]) -> Drawing:
    figure, axes = subplots(1, 2, 3.2)
    for i, f in enumerate(at):
        looks = {"color": COLOURS[i], "marker": MARKERS[i], "markersize": 3}
        label = f"{float(line.frequency[f]):g} Hz"
        axes[0, 0].plot(1e3 * line.x, line.level[:, f], linestyle=LINES[i], label=label, **looks)
        draw_phases(axes[0, 1], line.x.numpy(), line.pressure[:, f].numpy(), LINES[i], **looks)
    patches = ((line.provenance.get("solved") or {}).get("duct") or {}).get("liner") or []
    for axis, text in zip(axes[0], ("SPL (dB re 20 µPa)", "phase (degrees)"), strict=True):
        for start, end in patches:
            axis.axvspan(1e3 * start, 1e3 * end, color="0.9", zorder=0)
        label_axes(axis, "$x$ (mm)", text)
    return finish(figure, None, legend=3)


def _spectrum(rows: Any) -> list[Block]:
    """Loss and energy over frequency, where there are several."""
    if len(rows) < 2:
        return []
    names = ("transmission loss (dB)", *ENERGY)
    at = torch.tensor([row[FREQUENCY] for row in rows]).numpy()
    values = {name: torch.tensor([row[name] for row in rows]).numpy() for name in names}
    loss = values[names[0]]
    alt = (
        f"Transmission loss at {len(rows)} frequencies from {at.min():g} to {at.max():g} Hz: "
        f"{loss.min():.2f} to {loss.max():.2f} dB; energy absorbed "
        f"{values[ENERGY[1]].min():.3f} to {values[ENERGY[1]].max():.3f} of that coming in."
    )
    caption = (
        "Transmission loss of the plane-like mode, and where the energy goes, over frequency; "
        "what is missing the mean flow took, or, below 0, gave."
    )
    curves = Curves(at, values, "", FREQUENCY)
    return [Figure("spectrum", _draw_spectrum(curves), typeset(alt), caption, curves.table)]


@styled
def _draw_spectrum(curves: Curves) -> Drawing:
    figure, (left, right) = panels_of(2, 3.0)
    draw_curve(left, curves, "transmission loss (dB)", COLOURS[0], 1e-3, marker="o")
    for i, name in enumerate(ENERGY):
        draw_curve(right, curves, name, COLOURS[i], 1e-3, marker=MARKERS[i], label=name)
    right.legend()
    label_axes(left, "$f$ (kHz)", "transmission loss (dB)")
    label_axes(right, "$f$ (kHz)", "share of the energy in")
    return finish(figure, None)


def _mesh(line: MicrophoneLine, rows: Any) -> str:
    """Unknowns of both meshes, and by how much the answer moves."""
    about = line.provenance
    text = f"{about.get('unknowns', 'an unknown number of')} unknowns"
    moved = [row[MESH] for row in rows if row.get(MESH) is not None]
    if not moved or about.get("finer_unknowns") is None:
        return f"One mesh of {text}: no finer one was solved, and nothing tells its error."
    return (
        f"A mesh of {text}. One of {about['finer_unknowns']} moves transmission and levels by "
        f"{max(moved):.2g} dB at most; {SETTLED:g} dB is asked for, more is warned of."
    )


def _origin(line: MicrophoneLine, path: Path | None) -> list[Block]:
    """Files, the command, versions."""
    made = SimpleNamespace(choices=line.provenance)
    return [
        *files_of(inputs_of(made), [("result", path, "" if path else "this field, in memory")]),
        *typed([line.provenance.get("command")]),
        versions(made),
    ]

"""The answers of solved ducts and of their modes."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from torch import Tensor

from torchliner.checks import DataWarning
from torchliner.duct.field import DuctField
from torchliner.duct.presets import DuctSetup
from torchliner.duct.settled import SETTLED
from torchliner.file_names import frequency_ends
from torchliner.records import MicrophoneLine
from torchliner.report.answer import Answer, Grid, Picture
from torchliner.report.fields import draw_line, draw_modes, draw_walls
from torchliner.report.of_wall import pressure_rows
from torchliner.report.table import Column, Table, table_of

NEPER = 20 * math.log10(math.e)  # dB
ROUNDING = 1e-12
MOST_DRAWN = 6  # frequencies along a wall
MESH = "mesh difference (dB)"
MICROPHONES = "frequency,x,spl,phase"
Row = dict[str, Any]


def of_line(lines: Sequence[MicrophoneLine], source: Path | None = None) -> Answer:
    """Of a solved duct, from the line of microphones that ``torchliner duct solve`` writes.

    Raises:
        ValueError: microphones that were measured: no result, but what one is educed from.
    """
    (line,) = lines
    solved, modes = (line.provenance.get(key) for key in ("solved", "plane_mode"))
    if not isinstance(solved, Mapping) or not isinstance(modes, list) or len(modes) != len(line.frequency):
        raise ValueError(
            f"{line.name} holds microphones, from which an impedance is yet to be educed: report what torchliner kt "
            "FILE -o writes"
        )
    at = [round(i * (len(modes) - 1) / max(1, MOST_DRAWN - 1)) for i in range(min(len(modes), MOST_DRAWN))]
    picture = Picture(
        "along-wall",
        "Sound pressure at the microphones, phase of exp(+jωt); grey: liner.",
        lambda path: draw_line(line, at, (solved.get("duct") or {}).get("liner") or [], path),
        lambda: table_of(_microphones(line)),
    )
    return _answer(line, solved, modes, [picture], source)


def of_field(field: DuctField, setup: DuctSetup) -> Answer:
    """Of a solved field, along the wall of the microphones of its setup; all of its frequencies are drawn."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DataWarning)  # they are notes of the line
        line = setup.line_of(field)
    pictures = [
        Picture(
            f"along-wall{end}",
            "Sound pressure along the wall of the microphones, phase of exp(+jωt); grey: liner.",
            partial(draw_walls, [(setup, field)], frequency_index=f),
            lambda: table_of(_microphones(line)),
        )
        for f, end in enumerate(frequency_ends(setup.frequency.tolist()))
    ]
    return _answer(line, setup.facts, field.rows(), pictures)


def _answer(
    line: MicrophoneLine, solved: Any, modes: list[Row], pictures: Sequence[Picture], source: Path | None = None
) -> Answer:
    """What the duct takes from sound, where its energy goes, whether the mesh is fine enough."""
    row = max(modes, key=lambda each: each.get(MESH) or 0.0)
    check, moved = "no second mesh was solved", row.get(MESH)
    if moved is not None:
        within = "within" if moved <= SETTLED else "above"
        check = f"a finer mesh moves it by {moved:.2g} dB, {within} the {SETTLED:g} dB asked for"
    lines = [
        f"At {row['frequency (Hz)']:g} Hz the duct takes {row['transmission loss (dB)']:.2f} dB from the plane wave of "
        f"a source {line.source_side}; {check}."
    ]
    if grown := [each for each in modes if each.get("growth over the liner (dB)")]:
        most = max(grown, key=lambda each: each["growth over the liner (dB)"])
        lines.append(
            f"At {most['frequency (Hz)']:g} Hz a hydrodynamic wave grows by {most['growth over the liner (dB)']:.3g} "
            "dB over the liner."
        )
    about = {key: value for key, value in line.provenance.items() if key != "plane_mode"}
    unknowns = {"unknowns": about.get("unknowns"), "unknowns of the finer mesh": about.get("finer_unknowns")}
    rows = _microphones(line)
    return Answer(
        title=f"Solved duct: {line.title}",
        lines=lines,
        table=Table(modes, [Column(key, heading=key, text=".4g") for key in modes[0]]),
        caption="The plane-like mode sent back and let through, and its energy, in shares of that coming in.",
        plain={"duct": solved, **unknowns, "plane_mode": modes, "microphones": rows},
        brief=table_of(rows, MICROPHONES),
        grids=[Grid("microphones", "At the microphones.", table_of(rows, MICROPHONES))],
        notes=line.notes,
        pictures=pictures,
        results=[SimpleNamespace(choices=line.provenance)],
        choices=about,
        source=source,
    )


def _microphones(line: MicrophoneLine) -> list[Row]:
    """Level and phase of every frequency."""
    return [
        {name: value for name, value in row.items() if name != "eduction"}
        for f, hertz in enumerate(line.frequency.tolist())
        for row in pressure_rows("", hertz, line.x, line.pressure[:, f])
    ]


def of_modes(setup: DuctSetup, modes: Mapping[str, Any], growing: Tensor) -> Answer:
    """One row per frequency, direction and mode; decay in dB over the liner's length too, below 0 of a wave that grows
    in its direction.

    The growing wave (1/m, (F,), nan for none) has no number.
    """
    length = setup.case.liner[0][1] - setup.case.liner[0][0] if setup.case.liner else math.nan
    found = [
        (frequency, direction, n, complex(solved.wavenumber[f, n]))
        for direction, solved in modes.items()
        for f, frequency in enumerate(setup.frequency.tolist())
        for n in range(solved.wavenumber.shape[-1])
    ]
    waves = zip(setup.frequency.tolist(), growing.tolist(), strict=True)
    grown = [(frequency, "downstream", None, alpha) for frequency, alpha in waves if alpha == alpha]
    rows = []
    for frequency, direction, n, alpha in [*found, *grown]:
        away = NEPER * (-alpha.imag if direction == "downstream" else alpha.imag)
        decay = 0.0 if abs(alpha.imag) < ROUNDING * abs(alpha) else away
        row: Row = {"frequency": frequency, "direction": direction, "mode": n, "wavenumber": alpha}
        rows.append(row | {"decay": decay, "decay over liner": decay * length})
    patches = len(setup.case.liner)
    which = f" above the first of {patches} lined patches" if patches > 1 else ""
    wave = "no growing wave was found"
    if grown:
        others = f" and {len(grown) - 1} other frequencies" * (len(grown) > 1)
        wave = f"a hydrodynamic wave without a number grows downstream at {grown[0][0]:g} Hz{others}"
    pictures = [
        Picture(
            f"modes{end}",
            "|p| of each mode over the height",
            partial(draw_modes, dict(modes), frequency_index=f),
            lambda: table_of(rows),
        )
        for f, end in enumerate(frequency_ends(setup.frequency.tolist()))
    ]
    return Answer(
        title=f"Modes of {setup.name}",
        lines=[
            f"Waves e^(-j alpha x){which}; mode n grew out of the rigid duct's mode n as the wall's reflection went "
            f"straight from 1; {wave}."
        ],
        table=table_of(rows, "frequency,direction,mode,wavenumber,decay,decay over liner"),
        plain={"duct": setup.facts, "modes": rows},
        pictures=pictures,
    )

"""The answers of impedances educed from microphones, of solved ducts and of their modes."""

import cmath
import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import torch

from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.duct.presets import DuctSetup
from torchliner.duct.settled import SETTLED
from torchliner.records import FieldFit, MicrophoneLine, WallEduction
from torchliner.report import fields
from torchliner.report import figure as look
from torchliner.report.answer import Answer, Grid, Picture, row_words
from torchliner.report.maps import distinct
from torchliner.report.table import Row, bounds_of, table_of
from torchliner.studies.variants import rows_of

EDUCED = ("impedance", "low", "high", "deviation", "wavenumber", "energy_share", "end_reflection", "residual")
NEPER = 20 * math.log10(math.e)  # dB
ROUNDING = 1e-12
MOST_DRAWN = 6  # frequencies along a wall
MESH = "mesh difference (dB)"


def of_wall(*found: WallEduction | FieldFit) -> Answer:
    """Z of each eduction with its interval, how far they are apart, what is known of the wall."""
    lines, several = [one.source_line for one in found], len(found) > 1
    pairs = list(zip(found, lines, strict=True))
    labels = distinct([(f"source {one.source_side}", one.method, Path(line.name).stem) for one, line in pairs])
    each_rows = [
        rows_of(
            eduction=label,
            line=line.title or line.name,
            method=one.method,
            source=one.source_side,
            mach=float(one.choices.get("mach", line.mach)),
            frequency=one.frequency,
            **{name: getattr(one, name, None) for name in EDUCED},
            misfit=None if one.misfit is None else one.misfit.sqrt(),
            known=line.wall_impedance,
        )
        for (one, line), label in zip(pairs, labels, strict=True)
    ]
    rows, by_frequency = [row for mine in each_rows for row in mine], dict[float, list[Row]]()
    for row in rows:
        by_frequency.setdefault(row["frequency"], []).append(row)
    # The frequency of all at which the worst fitted is fitted best.
    main, at = min(by_frequency.items(), key=lambda pair: (-len(pair[1]), max(map(_misfit, pair[1]))))
    sentences = [
        f"{row_words(row, fields.LEVEL)}{'' if bounds_of(row) else ' without an interval'} in units of ρc at {main:g} "
        f"Hz, {row['eduction'] if several else row['method']}."
        for row in at
    ]
    if len(at) == 2 and cmath.isfinite(at[0]["impedance"] + at[1]["impedance"]):
        one, other = at[0]["impedance"], at[1]["impedance"]
        sentences.append(f"The two are {200 * abs(one - other) / (abs(one) + abs(other)):.3g} % apart.")
    pressures, waves = list[Row](), []
    for one, line, label in zip(found, lines, labels, strict=True):
        if main in (known := one.frequency.tolist()):
            f, (places, fitted) = known.index(main), one.fitted_along()
            waves.append((label, (places, fitted[:, f]), line.x, line.pressure[:, f]))
            pressures += [{"eduction": label} | row for row in _microphones(line) if row["frequency"] == main]
    along = partial(fields.draw_pressures, waves, title="pressures along the wall", markers="measured")
    curves = [
        look.curve_of(mine, "frequency", bars=len(mine) == 1, **look.colour_of(i, label, marker=look.MARKERS[i]))
        for i, (label, mine) in enumerate(zip(labels, each_rows, strict=True))
    ]
    spectra = partial(look.draw_parts, curves, look.KHZ, caption="95 % intervals", poles=True, legend=2)
    words = f"Sound pressure along the wall at {main:g} Hz: markers, the microphones; lines, what was fitted."
    shown = "frequency,impedance,interval,residual,known,deviation,wavenumber,energy_share,end_reflection,misfit"
    references = {f"{name}: Z = {z:.3f}.": 0 for line in lines for name, z in line.reference.items()}
    return Answer(
        title=f"Impedance from microphones: {'; '.join(dict.fromkeys(line.title or line.name for line in lines))}",
        lines=sentences,
        table=table_of(rows, "eduction," * several + shown),
        brief=rows if len(rows) > len(at) else [],
        caption="Z = p/(ρc v) with exp(jωt - jαx), x along the flow. Residual: rms of what is left over that of the "
        "pressures. Misfit: residuals over the errors of the microphones, 1 if the duct is right.",
        remarks=list(references),
        notes=[note for one, line in pairs for note in (*line.notes, *one.notes)],
        pictures=[
            Picture("spectrum", "Impedance over frequency with 95 % intervals.", spectra, lambda: rows),
            Picture("along_wall", words, along, lambda: pressures),
        ],
        results=list(found),
    )


def _misfit(row: Row) -> float:
    """What is left of the pressures, where there is a Z."""
    return float(row["residual"]) if cmath.isfinite(row["impedance"]) else math.inf


def _microphones(line: MicrophoneLine) -> list[Row]:
    """Level and phase at the microphones, of every frequency."""
    pressure = line.pressure.T
    level, phase = spl_from_pressure_amplitude(pressure), torch.rad2deg(torch.angle(pressure))
    return rows_of(frequency=line.frequency[:, None], x=line.x, spl=level, phase=phase)


def of_line(line: MicrophoneLine) -> Answer:
    """What microphones say, and of a solved duct what it takes from sound, and whether the mesh is fine enough."""
    solved, modes = (line.provenance.get(key) for key in ("solved", "plane_mode"))
    at = torch.linspace(0, len(line.frequency) - 1, min(len(line.frequency), MOST_DRAWN)).round().int().tolist()
    microphones = table_of(_microphones(line), "frequency,x,spl,phase")
    words = "Sound pressure along the wall of the microphones, phase of exp(+jωt); grey: liner."
    waves = [(f"{float(line.frequency[f]):g} Hz", None, line.x, line.pressure[:, f]) for f in dict.fromkeys(at)]
    liner = ((solved or {}).get("duct") or {}).get("liner") or []
    draw = partial(fields.draw_pressures, waves, title=line.title or line.name, liner=liner)
    pictures = [Picture("along_wall", words, draw, lambda: microphones.rows)]
    if not solved or not modes:
        title = f"Microphones: {line.title or line.name}"
        return Answer(title, (), microphones, caption=words, notes=line.notes, pictures=pictures)
    row = max(modes, key=lambda each: each.get(MESH) or 0.0)
    moved = row.get(MESH)
    check = "no second mesh was solved" if moved is None else f"a finer mesh moves it by {moved:.2g} dB"
    sentence = f"At {row['frequency (Hz)']:g} Hz the duct takes {row['transmission loss (dB)']:.2f} dB from the plane "
    sentence += f"wave of a source {line.source_side}; {check} (limit {SETTLED:g} dB)."
    return Answer(
        title=f"Solved duct: {line.title}",
        lines=[sentence],
        table=table_of(modes, ",".join(modes[0])),
        caption="The plane-like mode sent back and let through, and its energy, in shares of that coming in.",
        grids=[Grid("microphones", "At the microphones.", microphones)],
        notes=line.notes,
        pictures=pictures,
        results=[SimpleNamespace(choices={key: v for key, v in line.provenance.items() if key != "plane_mode"})],
        more={"duct": solved},
    )


def of_modes(setup: DuctSetup, modes: Mapping[str, Any]) -> Answer:
    """One row per frequency, direction and mode; decay in dB over the liner's length too."""
    rows: list[Row] = []
    for direction, solved in modes.items():
        mode = torch.arange(solved.wavenumber.shape[-1])
        several = rows_of(frequency=setup.frequency[:, None], mode=mode, wavenumber=solved.wavenumber)
        rows += [{"direction": direction} | row for row in several]
    length = setup.case.liner[0][1] - setup.case.liner[0][0] if setup.case.liner else math.nan
    for row in rows:
        alpha, sign = row["wavenumber"], -1 if row["direction"] == "downstream" else 1
        decay = 0.0 if abs(alpha.imag) < ROUNDING * abs(alpha) else sign * NEPER * alpha.imag
        row |= {"decay": decay, "decay over liner (dB)": decay * length}
    return Answer(
        title=f"Modes of {setup.name}",
        lines=[
            "Waves e^(-j alpha x) above the first liner; mode n grew out of the rigid duct's mode n as the wall's "
            "reflection went straight from 1."
        ],
        table=table_of(rows, "frequency,direction,mode,wavenumber,decay,decay over liner (dB)"),
        more={"duct": setup.facts},
    )

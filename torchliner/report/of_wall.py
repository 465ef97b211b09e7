"""The answer of impedances educed from microphones: lines and methods side by side."""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import torch

from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.records import FieldFit, MicrophoneLine, WallEduction
from torchliner.report.answer import Answer, Grid, Picture, difference_row, impedance_words, plain_of
from torchliner.report.fields import LEVEL, draw_along, draw_spectra, draw_wall, spectrum_of
from torchliner.report.numbers import table_of_curves
from torchliner.report.table import bounds_of, if_known, table_of

COMPARED = "Differences; half-widths add as squares, as those of independent errors do."
FIT = ("end_reflection", "standard_error")  # of a fit of the field
LABELS = ((0,), (1,), (2,), (0, 1), (0, 2), (0, 1, 2))  # parts of a label, the fewest first
Educed = WallEduction | FieldFit
Row = dict[str, Any]


def wall_rows(line: MicrophoneLine, found: Educed) -> list[Row]:
    """One row per frequency of a line without leading axes.

    ``deviation`` is u(R) + j u(X) over the draws; without draws the standard error, infinite where it has no bound.
    ``known`` is Z of the wall where the line states it, ``off`` the impedance minus that. ``low`` and ``high`` bound
    the 95 % interval. What a method does not give is None.

    Raises:
        ValueError: the line has leading axes, as files of draws do.
    """
    if found.impedance.ndim != 1:
        raise ValueError(f"{line.name} holds {tuple(found.impedance.shape[:-1])} lines; a table needs one")
    about: Row = {"line": line.title or line.name, "method": found.method, "source": found.source_side}
    about["mach"] = float(found.choices.get("mach", line.mach))
    names = ("wavenumber", "energy_share") if isinstance(found, WallEduction) else FIT
    values: dict[str, Any] = {name: getattr(found, name) for name in ("frequency", "impedance", "residual", *names)}
    values["misfit"] = None if found.misfit is None else found.misfit**0.5
    if line.wall_impedance is not None:
        values |= {"known": line.wall_impedance, "off": found.impedance - line.wall_impedance}
    if found.draws is not None:
        values |= {"failed_draws": found.failed, "deviation": found.standard_deviation}
        if isinstance(found, WallEduction):
            values |= dict(zip(("level_error", "phase_error"), found.used_errors, strict=True))
    elif found.covariance is not None:
        values["deviation"] = found.standard_error
    if "deviation" in values:
        values["low"], values["high"] = found.interval(LEVEL)
    if isinstance(found, WallEduction) and found.singular_values is not None:
        values["singular_values"] = (found.singular_values / found.singular_values[0]).T
    rows = []
    for f in range(len(found.frequency)):
        row: Row = dict.fromkeys(("low", "high", "deviation", "wavenumber", *FIT)) | about
        row |= {name: None if column is None else column[f].tolist() for name, column in values.items()}
        error = row["standard_error"]
        if error is not None and cmath.isinf(error):
            row |= {"deviation": error, "low": None, "high": None}
        if row["low"] is not None and cmath.isnan(row["low"]):
            row |= {"low": None, "high": None}
        rows.append(row)
    return rows


def of_wall(found: Sequence[Educed], source: Path | None = None) -> Answer:
    """Z of each eduction with its interval, how far they are apart, what is known of the wall."""
    lines = [one.source_line for one in found]
    labels = labels_of(found, lines)
    several = len(found) > 1
    tables: list[list[Row]] = [
        [{"eduction": label} | row for row in wall_rows(line, one)]
        for one, line, label in zip(found, lines, labels, strict=True)
    ]
    rows: list[Row] = [row for each in tables for row in each]
    main = _best_fitted(found)
    at = [row for row in rows if row["frequency"] == main]
    sentences = [
        f"{_words(row)} in units of ρc at {main:g} Hz, {row['eduction'] if several else row['method']}." for row in at
    ]
    compared = [
        difference_row(main, row["impedance"], bounds_of(row), other["eduction"], other["impedance"], bounds_of(other))
        | {"of": row["eduction"]}
        for row, other in itertools.combinations(at, 2)
    ]
    for row in at:
        for name, z in _walls_of(lines[labels.index(row["eduction"])], main).items():
            compared.append(
                difference_row(main, row["impedance"], bounds_of(row), name, z, None) | {"of": row["eduction"]}
            )
    if len(at) == 2 and cmath.isfinite(at[0]["impedance"] + at[1]["impedance"]):
        one, other = at[0]["impedance"], at[1]["impedance"]
        sentences.append(f"The two are {200 * abs(one - other) / (abs(one) + abs(other)):.3g} % apart.")
    shown = "eduction," * several + "frequency,impedance" + if_known(rows, "low").replace("low", "interval")
    brief = shown + if_known(rows, "residual", "known")
    verbose = shown + if_known(rows, "deviation", "wavenumber", "energy_share", "end_reflection")
    verbose += if_known(rows, "residual", "misfit", "known", "off")
    notes = [note for one, line in zip(found, lines, strict=True) for note in (*line.notes, *one.notes)]
    choices = {label: dict(one.choices) for label, one in zip(labels, found, strict=True)}
    for label, line in zip(labels, lines, strict=True):
        choices[label] |= {"line": line.name, "microphones": line.microphones, "duct height": float(line.duct_height)}
    titles = dict.fromkeys(line.title or line.name for line in lines)
    return Answer(
        title=f"Impedance from microphones: {'; '.join(titles)}",
        lines=sentences,
        table=table_of(rows, verbose),
        brief=table_of(rows if len(rows) > len(at) else [], brief),
        caption=(
            "Z = p/(ρc v) with exp(jωt - jαx), x along the flow. Residual: rms of what is left over that of the "
            "pressures. Misfit: residuals over the errors of the microphones, 1 if the duct is right."
        ),
        plain={
            "lines": [
                {
                    "name": line.name,
                    "title": line.title,
                    "choices": plain_of(one.choices),
                    "rows": each,
                    "notes": [str(note) for note in (*line.notes, *one.notes)],
                }
                for line, one, each in zip(lines, found, tables, strict=True)
            ]
        },
        grids=[Grid("compared-table", COMPARED, table_of(compared, "frequency,of,minus,difference,interval,differs"))],
        remarks=[f"{labels[i]}: {_basis(one)}." for i, one in enumerate(found)],
        notes=notes,
        pictures=_pictures(found, lines, labels, main),
        results=list(found),
        choices=choices,
        source=source,
    )


def _words(row: Row) -> str:
    """Z and its interval."""
    z = row["impedance"]
    bounds = None if row["low"] is None else (row["low"], row["high"])
    return impedance_words(z, bounds, LEVEL) + ("" if bounds else " without an interval")


def _basis(found: Educed) -> str:
    """Where the interval comes from."""
    if isinstance(found, FieldFit) and found.draws is not None:
        return f"interval over {len(found.draws.impedance)} draws"
    if found.draws is not None:
        level, phase = ({f"{float(end):.2g}" for end in (used.min(), used.max())} for used in found.used_errors)
        used = f"{' to '.join(sorted(level, key=float))} dB, {' to '.join(sorted(phase, key=float))} degrees"
        return f"interval over {len(found.draws.impedance)} draws of the microphones' errors, {used}"
    if found.covariance is None:
        return "no interval, the waves leave no degree of freedom"
    if isinstance(found, FieldFit):
        return "interval by the microphones' stated errors"
    return f"interval by what the waves leave, {found.freedom} degrees of freedom"


def labels_of(found: Sequence[Educed], lines: Sequence[MicrophoneLine]) -> list[str]:
    """As few words as tell eductions apart, the method among them if there are several."""
    parts = [
        (f"source {one.source_side}", one.method, line.title or Path(line.name).stem)
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


def _best_fitted(found: Sequence[Educed]) -> float:
    """The frequency of all, Hz, at which the worst fitted is fitted best."""
    residuals: dict[float, list[float]] = {}
    for one in found:
        for f, residual, z in zip(one.frequency.tolist(), one.residual.tolist(), one.impedance.tolist(), strict=True):
            residuals.setdefault(f, []).append(residual if z == z else math.inf)
    return min(residuals, key=lambda f: (-len(residuals[f]), max(residuals[f])))


def _walls_of(line: MicrophoneLine, frequency: float) -> dict[str, complex]:
    """What is known of the wall; impedances that a line names stand for its tone, where it has one alone."""
    known = {name: complex(z) for name, z in line.reference.items()} if len(line.frequency) == 1 else {}
    wall = math.nan if line.wall_impedance is None else line.wall_impedance[line.frequency.tolist().index(frequency)]
    return known if wall != wall else known | {"the solved wall": complex(wall)}


def pressure_rows(label: str, frequency: float, x: Any, pressure: Any) -> list[Row]:
    """Level and phase at places, a row each; pressure complex, Pa, (X,)."""
    level, phase = spl_from_pressure_amplitude(pressure), torch.rad2deg(torch.angle(pressure))
    return [
        {"eduction": label, "frequency": frequency, "x": at, "spl": spl, "phase": angle}
        for at, spl, angle in zip(x.tolist(), level.tolist(), phase.tolist(), strict=True)
    ]


def _pictures(found: Sequence[Educed], lines: Any, labels: Sequence[str], main: float) -> list[Picture]:
    there = [(i, one.frequency.tolist().index(main)) for i, one in enumerate(found) if main in one.frequency.tolist()]
    pressures = [row for i, f in there for row in pressure_rows(labels[i], main, lines[i].x, lines[i].pressure[:, f])]
    words = f"Sound pressure along the wall at {main:g} Hz: markers, the microphones; lines, what was fitted."
    along = Picture("along-wall", words, partial(draw_along, found, there, labels), lambda: table_of(pressures))
    curves = [spectrum_of(one, label) for one, label in zip(found, labels, strict=True)]
    words = "Impedance over frequency; shaded: 95 % intervals. The CSV has them whole."
    if any(len(one.frequency) > 1 for one in found):
        return [
            Picture("spectrum", words, partial(draw_spectra, found, labels), lambda: table_of_curves(curves)),
            along,
        ]
    words = "Impedance, with its draws, and levels along the wall, with the range of the draws."
    return [Picture("impedance", words, partial(draw_wall, found, labels), lambda: table_of_curves(curves)), along]

"""Pictures of eductions from microphones: over frequency, along the wall, in complex planes."""

from __future__ import annotations

import cmath
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.records import WallEduction
from torchliner.report.page.blocks import Block, Figure, Text
from torchliner.report.page.wall_subject import WallSubject
from torchliner.report.table import Column, Table, format_complex, plain_columns
from torchliner.report.typesetting import typeset
from torchliner.report.wall_pressure import (
    draw_along,
    draw_impedances,
    draw_spectra,
    draw_waves,
    spectrum_of,
)

ALONG = tuple(map(Column, ("eduction", "what", "frequency (Hz)", "x (m)", "SPL (dB)",
                           "phase (deg)")))  # fmt: skip


def pressure_rows(label: str, what: str, frequency: float, x: Any, pressure: Any) -> list[Any]:
    """Level and phase at places, a row each; pressure complex, Pa, (X,)."""
    level = spl_from_pressure_amplitude(pressure)
    phase = torch.rad2deg(torch.angle(pressure))
    return [
        dict(zip((c.name for c in ALONG), (label, what, frequency, *row), strict=True))
        for row in zip(x.tolist(), level.tolist(), phase.tolist(), strict=True)
    ]


def spectrum(subject: WallSubject) -> list[Block]:
    """R and X over frequency, where there are several."""
    if all(len(one.frequency) < 2 for one in subject.found):
        return []
    curves = [spectrum_of(one, label) for one, label in
              zip(subject.found, subject.drawable, strict=True)]  # fmt: skip
    names = list(dict.fromkeys(name for each in curves for name in each.values))
    rows = [
        {"eduction": label, "frequency (Hz)": f} | {n: each.values[n][i] if n in each.values
                                                    else None for n in names}
        for each, label in zip(curves, subject.labels, strict=True)
        for i, f in enumerate(each.at.tolist())
    ]  # fmt: skip
    ends = "; ".join(
        f"{label}: " + ", ".join(f"{part} {_range(each.values[part])}"
                                 for part in ("resistance", "reactance"))
        for each, label in zip(curves, subject.labels, strict=True)
    )  # fmt: skip
    alt = f"Resistance and reactance over frequency. {ends}."
    caption = "Impedance over frequency; shaded: 95 % statistical intervals."
    drawn, beyond = draw_spectra(subject.found, subject.drawable)
    if beyond:
        caption += " They go on beyond the axes; the CSV has them whole."
    columns = [Column("eduction"), Column("frequency (Hz)"), *map(Column, names)]
    return [Figure("spectrum", drawn, typeset(alt), caption, Table(rows, columns, ""))]


def _range(values: Any) -> str:
    known = values[np.isfinite(values)]
    return f"{known.min():.3f} to {known.max():.3f}" if known.size else "unknown"


def along_wall(subject: WallSubject) -> list[Block]:
    """SPL and phase along the wall, measured and fitted."""
    blocks: list[Block] = []
    for number, frequency in enumerate(subject.drawn):
        rows: list[Any] = []
        words = []
        there = subject.there(frequency)
        for i, f in there:
            line, one, label = subject.lines[i], subject.found[i], subject.labels[i]
            level = line.level[:, f]
            words.append(f"{label}: {float(level.min()):.1f} to {float(level.max()):.1f} dB, "
                         f"residual {100 * float(one.residual[f]):.2g} %")  # fmt: skip
            places, fitted = one.fitted_along()
            rows += pressure_rows(label, "measured", frequency, line.x, line.pressure[:, f])
            rows += pressure_rows(label, "fitted", frequency, places, fitted[:, f])
        alt = f"Level and phase along the wall at {frequency:g} Hz. {'; '.join(words)}."
        caption = (
            f"Sound pressure along the wall at {frequency:g} Hz, phase of exp(+jωt): markers, the "
            "microphones; lines, what was fitted."
        )
        if any(subject.found[i].draws is not None for i, _ in there):
            caption += " Shaded: range of the draws."
        drawn = draw_along(subject.found, there, subject.drawable)
        blocks.append(Figure(f"along-wall-{number}", drawn, typeset(alt), caption,
                             Table(rows, ALONG, "")))  # fmt: skip
    if len(subject.drawn) < len(subject.common):
        words_ = f"Drawn at {subject.main:g} Hz, the best fitted of {len(subject.common)}."
        blocks.insert(0, Text(words_))
    return blocks


def in_planes(subject: WallSubject) -> list[Block]:
    """Z with its draws or its interval and what is known; wavenumbers of all waves."""
    blocks: list[Block] = []
    for number, frequency in enumerate(subject.drawn):
        blocks += _impedances(subject, number, frequency)
        blocks += _waves(subject, number, frequency)
    return blocks


def _impedances(subject: WallSubject, number: int, frequency: float) -> list[Block]:
    there = [(i, f) for i, f in subject.there(frequency)
             if cmath.isfinite(subject.rows[i][f]["impedance"])]  # fmt: skip
    if not there:
        return []
    known = {k: v for i, f in there for k, v in subject.known(i, f).items()}
    rows = [subject.rows[i][f] | {"name": subject.labels[i]} for i, f in there]
    rows += [{"name": name, "impedance": z, "low": None, "high": None} for name, z in known.items()]
    places = "; ".join(f"{row['name']} {format_complex(row['impedance'])}" for row in rows)
    alt = f"Impedances in the complex plane at {frequency:g} Hz: {places}."
    drawn_too = any(subject.found[i].draws is not None for i, _ in there)
    caption = f"Z over ρc in the complex plane at {frequency:g} Hz."
    caption += " Dots: draws of the microphones' errors." if drawn_too else ""
    if any(subject.found[i].draws is None and row["low"] is not None
           for (i, _), row in zip(there, rows, strict=False)):  # fmt: skip
        caption += " Crosses: 95 % statistical intervals."
    caption += " Without colour: known from elsewhere." if known else ""
    escaped = {name.replace("$", r"\$"): z for name, z in known.items()}
    drawn = draw_impedances(subject.found, there, subject.drawable, escaped)
    table = Table(rows, [Column("name"), *plain_columns("impedance* low* high*", None)])
    return [Figure(f"impedance-plane-{number}", drawn, typeset(alt), caption, table)]


def _waves(subject: WallSubject, number: int, frequency: float) -> list[Block]:
    """Of the eductions by waves."""
    there = [(i, f) for i, f in subject.there(frequency)
             if isinstance(subject.found[i], WallEduction)]  # fmt: skip
    if not there:
        return []
    rows, words = [], []
    for i, f in there:
        one: Any = subject.found[i]
        kept, energies = complex(one.wavenumber[f]), one.energies[:, f].tolist()
        for alpha, energy in zip(one.modes[:, f].tolist(), energies, strict=True):
            rows.append({"eduction": subject.labels[i], "real (1/m)": alpha.real,
                         "imaginary (1/m)": alpha.imag, "energy": energy,
                         "kept": int(alpha == kept)})  # fmt: skip
        here = f"{format_complex(kept)} per metre" if cmath.isfinite(kept) else "no wave"
        words.append(f"{subject.labels[i]} {here}")
    rigid = _rigid(subject, [i for i, _ in there], frequency)
    alt = f"Wavenumbers in the complex plane at {frequency:g} Hz: {'; '.join(words)}."
    caption = (
        f"Wavenumbers α of exp(−jαx) at {frequency:g} Hz: filled, the wave whose impedance is "
        "given, with its draws as dots; open, the other waves found; ticks, the plane waves of "
        "the rigid duct, k/(1 + M) and −k/(1 − M)."
    )
    drawn = draw_waves(subject.found, there, subject.drawable, rigid)
    table = Table(rows, list(map(Column, rows[0])))
    return [Figure(f"wavenumbers-{number}", drawn, typeset(alt), typeset(caption), table)]


def _rigid(subject: WallSubject, numbers: Sequence[int], frequency: float) -> list[float]:
    """Wavenumbers of the rigid ducts' plane waves, 1/m, each once."""
    found: dict[float, None] = {}
    for i in numbers:
        line = subject.lines[i]
        k = 2 * torch.pi * frequency / float(line.fluid.sound_speed)
        mach = float(subject.found[i].choices.get("mach", line.mach or 0.0))
        found |= dict.fromkeys((k / (1 + mach), -k / (1 - mach)))
    return list(found)

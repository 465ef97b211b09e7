"""Height studies as numbers and drawings: Z over height, imprint over height, rms along x."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.heights.study import HeightStudy
from torchliner.records import VelocityPlane
from torchliner.report import table
from torchliner.report.figure import COLOURS, MARKERS, PARTS, Figure, finish, styled, subplots
from torchliner.report.numbers import velocity_along_x
from torchliner.report.table import COMPLEX_PART, Array, Table

ORDERS = ("probes_first", "velocity_first")
_V, _U = r"$v'_{\mathrm{rms}}$", r"$u'_{\mathrm{rms}}$"
MOST_LENGTHS = 5  # curves a reader can tell apart


def plain_rows(study: HeightStudy) -> list[dict[str, Any]]:
    """One dictionary of plain numbers a height and length, for CSV and JSON."""
    facts = {one.height: one for one in study.facts}
    plain = []
    for row in study.rows:
        known = facts[row.height]
        entry: dict[str, Any] = {
            "height (m)": row.height,
            "averaging length (m)": row.length,
            "length in cells": None if study.pitch is None else row.length / study.pitch,
            "probes": row.probes,
            "windows": row.windows,
        }
        for order in ORDERS:
            value, spread = getattr(row, order), getattr(row, f"{order}_spread")
            label = order.replace("_", " ")
            entry |= {
                f"resistance, {label}": value.real, f"reactance, {label}": value.imag,
                f"spread of R, {label}": spread.real, f"spread of X, {label}": spread.imag,
            }  # fmt: skip
        entry |= {
            "coherence": known.coherence,
            "v' rms (m/s)": known.velocity_rms,
            "imprint on v'": None if known.imprint is None else known.imprint.relative,
            "jet velocity (m/s)": known.jet_velocity,
            "jet height (m)": known.jet_height,
        }
        plain.append(entry)
    return plain


def write_rows(study: HeightStudy, path: str | Path) -> None:
    """``plain_rows`` as CSV; what is not known stays empty."""
    table.write_rows(
        [
            {name: None if value is None else f"{value:.9g}" for name, value in row.items()}
            for row in plain_rows(study)
        ],
        path,
    )


def length_label(length: float, pitch: float | None) -> str:
    """'1/4 cell', '2 cells' or millimetres."""
    if pitch is not None:
        for share, name in ((1 / 8, "1/8 cell"), (1 / 4, "1/4 cell"), (1 / 2, "1/2 cell")):
            if abs(length / pitch - share) < 0.02 * share:
                return name
        cells = round(length / pitch)
        if cells and abs(length / pitch - cells) < 0.01 * cells:
            return "1 cell" if cells == 1 else f"{cells} cells"
    return f"{1e3 * length:.3g} mm"


def impedance_over_height(study: HeightStudy) -> Table:
    """R and X over height, a column an averaging length, order and part."""
    values: dict[str, Array] = {}
    for length in study.lengths:
        rows = study.at_length(length)
        for part, attribute in COMPLEX_PART.items():
            for order in ORDERS:
                name = f"{part}, {order.replace('_', ' ')}, {1e3 * length:.4g} mm"
                values[name] = np.array([getattr(getattr(r, order), attribute) for r in rows])
    heights = np.array([facts.height for facts in study.facts])
    return Table(heights, values, study.title, "height (m)")


def imprint_over_height(study: HeightStudy) -> Table:
    """Imprints, rms, relative to the mean of the profile (of v_0: to that of v'); nan: unknown."""
    values: dict[str, Array] = {}
    known = [facts.imprint for facts in study.facts]

    def column(name: str, numbers: Sequence[float | None]) -> None:
        if any(number is not None for number in numbers):
            values[name] = np.array([math.nan if n is None else n for n in numbers])

    column("v' rms", [i.relative if i else None for i in known])
    column("v' rms, first harmonic", [i.first / 2**0.5 / i.mean if i else None for i in known])
    column(
        "v' rms, between harmonics",
        [i.between / i.mean if i is not None and i.between is not None else None for i in known],
    )
    steady = [facts.mean_imprint for facts in study.facts]
    column("v0", [s.rms / i.mean if s and i else None for s, i in zip(steady, known, strict=True)])
    stream = [facts.streamwise_imprint for facts in study.facts]
    column("u' rms", [u.relative if u else None for u in stream])
    heights = np.array([facts.height for facts in study.facts])
    if study.decay is not None:
        values["v' rms, fitted decay"] = study.decay.at(heights)
    return Table(heights, values, study.title, "height (m)")


@styled
def draw_impedance_over_height(study: HeightStudy, path: str | Path | None = None) -> Figure:
    """R and X over height: admittance over probes, and velocity first at several lengths."""
    figure, axes = subplots(1, 2, 3.2)
    lengths = study.lengths[1:]
    if len(lengths) > MOST_LENGTHS:
        keep = np.unique(np.linspace(0, len(lengths) - 1, MOST_LENGTHS).round().astype(int))
        lengths = tuple(lengths[i] for i in keep)
    for axis, (part, label) in zip(axes[0], PARTS, strict=True):
        rows = study.at_length(study.lengths[0])
        heights = [1e3 * row.height for row in rows]
        values = [getattr(row.probes_first, COMPLEX_PART[part]) for row in rows]
        axis.plot(heights, values, "k*-", label="admittance over probes", markersize=6, zorder=4)
        for i, length in enumerate(lengths):
            rows = study.at_length(length)
            values = [getattr(row.velocity_first, COMPLEX_PART[part]) for row in rows]
            spread = [getattr(row.velocity_first_spread, COMPLEX_PART[part]) for row in rows]
            shifted = [h + 0.02 * (i - len(lengths) / 2) for h in heights]
            axis.errorbar(
                shifted, values, spread, marker=MARKERS[i], color=COLOURS[i], capsize=2,
                markerfacecolor="white", elinewidth=0.7,
                label=f"velocity first, {length_label(length, study.pitch)}",
            )  # fmt: skip
        if "true" in study.reference:
            true = getattr(study.reference["true"], COMPLEX_PART[part])
            axis.axhline(true, color="0.4", linewidth=0.9, linestyle="--", label="true")
        axis.set_xlabel("$y$ (mm)")
        axis.set_ylabel(label)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    hard = " (null test)" if study.choices.get("surface") == "hard wall" else ""
    figure.suptitle(
        f"{study.title}{hard}, {study.frequency:g} Hz; bars: standard deviation over windows",
        fontsize=9,
    )
    return finish(figure, path)


@styled
def draw_imprint(study: HeightStudy, path: str | Path | None = None) -> Figure:
    """Imprint of the cells over height, its fitted decay and that of an evanescent sound field."""
    table = imprint_over_height(study)
    figure, axes = subplots(1, 1, 3.0)
    axis = axes[0, 0]
    names = {
        "v' rms": rf"{_V}, all harmonics", "v' rms, first harmonic": rf"{_V}, first harmonic",
        "v' rms, between harmonics": rf"{_V}, between harmonics", "v0": "$v_0$", "u' rms": _U,
    }  # fmt: skip
    for i, name in enumerate(name for name in table.values if name in names):
        decay = study.decay if name == "v' rms" else None
        fitted = decay is not None and decay.follows
        axis.plot(
            1e3 * table.at, table.values[name], MARKERS[i] + ("" if fitted else ":"),
            color=COLOURS[i], label=names[name],
        )  # fmt: skip
        if decay is not None and fitted:
            text = rf"fit: $e^{{-y/l}}$, $l={1e3 * decay.length:.3g}$ mm"
            axis.plot(1e3 * table.at, decay.at(table.at), "-", color=COLOURS[i], label=text)
    if study.decay is not None:
        first = table.values["v' rms, first harmonic"][0]
        sound = first * np.exp(-(table.at - table.at[0]) / study.decay.evanescent)
        text = rf"sound: $l=L_c/2\pi={1e3 * study.decay.evanescent:.3g}$ mm"
        axis.plot(1e3 * table.at, sound, "--", color="0.3", label=text)
    axis.set_yscale("log")
    axis.set_xlabel("$y$ (mm)")
    axis.set_ylabel("cell-periodic part (rms) over mean")
    figure.legend(*axis.get_legend_handles_labels(), loc="outside right center")
    figure.suptitle(f"{study.title}, {study.frequency:g} Hz", fontsize=9)
    return finish(figure, path)


@styled
def draw_rms_along_x(
    cases: Sequence[tuple[str, Sequence[VelocityPlane], float | None]],
    path: str | Path | None = None,
) -> Figure:
    """v'_rms and u'_rms along x at all heights, a column a case; cells marked (figure 16).

    Args:
        cases: title, planes and cell pitch (m; None where there are no cells).
        path: picture to write, or None. Colours go by the heights of the first case.
    """
    figure, axes = subplots(2, len(cases), 4.4)
    heights = np.array(sorted(plane.height or 0.0 for plane in cases[0][1]))
    for column, (title, planes, pitch) in enumerate(cases):
        for plane in sorted(planes, key=lambda plane: plane.height or 0.0):
            profile = velocity_along_x(plane)
            colour = COLOURS[int(np.abs(heights - (plane.height or 0.0)).argmin())]
            for axis, part in zip(axes[:, column], "vu", strict=True):
                values = profile.values.get(f"{part}' rms (m/s)")
                if values is not None:
                    axis.plot(1e3 * profile.x, values, color=colour, label=profile.label)
        _finish_column(axes[:, column], planes[0], pitch)
        axes[0, column].set_title(f"({'abc'[column]}) {title}", loc="left")
    for axis, part in zip(axes[:, 0], (_V, _U), strict=True):
        axis.set_ylabel(f"{part} (m s$^{{-1}}$)")
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=len(heights)
    )
    return finish(figure, path)


def _finish_column(axes: Any, plane: VelocityPlane, pitch: float | None) -> None:
    last = float(plane.x[-1])
    for axis in axes:
        for k in range(0 if pitch is None else int(last / (pitch or 1.0) + 1.5)):
            axis.axvline(
                1e3 * k * (pitch or 0.0), color="0.7", linewidth=0.6, linestyle="--", zorder=0
            )
        tops = [float(np.max(line.get_ydata())) for line in axis.get_lines()]
        axis.set_ylim(0, 1.1 * max(tops, default=1.0))
        axis.set_xlim(0, 1e3 * last)
    axes[1].set_xlabel("$x$ (mm)")

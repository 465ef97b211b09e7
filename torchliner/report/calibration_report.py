"""A calibration as text, rows and a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.report.figure import COLOURS, PARTS, Figure, finish, head_panel, styled, subplots
from torchliner.report.table import Column, Table, format_complex, format_pair, plain_columns
from torchliner.studies.calibrate import Calibration
from torchliner.studies.rows import Row

ELLIPSE = 2.4477  # radius that holds 95 % of a two-dimensional Gaussian


def _format_misses(misses: complex | None) -> str:
    if misses is None or misses != misses:
        return "-"
    return f"{misses.real:+.1f}, {misses.imag:+.1f} s.d."


PREDICTIONS = (
    *plain_columns("label frequency height before* after* standard* correlation true* misses*", ""),
    Column("", "label", "plane"),
    Column("", "frequency", "f Hz", ".1f"),
    Column("", "before", "as it was", format_complex),
    Column("", "after", "calibrated", format_complex),
    Column("", "standard", "u(R), u(X)", lambda value: format_pair(value, 4)),
    Column("", "true", "reference", format_complex),
    Column("", "misses", "R, X off by", _format_misses),
)


def parameter_table(found: Calibration) -> Table:
    """One row per parameter: value, spread, bounds, interval; SI."""
    numbers = found.liner.numbers()
    return Table(
        range(len(found.parameters)),
        (
            Column("parameter", lambda i: found.parameters[i], "parameter"),
            Column("value", lambda i: float(found.values[i]), "value", ".5g"),
            Column("unit", lambda i: numbers[found.parameters[i]].unit, "unit"),
            Column("standard", lambda i: float(found.standard[i]), "u", ".2g"),
            Column("lower_95", lambda i: float(found.interval[0, i])),
            Column("upper_95", lambda i: float(found.interval[1, i])),
            Column("", lambda i: found.interval[:, i].tolist(), "95 % of the posterior",
                   lambda ends: f"{ends[0]:.5g} to {ends[1]:.5g}"),
            Column("low", lambda i: float(found.law.low[i])),
            Column("high", lambda i: float(found.law.high[i])),
            Column("", lambda i: (found.law.low[i], found.law.high[i]), "bounds",
                   lambda ends: f"{ends[0]:.4g} to {ends[1]:.4g}"),
            Column("on_bound", lambda i: found.parameters[i] in found.on_bound),
        ),
    )  # fmt: skip


def prediction_table(rows: Sequence[Row]) -> Table:
    """Before, after, spread, reference, misses in standard deviations; complex values as two."""
    return Table(rows, PREDICTIONS)


def plain_calibration(found: Calibration, rows: Sequence[Row]) -> dict[str, Any]:
    """For JSON."""
    return {
        "parameters": parameter_table(found).as_rows(),
        "correlation": found.correlation.tolist(),
        "singular_values": found.singular_values.tolist(),
        "unseen": [list(group) for group in found.unseen],
        "sum_of_squares": found.chi_square,
        "degrees_of_freedom": found.freedom,
        "scaling": found.scaling,
        "averaging": found.averaging,
        "reference": [complex(z) for z in found.wanted] if found.level_check is None else None,
        "level_check": None if found.level_check is None else found.level_check.tolist(),
        "fitted_speeds": list(found.speeds),
        "fitted": [complex(z) for z in found.found],
        "predictions": list(rows),
        "notes": list(found.notes),
    }


def format_calibration(found: Calibration) -> str:
    """Parameters, correlations, misfit."""
    lines = [parameter_table(found).as_text()]
    names = found.parameters
    pairs = [
        f"{names[i]} and {names[j]} {float(found.correlation[i, j]):+.2f}" for i in range(len(names)) for j in range(i)
    ]
    if pairs:
        lines.append("correlations: " + ", ".join(pairs))
    left = [None] * len(found.found) if found.level_check is None else found.level_check.tolist()
    lines += [
        f"level check {away:+.2f} dB, Z {format_complex(complex(value))}" if away is not None else
        f"reference {format_complex(complex(wanted))}, fitted {format_complex(complex(value))}"
        for wanted, value, away in zip(found.wanted, found.found, left, strict=True)
    ]  # fmt: skip
    effective = "none" if found.posterior is None else f"{found.posterior.effective:.0f}"
    lines.append(
        f"{found.data} data, {len(names)} parameters, sum of squares "
        f"{found.chi_square:.4g} ({found.scaling}); averaging: {found.averaging}; independent draws: "
        f"{effective}"
    )
    return "\n".join(lines)


@styled
def draw_predictions(panels: Mapping[str, Sequence[Row]], title: str, path: str | Path | None = None) -> Figure:
    """Complex plane: reference, prediction as it was, calibrated with its 95 % ellipse; a panel of rows
    a title."""
    figure, axes = subplots(1, len(panels), 3.6)
    names = list(dict.fromkeys(row.label for rows in panels.values() for row in rows))
    for axis, (heading, rows) in zip(axes[0], panels.items(), strict=True):
        for row in rows:
            _draw_prediction(axis, row, COLOURS[names.index(row.label)])
        axis.axhline(0, color="0.8", linewidth=0.6, zorder=0)
        axis.margins(0.08)
        head_panel(axis, heading)
        axis.set_xlabel(PARTS[0][1])
    axes[0, 0].set_ylabel(PARTS[1][1])
    for i, name in enumerate(names):
        axes[0, 0].plot([], [], "-", color=COLOURS[i], label=name)
    for marker, label, face in (
        ("*", "reference", "k"),
        ("o", "model as it was", "white"),
        ("s", "calibrated, 95 % ellipse", "k"),
    ):
        axes[0, 0].plot([], [], marker, color="k", markerfacecolor=face, label=label)
    return finish(figure, path, title, legend=3)


def _draw_prediction(axis: Any, row: Row, colour: str) -> None:
    if row.true is not None:
        axis.plot(row.true.real, row.true.imag, "*", color=colour, markersize=10)
        axis.plot(
            [row.true.real, row.after.real], [row.true.imag, row.after.imag], ":",
            color=colour, linewidth=0.8,
        )  # fmt: skip
    axis.plot(row.before.real, row.before.imag, "o", color=colour, markerfacecolor="white", markersize=7)
    axis.plot(row.after.real, row.after.imag, "s", color=colour, markersize=3.5)
    axis.plot(*_ellipse(row), color=colour, linewidth=0.9)


def _ellipse(row: Row) -> tuple[Any, Any]:
    """Points of the 95 % ellipse of the parameters' spread."""
    product = row.correlation * row.standard.real * row.standard.imag
    covariance = np.array([[row.standard.real**2, product], [product, row.standard.imag**2]])
    if not np.isfinite(covariance).all():
        return [], []
    widths, axes = np.linalg.eigh(covariance)
    turn = np.linspace(0, 2 * np.pi, 181)
    circle = np.stack([np.cos(turn), np.sin(turn)]) * np.sqrt(np.maximum(widths, 0))[:, None]
    points = ELLIPSE * axes @ circle
    return row.after.real + points[0], row.after.imag + points[1]

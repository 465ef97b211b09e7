"""A calibration as text, rows and a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.calibration.calibrate import Calibration
from torchliner.report.figure import COLOURS, PARTS, Figure, finish, styled, subplots
from torchliner.report.table import format_complex
from torchliner.tdibc.educe import educe

ELLIPSE = 2.4477  # radius that holds 95 % of a two-dimensional Gaussian


@dataclass(frozen=True)
class PredictionRow:
    """One predicted impedance beside what is known of it, all normalised.

    Args:
        label: of the plane.
        frequency: Hz.
        height: m, or None.
        before, after: with the liner as it was, and calibrated.
        standard: u(R) + j u(X) of ``after``, from the parameters' spread.
        correlation: of R and X.
        true: reference, or None.
        misses: by how many standard deviations R and X lie off it, signed; None without one.
    """

    label: str
    frequency: float
    height: float | None
    before: complex
    after: complex
    standard: complex
    correlation: float
    true: complex | None
    misses: complex | None

    def plain(self) -> dict[str, Any]:
        """For CSV: complex values as two numbers."""
        row: dict[str, Any] = {}
        for key, value in vars(self).items():
            if key in ("before", "after", "standard", "true", "misses"):
                row[f"{key}_resistance"] = "" if value is None else value.real
                row[f"{key}_reactance"] = "" if value is None else value.imag
            else:
                row[key] = value
        return row


def parameter_rows(found: Calibration) -> list[dict[str, Any]]:
    """One row a parameter: value, spread, bounds, interval."""
    numbers = found.liner.numbers()
    return [
        {
            "parameter": name, "value": float(found.values[i]), "unit": numbers[name].unit,
            "standard": float(found.standard[i]), "lower_95": float(found.interval[0, i]),
            "upper_95": float(found.interval[1, i]), "low": float(found.low[i]),
            "high": float(found.high[i]), "on_bound": name in found.on_bound,
        }
        for i, name in enumerate(found.parameters)
    ]  # fmt: skip


def format_calibration(found: Calibration) -> str:
    """Parameters, correlations, misfit."""
    lines = [f"{'parameter':24s}{'value':>11s} {'unit':5s}{'u':>10s}{'95 % of the posterior':>24s}"
             f"{'bounds':>20s}"]  # fmt: skip
    for row in parameter_rows(found):
        interval = f"{row['lower_95']:.5g} to {row['upper_95']:.5g}"
        bounds = f"{row['low']:.4g} to {row['high']:.4g}"
        lines.append(
            f"{row['parameter']:24s}{row['value']:11.5g} {row['unit']:5s}{row['standard']:10.2g}"
            f"{interval:>24s}{bounds:>20s}"
        )
    names = found.parameters
    pairs = [
        f"{names[i]} and {names[j]} {float(found.correlation[i, j]):+.2f}"
        for i in range(len(names))
        for j in range(i)
    ]
    if pairs:
        lines.append("correlations: " + ", ".join(pairs))
    lines += [
        f"reference {format_complex(complex(wanted))}, fitted {format_complex(complex(value))}"
        for wanted, value in zip(found.wanted, found.found, strict=True)
    ]
    effective = "none" if found.posterior is None else f"{found.posterior.effective:.0f}"
    lines.append(
        f"{2 * len(found.wanted)} data, {len(names)} parameters, sum of squares "
        f"{found.chi_square:.4g} ({found.scaling}); averaging: {found.order}; independent draws: "
        f"{effective}"
    )
    return "\n".join(lines)


def format_predictions(rows: Sequence[PredictionRow]) -> str:
    """A text table: before, after, spread, truth, misses in standard deviations."""
    lines = [f"{'plane':20s}{'f Hz':>8s}{'as it was':>16s}{'calibrated':>16s}{'u(R), u(X)':>16s}"
             f"{'true':>16s}{'R, X off by':>18s}"]  # fmt: skip
    for row in rows:
        spread = f"{row.standard.real:.4f} {row.standard.imag:.4f}"
        true = "-" if row.true is None else format_complex(row.true)
        off = "-"
        if row.misses is not None and row.misses == row.misses:
            off = f"{row.misses.real:+.1f} {row.misses.imag:+.1f} s.d."
        lines.append(
            f"{row.label:20s}{row.frequency:8.1f}{format_complex(row.before):>16s}"
            f"{format_complex(row.after):>16s}{spread:>16s}{true:>16s}{off:>18s}"
        )
    return "\n".join(lines)


@styled
def draw_predictions(
    panels: Mapping[str, Sequence[PredictionRow]], title: str, path: str | Path | None = None
) -> Figure:
    """Complex plane: truth, prediction as it was, calibrated with its 95 % ellipse.

    Args:
        panels: rows by the title of their panel.
        title: of the figure.
        path: where to save it.
    """
    figure, axes = subplots(1, len(panels), 3.6)
    names = list(dict.fromkeys(row.label for rows in panels.values() for row in rows))
    for axis, (heading, rows) in zip(axes[0], panels.items(), strict=True):
        for row in rows:
            _draw_prediction(axis, row, COLOURS[names.index(row.label) % len(COLOURS)])
        axis.axhline(0, color="0.8", linewidth=0.6, zorder=0)
        axis.margins(0.08)
        axis.set_title(heading)
        axis.set_xlabel(PARTS[0][1])
    axes[0, 0].set_ylabel(PARTS[1][1])
    for i, name in enumerate(names):
        axes[0, 0].plot([], [], "-", color=COLOURS[i % len(COLOURS)], label=name)
    for marker, label, face in (
        ("*", "true", "k"),
        ("o", "model as it was", "white"),
        ("s", "calibrated, 95 % ellipse", "k"),
    ):
        axes[0, 0].plot([], [], marker, color="k", markerfacecolor=face, label=label)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    figure.suptitle(title, fontsize=9)
    return finish(figure, path)


def _draw_prediction(axis: Any, row: PredictionRow, colour: str) -> None:
    if row.true is not None:
        axis.plot(row.true.real, row.true.imag, "*", color=colour, markersize=10)
        axis.plot(
            [row.true.real, row.after.real], [row.true.imag, row.after.imag], ":",
            color=colour, linewidth=0.8,
        )  # fmt: skip
    axis.plot(
        row.before.real, row.before.imag, "o", color=colour, markerfacecolor="white", markersize=7
    )
    axis.plot(row.after.real, row.after.imag, "s", color=colour, markersize=3.5)
    axis.plot(*_ellipse(row), color=colour, linewidth=0.9)


def _ellipse(row: PredictionRow) -> tuple[Any, Any]:
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


def prediction_rows(
    found: Calibration,
    plane: Any,
    before: Any,
    *,
    label: str | None = None,
    reference: str = "true",
    noise: complex = 0j,
) -> list[PredictionRow]:
    """Rows of one plane.

    Args:
        found: calibration.
        plane: velocity plane.
        before: liner as it was, whose other numbers the prediction keeps.
        label: of the plane; default its case.
        reference: name of the impedance beside which it is put, if the plane has it.
        noise: standard uncertainty of that, u(R) + j u(X), part of the misses.
    """
    said = found.choices
    first = educe(plane, before, phase=said.phase, edge=said.edge, drive=said.drive,
                  mean=said.mean, kernel=said.kernel)  # fmt: skip
    values = first.liner_impedance
    if found.order == "velocity first":
        values = first.liner_impedance_velocity_first
    prediction = found.predict(plane, before)
    true = plane.reference.get(reference)
    rows = []
    for i, frequency in enumerate(prediction.frequency.tolist()):
        covariance, standard = prediction.covariance[i], complex(prediction.standard[i])
        product = standard.real * standard.imag
        rows.append(
            PredictionRow(
                label or str(plane.provenance.get("case", plane.title)), frequency, plane.height,
                complex(values[i]), complex(prediction.impedance[i]), standard,
                float(covariance[0, 1]) / product if product else 0.0, true,
                None if true is None else prediction.misses(complex(true), noise, i),
            )
        )  # fmt: skip
    return rows

"""Sensitivities and uncertainty budgets as rows, text and bars."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.calibration.budget import Budget
from torchliner.calibration.sensitivities import Sensitivities
from torchliner.report.figure import COLOURS, Figure, finish, styled, subplots
from torchliner.report.table import format_complex

SIGNS = {
    "facesheet_thickness": "thickness $L_p$",
    "orifice_diameter": "diameter $d$",
    "porosity": r"porosity $\phi_p$",
    "cavity_depth": "depth $H_c$",
    "cavity_hydraulic_radius": "hydraulic radius $r_c$",
    "cavity_porosity": r"cavity porosity $\phi_c$",
    "open_area_fraction": r"open area $\alpha$",
    "vena_contracta": "vena contracta $C_{vc}$",
    "velocity_gain": "velocity gain",
    "offset_resistance": "offset, Re",
    "offset_reactance": "offset, Im",
    "temperature": "temperature $T$",
    "pressure": "pressure $p$",
}


def sensitivity_rows(found: Sensitivities, order: str) -> list[dict[str, Any]]:
    """One row per frequency and parameter: dZ per SI unit and per 1 %, largest first."""
    percent = found.per_percent().of_liner(order)
    rows = []
    for i, frequency in enumerate(found.found.frequency.tolist()):
        for j in percent[:, i].abs().argsort(descending=True).tolist():
            slope, step = complex(found.of_liner(order)[j, i]), complex(percent[j, i])
            rows.append(
                {
                    "frequency": frequency, "parameter": found.parameters[j],
                    "value": float(found.values[j]), "unit": found.units[j],
                    "resistance_per_unit": slope.real, "reactance_per_unit": slope.imag,
                    "resistance_per_percent": step.real, "reactance_per_percent": step.imag,
                }
            )  # fmt: skip
    return rows


def budget_rows(budget: Budget, frequency: Sequence[float], order: str) -> list[dict[str, Any]]:
    """One row per frequency and parameter, largest first, and one of the sum."""
    rows = []
    for i, each in enumerate(frequency):
        for part in budget.sorted(order, i):
            rows.append(
                {
                    "frequency": each, "parameter": part.parameter, "value": part.value,
                    "unit": part.unit, "half_width": part.half_width,
                    "standard": part.standard, "resistance": part.impedance.real,
                    "reactance": part.impedance.imag,
                }
            )  # fmt: skip
        total = complex(budget.combined(order)[i])
        rows.append(
            {"frequency": each, "parameter": "combined", "value": None, "unit": None,
             "half_width": None, "standard": None, "resistance": total.real,
             "reactance": total.imag}
        )  # fmt: skip
    return rows


def format_sensitivities(rows: Sequence[dict[str, Any]]) -> str:
    """A text table of ``sensitivity_rows``."""
    lines = [f"{'f Hz':>8s} {'parameter':24s}{'value':>12s} {'unit':5s}{'dR per 1 %':>12s}"
             f"{'dX per 1 %':>12s}{'dR/dp':>12s}{'dX/dp':>12s}"]  # fmt: skip
    lines += [
        f"{row['frequency']:8.1f} {row['parameter']:24s}{row['value']:12.6g} {row['unit']:5s}"
        f"{row['resistance_per_percent']:+12.5f}{row['reactance_per_percent']:+12.5f}"
        f"{row['resistance_per_unit']:+12.4g}{row['reactance_per_unit']:+12.4g}"
        for row in rows
    ]
    return "\n".join(lines)


def format_budget(
    budget: Budget, found: Sensitivities, order: str, rows: Sequence[dict[str, Any]]
) -> str:
    """A text table of ``budget_rows`` with the impedance and its correlation of R and X."""
    lines = [f"{'f Hz':>8s} {'parameter':24s}{'value':>12s}{'half-width':>12s}{'u(p)':>12s} "
             f"{'unit':5s}{'dR':>10s}{'dX':>10s}"]  # fmt: skip
    for row in rows:
        if row["parameter"] != "combined":
            lines.append(
                f"{row['frequency']:8.1f} {row['parameter']:24s}{row['value']:12.6g}"
                f"{row['half_width']:12.3g}{row['standard']:12.3g} {row['unit']:5s}"
                f"{row['resistance']:+10.5f}{row['reactance']:+10.5f}"
            )
            continue
        i = found.found.frequency.tolist().index(row["frequency"])
        nominal = nominal_impedance(found, order)[i]
        together = budget_correlation(budget, order, i)
        lines.append(
            f"{row['frequency']:8.1f} {'combined standard uncertainty':65s}"
            f"{row['resistance']:10.5f}{row['reactance']:10.5f}\n"
            f"{row['frequency']:8.1f} Z = {format_complex(nominal)}, correlation of R and X "
            f"{together:+.2f}"
        )
    return "\n".join(lines)


def budget_correlation(budget: Budget, order: str, frequency_index: int) -> float:
    """Of R and X, -1 to 1; 0 where one of them has no uncertainty."""
    covariance = budget.covariance[order][frequency_index]
    product = float((covariance[0, 0] * covariance[1, 1]).sqrt())
    return float(covariance[0, 1]) / product if product else 0.0


def nominal_impedance(found: Sensitivities, order: str) -> list[complex]:
    """Of the whole liner at each frequency, at the parameters as stated."""
    result = found.found
    value = result.liner_impedance
    if order == "velocity first":
        value = result.liner_impedance_velocity_first
    return [complex(z) for z in value]


@styled
def draw_contributions(
    rows: Sequence[dict[str, Any]], title: str, path: str | Path | None = None
) -> Figure:
    """Bars of the changes of R and X, one pair of panels, largest on top.

    Args:
        rows: of one frequency, from ``budget_rows`` or ``sensitivity_rows``.
        title: of the figure.
        path: where to save it.
    """
    total = next((row for row in rows if row["parameter"] == "combined"), None)
    kept = [row for row in rows if row is not total][::-1]
    end = "" if "resistance" in kept[0] else "_per_percent"
    figure, axes = subplots(1, 2, 1.3 + 0.24 * len(kept))
    places = np.arange(len(kept))
    for axis, part, sign in zip(axes[0], ("resistance", "reactance"), "RX", strict=True):
        values = np.array([row[part + end] for row in kept])
        colours = [COLOURS[0] if value >= 0 else COLOURS[1] for value in values]
        axis.barh(places, 1e3 * np.abs(values), color=colours, height=0.65)
        if total is not None:
            axis.axvline(1e3 * total[part], color="k", linestyle="--", linewidth=0.9)
        axis.set_xlim(left=0)
        axis.set_xlabel(
            rf"$|\Delta {sign}|$ for one $u(p)$, $10^{{-3}}\rho c$" if total is not None
            else rf"$|\Delta {sign}|$ for 1 % of $p$, $10^{{-3}}\rho c$"
        )  # fmt: skip
        axis.set_yticks(
            places,
            [SIGNS.get(row["parameter"], row["parameter"]) for row in kept] if sign == "R" else [],
        )
        axis.tick_params(axis="y", length=0)
    handles = [axes[0, 0].barh([0], [0], color=colour) for colour in COLOURS[:2]]
    labels = ["grows with $p$", "falls with $p$"]
    if total is not None:
        handles.append(axes[0, 0].plot([], [], "k--", linewidth=0.9)[0])
        labels.append("combined")
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    figure.suptitle(title, fontsize=9)
    return finish(figure, path)

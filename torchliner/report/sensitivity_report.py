"""Sensitivities and uncertainty budgets as rows, text and bars."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.report.figure import COLOURS, Figure, finish, place_legend, styled, subplots
from torchliner.report.table import Column, Table, format_complex
from torchliner.studies.budget import correlation_of
from torchliner.studies.rows import Study
from torchliner.studies.sensitivities import Sensitivities

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
SLOPES = (
    Column("frequency", heading="f Hz", text=".1f"),
    Column("parameter", heading="parameter"),
    Column("value", heading="value", text=".6g"),
    Column("unit", heading="unit"),
    Column("resistance_per_unit", "slope.real", "dR/dp", "+.4g"),
    Column("reactance_per_unit", "slope.imag", "dX/dp", "+.4g"),
    Column("resistance_per_percent", "step.real", "dR per 1 %", "+.5f"),
    Column("reactance_per_percent", "step.imag", "dX per 1 %", "+.5f"),
)
COMBINED = "combined"  # the row of the sum
CONTRIBUTIONS = (
    Column("frequency", heading="f Hz", text=".1f"),
    Column("parameter", heading="parameter"),
    Column("value", heading="value", text=".6g"),
    Column("unit", heading="unit"),
    Column("half_width", heading="half-width", text=".3g"),
    Column("standard", heading="u(p)", text=".3g"),
    Column("resistance", "impedance.real", "dR", "+.5f"),
    Column("reactance", "impedance.imag", "dX", "+.5f"),
)


def sensitivity_table(found: Sensitivities, averaging: str) -> Table:
    """One row per frequency and parameter: dZ per SI unit and per 1 %, largest first."""
    slopes, steps = found.liner[averaging], found.per_percent().liner[averaging]
    rows = [
        {
            "frequency": frequency, "parameter": found.parameters[j],
            "value": float(found.values[j]), "unit": found.units[j],
            "slope": complex(slopes[j, i]), "step": complex(steps[j, i]),
        }
        for i, frequency in enumerate(found.found.frequency.tolist())
        for j in steps[:, i].abs().argsort(descending=True).tolist()
    ]  # fmt: skip
    return Table(rows, SLOPES)


def budget_table(budget: Study, frequency: Sequence[float], averaging: str) -> Table:
    """One row per frequency and parameter, largest first, and one of the sum."""
    rows: list[dict[str, Any]] = []
    for i, each in enumerate(frequency):
        rows += budget.of(averaging=averaging, frequency=each)
        nothing = dict.fromkeys(("value", "unit", "half_width", "standard"))
        rows.append({"frequency": each, "parameter": COMBINED, **nothing,
                     "impedance": complex(budget.combined[averaging][i])})  # fmt: skip
    return Table(rows, CONTRIBUTIONS)


def format_budget(budget: Study, found: Sensitivities, averaging: str, table: Table) -> str:
    """``budget_table`` with the impedance and its correlation of R and X."""
    nominal = found.found.liner[averaging].impedance.tolist()
    lines = [
        f"{frequency:.1f} Hz: Z = {format_complex(nominal[i])}, correlation of R and X "
        f"{correlation_of(budget.covariance[averaging][i]):+.2f}; dR, dX: standard uncertainty, "
        "combined and by parameter"
        for i, frequency in enumerate(found.found.frequency.tolist())
    ]
    return "\n".join([table.as_text(), *lines])


@styled
def draw_contributions(rows: Sequence[dict[str, Any]], title: str, path: str | Path | None = None) -> Figure:
    """Bars of the changes of R and X, one pair of panels, largest on top; rows of one frequency, of
    ``budget_table`` or ``sensitivity_table``."""
    total = next((row for row in rows if row["parameter"] == COMBINED), None)
    kept = [row for row in rows if row is not total][::-1]
    end = "" if "resistance" in kept[0] else "_per_percent"
    figure, axes = subplots(1, 2, 1.1 + 0.22 * len(kept), beside=True)
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
        names = [SIGNS.get(row["parameter"], row["parameter"]) for row in kept]
        axis.set_yticks(places, names if sign == "R" else [])
        axis.tick_params(axis="y", length=0)
    handles = [axes[0, 0].barh([0], [0], color=colour) for colour in COLOURS[:2]]
    labels = ["grows with $p$", "falls with $p$"]
    if total is not None:
        handles.append(axes[0, 0].plot([], [], "k--", linewidth=0.9)[0])
        labels.append(COMBINED)
    place_legend(figure, handles, labels, 3)
    return finish(figure, path, title)

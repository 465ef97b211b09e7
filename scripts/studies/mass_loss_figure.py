"""Reactance predicted by laws of lost mass: rows and their picture."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torchliner.report.figure import COLOURS, MARKERS, Figure, finish, styled, subplots

WITHIN = 0.1  # in X, that a law is asked for


@dataclass(frozen=True)
class LossRow:
    """Z of a case by a law that was fitted without it, and the true one."""

    law: str
    case: str
    predicted: complex
    true: complex

    def plain(self) -> dict[str, Any]:
        """For CSV: complex values as two numbers."""
        return {
            "law": self.law,
            "case": self.case,
            "resistance": self.predicted.real,
            "reactance": self.predicted.imag,
            "true_resistance": self.true.real,
            "true_reactance": self.true.imag,
        }

    @classmethod
    def of_plain(cls, row: dict[str, str]) -> LossRow:
        """The row of such a CSV again."""
        parts = [float(row[f"{kind}{part}"]) for kind in ("", "true_") for part in ("resistance", "reactance")]
        return cls(row["law"], row["case"], complex(*parts[:2]), complex(*parts[2:]))


@styled
def draw_mass_loss(rows: Sequence[LossRow], laws: Sequence[str], path: str | Path | None = None) -> Figure:
    """Predicted against true X, the band that is asked for in grey, each case named once."""
    figure, axes = subplots(1, 1, 3.6)
    axis = axes[0, 0]
    ends = [-0.95, 0.0]
    axis.fill_between(
        ends, [e - WITHIN for e in ends], [e + WITHIN for e in ends], color="0.92", label=f"within {WITHIN:g}"
    )
    axis.plot(ends, ends, color="k", linewidth=0.8, label="equal")
    for k, law in enumerate(laws):
        mine = [row for row in rows if row.law == law]
        axis.plot(
            [row.true.imag for row in mine],
            [row.predicted.imag for row in mine],
            MARKERS[k],
            color=COLOURS[k],
            markerfacecolor="white" if k < len(laws) - 1 else COLOURS[k],
            markersize=4.5,
            label=_typeset(law),
        )
    named = sorted((row for row in rows if row.law == laws[-1]), key=lambda row: row.true.imag)
    for i, row in enumerate(named):
        place = (row.true.imag, ends[0] + 0.02 + 0.055 * (i % 3))
        top = max(one.predicted.imag for one in rows if one.case == row.case and one.law in laws)
        axis.plot([row.true.imag] * 2, [place[1] + 0.03, top], color="0.8", linewidth=0.5, zorder=0)
        axis.annotate(
            row.case,
            place,
            fontsize=7,
            ha="center",
            color="0.3",
            bbox={"color": "w", "alpha": 0.7, "linewidth": 0, "pad": 0.5},
        )
    axis.set(xlabel=r"true reactance, $\mathrm{Im}\,Z$", ylabel=r"$\mathrm{Im}\,Z$ of a fit without the case")
    axis.set_xlim(*ends)
    axis.set_ylim(*ends)
    return finish(figure, path, legend=3)


def _typeset(law: str) -> str:
    """Its letters as symbols."""
    return re.sub(r"\\?\|v\\?\||\b[ABkp]\b", lambda found: f"${found[0]}$".replace("\\", ""), law)

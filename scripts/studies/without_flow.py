"""Predictions by a liner calibrated without flow: rows and their picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torchliner.names import AVERAGINGS
from torchliner.report.figure import (
    COLOURS,
    MARKERS,
    PARTS,
    Figure,
    finish,
    plain_log_ticks,
    styled,
    subplots,
)
from torchliner.report.numbers import part_of


@dataclass(frozen=True)
class PredictedRow:
    """One case, height (m) and averaging: Z of the preset, of the calibrated liner, and the reference.

    ``model`` names the fit, ``fitted`` says that the case is among those it was made from;
    ``level_check`` (dB) is that of the calibrated liner.
    """

    model: str
    case: str
    fitted: bool
    height: float
    averaging: str
    before: complex
    after: complex
    true: complex
    level_check: float

    def plain(self) -> dict[str, Any]:
        """For CSV: complex values as two numbers."""
        row: dict[str, Any] = {"model": self.model, "case": self.case, "averaging": self.averaging,
                               "fitted": int(self.fitted), "height": self.height,
                               "level_check": self.level_check}  # fmt: skip
        for name in ("before", "after", "true"):
            value = getattr(self, name)
            row[f"{name}_resistance"], row[f"{name}_reactance"] = value.real, value.imag
        return row

    @classmethod
    def of_plain(cls, row: dict[str, str]) -> PredictedRow:
        """The row of such a CSV again."""
        before, after, true = (
            complex(float(row[f"{name}_resistance"]), float(row[f"{name}_reactance"]))
            for name in ("before", "after", "true")
        )
        return cls(row["model"], row["case"], row["fitted"] == "1", float(row["height"]),
                   row["averaging"], before, after, true, float(row["level_check"]))  # fmt: skip


@styled
def draw_without_flow(rows: Sequence[PredictedRow], path: str | Path | None = None) -> Figure:
    """R and X by case: the reference as a bar, a column an averaging, its heights from left to right."""
    cases = list(dict.fromkeys(row.case for row in rows))
    figure, axes = subplots(1, 2, 3.4)
    for axis, (part, label) in zip(axes[0], PARTS, strict=True):
        for i, case in enumerate(cases):
            mine = [row for row in rows if row.case == case]
            axis.hlines(part_of(mine[0].true, part), i - 0.4, i + 0.4, color="k", linewidth=1.6)
            if mine[0].fitted:
                axis.axvspan(i - 0.5, i + 0.5, color="0.93", zorder=0)
            for k, averaging in enumerate(AVERAGINGS):
                shown = sorted((row for row in mine if row.averaging == averaging), key=lambda r: r.height)
                places = [i + 0.27 * (k - 1) + 0.05 * j for j in range(len(shown))]
                axis.plot(places, [part_of(row.after, part) for row in shown], MARKERS[k] + "-",
                          color=COLOURS[k], markersize=3.6, linewidth=0.7,
                          markerfacecolor="white")  # fmt: skip
        axis.set_xticks(range(len(cases)), cases, rotation=40, ha="right")
        axis.set_ylabel(label)
    axes[0, 0].set_yscale("log")
    plain_log_ticks(axes[0, 0].yaxis)
    first = axes[0, 0]
    for k, averaging in enumerate(AVERAGINGS):
        first.plot([], [], MARKERS[k] + "-", color=COLOURS[k], markerfacecolor="white", label=averaging)
    first.plot([], [], color="k", linewidth=1.6, label="reference")
    first.fill_between([], [], color="0.93", label="fitted")
    return finish(
        figure, path, "contraction coefficient fitted without flow; heights rise to the right, 1400 Hz",
        legend=5,
    )  # fmt: skip

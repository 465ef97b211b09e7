"""The picture of predictions by a liner calibrated without flow."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from torchliner.names import AVERAGINGS
from torchliner.report.figure import (
    COLOURS,
    MARKERS,
    PARTS,
    Figure,
    finish,
    styled,
    subplots,
)
from torchliner.report.numbers import part_of
from torchliner.studies.rows import Row


@styled
def draw_without_flow(rows: Sequence[Row], path: str | Path | None = None) -> Figure:
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
                axis.plot(
                    places,
                    [part_of(row.after, part) for row in shown],
                    MARKERS[k] + "-",
                    color=COLOURS[k],
                    markersize=3.6,
                    linewidth=0.7,
                    markerfacecolor="white",
                )
        axis.set_xticks(range(len(cases)), cases, rotation=40, ha="right")
        axis.set_ylabel(label)
    axes[0, 0].set_yscale("log")
    axes[0, 0].yaxis.set_major_formatter("{x:g}")
    first = axes[0, 0]
    for k, averaging in enumerate(AVERAGINGS):
        first.plot([], [], MARKERS[k] + "-", color=COLOURS[k], markerfacecolor="white", label=averaging)
    first.plot([], [], color="k", linewidth=1.6, label="reference")
    first.fill_between([], [], color="0.93", label="fitted")
    return finish(
        figure,
        path,
        "contraction coefficient fitted without flow; heights rise to the right, 1400 Hz",
        legend=5,
    )

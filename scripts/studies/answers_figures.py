"""Pictures of the answers: educed against reference, and the rms that acts against height."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from torchliner.report.figure import (
    COLOURS,
    MARKERS,
    PARTS,
    Figure,
    finish,
    styled,
    subplots,
)

LIMIT, LOWEST = 0.3, 6e-4  # dB; m: the parity shows planes up to this height
KINDS = {"n": "slit", "g": "slit with flow", "o": "orifice", "t": "orifice, coarser lattice"}


def kind_of(row: dict[str, Any]) -> str:
    """Of a case, by letter and flow."""
    if row["case"][0] in "tq":
        return "orifice with flow" if row["mach"] else "orifice"
    return KINDS[row["case"][0]]


@styled
def draw_parity(rows: Sequence[dict[str, Any]], path: str | Path | None = None) -> Figure:
    """R and X against the reference at 0.5 mm: preset as crosses; calibrated without flow, with the run without sound
    where there is one, as symbols, filled where the level check passes."""
    figure, axes = subplots(1, 2, 3.0)
    shown = [row for row in rows if row["height"] <= LOWEST]
    kinds = list(dict.fromkeys(map(kind_of, shown)))
    for axis, (part, label) in zip(axes[0], PARTS, strict=True):
        sign = 1 if part == "resistance" else -1
        ends = [0.07, 4.0] if part == "resistance" else [0.0, 0.95]
        axis.plot(ends, ends, color="k", linewidth=0.8)
        if part == "resistance":
            axis.fill_between(ends, [0.85 * e for e in ends], [1.15 * e for e in ends], color="0.9", zorder=0)
        else:
            axis.fill_between(ends, [e - 0.1 for e in ends], [e + 0.1 for e in ends], color="0.9", zorder=0)
        for row in shown:
            k, true = kinds.index(kind_of(row)), sign * row[f"true_{part}"]
            best = row[f"background_{part}"]
            best = row[f"calibrated_{part}"] if math.isnan(best) else best
            axis.plot(true, sign * row[f"preset_{part}"], "x", color="0.6", markersize=3.5, zorder=1)
            passes = abs(row["level_check"]) <= LIMIT
            axis.plot(
                true,
                sign * best,
                MARKERS[k],
                color=COLOURS[k],
                markersize=4.5,
                markerfacecolor=COLOURS[k] if passes else "white",
            )
        name = label if sign > 0 else f"−{label}"
        axis.set(xlabel=f"reference {name}", ylabel=f"educed {name}")
        if part == "resistance":
            axis.set_xscale("log")
            axis.set_yscale("log")
            axis.xaxis.set_major_formatter("{x:g}")
            axis.yaxis.set_major_formatter("{x:g}")
        axis.set_xlim(*ends)
        axis.set_ylim(*ends)
    first = axes[0, 0]
    first.plot([], [], "x", color="0.6", markersize=3.5, label="preset")
    for k, kind in enumerate(kinds):
        first.plot([], [], MARKERS[k], color=COLOURS[k], markersize=4.5, label=kind)
    return finish(figure, path, legend=3)


@styled
def draw_background(rows: Sequence[dict[str, Any]], path: str | Path | None = None) -> Figure:
    """rms that gives the reference R (symbols), of the record (thin) and without sound (thick), over M, by height."""
    figure, axes = subplots(1, 1, 3.2)
    axis = axes[0, 0]
    for k, case in enumerate(dict.fromkeys(row["case"].removesuffix("h") for row in rows)):
        mine = sorted((row for row in rows if row["case"].removesuffix("h") == case), key=lambda row: row["diameters"])
        at = [row["diameters"] for row in mine]
        axis.plot(
            at, [row["needed"] / row["mach"] for row in mine], MARKERS[k], color=COLOURS[k], markersize=4.5, label=case
        )
        axis.plot(at, [row["own"] / row["mach"] for row in mine], ":", color=COLOURS[k], linewidth=0.9)
        quiet = [(row["diameters"], row["quiet"] / row["mach"]) for row in mine if not math.isnan(row["quiet"])]
        axis.plot(*zip(*quiet, strict=True), "-", color=COLOURS[k], linewidth=1.4)
    axis.axvline(0.5, color="0.8", linewidth=0.8, zorder=0)
    axis.set_ylim(0, 22)
    axis.set(xlabel="height over hole diameter", ylabel="rms over Mach number (m/s)")
    return finish(figure, path, legend=3)

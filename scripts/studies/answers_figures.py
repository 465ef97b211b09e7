"""Pictures of the answers: educed against reference, and the rms that acts against height."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.report.figure import COLOURS, MARKERS, PARTS, Figure, entry, finish, part_of, styled, subplots
from torchliner.studies.variants import Row

LIMIT, LOWEST = 0.3, 6e-4  # dB; m: the parity shows planes up to this height
KINDS = {"n": "slit", "g": "slit with flow", "o": "orifice", "t": "orifice, coarser lattice"}


def kind_of(row: dict[str, Any]) -> str:
    """Of a case, by letter and flow."""
    if row["case"][0] in "tq":
        return "orifice with flow" if row["mach"] else "orifice"
    return KINDS[row["case"][0]]


@styled
def draw_parity(rows: Sequence[Row], path: Path) -> Figure:
    """R and X against the reference at 0.5 mm: preset as crosses; calibrated without flow, with the run without sound
    where there is one, as symbols, filled where the level check passes."""
    figure, axes = subplots(1, 2, 3.0)
    shown = [row for row in rows if row.height <= LOWEST]
    kinds = list(dict.fromkeys(map(kind_of, shown)))
    for axis, (part, label) in zip(axes[0], PARTS, strict=True):
        resistance = part == "resistance"
        sign, ends = (1, [0.07, 4.0]) if resistance else (-1, [0.0, 0.95])
        beside = np.array(ends)
        low, high = (0.85 * beside, 1.15 * beside) if resistance else (beside - 0.1, beside + 0.1)
        axis.plot(ends, ends, color="k", linewidth=0.8)
        axis.fill_between(ends, low, high, color="0.9", zorder=0)
        for row in shown:
            k, true = kinds.index(kind_of(row)), sign * part_of(row.true, part)
            best = row.background if row.background == row.background else row.calibrated
            style: Any = {"color": COLOURS[k], "markersize": 4.5}
            style["markerfacecolor"] = COLOURS[k] if abs(row.level_check) <= LIMIT else "white"
            axis.plot(true, sign * part_of(row.preset, part), "x", color="0.6", markersize=3.5, zorder=1)
            axis.plot(true, sign * part_of(best, part), MARKERS[k], **style)
        name = label if sign > 0 else f"−{label}"
        axis.set(xlabel=f"reference {name}", ylabel=f"educed {name}")
        if resistance:
            axis.set(xscale="log", yscale="log")
            axis.xaxis.set_major_formatter("{x:g}")
            axis.yaxis.set_major_formatter("{x:g}")
        axis.set(xlim=ends, ylim=ends)
    entry(axes[0, 0], "preset", "x", color="0.6", markersize=3.5)
    for k, kind in enumerate(kinds):
        entry(axes[0, 0], kind, MARKERS[k], color=COLOURS[k], markersize=4.5)
    return finish(figure, path, legend=3)


@styled
def draw_background(rows: Sequence[dict[str, Any]], path: Path) -> Figure:
    """rms that gives the reference R (symbols), of the record (thin) and without sound (thick), over M, by height."""
    figure, axes = subplots(1, 1, 3.2)
    axis = axes[0, 0]
    for k, case in enumerate(dict.fromkeys(row["case"].removesuffix("h") for row in rows)):
        mine = sorted((row for row in rows if row["case"].removesuffix("h") == case), key=lambda row: row["diameters"])
        for name, line, style in (
            ("needed", MARKERS[k], {"markersize": 4.5, "label": case}),
            ("own", ":", {"linewidth": 0.9}),
            ("quiet", "-", {"linewidth": 1.4}),
        ):
            at = [(row["diameters"], row[name] / row["mach"]) for row in mine if not math.isnan(row[name])]
            axis.plot(*zip(*at, strict=True), line, color=COLOURS[k], **style)
    axis.axvline(0.5, color="0.8", linewidth=0.8, zorder=0)
    axis.set(xlabel="height over hole diameter", ylabel="rms over Mach number (m/s)", ylim=(0, 22))
    return finish(figure, path, legend=3)

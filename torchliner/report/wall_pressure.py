"""Impedances educed from wall pressures: the methods and the figure behind ``torchliner kt``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.records import MicrophoneLine
from torchliner.report.figure import (
    COLOURS,
    MARKERS,
    PARTS,
    SPL,
    Figure,
    draw_band,
    entry,
    finish,
    impedance_panels,
    label_axes,
    styled,
)
from torchliner.report.numbers import part_of
from torchliner.report.wall_table import LEVEL, Educed

FAR = 8.0  # interquartile ranges: 11 standard deviations of normal draws
TINY = 1e-9


@styled
def draw_wall(
    lines: Sequence[MicrophoneLine], found: Sequence[Educed], path: str | Path | None = None
) -> Figure:
    """One frequency: Z with its draws, and the levels with the range of the draws (figure 14).
    Several: R and X over frequency with 95 % of the draws."""
    figure, panels = impedance_panels(3.2, "$f$ (kHz)")
    single = all(len(one.frequency) == 1 for one in found)
    (left, _), (right, _) = panels
    for i, (line, one) in enumerate(zip(lines, found, strict=True)):
        label = f"{line.title or Path(line.name).stem}, source {one.source_side}"
        colour, marker = COLOURS[i], MARKERS[i]
        if single:
            draw_cloud(left, one, colour, marker, label)
            draw_levels(right, line, one, colour, marker)
        else:
            for axis, part in panels:
                _draw_spectrum(axis, one, part, colour, marker, label)
    if single:
        entry(left, "measured level", "o", markerfacecolor="none")
        entry(left, "fitted level, range of the draws")
        label_axes(left, PARTS[0][1], PARTS[1][1])
        label_axes(right, "$x$ (mm)", SPL)
    hertz = f", {float(found[0].frequency[0]):g} Hz" if single else ""
    return finish(figure, path, f"{found[0].method}{hertz}", legend=2)


def draw_cloud(axis: Any, one: Educed, colour: str, marker: str, label: str) -> None:
    """Impedances of the draws in their plane, and the one without errors (figure 14a).

    Draws far outside the cloud are not drawn, since one would set the axes; the label counts them.
    """
    value = complex(one.impedance[0])
    if one.draws is not None:
        drawn = one.draws.impedance[:, 0].numpy()
        drawn = drawn[np.isfinite(drawn)]
        shown = near_cloud(drawn)
        axis.plot(drawn[shown].real, drawn[shown].imag, ".", color=colour, markersize=1.5,
                  alpha=0.4)  # fmt: skip
        if not shown.all():
            label += f" ({int((~shown).sum())} of {len(drawn)} draws outside)"
    axis.plot(value.real, value.imag, marker, color=colour, markeredgecolor="k", label=label,
              markersize=6)  # fmt: skip


def near_cloud(values: np.ndarray) -> np.ndarray:
    """Which of complex values (D,) lie within ``FAR`` times the middle half of R and of X."""
    parts = np.stack([values.real, values.imag])
    low, middle, high = np.quantile(parts, (0.25, 0.5, 0.75), axis=1)[..., None]
    near: np.ndarray = (np.abs(parts - middle) <= FAR * np.maximum(high - low, TINY)).all(0)
    return near


def draw_levels(axis: Any, line: MicrophoneLine, one: Educed, colour: str, marker: str) -> None:
    """Measured and fitted SPL; the shade is the range over the draws (figure 14b)."""
    x, level = one.level_along()
    if one.draws is not None:
        drawn = one.draws.level_along()[1][..., 0].numpy()
        low, high = np.nanmin(drawn, 0), np.nanmax(drawn, 0)
        draw_band(axis, 1e3 * x.numpy(), low, high, colour, 0.25)
    axis.plot(1e3 * x.numpy(), level[:, 0].numpy(), color=colour)
    axis.plot(1e3 * line.x.numpy(), line.level[:, 0].numpy(), marker, color=colour,
              markerfacecolor="none")  # fmt: skip


def _draw_spectrum(axis: Any, one: Educed, part: str, colour: str, marker: str, label: str) -> None:
    at = one.frequency.numpy() / 1e3
    if one.draws is not None:
        low, high = (part_of(end, part) for end in one.interval(LEVEL))
        draw_band(axis, at, low, high, colour, 0.25)
    axis.plot(at, part_of(one.impedance, part), marker + "-", color=colour, label=label,
              markersize=3)  # fmt: skip

"""Impedances educed from wall pressures: the methods and the figure behind ``torchliner kt``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.records import MicrophoneLine
from torchliner.report.curves import COMPLEX_PART
from torchliner.report.figure import COLOURS, MARKERS, PARTS, Figure, finish, styled, subplots
from torchliner.report.wall_table import LEVEL, Educed


@styled
def draw_wall(
    lines: Sequence[MicrophoneLine],
    found: Sequence[Educed],
    path: str | Path | None = None,
) -> Figure:
    """One frequency: Z with its draws, and the levels with the range of the draws (figure 14).
    Several: R and X over frequency with 95 % of the draws."""
    figure, axes = subplots(1, 2, 3.2)
    single = all(len(one.frequency) == 1 for one in found)
    for i, (line, one) in enumerate(zip(lines, found, strict=True)):
        label = f"{line.title or Path(line.name).stem}, source {one.source_side}"
        colour, marker = COLOURS[i % len(COLOURS)], MARKERS[i % len(MARKERS)]
        if single:
            draw_cloud(axes[0, 0], one, colour, marker, label)
            draw_levels(axes[0, 1], line, one, colour, marker)
        else:
            for axis, (part, _) in zip(axes[0], PARTS, strict=True):
                _draw_spectrum(axis, one, COMPLEX_PART[part], colour, marker, label)
    if single:
        labels = ((PARTS[0][1], PARTS[1][1]), ("$x$ (mm)", "SPL (dB)"))
    else:
        labels = tuple(("$f$ (kHz)", label) for _, label in PARTS)  # type: ignore[assignment]
    for axis, (across, up) in zip(axes[0], labels, strict=True):
        axis.set_xlabel(across)
        axis.set_ylabel(up)
    handles, names = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=min(2, len(names)))
    hertz = f", {float(found[0].frequency[0]):g} Hz" if single else ""
    figure.suptitle(f"{found[0].method}{hertz}", fontsize=9)
    return finish(figure, path)


def draw_cloud(axis: Any, one: Educed, colour: str, marker: str, label: str) -> None:
    """Impedances of the draws in their plane, and the one without errors (figure 14a)."""
    if one.draws is not None:
        drawn = one.draws.impedance[:, 0].numpy()
        axis.plot(drawn.real, drawn.imag, ".", color=colour, markersize=1.5, alpha=0.4)
    value = complex(one.impedance[0])
    axis.plot(value.real, value.imag, marker, color=colour, markeredgecolor="k", label=label,
              markersize=6)  # fmt: skip


def draw_levels(axis: Any, line: MicrophoneLine, one: Educed, colour: str, marker: str) -> None:
    """Measured and fitted SPL; the shade is the range over the draws (figure 14b)."""
    x, level = one.level_along()
    if one.draws is not None:
        drawn = one.draws.level_along()[1][..., 0].numpy()
        axis.fill_between(1e3 * x.numpy(), np.nanmin(drawn, 0), np.nanmax(drawn, 0),
                          color=colour, alpha=0.25, linewidth=0)  # fmt: skip
    axis.plot(1e3 * x.numpy(), level[:, 0].numpy(), color=colour)
    axis.plot(1e3 * line.x.numpy(), line.level[:, 0].numpy(), marker, color=colour,
              markerfacecolor="none")  # fmt: skip


def _draw_spectrum(axis: Any, one: Educed, part: str, colour: str, marker: str, label: str) -> None:
    at = one.frequency.numpy() / 1e3
    if one.draws is not None:
        low, high = (getattr(end, part).numpy() for end in one.interval(LEVEL))
        axis.fill_between(at, low, high, color=colour, alpha=0.25, linewidth=0)
    axis.plot(at, getattr(one.impedance, part).numpy(), marker + "-", color=colour, label=label,
              markersize=3)  # fmt: skip

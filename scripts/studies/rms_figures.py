"""Rms velocities along x at several heights, case by case (figure 16)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.records import VelocityPlane
from torchliner.report.figure import (
    COLOURS,
    U_RMS,
    V_RMS,
    Figure,
    draw_curve,
    finish,
    head_panel,
    styled,
    subplots,
)
from torchliner.report.numbers import velocity_along_x


@styled
def draw_rms_along_x(
    cases: Sequence[tuple[str, Sequence[VelocityPlane], float | None]],
    path: str | Path | None = None,
) -> Figure:
    """v'_rms and u'_rms along x at all heights, a column a case; cells marked (figure 16).

    Args:
        cases: title, planes and cell pitch (m; None where there are no cells).
        path: picture to write, or None. Colours go by the heights of the first case.
    """
    figure, axes = subplots(2, len(cases), 4.4)
    heights = np.array(sorted(plane.height or 0.0 for plane in cases[0][1]))
    for column, (title, planes, pitch) in enumerate(cases):
        for plane in sorted(planes, key=lambda plane: plane.height or 0.0):
            profile = velocity_along_x(plane)
            colour = COLOURS[int(np.abs(heights - (plane.height or 0.0)).argmin())]
            for axis, part in zip(axes[:, column], "vu", strict=True):
                if f"{part}' rms (m/s)" in profile.values:
                    draw_curve(axis, profile, f"{part}' rms (m/s)", colour, 1e3)
        _finish_column(axes[:, column], planes[0], pitch)
        head_panel(axes[0, column], title)
    for axis, part in zip(axes[:, 0], (V_RMS, U_RMS), strict=True):
        axis.set_ylabel(f"{part} (m s$^{{-1}}$)")
    return finish(figure, path, legend=len(heights))


def _finish_column(axes: Any, plane: VelocityPlane, pitch: float | None) -> None:
    last = float(plane.x[-1])
    for axis in axes:
        for k in range(0 if pitch is None else int(last / (pitch or 1.0) + 1.5)):
            axis.axvline(
                1e3 * k * (pitch or 0.0), color="0.7", linewidth=0.6, linestyle="--", zorder=0
            )
        tops = [float(np.max(line.get_ydata())) for line in axis.get_lines()]
        axis.set_ylim(0, 1.1 * max(tops, default=1.0))
        axis.set_xlim(0, 1e3 * last)
    axes[1].set_xlabel("$x$ (mm)")

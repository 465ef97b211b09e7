"""Pictures along walls: levels and phases of sound in ducts; impedances of microphones and of stations."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.records import ImpedanceLine
from torchliner.report import figure as look
from torchliner.report.table import Row

LEVEL = 0.95  # of the intervals
WIDTHS_OF_SEGMENTS = 3.0  # standard deviations over the segments in the paper's coloured areas
FINE = 400  # points of a picture along the duct


def level_and_phase(pressure: Any, near: Any = None) -> tuple[Any, Any]:
    """SPL (dB) and phase (degrees) of complex pressures: unwrapped, or within half a turn of ``near``."""
    p = np.asarray(pressure)
    phase = np.unwrap(np.degrees(np.angle(p)), period=360.0)
    if near is not None:
        phase += 360.0 * np.round((near - phase) / 360.0)
    return spl_from_pressure_amplitude(torch.as_tensor(p)).numpy(), phase


@look.styled
def draw_pressures(
    waves: Sequence[tuple[str, Any, Any, Any]],
    path: str | Path | None = None,
    title: str = "",
    *,
    liner: Sequence[tuple[float, float]] = (),
    markers: str = "",
) -> look.Figure:
    """SPL and phase along the wall of the microphones (figures 13, 18).

    ``waves`` have a name, a curve (x in m, p in Pa) or None, and places and pressures of the microphones, which are
    open markers, called ``markers`` in the legend; ``liner``: ends of patches, m, in grey.
    """
    figure, axes = look.panels_of(2, 3.2)
    for axis, label in zip(axes, (look.SPL, "phase (degrees)"), strict=True):
        for start, end in liner:
            axis.axvspan(1e3 * start, 1e3 * end, color="0.9", zorder=0, label="liner")
        axis.set(xlabel=look.X_MM, ylabel=label)
    for i, (label, curve, at, pressure) in enumerate(waves):
        x, p = (at, pressure) if curve is None else curve
        lines = level_and_phase(p)
        points = level_and_phase(pressure, np.interp(at, x, lines[1]))
        style = look.dots(look.COLOURS[i], look.MARKERS[i], "", markerfacecolor="none")
        for axis, line, values in zip(axes, lines, points, strict=True):
            axis.plot(1e3 * np.asarray(x), line, **look.colour_of(i, label))
            axis.plot(1e3 * np.asarray(at), values, **style)
    if markers:
        look.entry(axes[0], markers, "o", markerfacecolor="none")
    return look.finish(figure, path, title, 3)


def draw_lines(
    lines: ImpedanceLine | Sequence[ImpedanceLine],
    path: str | Path | None = None,
    frequency_index: int | None = 0,
    labels: Sequence[str] | None = None,
    axes: Any = None,
) -> look.Figure:
    """Resistance and reactance along the line (figures 10, 11). Area: three standard deviations over the segments, as
    in the paper; dark band: the statistical interval of the mean; crosses: stations that do not count in averages."""
    lines, f = [lines] if isinstance(lines, ImpedanceLine) else lines, frequency_index or 0
    before, drawn, known = look.runs_in(axes), list[Row](), bool(torch.isfinite(lines[0].x).all())
    for i, line in enumerate(lines, before):
        x = 1e3 * line.x if known else torch.arange(1.0, len(line.x) + 1)
        z, out = line.impedance[:, f], ~line.used
        wide, name = WIDTHS_OF_SEGMENTS * line.segment_spread[:, f], line.title or f"line {i + 1}"
        style = look.colour_of(i, labels[i - before] if labels else name, marker=look.MARKERS[i], markersize=2.5)
        drawn.append({"x": x, "y": z, "ends": (z - wide, z + wide)} | style)
        if line.interval is not None:
            ends = line.interval.low[:, f], line.interval.high[:, f]
            drawn.append({"x": x, "y": z, "ends": ends, "color": look.COLOURS[i]})
        drawn.append({"x": x[out], "y": z[out]} | look.dots("k", "x", "not in averages" if out.any() else ""))

    def more(axis: Any, part: str) -> None:
        if before or part == "reactance":
            return
        look.entry(axis, "3 standard deviations over segments", color="0.85", **look.BAND)
        if lines[0].interval is not None:
            words = f"{100 * float(lines[0].choices['interval']):g} % interval"
            look.entry(axis, words, color="0.6", **look.BAND)

    about = {"more": more, "poles": None, "height": 3.5, "legend": 3, "axes": axes, "runs": len(lines)}
    caption = f"{lines[0].title} {float(lines[0].frequency[f]):g} Hz"
    return look.draw_parts(drawn, look.X_MM if known else "station", path, caption, **about)

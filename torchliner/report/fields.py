"""Pictures of sound in ducts: levels and phases along a wall, fields; impedances educed from microphones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.report import figure as look

LEVEL = 0.95  # of the intervals
FINE, ACROSS = 400, 60  # points of a picture along and across the duct
NEAR_WALL = 0.05  # of the height


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

    Args:
        waves: of each its name, a curve (x in m, p in Pa) or None, and the places and pressures of the microphones,
            which are open markers.
        title: caption.
        liner: ends of patches, m, in grey.
        markers: what they are, in the legend.
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


def draw_along(found: Sequence[Any], there: Sequence[tuple[int, int]], labels: Sequence[str], path: Any) -> look.Figure:
    """Pressures measured and fitted; ``there``: numbers of the eductions that are drawn, and of a frequency of each."""
    waves = []
    for i, f in there:
        line, (places, fitted) = found[i].source_line, found[i].fitted_along()
        waves.append((labels[i], (places, fitted[:, f]), line.x, line.pressure[:, f]))
    return draw_pressures(waves, path, "measured and fitted pressures along the wall", markers="measured")


def draw_line(line: Any, at: Sequence[int], liner: Any, path: Any) -> look.Figure:
    """Pressures at the microphones of a line, at some of its frequencies; ``liner``: ends of patches, m."""
    waves = [(f"{float(line.frequency[f]):g} Hz", None, line.x, line.pressure[:, f]) for f in dict.fromkeys(at)]
    return draw_pressures(waves, path, look.plain_label(line.title or line.name), liner=liner)


@look.styled
def draw_field(setup: Any, field: Any, path: str | Path | None = None, frequency_index: int = 0) -> look.Figure:
    """SPL and wall-normal velocity in the duct; colours end at 99.5 % of the values off the wall, since vorticity on
    the liner would hide the rest."""
    figure, axes = look.subplots(2, 1, 3.8)
    case = setup.case
    x, y = np.meshgrid(np.linspace(case.start, case.end, FINE), np.linspace(0, case.height, ACROSS))
    p, _, v = (part[frequency_index].detach().reshape(x.shape) for part in field.at(x.ravel(), y.ravel()))
    values = spl_from_pressure_amplitude(p).numpy(), v.abs().numpy()
    for axis, each, label in zip(axes[:, 0], values, (look.SPL, "$|v|$ (m s$^{-1}$)"), strict=True):
        top = np.percentile(each[y > NEAR_WALL * case.height], 99.5)
        colours: Any = {"cmap": "cividis", "shading": "gouraud", "rasterized": True, "vmin": each.min(), "vmax": top}
        figure.colorbar(axis.pcolormesh(1e3 * x, 1e3 * y, each, **colours), ax=axis, label=label, extend="max")
        for start, end in case.liner:
            axis.plot([1e3 * start, 1e3 * end], [0, 0], color=look.COLOURS[1], lw=3, clip_on=False, label="liner")
        axis.set(xlabel=look.X_MM, ylabel=look.Y_MM)
    words = f"{setup.name}, {float(setup.frequency[frequency_index]):g} Hz, source {field.source}"
    return look.finish(figure, path, words, 1)


def draw_spectra(
    found: Sequence[Any], labels: Sequence[str], rows: Sequence[look.Rows], path: str | Path | None = None
) -> look.Figure:
    """R and X over frequency of eductions from microphones, with their 95 % intervals; ``rows``: of each eduction."""
    drawn = []
    for i, (label, mine) in enumerate(zip(labels, rows, strict=True)):
        style = look.colour_of(i, label, marker=look.MARKERS[i], markersize=3)
        drawn.append(look.curve_of(mine, "frequency", bars=len(mine) == 1, **style))
    words = f"{found[0].method}; {'bars' if len(rows[0]) == 1 else 'shaded'}: 95 % intervals"
    return look.draw_parts(drawn, look.KHZ, path, words, poles=True, legend=2, height=3.2)

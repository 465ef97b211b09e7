"""Pictures of sound in ducts: levels and phases along a wall, fields, modes; impedances educed from microphones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.report import figure as look
from torchliner.report.numbers import Curves, part_of
from torchliner.report.planes import AXES, draw_cloud

LEVEL = 0.95  # of the intervals
FINE, ACROSS = 400, 60  # points of a picture along and across the duct
NEAR_WALL = 0.05  # of the height


def _wall_panels(liner: Sequence[tuple[float, float]] = ()) -> tuple[look.Figure, Any]:
    """SPL beside phase along a wall, the liner in grey."""
    figure, axes = look.panels_of(2, 3.2)
    for axis, label in zip(axes, (look.SPL, "phase (degrees)"), strict=True):
        for start, end in liner:
            axis.axvspan(1e3 * start, 1e3 * end, color="0.9", zorder=0, label="liner")
        axis.set(xlabel=look.X_MM, ylabel=label)
    return figure, axes


def level_and_phase(pressure: Any, near: Any = None) -> tuple[Any, Any]:
    """SPL (dB) and phase (degrees) of complex pressures: unwrapped, or within half a turn of ``near``."""
    p = np.asarray(pressure)
    phase = np.unwrap(np.degrees(np.angle(p)), period=360.0)
    if near is not None:
        phase += 360.0 * np.round((near - phase) / 360.0)
    return spl_from_pressure_amplitude(torch.as_tensor(p)).numpy(), phase


def _draw_pressures(axes: Any, i: int, label: str, curve: Any, at: Any, pressure: Any) -> None:
    """A ``curve`` (x, p) along x, m, and pressures ``at`` places as open markers; without a curve these alone."""
    x, p = (at, pressure) if curve is None else curve
    lines = level_and_phase(p)
    points = level_and_phase(pressure, np.interp(at, x, lines[1]))
    dots: Any = {"marker": look.MARKERS[i], "markerfacecolor": "none", "linestyle": "none", "color": look.COLOURS[i]}
    for axis, line, values in zip(axes, lines, points, strict=True):
        axis.plot(1e3 * np.asarray(x), line, **look.colour_of(i, label))
        axis.plot(1e3 * np.asarray(at), values, **dots)


@look.styled
def draw_walls(
    solved: Sequence[tuple[Any, Any]],
    path: str | Path | None = None,
    frequency_index: int = 0,
    labels: Sequence[str] | None = None,
    title: str | None = None,
) -> look.Figure:
    """SPL and phase along the wall of the microphones (figures 13, 18) of pairs of setup and solved field."""
    setup = solved[0][0]
    figure, axes = _wall_panels(setup.case.liner)
    for i, (each, field) in enumerate(solved):
        label = labels[i] if labels else f"{each.name}, source {field.source}"
        places, at = np.linspace(each.case.start, each.case.end, FINE), np.asarray(each.places)
        curve, points = (field.wall_pressure(x, each.wall)[frequency_index].detach() for x in (places, at))
        _draw_pressures(axes, i, label, (places, curve), at, points)
    look.entry(axes[0], "at the microphones", "o", markerfacecolor="none")
    title = title or f"{setup.wall} wall, {float(setup.frequency[frequency_index]):g} Hz"
    return look.finish(figure, path, title, 3)


@look.styled
def draw_line(line: Any, at: Sequence[int], liner: Any = (), path: str | Path | None = None) -> look.Figure:
    """SPL and phase at the microphones of a line, at some of its frequencies; ``liner``: ends of patches, m."""
    figure, axes = _wall_panels(liner)
    for i, f in enumerate(dict.fromkeys(at)):
        _draw_pressures(axes, i, f"{float(line.frequency[f]):g} Hz", None, line.x, line.pressure[:, f])
    return look.finish(figure, path, look.plain_label(line.title or line.name), 3)


@look.styled
def draw_along(
    found: Sequence[Any], there: Sequence[tuple[int, int]], labels: Sequence[str], path: str | Path | None = None
) -> look.Figure:
    """SPL and phase along the wall, measured and fitted.

    Args:
        found: eductions.  there: numbers of those that are drawn, and of a frequency of each.
        labels: of all eductions.
    """
    figure, axes = _wall_panels()
    for i, f in there:
        line, (places, fitted) = found[i].source_line, found[i].fitted_along()
        _draw_pressures(axes, i, labels[i], (places, fitted[:, f]), line.x, line.pressure[:, f])
    look.entry(axes[0], "measured", "o", markerfacecolor="none")
    return look.finish(figure, path, "measured and fitted pressures along the wall", 3)


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


@look.styled
def draw_modes(modes: dict[str, Any], path: str | Path | None = None, frequency_index: int = 0) -> look.Figure:
    """|p| of each mode over the height."""
    figure, axes = look.panels_of(2, 3.4)
    for axis, (direction, solved) in zip(axes, modes.items(), strict=True):
        heights = np.linspace(0, float(solved.height[0]), 200)
        for n, shape in enumerate(solved.at(heights)[0][frequency_index].abs().numpy()):
            axis.plot(shape / shape.max(), 1e3 * heights, **look.colour_of(n, f"mode {n}"))
        axis.set(xlabel="$|p|$ over its maximum", ylabel="$y$ (mm), liner at 0", title=direction)
    return look.finish(figure, path, legend=6)


def draw_levels(axis: Any, line: Any, one: Any, colour: str, marker: str, f: int = 0) -> None:
    """Measured and fitted SPL; the shade is the range over the draws (figure 14b)."""
    x, level = one.level_along()
    drawn = None if one.draws is None else one.draws.level_along()[1][..., f].numpy()
    bounds = None if drawn is None else (np.nanmin(drawn, 0), np.nanmax(drawn, 0))
    look.draw_values(axis, 1e3 * x, level[:, f], bounds, color=colour)
    axis.plot(1e3 * line.x, line.level[:, f], marker, color=colour, markerfacecolor="none", linestyle="none")


@look.styled
def draw_wall(found: Sequence[Any], labels: Sequence[str], path: str | Path | None = None) -> look.Figure:
    """Of eductions from microphones at one frequency: Z with its draws, and the levels with the range of the draws
    (figure 14). Of several: R and X over frequency."""
    if any(len(one.frequency) > 1 for one in found):
        return draw_spectra(found, labels, path)
    figure, (left, right) = look.panels_of(2, 3.2)
    for i, one in enumerate(found):
        draw_cloud(left, one, look.COLOURS[i], look.MARKERS[i], look.plain_label(labels[i]))
        draw_levels(right, one.line, one, look.COLOURS[i], look.MARKERS[i])
    look.frame(left, "xy")
    look.entry(left, "measured level", "o", markerfacecolor="none")
    look.entry(left, "fitted level, range of the draws")
    left.set(**AXES)
    right.set(xlabel=look.X_MM, ylabel=look.SPL)
    return look.finish(figure, path, f"{found[0].method}, {float(found[0].frequency[0]):g} Hz", 2)


def spectrum_of(one: Any, label: str) -> Curves:
    """R and X over frequency, with the bounds of their 95 % intervals where these are known."""
    parts = {"": one.impedance}
    if one.draws is not None or one.covariance is not None:
        parts |= dict(zip((" low", " high"), one.interval(LEVEL), strict=True))
    values = {
        f"{part}{end}": np.where(np.isfinite(shown := part_of(value, part)), shown, np.nan)
        for part, _ in look.PARTS
        for end, value in parts.items()
    }
    return Curves(one.frequency.numpy(), values, label, "frequency (Hz)")


@look.styled
def draw_spectra(found: Sequence[Any], labels: Sequence[str], path: str | Path | None = None) -> look.Figure:
    """R and X over frequency with their 95 % intervals."""
    figure, panels = look.impedance_panels(3.2, look.KHZ)
    for axis, part in panels:
        for i, (one, label) in enumerate(zip(found, labels, strict=True)):
            style = look.colour_of(i, label, marker=look.MARKERS[i], markersize=3)
            look.draw_curve(axis, spectrum_of(one, label), part, **style)
        look.frame(axis, poles=True)
    return look.finish(figure, path, f"{found[0].method}; shaded: 95 % intervals", 2)

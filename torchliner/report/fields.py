"""Pictures of sound in ducts: levels and phases along a wall, fields, modes; impedances educed from microphones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.report.figure import (
    COLOURS,
    LINES,
    MARKERS,
    ONE_ROW,
    PARTS,
    SPL,
    Figure,
    break_at_poles,
    draw_band,
    draw_curve,
    entry,
    finish,
    frame,
    head_panel,
    impedance_panels,
    label_axes,
    plain_label,
    styled,
    subplots,
)
from torchliner.report.numbers import Curves, part_of
from torchliner.report.planes import draw_cloud

LEVEL = 0.95  # of the intervals
FINE, ACROSS = 400, 60  # points of a picture along and across the duct
NEAR_WALL = 0.05  # of the height
PHASE = "phase (degrees)"


def wall_panels(liner: Sequence[tuple[float, float]] = ()) -> tuple[Figure, Any]:
    """SPL beside phase along a wall, the liner in grey."""
    figure, axes = subplots(1, 2, 3.2)
    for axis, label in zip(axes[0], (SPL, PHASE), strict=True):
        for start, end in liner:
            axis.axvspan(1e3 * start, 1e3 * end, color="0.9", zorder=0)
        label_axes(axis, "$x$ (mm)", label)
    if liner:
        entry(axes[0, 0], "liner", width=5, color="0.9")
    return figure, axes[0]


def unwrapped(phase: Any, near: Any = None) -> Any:
    """A phase in degrees without jumps of a turn, or the turns of each value that are nearest to ``near``."""
    if near is None:
        return np.unwrap(phase, period=360.0)
    return phase + 360.0 * np.round((near - phase) / 360.0)


def draw_pressure(axes: Any, x: Any, pressure: Any, along: Any = None, **looks: Any) -> Any:
    """Level and phase of complex pressures at places, m, in both panels; the phase without jumps, or with the turns of
    a curve ``along`` (x, phase). Returns the phase drawn."""
    x, phase = np.asarray(x), np.degrees(np.angle(np.asarray(pressure)))
    phase = unwrapped(phase) if along is None else unwrapped(phase, np.interp(x, *along))
    label = {"label": looks.pop("label", None)}
    axes[0].plot(1e3 * x, spl_from_pressure_amplitude(torch.as_tensor(np.asarray(pressure))).numpy(), **looks, **label)
    axes[1].plot(1e3 * x, phase, **looks)
    return phase


@styled
def draw_walls(
    solved: Sequence[tuple[Any, Any]],
    path: str | Path | None = None,
    frequency_index: int = 0,
    labels: Sequence[str] | None = None,
    title: str | None = None,
) -> Figure:
    """SPL and phase along the wall of the microphones (figures 13, 18) of pairs of setup and solved field."""
    setup = solved[0][0]
    figure, axes = wall_panels(setup.case.liner)
    for i, (each, field) in enumerate(solved):
        label = labels[i] if labels else f"{each.name}, source {field.source}"
        places, at = np.linspace(each.case.start, each.case.end, FINE), np.asarray(each.places)
        curve, points = (field.wall_pressure(x, each.wall)[frequency_index].detach() for x in (places, at))
        phase = draw_pressure(axes, places, curve, color=COLOURS[i], linestyle=LINES[i], label=plain_label(label))
        dots: Any = {"color": COLOURS[i], "marker": MARKERS[i], "markersize": 3, "linestyle": "none"}
        draw_pressure(axes, at, points, (places, phase), **dots)
    entry(axes[0], "at the microphones", "o")
    title = title or f"{setup.wall} wall, {float(setup.frequency[frequency_index]):g} Hz"
    return finish(figure, path, title, legend=3)


@styled
def draw_line(line: Any, at: Sequence[int], liner: Any = (), path: str | Path | None = None) -> Figure:
    """SPL and phase at the microphones of a line, at some of its frequencies; ``liner``: ends of patches, m."""
    figure, axes = wall_panels(liner)
    for i, f in enumerate(dict.fromkeys(at)):
        label = f"{float(line.frequency[f]):g} Hz"
        looks: Any = {"color": COLOURS[i], "marker": MARKERS[i], "markersize": 3, "linestyle": LINES[i]}
        draw_pressure(axes, line.x, line.pressure[:, f], label=label, **looks)
    return finish(figure, path, plain_label(line.title or line.name), legend=3)


@styled
def draw_field(setup: Any, field: Any, path: str | Path | None = None, frequency_index: int = 0) -> Figure:
    """SPL and wall-normal velocity in the duct."""
    figure, axes = subplots(2, 1, 3.8)
    case = setup.case
    x, y = np.linspace(case.start, case.end, FINE), np.linspace(0, case.height, ACROSS)
    grid = np.meshgrid(x, y)
    p, _, v = (part[frequency_index].detach() for part in field.at(grid[0].ravel(), grid[1].ravel()))
    level = spl_from_pressure_amplitude(p).numpy().reshape(grid[0].shape)
    speed = torch.abs(v).numpy().reshape(grid[0].shape)
    inside = y > NEAR_WALL * case.height
    for axis, values, label in zip(axes[:, 0], (level, speed), (SPL, "$|v|$ (m s$^{-1}$)"), strict=True):
        top = np.percentile(values[inside], 99.5)  # vorticity on the liner's face beside
        colours: Any = {"cmap": "cividis", "shading": "gouraud", "rasterized": True, "vmin": values.min(), "vmax": top}
        drawn = axis.pcolormesh(1e3 * x, 1e3 * y, values, **colours)
        figure.colorbar(drawn, ax=axis, label=label, extend="max")
        for start, end in case.liner:
            axis.plot([1e3 * start, 1e3 * end], [0, 0], color=COLOURS[1], linewidth=3, clip_on=False)
        label_axes(axis, "$x$ (mm)", "$y$ (mm)")
    entry(axes[0, 0], "liner", color=COLOURS[1], linewidth=3)
    title = f"{setup.name}, {float(setup.frequency[frequency_index]):g} Hz, source {field.source}; "
    title += "the colours end at 99.5 % of the values off the wall"
    return finish(figure, path, title, ONE_ROW)


@styled
def draw_modes(modes: dict[str, Any], path: str | Path | None = None, frequency_index: int = 0) -> Figure:
    """|p| of each mode over the height."""
    figure, axes = subplots(1, 2, 3.4)
    for axis, (direction, solved) in zip(axes[0], modes.items(), strict=True):
        heights = np.linspace(0, float(solved.height[0]), 200)
        pressure, _, _ = solved.at(heights)
        for n, shape in enumerate(pressure[frequency_index].abs().numpy()):
            axis.plot(shape / shape.max(), 1e3 * heights, color=COLOURS[n], linestyle=LINES[n], label=f"mode {n}")
        label_axes(axis, "$|p|$ over its maximum", "$y$ (mm), liner at 0")
        head_panel(axis, direction)
    return finish(figure, path, legend=ONE_ROW)


def draw_levels(axis: Any, line: Any, one: Any, colour: str, marker: str, f: int = 0, style: Any = "-") -> None:
    """Measured and fitted SPL; the shade is the range over the draws (figure 14b)."""
    x, level = one.level_along()
    if one.draws is not None:
        drawn = one.draws.level_along()[1][..., f].numpy()
        draw_band(axis, 1e3 * x.numpy(), np.nanmin(drawn, 0), np.nanmax(drawn, 0), colour, 0.25)
    axis.plot(1e3 * x.numpy(), level[:, f].numpy(), color=colour, linestyle=style)
    dots: Any = {"marker": marker, "color": colour, "markerfacecolor": "none", "linestyle": "none"}
    axis.plot(1e3 * line.x.numpy(), line.level[:, f].numpy(), **dots)


@styled
def draw_wall(found: Sequence[Any], labels: Sequence[str], path: str | Path | None = None) -> Figure:
    """Of eductions from microphones at one frequency: Z with its draws, and the levels with the range of the draws
    (figure 14). Of several: R and X over frequency."""
    if any(len(one.frequency) > 1 for one in found):
        return draw_spectra(found, labels, path)
    figure, axes = subplots(1, 2, 3.2)
    left, right = axes[0]
    for i, one in enumerate(found):
        draw_cloud(left, one, COLOURS[i], MARKERS[i], plain_label(labels[i]))
        draw_levels(right, one.line, one, COLOURS[i], MARKERS[i])
    entry(left, "measured level", "o", markerfacecolor="none")
    entry(left, "fitted level, range of the draws")
    label_axes(left, PARTS[0][1], PARTS[1][1])
    label_axes(right, "$x$ (mm)", SPL)
    return finish(figure, path, f"{found[0].method}, {float(found[0].frequency[0]):g} Hz", legend=2)


@styled
def draw_along(
    found: Sequence[Any], there: Sequence[tuple[int, int]], labels: Sequence[str], path: str | Path | None = None
) -> Figure:
    """SPL and phase along the wall, measured and fitted.

    Args:
        found: eductions.  there: numbers of those that are drawn, and of a frequency of each.
        labels: of all eductions.
    """
    figure, axes = wall_panels()
    for i, f in there:
        one, line, looks = found[i], found[i].source_line, {"color": COLOURS[i]}
        places, fitted = one.fitted_along()
        phase = draw_pressure(axes, places, fitted[:, f], linestyle=LINES[i], label=plain_label(labels[i]), **looks)
        dots: Any = {"marker": MARKERS[i], "markerfacecolor": "none", "linestyle": "none"}
        draw_pressure(axes, line.x, line.pressure[:, f], (places, phase), **dots, **looks)
    entry(axes[0], "measured", "o", markerfacecolor="none")
    return finish(figure, path, "measured and fitted pressures along the wall", legend=3)


def spectrum_of(one: Any, label: str) -> Curves:
    """R and X over frequency, with the bounds of their 95 % intervals where these are known."""
    parts = {"": one.impedance}
    if one.draws is not None or one.covariance is not None:
        parts |= dict(zip((" low", " high"), one.interval(LEVEL), strict=True))
    values = {
        f"{part}{end}": np.where(np.isfinite(shown := part_of(value, part)), shown, np.nan)
        for part, _ in PARTS
        for end, value in parts.items()
    }
    return Curves(one.frequency.numpy(), values, label, "frequency (Hz)")


@styled
def draw_spectra(found: Sequence[Any], labels: Sequence[str], path: str | Path | None = None) -> Figure:
    """R and X over frequency with their 95 % intervals; the caption says whether these go on beyond the axes."""
    figure, panels = impedance_panels(3.2, "$f$ (kHz)")
    curves = [spectrum_of(one, plain_label(label)) for one, label in zip(found, labels, strict=True)]
    beyond = False
    for axis, part in panels:
        bands = []
        for i, each in enumerate(curves):
            draw_curve(axis, each, part, COLOURS[i], 1e-3, marker=MARKERS[i], markersize=3)
            bands += [values for name, values in each.values.items() if name.startswith(f"{part} ")]
        beyond |= frame(axis, np.concatenate([each.values[part] for each in curves]), *bands)
        break_at_poles(axis)
    caption = f"{found[0].method}; shaded: 95 % intervals{', cut off at the axes' * beyond}"
    return finish(figure, path, caption, legend=2)

"""Figures of impedances educed from wall pressures, behind ``torchliner kt`` and its page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.records import MicrophoneLine
from torchliner.report.figure import (
    COLOURS,
    LINES,
    MARKERS,
    PARTS,
    SPL,
    Figure,
    draw_band,
    draw_curve,
    entry,
    finish,
    frame,
    impedance_panels,
    label_axes,
    styled,
    subplots,
)
from torchliner.report.numbers import Curves, part_of
from torchliner.report.wall_table import LEVEL, Educed

FAR = 8.0  # interquartile ranges: 11 standard deviations of normal draws
TINY = 1e-9
JUMP = 180.0  # degrees, between neighbours: the phase has turned round


@styled
def draw_wall(lines: Sequence[MicrophoneLine], found: Sequence[Educed], path: str | Path | None = None) -> Figure:
    """One frequency: Z with its draws, and the levels with the range of the draws (figure 14).
    Several: R and X over frequency with their 95 % intervals."""
    labels = [
        f"{line.title or Path(line.name).stem}, source {one.source_side}"
        for line, one in zip(lines, found, strict=True)
    ]
    if any(len(one.frequency) > 1 for one in found):
        return draw_spectra(found, labels, path)[0]
    figure, panels = impedance_panels(3.2, "$f$ (kHz)")
    (left, _), (right, _) = panels
    for i, (line, one) in enumerate(zip(lines, found, strict=True)):
        draw_cloud(left, one, COLOURS[i], MARKERS[i], labels[i])
        draw_levels(right, line, one, COLOURS[i], MARKERS[i])
    entry(left, "measured level", "o", markerfacecolor="none")
    entry(left, "fitted level, range of the draws")
    label_axes(left, PARTS[0][1], PARTS[1][1])
    label_axes(right, "$x$ (mm)", SPL)
    caption = f"{found[0].method}, {float(found[0].frequency[0]):g} Hz"
    return finish(figure, path, caption, legend=2)


def draw_cloud(axis: Any, one: Educed, colour: str, marker: str, label: str, f: int = 0) -> None:
    """Impedances of the draws in their plane, and the one without errors (figure 14a).

    Draws far outside the cloud are not drawn, since one would set the axes; the label counts them.
    """
    value = complex(one.impedance[f])
    if one.draws is not None:
        drawn = one.draws.impedance[:, f].numpy()
        drawn = drawn[np.isfinite(drawn)]
        shown = near_cloud(drawn)
        axis.plot(drawn[shown].real, drawn[shown].imag, ".", color=colour, markersize=1.5, alpha=0.4)
        if not shown.all():
            label += f" ({int((~shown).sum())} of {len(drawn)} draws outside)"
    axis.plot(
        value.real, value.imag, marker, color=colour, markeredgecolor="k", label=label, markersize=6, linestyle="none"
    )


def near_cloud(values: np.ndarray) -> np.ndarray:
    """Which of complex values (D,) lie within ``FAR`` times the middle half of R and of X."""
    parts = np.stack([values.real, values.imag])
    low, middle, high = np.quantile(parts, (0.25, 0.5, 0.75), axis=1)[..., None]
    near: np.ndarray = (np.abs(parts - middle) <= FAR * np.maximum(high - low, TINY)).all(0)
    return near


def draw_levels(
    axis: Any, line: MicrophoneLine, one: Educed, colour: str, marker: str, f: int = 0, style: Any = "-"
) -> None:
    """Measured and fitted SPL; the shade is the range over the draws (figure 14b)."""
    x, level = one.level_along()
    if one.draws is not None:
        drawn = one.draws.level_along()[1][..., f].numpy()
        low, high = np.nanmin(drawn, 0), np.nanmax(drawn, 0)
        draw_band(axis, 1e3 * x.numpy(), low, high, colour, 0.25)
    axis.plot(1e3 * x.numpy(), level[:, f].numpy(), color=colour, linestyle=style)
    axis.plot(
        1e3 * line.x.numpy(),
        line.level[:, f].numpy(),
        marker=marker,
        color=colour,
        markerfacecolor="none",
        linestyle="none",
    )


def draw_phases(axis: Any, x: Any, pressure: Any, style: str, **looks: Any) -> None:
    """Phase of complex pressures along x, m; a line is broken where the phase turns round."""
    phase = np.degrees(np.angle(pressure))
    if style != "none":
        phase = np.where(np.append(np.abs(np.diff(phase)) > JUMP, False), np.nan, phase)
    axis.plot(1e3 * np.asarray(x), phase, linestyle=style, **looks)


@styled
def draw_along(found: Sequence[Educed], there: Sequence[tuple[int, int]], labels: Sequence[str]) -> Figure:
    """SPL and phase along the wall, measured and fitted.

    Args:
        found: eductions.  there: numbers of those that are drawn, and of a frequency of each.
        labels: of all eductions.
    """
    figure, axes = subplots(1, 2, 3.2)
    seen: list[Any] = []
    for i, f in there:
        one, line, colour, style = found[i], found[i].source_line, COLOURS[i], LINES[i]
        measured = line.pressure[:, f]
        marker = "" if any(map(measured.equal, seen)) else MARKERS[i]  # of another method
        seen.append(measured)
        draw_levels(axes[0, 0], line, one, colour, marker, f, style)
        places, fitted = one.fitted_along()
        draw_phases(axes[0, 1], places.numpy(), fitted[:, f].numpy(), style, color=colour)
        draw_phases(
            axes[0, 1], line.x.numpy(), measured.numpy(), "none", color=colour, marker=marker, markerfacecolor="none"
        )
        entry(axes[0, 0], labels[i], color=colour, linestyle=style)
    entry(axes[0, 0], "measured", "o", markerfacecolor="none")
    label_axes(axes[0, 0], "$x$ (mm)", "SPL (dB re 20 µPa)")
    label_axes(axes[0, 1], "$x$ (mm)", "phase (degrees)")
    return finish(figure, None, legend=3)


def spectrum_of(one: Educed, label: str) -> Curves:
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
def draw_spectra(found: Sequence[Educed], labels: Sequence[str], path: str | Path | None = None) -> tuple[Figure, bool]:
    """R and X over frequency with their 95 % intervals; whether these go on beyond the axes."""
    figure, panels = impedance_panels(3.2, "$f$ (kHz)")
    curves = [spectrum_of(one, label) for one, label in zip(found, labels, strict=True)]
    beyond = False
    for axis, part in panels:
        for i, each in enumerate(curves):
            draw_curve(axis, each, part, COLOURS[i], 1e-3, marker=MARKERS[i], markersize=3)
        values, bands = (
            np.concatenate([v for each in curves for n, v in each.values.items() if chosen(n)])
            for chosen in (lambda n, p=part: n == p, lambda n, p=part: n.startswith(p))
        )
        beyond |= frame(axis, values, bands)
    return finish(figure, path, found[0].method, legend=2), beyond

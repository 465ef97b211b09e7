"""Waves measured above one liner, by their direction and the side of their source: the mismatch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.duct.dispersion import impedance_from_wavenumber
from torchliner.records import MicrophoneLine, WallEduction
from torchliner.records.drawn_impedance import deviation as deviation_of
from torchliner.report.figure import (
    COLOURS,
    PARTS,
    Figure,
    finish,
    styled,
    subplots,
)
from torchliner.report.numbers import COMPLEX_PART

NEPER = 20 / np.log(10)  # dB
LEVEL = 0.95  # of the shaded intervals
TIED, FREE = "two waves", "two free waves"  # as ``two_wave_fit`` names its results
THIN = 4  # every so manieth symbol


@dataclass(frozen=True)
class MeasuredWave:
    """One wave over frequency.

    Args:
        direction: in which it runs, ``downstream`` or ``upstream``.
        source_side: of the record.
        method: of the eduction.
        reflected: whether it runs towards the source.
        height: H, m, behind the impedance.
        mach, sound_speed: of the duct.
        frequency: Hz, (F,).
        wavenumber, impedance: (F,).
        low, high: of the impedance, (F,), if drawn.
        wavenumber_deviation: (F,), if drawn.
        residual: (F,).
    """

    direction: str
    source_side: str
    method: str
    reflected: bool
    height: float
    mach: float
    sound_speed: float
    frequency: Tensor
    wavenumber: Tensor
    impedance: Tensor
    residual: Tensor
    low: Tensor | None = None
    high: Tensor | None = None
    wavenumber_deviation: Tensor | None = None

    @classmethod
    def of(cls, direction: str, found: WallEduction, line: MicrophoneLine, mode: int | None = None) -> MeasuredWave:
        """The wave whose impedance was educed, or one of the modes by number."""
        head = (
            direction,
            found.source_side,
            found.method,
            mode == 1,
            float(line.duct_height),
            line.stated_mach,
            float(line.fluid.sound_speed),
            found.frequency,
        )
        if mode is None:
            low, high = found.interval(LEVEL) if found.draws is not None else (None, None)
            deviation = None if found.draws is None else deviation_of(found.draws.wavenumber)  # type: ignore[attr-defined]
            return cls(*head, found.wavenumber, found.impedance, found.residual, low, high, deviation)
        wave = found.modes[..., mode, :]
        # In coordinates of the flow the relation holds for either direction.
        impedance = impedance_from_wavenumber(
            wave,
            found.frequency,
            height=line.duct_height,
            mach=line.mach,
            sound_speed=line.fluid.sound_speed,
            condition=found.choices["condition"],
        )
        return cls(*head, wave, impedance, found.residual)

    def where(self, mask: Tensor) -> MeasuredWave:
        """At some of the frequencies."""
        parts: Any = {k: v[mask] for k, v in vars(self).items() if isinstance(v, Tensor)}
        return replace(self, **parts)


def wave_rows(wave: MeasuredWave) -> list[dict[str, Any]]:
    """A row a frequency, four digits."""
    rows = []
    for i, hertz in enumerate(wave.frequency.tolist()):
        row: dict[str, Any] = {
            "direction": wave.direction,
            "source": wave.source_side,
            "method": wave.method,
            "reflected": int(wave.reflected),
            "height_mm": f"{1e3 * wave.height:g}",
            "frequency_hz": f"{hertz:g}",
        }
        row |= _pair("alpha", wave.wavenumber, i, "per_m")
        row |= _pair("alpha_std", wave.wavenumber_deviation, i, "per_m")
        for name, values in (("z", wave.impedance), ("z_low", wave.low), ("z_high", wave.high)):
            row |= _pair(name, values, i, "")
        rows.append({**row, "residual": f"{float(wave.residual[i]):.3g}"})
    return rows


def _pair(name: str, values: Tensor | None, index: int, unit: str) -> dict[str, str]:
    end = f"_{unit}" if unit else ""
    value = None if values is None else complex(values[index])
    return {
        f"{name}_real{end}": "" if value is None else f"{value.real:.4g}",
        f"{name}_imag{end}": "" if value is None else f"{value.imag:.4g}",
    }


@styled
def draw_mismatch(waves: Sequence[MeasuredWave], heights: Sequence[float], path: str | Path | None = None) -> Figure:
    """Phase and decay of the waves by fits that know no height; below them R and X under each
    assumed height, lines by fits that tie both waves to one impedance."""
    figure, axes = subplots(1 + len(heights), 2, 2.15 * (1 + len(heights)) + 0.6)
    first = [wave for wave in waves if wave.height == heights[0] and wave.method != TIED]
    for wave in first:
        k = 2 * torch.pi * wave.frequency / wave.sound_speed
        _draw(axes[0, 0], wave, (wave.wavenumber.real.abs() / k).numpy())
        _draw(axes[0, 1], wave, (NEPER * wave.wavenumber.imag.abs()).numpy())
    _draw_limits(axes[0, 0], first[0].mach)
    axes[0, 0].set_ylabel(r"$|\mathrm{Re}\,\alpha|/k$")
    axes[0, 1].set_ylabel(r"decay (dB m$^{-1}$)")
    for axis in axes[0]:
        axis.set_ylim(bottom=0)
    for row, height in zip(axes[1:], heights, strict=True):
        some = [w for w in waves if w.height == height and (w.reflected or w.method != FREE)]
        for axis, (part, label) in zip(row, PARTS, strict=True):
            for wave in some:
                _draw_impedance(axis, wave, COMPLEX_PART[part])
            _limit(axis, some, COMPLEX_PART[part])
            axis.set_ylabel(label)
            axis.text(0.03, 0.95, f"$H = {1e3 * height:g}$ mm", transform=axis.transAxes, va="top", fontsize=8)
        row[1].axhline(0, color="0.6", linewidth=0.6, zorder=0)
    for axis in axes.flat:
        axis.set_xlim(0.18, 1.5)
    for axis in axes[-1]:
        axis.set_xlabel("$f$ (kHz)")
    return finish(figure, path, legend=2)


def _draw_limits(axis: Any, mach: float) -> None:
    """Of a rigid duct."""
    for limit, name in ((1 / (1 - mach), r"$1/(1-M)$"), (1 / (1 + mach), r"$1/(1+M)$")):
        axis.axhline(limit, color="0.5", linewidth=0.7, linestyle=":", zorder=0)
        axis.text(1.47, limit + 0.03, name, fontsize=8, ha="right", va="bottom", color="0.3")


def _label(wave: MeasuredWave) -> str:
    if wave.reflected:
        return f"{wave.direction} wave, reflected; source {wave.source_side}"
    how = "Kumaresan-Tufts" if wave.method not in (TIED, FREE) else "two-wave fit"
    return f"{wave.direction} wave, source {wave.source_side}: {how}"


def _draw(axis: Any, wave: MeasuredWave, values: Any) -> None:
    """Lines for the fits, dots for Kumaresan and Tufts, open symbols for reflected waves."""
    colour = COLOURS[0] if wave.direction == "downstream" else COLOURS[1]
    at = wave.frequency.numpy() / 1e3
    if wave.reflected:
        marker, edge = ("s", "k") if wave.direction == "upstream" else ("^", "0.5")
        axis.plot(
            at[::THIN],
            values[::THIN],
            marker,
            color=edge,
            markerfacecolor="none",
            markersize=3,
            markeredgewidth=0.6,
            label=_label(wave),
            zorder=4,
        )
    elif wave.method in (TIED, FREE):
        axis.plot(at, values, color=colour, label=_label(wave), zorder=3)
    else:
        axis.plot(at[::THIN], values[::THIN], "o", color=colour, markersize=2.6, label=_label(wave), zorder=2)


def _draw_impedance(axis: Any, wave: MeasuredWave, part: str) -> None:
    if wave.low is not None and wave.high is not None and wave.method == TIED:
        colour = COLOURS[0] if wave.direction == "downstream" else COLOURS[1]
        low, high = (getattr(end, part).numpy() for end in (wave.low, wave.high))
        at = wave.frequency.numpy() / 1e3
        axis.fill_between(at, low, high, color=colour, alpha=0.2, linewidth=0)
    _draw(axis, wave, getattr(wave.impedance, part).numpy())


def _limit(axis: Any, waves: Sequence[MeasuredWave], part: str) -> None:
    """From the fits alone: a reflected wave that is hardly heard reaches anywhere."""
    values = np.concatenate([getattr(w.impedance, part).numpy() for w in waves if w.method == TIED])
    low, high = np.percentile(values, [1, 99])
    margin = 0.2 * (high - low)
    axis.set_ylim(0 if part == "real" else low - margin, high + margin)

"""Impedances educed from wall pressures: the rows and the figure behind ``torchliner kt``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchliner.eduction.two_wave_fit import two_wave_fit
from torchliner.eduction.wall_pressure import kumaresan_tufts
from torchliner.records import MicrophoneLine, WallEduction
from torchliner.report.figures import PARTS, Figure, finish, styled, subplots
from torchliner.report.numbers import COMPLEX_PART
from torchliner.report.style import COLOURS, MARKERS
from torchliner.report.truth import format_complex

METHODS = ("kt", "two-waves", "free-waves")
LEVEL = 0.95
SHOWN = 4  # singular values in the table
FINE = 201  # places of the fitted level


@dataclass(frozen=True)
class WallRow:
    """One frequency of one line.

    Args:
        line: file or title.  source: side.  method: of the eduction.  frequency: Hz.
        wavenumber: 1/m.  impedance: normalised.
        deviation: of R (real) and X (imaginary) over the draws, None without.
        interval: bounds of 95 % of the draws, None without.
        residual: of the pressures, relative.
        singular_values: over the first one; empty for fits.
        failed: draws without an impedance.
    """

    line: str
    source: str
    method: str
    frequency: float
    wavenumber: complex
    impedance: complex
    deviation: complex | None
    interval: tuple[complex, complex] | None
    residual: float
    singular_values: tuple[float, ...]
    failed: int = 0

    def plain(self) -> dict[str, Any]:
        """For CSV and JSON: complex values as two numbers, nan where there is none."""
        nothing = complex(float("nan"), float("nan"))
        low, high = self.interval or (nothing, nothing)
        spread = nothing if self.deviation is None else self.deviation
        return {
            "line": self.line, "source": self.source, "method": self.method,
            "frequency": self.frequency, "wavenumber_real": self.wavenumber.real,
            "wavenumber_imag": self.wavenumber.imag, "resistance": self.impedance.real,
            "reactance": self.impedance.imag, "resistance_deviation": spread.real,
            "reactance_deviation": spread.imag, "resistance_low": low.real,
            "resistance_high": high.real, "reactance_low": low.imag, "reactance_high": high.imag,
            "residual": self.residual,
            "singular_values": " ".join(f"{value:.3g}" for value in self.singular_values),
            "failed_draws": self.failed,
        }  # fmt: skip


def educe_line(line: MicrophoneLine, method: str, **options: Any) -> WallEduction:
    """By one of ``METHODS``; options are those of ``kumaresan_tufts`` and ``two_wave_fit``."""
    if method == "kt":
        return kumaresan_tufts(line, **options)
    return two_wave_fit(line, tied=method == "two-waves", **options)


def wall_rows(line: MicrophoneLine, found: WallEduction) -> list[WallRow]:
    """A row a frequency of a line without leading axes.

    Raises:
        ValueError: the line has leading axes, as files of draws do.
    """
    if found.wavenumber.ndim != 1:
        raise ValueError(
            f"{line.name} holds {tuple(found.wavenumber.shape[:-1])} lines; a table needs one"
        )
    rows = []
    bounds = found.interval(LEVEL) if found.draws is not None else None
    for f, frequency in enumerate(found.frequency.tolist()):
        values: tuple[float, ...] = ()
        if found.singular_values is not None:
            values = tuple((found.singular_values[:, f] / found.singular_values[0, f]).tolist())
        drawn = found.draws is not None
        rows.append(
            WallRow(
                line.title or line.name, found.source_side, found.method, frequency,
                complex(found.wavenumber[f]), complex(found.impedance[f]),
                complex(found.standard_deviation[f]) if drawn else None,
                None if bounds is None else (complex(bounds[0][f]), complex(bounds[1][f])),
                float(found.residual[f]), values, int(found.failed[f]) if drawn else 0,
            )
        )  # fmt: skip
    return rows


def format_wall(line: MicrophoneLine, found: WallEduction) -> str:
    """A text table of one line."""
    rank = "" if found.rank is None else f", rank {found.rank}, order {found.order}"
    head = (
        f"{line.title or line.name}: {found.method}{rank}, source {found.source_side}, "
        f"{len(found.x)} microphones from {1e3 * float(found.x[0]):.4g} to "
        f"{1e3 * float(found.x[-1]):.4g} mm, H {1e3 * float(line.duct_height):.4g} mm, "
        f"M {float(line.mach):.3g}, {found.choices['condition']}"
    )
    lines = [head, f"{'f Hz':>7s} {'alpha 1/m':>16s} {'Z':>14s} {'deviation':>13s} "
             f"{'resid. %':>8s}  singular values"]  # fmt: skip
    for row in wall_rows(line, found):
        spread = "-" if row.deviation is None else (
            f"{row.deviation.real:.3f}, {row.deviation.imag:.3f}"
        )  # fmt: skip
        shown = " ".join(f"{value:.2g}" for value in row.singular_values[:SHOWN]) or "-"
        alpha = f"{row.wavenumber.real:.3f}{row.wavenumber.imag:+.3f}j"
        lines.append(
            f"{row.frequency:7.1f} {alpha:>16s} {format_complex(row.impedance):>14s} "
            f"{spread:>13s} {100 * row.residual:8.3f}  {shown}"
        )
    lines.append(
        "Z is p/(rho c v), exp(+jwt - j alpha x), x along the flow; deviation: of R and X over the "
        "draws"
    )
    return "\n".join(lines)


@styled
def draw_wall(
    lines: Sequence[MicrophoneLine],
    found: Sequence[WallEduction],
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
            _draw_cloud(axes[0, 0], one, colour, marker, label)
            _draw_levels(axes[0, 1], line, one, colour, marker)
        else:
            for axis, (part, _) in zip(axes[0], PARTS, strict=True):
                _draw_spectrum(axis, one, COMPLEX_PART[part], colour, label)
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


def _draw_cloud(axis: Any, one: WallEduction, colour: str, marker: str, label: str) -> None:
    if one.draws is not None:
        drawn = one.draws.impedance[:, 0].numpy()
        axis.plot(drawn.real, drawn.imag, ".", color=colour, markersize=1.5, alpha=0.4)
    value = complex(one.impedance[0])
    axis.plot(value.real, value.imag, marker, color=colour, markeredgecolor="k", label=label,
              markersize=6)  # fmt: skip


def _draw_levels(
    axis: Any, line: MicrophoneLine, one: WallEduction, colour: str, marker: str
) -> None:
    """Measured and fitted SPL; the shade is the range over the draws."""
    x = torch.linspace(float(one.x[0]), float(one.x[-1]), FINE, dtype=torch.float64)
    if one.draws is not None:
        drawn = one.draws.level_at(x)[..., 0].numpy()
        axis.fill_between(1e3 * x.numpy(), np.nanmin(drawn, 0), np.nanmax(drawn, 0),
                          color=colour, alpha=0.25, linewidth=0)  # fmt: skip
    axis.plot(1e3 * x.numpy(), one.level_at(x)[:, 0].numpy(), color=colour)
    axis.plot(1e3 * line.x.numpy(), line.level[:, 0].numpy(), marker, color=colour,
              markerfacecolor="none")  # fmt: skip


def _draw_spectrum(axis: Any, one: WallEduction, part: str, colour: str, label: str) -> None:
    at = one.frequency.numpy() / 1e3
    if one.draws is not None:
        low, high = (getattr(end, part).numpy() for end in one.interval(LEVEL))
        axis.fill_between(at, low, high, color=colour, alpha=0.25, linewidth=0)
    axis.plot(at, getattr(one.impedance, part).numpy(), color=colour, label=label)

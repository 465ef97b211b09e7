"""Impedance against frequency."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.records import ImpedanceMap
from torchliner.report.curves import Array, Curves
from torchliner.report.figure import COLOURS, PARTS, finish, styled, subplots
from torchliner.report.numbers import height_label

BARS = 15  # statistical intervals along a curve, about


def impedance_over_frequency(result: ImpedanceMap) -> Curves:
    """Whole-liner impedance in both orders, its statistical interval (admittance over probes), and
    quartiles over the probes that were not left out, which are no uncertainty."""
    values: dict[str, Array] = {}
    for part in ("real", "imag"):
        name = {"real": "resistance", "imag": "reactance"}[part]
        values[name] = getattr(_host(result.liner_impedance), part)
        first = getattr(_host(result.liner_impedance_velocity_first), part)
        values[f"{name}, velocity first"] = first
        if result.uncertainty is not None:
            bounds = result.uncertainty.liner
            for end, bound in (("low", bounds.low), ("high", bounds.high)):
                values[f"{name} {end}"] = getattr(_host(bound), part)
        flat = getattr(_host(result.impedance), part).reshape(-1, len(result.frequency))
        for share in (25, 75):
            values[f"{name}, {share} % of probes"] = np.nanpercentile(flat, share, axis=0)
    frequency = _host(result.frequency)
    return Curves(frequency, values, height_label(result.height), "frequency (Hz)")


def _host(value: Any) -> Any:
    return value.detach().cpu().numpy()


@styled
def draw_spectrum(results: Sequence[ImpedanceMap], path: str | Path | None = None) -> Any:
    """R and X over frequency at several heights: spread over probes shaded, intervals as bars."""
    figure, axes = subplots(1, 2, 3.0)
    ordered = sorted(results, key=lambda r: r.height or 0.0)
    for axis, (part, label) in zip(axes[0], PARTS, strict=True):
        drawn = []
        for i, result in enumerate(ordered):
            numbers = impedance_over_frequency(result)
            colour, kilohertz = COLOURS[i % len(COLOURS)], numbers.at / 1e3
            name = numbers.label or "educed"
            axis.plot(kilohertz, numbers.values[part], color=colour, label=name)
            axis.plot(kilohertz, numbers.values[f"{part}, velocity first"], "--", color=colour)
            drawn += [numbers.values[part], numbers.values[f"{part}, velocity first"]]
            low, high = (numbers.values[f"{part}, {share} % of probes"] for share in (25, 75))
            axis.fill_between(kilohertz, low, high, color=colour, alpha=0.2, linewidth=0)
            if f"{part} low" in numbers.values:
                some = slice(i, None, max(1, len(kilohertz) // BARS))
                ends = (numbers.values[f"{part} {end}"][some] for end in ("low", "high"))
                axis.vlines(kilohertz[some], *ends, color=colour, linewidth=1.2, zorder=3)
        # A cavity's antiresonance, where Z has a pole, would hide all the rest.
        low, high = np.nanpercentile(np.concatenate(drawn), [5, 90])
        margin = 0.5 * (high - low) + 1e-9
        axis.set_ylim(low - margin, high + margin)
        axis.set_xlabel(r"$f$ (kHz)")
        axis.set_ylabel(label)
    axes[0, 1].axhline(0, color="0.6", linewidth=0.6, zorder=0)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(4, len(labels)))
    title = ordered[0].title.split(", y =")[0] or "educed impedance"
    known = ordered[0].uncertainty
    bars = "" if known is None else (
        f"; bars: {100 * known.settings['level']:g} % statistical interval"
    )  # fmt: skip
    figure.suptitle(
        f"{title}; solid: admittance over probes, dashed: velocity first\nshaded: middle half of "
        f"the probes{bars}",
        fontsize=9,
    )
    return finish(figure, path)

"""Impedance against frequency."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.records import ImpedanceMap
from torchliner.records.impedance_map import ENDS
from torchliner.report.curves import COMPLEX_PART, Array, Curves, part_of
from torchliner.report.figure import COLOURS, draw_band, finish, impedance_panels, styled
from torchliner.report.numbers import case_title, height_label, interval_words

BARS = 15  # statistical intervals along a curve, about


def impedance_over_frequency(result: ImpedanceMap) -> Curves:
    """Whole-liner impedance in all orders, the statistical interval of the answer, and
    quartiles over the probes that were not left out, which are no uncertainty."""
    values: dict[str, Array] = {}
    for part in COMPLEX_PART:
        values[part] = part_of(result.answer, part)
        for order in result.orders:
            if order != result.order:
                values[f"{part}, {order}"] = part_of(result.of_liner(order), part)
        if result.uncertainty is not None:
            bounds = getattr(result.uncertainty, f"liner{ENDS[result.order]}")
            for end, bound in (("low", bounds.low), ("high", bounds.high)):
                values[f"{part} {end}"] = part_of(bound, part)
        flat = part_of(result.impedance, part).reshape(-1, len(result.frequency))
        for share in (25, 75):
            values[f"{part}, {share} % of probes"] = np.nanpercentile(flat, share, axis=0)
    frequency = result.frequency.detach().cpu().numpy()
    return Curves(frequency, values, height_label(result.height), "frequency (Hz)")


def _others(result: ImpedanceMap) -> list[str]:
    return [order for order in result.orders if order != result.order]


@styled
def draw_spectrum(results: Sequence[ImpedanceMap], path: str | Path | None = None) -> Any:
    """R and X over frequency at several heights: spread over probes shaded, intervals as bars."""
    figure, panels = impedance_panels(3.0, r"$f$ (kHz)")
    ordered = sorted(results, key=lambda r: r.height or 0.0)
    for axis, part in panels:
        drawn = []
        for i, result in enumerate(ordered):
            numbers = impedance_over_frequency(result)
            colour, kilohertz = COLOURS[i], numbers.at / 1e3
            name = numbers.label or "educed"
            axis.plot(kilohertz, numbers.values[part], color=colour, label=name)
            drawn.append(numbers.values[part])
            for other, style in zip(_others(result), ("--", ":"), strict=False):
                axis.plot(kilohertz, numbers.values[f"{part}, {other}"], style, color=colour)
                drawn.append(numbers.values[f"{part}, {other}"])
            low, high = (numbers.values[f"{part}, {share} % of probes"] for share in (25, 75))
            draw_band(axis, kilohertz, low, high, colour)
            if f"{part} low" in numbers.values:
                some = slice(i, None, max(1, len(kilohertz) // BARS))
                ends = (numbers.values[f"{part} {end}"][some] for end in ("low", "high"))
                axis.vlines(kilohertz[some], *ends, color=colour, linewidth=1.2, zorder=3)
        # A cavity's antiresonance, where Z has a pole, would hide all the rest.
        low, high = np.nanpercentile(np.concatenate(drawn), [5, 90])
        margin = 0.5 * (high - low) + 1e-9
        axis.set_ylim(low - margin, high + margin)
    panels[1][0].axhline(0, color="0.6", linewidth=0.6, zorder=0)
    title = case_title(ordered[0]) or "educed impedance"
    words = interval_words(ordered[0])
    kinds = zip(("dashed", "dotted"), _others(ordered[0]), strict=False)
    lines = ", ".join(f"{kind}: {order}" for kind, order in kinds)
    title += f"; solid: {ordered[0].order}, {lines}\nshaded: middle half of the "
    title += f"probes; bars: {words}" if words else "probes"
    return finish(figure, path, title, legend=4)

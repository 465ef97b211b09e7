"""What a reconstruction from random samples does, drawn over the mean rate of arrivals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from torchliner.report.figure import (
    COLOURS,
    MARKERS,
    Figure,
    finish,
    styled,
    subplots,
)
from torchliner.report.table import rows_of, table_of

KILO = 1e-3
RATE_LABEL = r"arrivals $\lambda$ (kHz)"
# One look for a way of reconstruction in all figures.
LOOKS = {
    "linear": (COLOURS[0], MARKERS[0]),
    "hold": (COLOURS[1], MARKERS[1]),
    "band-limited": (COLOURS[2], MARKERS[2]),
    "linear, tone corrected": (COLOURS[3], MARKERS[3]),
    "linear, tone and its noise corrected": (COLOURS[5], MARKERS[4]),
}


class Curves(NamedTuple):
    """Columns ``values`` over the rates ``at``, Hz; ``variable``: the heading of these."""

    at: np.ndarray
    values: dict[str, np.ndarray]
    variable: str

    def write_csv(self, path: Path) -> None:
        table_of(rows_of(**{self.variable: self.at}, **self.values)).write_csv(path)


@styled
def draw_attenuation(
    factors: Curves,
    closed_forms: Curves,
    published: Mapping[float, float],
    errors: Curves,
    path: str | Path | None = None,
) -> Figure:
    """(a) the factor on a tone, (b) bias and scatter of its amplitude, over the mean rate.

    Args:
        factors: size of the factor for drawn arrivals, a column a method.
        closed_forms: the same for Poisson arrivals, on finer rates; columns as in ``factors``.
        published: known values by rate, Hz.
        errors: errors of the amplitude over its size; a column whose name begins with "bias" is
            dashed.
    """
    figure, axes = subplots(1, 2, 3.5)
    left, right = axes[0]
    for name, values in factors.values.items():
        colour, marker = LOOKS[name]
        left.plot(KILO * factors.at, values, marker, color=colour, label=name)
        if name in closed_forms.values:
            closed = closed_forms.values[name]
            left.plot(KILO * closed_forms.at, closed, color=colour, label=f"{name}, closed form")
    left.plot(
        [KILO * rate for rate in published],
        list(published.values()),
        "+",
        color="k",
        markersize=9,
        label="linear, known values",
        zorder=4,
    )
    left.set_ylabel("factor on the tone $|G|$")
    for i, (name, values) in enumerate(errors.values.items()):
        right.plot(
            KILO * errors.at,
            values,
            MARKERS[i] + ("--" if name.startswith("bias") else "-"),
            color=COLOURS[i],
            label=name,
            markerfacecolor="white" if i % 2 else None,
        )
    right.set_ylabel(r"error of the amplitude, over $|A|$")
    right.set_yscale("log")
    for axis in (left, right):
        _rate_axis(axis, factors)
        axis.legend(loc="lower right" if axis is left else "best", fontsize=7)
    right.set_ylim(top=3 * max(values.max() for values in errors.values.values()))
    return finish(figure, path)


@styled
def draw_effects(tables: Sequence[tuple[str, Curves, float]], path: str | Path | None = None) -> Figure:
    """Quantities over the mean rate, a panel each: (axis label, values by method, truth)."""
    figure, axes = subplots(1, len(tables), 3.1)
    for axis, (label, table, true) in zip(axes[0], tables, strict=True):
        axis.axhline(true, color="k", linewidth=0.9, label="velocity known everywhere")
        for name, values in table.values.items():
            colour, marker = LOOKS[name]
            axis.plot(KILO * table.at, values, marker + "-", color=colour, label=name)
        _rate_axis(axis, table)
        axis.set_ylabel(label)
    return finish(figure, path, legend=3)


def _rate_axis(axis: Any, table: Curves) -> None:
    from matplotlib.ticker import NullFormatter, NullLocator

    axis.set_xscale("log")
    low, high = 0.99 * KILO * table.at.min(), 1.01 * KILO * table.at.max()
    inside = [tick for tick in (5, 10, 20, 50, 100, 200) if low <= tick <= high]
    axis.set_xticks(inside, [f"{tick:g}" for tick in inside])
    axis.xaxis.set_minor_locator(NullLocator())
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set_xlabel(RATE_LABEL)

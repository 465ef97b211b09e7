"""Pictures of Z in the complex plane: probes, cells, averagings, heights, draws, predictions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.records import ImpedanceMap
from torchliner.report.curves import ORDERS, alongside_at, family, references_of
from torchliner.report.figure import (
    AVERAGINGS,
    COLOURS,
    MARKERS,
    ONE_ROW,
    PARTS,
    Figure,
    entry,
    finish,
    head_panel,
    label_axes,
    plain_label,
    styled,
    subplots,
)
from torchliner.report.numbers import interval_words

MOST_PROBES = 1500
ELLIPSE = 2.4477  # radius that holds 95 % of a two-dimensional Gaussian
FAR = 8.0  # interquartile ranges: 11 standard deviations of normal draws
TINY = 1e-9
KNOWN = "*x+1234" * 9  # markers of what is known from elsewhere
Rows = Sequence[Mapping[str, Any]]


def known_of(results: Sequence[ImpedanceMap], index: int) -> dict[str, complex]:
    """References of the file, at its tone, other methods, Goodrich."""
    found = references_of(results, index)
    for other, f in alongside_at(results, index):
        found |= {
            f"{other.name}, {order}": complex(getattr(other, f"liner_impedance{end}")[f]) for end, order in ORDERS
        }
    return found


def draw_point(axis: Any, value: complex, marker: str, colour: str, label: str = "", bounds: Any = None) -> None:
    """One Z, with a cross of the intervals of R and of X."""
    style: Any = {"color": colour, "linewidth": 0.9, "zorder": 4}
    if bounds is not None and np.isfinite([*bounds]).all():
        low, high = bounds
        axis.plot([low.real, high.real], [value.imag] * 2, **style)
        axis.plot([value.real] * 2, [low.imag, high.imag], **style)
    axis.plot(
        value.real, value.imag, marker=marker, color=colour, markersize=6, linestyle="none", zorder=5, label=label
    )


def _around(axis: Any, shown: Any, probes: Any = ()) -> None:
    """Limits about the values and 98 % of the probes: single ones over a hard spot would hide the rest."""
    for part, limit in (("real", axis.set_xlim), ("imag", axis.set_ylim)):
        ends = [value for value in getattr(np.asarray(shown), part) if np.isfinite(value)]
        if len(probes):
            ends += np.percentile(getattr(probes, part), [1, 99]).tolist()
        if ends:
            margin = 0.12 * (max(ends) - min(ends)) or 0.05
            limit(min(ends) - margin, max(ends) + margin)


@styled
def draw_complex_plane(result: ImpedanceMap, path: str | Path | None = None, index: int = 0) -> Figure:
    """Grey dots: probes; crosses: statistical intervals."""
    figure, axes = subplots(1, 1, 3.6)
    axis = axes[0, 0]
    probes = result.impedance[..., index].detach().cpu().numpy().reshape(-1)
    probes = probes[np.isfinite(probes)]
    probes = probes[:: -(-len(probes) // MOST_PROBES) or 1]
    axis.plot(probes.real, probes.imag, ".", color="#8c8c8c", markersize=2.5, zorder=1, label="probes")
    cells = result.cells[result.averaging].impedance[:, index].cpu().numpy()
    if len(cells) > 1:
        open_: Any = {"markersize": 4, "markerfacecolor": "#ffffff", "color": AVERAGINGS[result.averaging], "zorder": 2}
        axis.plot(cells.real, cells.imag, "o", label=f"cells, {result.averaging}", **open_)
    shown = list(cells)
    for i, (name, liner) in enumerate(result.liner.items()):
        value, bounds = complex(liner.impedance[index]), result.bounds_of_liner(name, index)
        draw_point(axis, value, MARKERS[i], AVERAGINGS[name], f"liner, {name}", bounds)
        shown += [value, *(bounds or ())]
    for i, (name, value) in enumerate(known_of([result], index).items()):
        draw_point(axis, value, KNOWN[i], "k", plain_label(name))
        shown.append(value)
    _around(axis, shown, probes)
    label_axes(axis, PARTS[0][1], PARTS[1][1])
    return finish(figure, path, f"{family([result], index)}; crosses: {interval_words(result) or 'no interval'}", 3)


@styled
def draw_against_height(
    results: Sequence[ImpedanceMap], path: str | Path | None = None, frequency_index: int = 0
) -> Figure:
    """Z in the complex plane at several heights, all averagings (figure 19a's trend).

    Raises:
        ValueError: no result states a height.
    """
    ordered = sorted((one for one in results if one.height is not None), key=lambda one: one.height or 0.0)
    if not ordered:
        raise ValueError(
            f"{results[0].title or 'the result'} states no height; a figure over height needs one, in m, with the "
            "plane (height=)"
        )
    figure, axes = subplots(1, 1, 3.3)
    axis, shown = axes[0, 0], list[complex]()
    for i, name in enumerate(results[0].averagings):
        values = np.array([complex(one.liner[name].impedance[frequency_index]) for one in ordered])
        axis.plot(values.real, values.imag, MARKERS[i] + "-", color=AVERAGINGS[name], label=name, zorder=3)
        for one, value in zip(ordered, values, strict=True):
            draw_point(axis, value, "", AVERAGINGS[name], bounds=one.bounds_of_liner(name, frequency_index))
            if name == results[0].averaging:
                place: Any = {"textcoords": "offset points", "xytext": (4, 4), "fontsize": 7}
                axis.annotate(f"{1e3 * (one.height or 0):.3g}", (value.real, value.imag), **place)
        shown += values.tolist()
    for i, (name, value) in enumerate(known_of(results, frequency_index).items()):
        draw_point(axis, value, KNOWN[i], "k", plain_label(name))
        shown.append(value)
    _around(axis, shown)
    label_axes(axis, PARTS[0][1], PARTS[1][1])
    words = interval_words(results[0])
    caption = f"{family(results, frequency_index)}; numbers: height y in mm{f'; crosses: {words}' * bool(words)}"
    return finish(figure, path, caption, legend=ONE_ROW)


def draw_cloud(axis: Any, one: Any, colour: str, marker: str, label: str, f: int = 0) -> None:
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
    style: Any = {"color": colour, "markeredgecolor": "k", "markersize": 6, "linestyle": "none"}
    axis.plot(value.real, value.imag, marker, label=label, **style)


def near_cloud(values: np.ndarray) -> np.ndarray:
    """Which of complex values (D,) lie within ``FAR`` times the middle half of R and of X."""
    parts = np.stack([values.real, values.imag])
    low, middle, high = np.quantile(parts, (0.25, 0.5, 0.75), axis=1)[..., None]
    near: np.ndarray = (np.abs(parts - middle) <= FAR * np.maximum(high - low, TINY)).all(0)
    return near


@styled
def draw_predictions(panels: Mapping[str, Rows], title: str, path: str | Path | None = None) -> Figure:
    """Complex plane: reference, prediction as it was, by the fit with its 95 % ellipse; a panel of rows a title."""
    figure, axes = subplots(1, len(panels), 3.6)
    names = list(dict.fromkeys(row["label"] for rows in panels.values() for row in rows))
    for axis, (heading, rows) in zip(axes[0], panels.items(), strict=True):
        for row in rows:
            colour, z, true = COLOURS[names.index(row["label"])], row["impedance"], row["true"]
            if true is not None:
                axis.plot(true.real, true.imag, "*", color=colour, markersize=10)
                axis.plot([true.real, z.real], [true.imag, z.imag], ":", color=colour, linewidth=0.8)
            before: Any = {"color": colour, "markerfacecolor": "white", "markersize": 7}
            axis.plot(row["before"].real, row["before"].imag, "o", **before)
            axis.plot(z.real, z.imag, "s", color=colour, markersize=3.5)
            axis.plot(*_ellipse(row), color=colour, linewidth=0.9)
        axis.axhline(0, color="0.8", linewidth=0.6, zorder=0)
        axis.margins(0.08)
        head_panel(axis, heading)
        axis.set_xlabel(PARTS[0][1])
    axes[0, 0].set_ylabel(PARTS[1][1])
    for i, name in enumerate(names):
        entry(axes[0, 0], plain_label(name), color=COLOURS[i])
    entry(axes[0, 0], "reference", "*", markerfacecolor="k")
    entry(axes[0, 0], "model as it was", "o", markerfacecolor="white")
    entry(axes[0, 0], "calibrated, 95 % ellipse", "s", markerfacecolor="k")
    return finish(figure, path, title, legend=3)


def _ellipse(row: Mapping[str, Any]) -> tuple[Any, Any]:
    """Points of the 95 % ellipse of the parameters' spread."""
    spread, z = row["standard"], row["impedance"]
    product = row["correlation"] * spread.real * spread.imag
    covariance = np.array([[spread.real**2, product], [product, spread.imag**2]])
    if not np.isfinite(covariance).all():
        return [], []
    widths, axes = np.linalg.eigh(covariance)
    turn = np.linspace(0, 2 * np.pi, 181)
    circle = np.stack([np.cos(turn), np.sin(turn)]) * np.sqrt(np.maximum(widths, 0))[:, None]
    points = ELLIPSE * axes @ circle
    return z.real + points[0], z.imag + points[1]

"""Pictures of Z in the complex plane: probes, cells, averagings, heights, draws, predictions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.records import ImpedanceMap
from torchliner.report import figure as look
from torchliner.report.curves import ORDERS, alongside_at, family, references_of
from torchliner.report.numbers import interval_words

MOST_PROBES = 1500
NORMAL = 1.96  # standard deviations of a 95 % interval
KNOWN = "*x+1234" * 9  # markers of what is known from elsewhere
AXES = {"xlabel": look.PARTS[0][1], "ylabel": look.PARTS[1][1]}
Rows = Sequence[Mapping[str, Any]]


def known_of(results: Sequence[ImpedanceMap], index: int) -> dict[str, complex]:
    """References of the file, at its tone, other methods, Goodrich."""
    found = references_of(results, index)
    for other, f in alongside_at(results, index):
        found |= {f"{other.name}, {word}": complex(getattr(other, f"liner_impedance{end}")[f]) for end, word in ORDERS}
    return found


def draw_point(axis: Any, value: complex, bounds: Any = None, **style: Any) -> None:
    """One Z, with a cross of the intervals of R and of X where known."""
    axis.plot(value.real, value.imag, **{"linestyle": "none", "markersize": 6, "zorder": 5} | style)
    if bounds is not None:
        low, high = bounds
        axis.hlines(value.imag, low.real, high.real, color=style["color"], linewidth=0.9)
        axis.vlines(value.real, low.imag, high.imag, color=style["color"], linewidth=0.9)


def _finish_plane(figure: Any, results: Sequence[ImpedanceMap], index: int, path: Any, words: str) -> look.Figure:
    """What is known from elsewhere, limits, labels, caption."""
    axis, interval = figure.axes[0], interval_words(results[0])
    for marker, (name, value) in zip(KNOWN, known_of(results, index).items(), strict=False):
        draw_point(axis, value, marker=marker, color="k", label=look.plain_label(name))
    look.frame(axis, "xy")
    axis.set(**AXES)
    return look.finish(figure, path, f"{family(results, index)}{words}{f'; crosses: {interval}' * bool(interval)}", 3)


@look.styled
def draw_complex_plane(result: ImpedanceMap, path: str | Path | None = None, index: int = 0) -> look.Figure:
    """Grey dots: probes; crosses: statistical intervals."""
    figure, (axis,) = look.panels_of(1, 3.6)
    probes = result.impedance[..., index].detach().cpu().numpy().ravel()
    probes = probes[:: -(-len(probes) // MOST_PROBES)]
    axis.plot(probes.real, probes.imag, ".", color="0.55", markersize=2.5, zorder=1, label="probes")
    cells, name = result.cells[result.averaging].impedance[:, index].cpu().numpy(), result.averaging
    if len(cells) > 1:
        style: Any = {"color": look.AVERAGINGS[name], "markerfacecolor": "w", "label": f"cells, {name}"}
        axis.plot(cells.real, cells.imag, "o", zorder=2, **style)
    for marker, (name, liner) in zip(look.MARKERS, result.liner.items(), strict=False):
        style = {"marker": marker, "color": look.AVERAGINGS[name], "label": f"liner, {name}"}
        draw_point(axis, complex(liner.impedance[index]), result.bounds_of_liner(name, index), **style)
    return _finish_plane(figure, [result], index, path, "")


@look.styled
def draw_against_height(
    results: Sequence[ImpedanceMap], path: str | Path | None = None, frequency_index: int = 0
) -> look.Figure:
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
    figure, (axis,) = look.panels_of(1, 3.3)
    for marker, name in zip(look.MARKERS, results[0].averagings, strict=False):
        values = np.array([complex(one.liner[name].impedance[frequency_index]) for one in ordered])
        axis.plot(values.real, values.imag, color=look.AVERAGINGS[name], marker=marker, label=name)
        for one, value in zip(ordered, values, strict=True):
            draw_point(axis, value, one.bounds_of_liner(name, frequency_index), color=look.AVERAGINGS[name])
            text = f"{1e3 * (one.height or 0):.3g} mm" * (name == "admittance")
            axis.annotate(text, (value.real, value.imag), textcoords="offset points", xytext=(4, 4))
    return _finish_plane(figure, results, frequency_index, path, "; lengths: height y")


def draw_cloud(axis: Any, one: Any, colour: str, marker: str, label: str, f: int = 0) -> None:
    """Impedances of the draws in their plane, and the one without errors (figure 14a)."""
    if one.draws is not None:
        drawn = one.draws.impedance[:, f].numpy()
        axis.plot(drawn.real, drawn.imag, ".", color=colour, markersize=1.5, alpha=0.4)
    draw_point(axis, complex(one.impedance[f]), marker=marker, color=colour, markeredgecolor="k", label=label)


@look.styled
def draw_predictions(panels: Mapping[str, Rows], title: str, path: str | Path | None = None) -> look.Figure:
    """Complex plane: reference, prediction as it was, by the fit with its 95 % intervals; a panel of rows a title."""
    figure, axes = look.panels_of(len(panels), 3.6)
    names = list(dict.fromkeys(row["label"] for rows in panels.values() for row in rows))
    for axis, (heading, rows) in zip(axes, panels.items(), strict=True):
        for row in rows:
            colour, z, true = look.COLOURS[names.index(row["label"])], row["impedance"], row["true"]
            if true is not None:
                draw_point(axis, true, marker="*", color=colour, markersize=10)
                axis.plot([true.real, z.real], [true.imag, z.imag], ":", color=colour, linewidth=0.8)
            draw_point(axis, row["before"], marker="o", color=colour, markerfacecolor="white")
            half = NORMAL * row["standard"]
            draw_point(axis, z, (z - half, z + half), marker="s", color=colour, markersize=3.5)
        axis.set(title=heading, **AXES)
    for name, colour in zip(names, look.COLOURS, strict=False):
        look.entry(axes[0], look.plain_label(name), color=colour)
    look.entry(axes[0], "reference", "*")
    look.entry(axes[0], "model as it was", "o", markerfacecolor="white")
    look.entry(axes[0], "calibrated, 95 % interval", "s")
    return look.finish(figure, path, title, legend=3)

"""The one way to make a figure."""

from __future__ import annotations

import functools
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

from torchliner.io.whole_file import PICTURES, written_whole
from torchliner.report.numbers import Curves

PARTS = (
    ("resistance", r"resistance, $\mathrm{Re}\,Z$"),
    ("reactance", r"reactance, $\mathrm{Im}\,Z$"),
)
Figure = Any  # matplotlib.figure.Figure; imported when drawn


def require_matplotlib() -> Any:
    """The module; ImportError where it is not installed."""
    try:
        import matplotlib
    except ImportError as error:
        raise ImportError("figures need matplotlib: pip install torchliner[report]") from error
    return matplotlib


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Draw and save under the style sheet without touching the caller's settings."""

    @functools.wraps(draw)
    def inner(*arguments: Any, **options: Any) -> Figure:
        with require_matplotlib().rc_context(RC):
            return draw(*arguments, **options)

    return inner


@functools.cache
def _shown() -> Any:
    """A figure that notebooks show, without pyplot and its list of open figures."""
    from matplotlib.figure import Figure

    class Shown(Figure):
        def _repr_png_(self) -> bytes:
            picture = io.BytesIO()
            self.savefig(picture, format="png")
            return picture.getvalue()

    return Shown


def panels_of(columns: int, height: float, given: Any = None) -> tuple[Figure, list[Any]]:
    """A row of new axes in a new figure, or those ``given``: one of the first panel, or each.

    Raises:
        ValueError: more or fewer axes than panels.
    """
    if given is None:
        figure, axes = subplots(1, columns, height)
        return figure, list(axes[0])
    found = [given] if hasattr(given, "plot") else list(given)
    if len(found) not in (1, columns):
        raise ValueError(f"{len(found)} axes are given; {columns} panels need {columns}, or one")
    return found[0].figure, found


def subplots(rows: int, columns: int, height: float) -> tuple[Figure, Any]:
    """A figure of the page's width and its axes, lettered."""
    figure = _shown()(figsize=(WIDTH, height))
    axes = figure.subplots(rows, columns, squeeze=False)
    if columns > 1:
        for letter, axis in zip("abcdef", axes.flat, strict=False):
            axis.set_title(f"({letter})", loc="left")
    return figure, axes


def impedance_panels(
    height: float, across: str, given: Any = None
) -> tuple[Figure, list[tuple[Any, str]]]:
    """Resistance and reactance beside each other over ``across``: each axis with its part."""
    figure, axes = panels_of(2, height, given)
    for axis, (_, label) in zip(axes, PARTS, strict=False):
        label_axes(axis, across, label)
    return figure, [(axis, part) for axis, (part, _) in zip(axes, PARTS, strict=False)]


def label_axes(axis: Any, across: str, up: str) -> None:
    """Symbols and units."""
    axis.set_xlabel(across)
    axis.set_ylabel(up)


def draw_curve(
    axis: Any, curves: Curves, name: str, colour: str, scale: float = 1.0, **style: Any
) -> None:
    """A column over ``scale`` times the variable; "{name} low" and "{name} high" are its band."""
    x = scale * curves.at
    if f"{name} low" in curves.values:
        draw_band(axis, x, curves.values[f"{name} low"], curves.values[f"{name} high"], colour)
    axis.plot(x, curves.values[name], color=colour, **{"label": curves.label} | style)


def draw_band(axis: Any, x: Any, low: Any, high: Any, colour: str, alpha: float = 0.2) -> None:
    """An interval along a curve, shaded."""
    axis.fill_between(x, low, high, color=colour, alpha=alpha, linewidth=0)


def legend_below(figure: Figure, axis: Any, columns: int) -> None:
    """The names in one panel, in so many columns at most, below all panels."""
    handles, labels = axis.get_legend_handles_labels()
    if labels:
        columns = min(columns, len(labels))
        figure.legend(handles, labels, loc="outside lower center", ncols=columns)


def finish(
    figure: Figure, path: str | Path | None, title: str | None = None, legend: int = 0,
    given: Any = None,
) -> Any:  # fmt: skip
    """Legend, heading and file, where asked for; the figure, or the axes that were ``given``,
    whose figure is another's to finish.

    Args:
        figure: with everything drawn.
        path: picture to write.
        title: above all panels.
        legend: columns, at most, of the names in the first panel, below all panels.
        given: axes of the caller.
    """
    if given is not None:
        return given
    if legend:
        legend_below(figure, figure.axes[0], legend)
    if title is not None:
        figure.suptitle(title, fontsize=9)
    if path is not None:
        with written_whole(path, *PICTURES) as temporary:
            figure.savefig(temporary, format=Path(path).suffix[1:].lower())
    return figure


ONE_ROW = 99  # of a legend
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000") * 99
MARKERS = ("o", "s", "^", "D", "v", "P") * 99  # both recur
WIDTH = 6.6  # in, text width of a journal page

RC: Any = {
    "font.size": 9.0, "font.family": "serif", "font.serif": ["STIXGeneral", "DejaVu Serif"],
    "mathtext.fontset": "stix", "axes.titlesize": 9.0, "axes.labelsize": 9.0,
    "legend.fontsize": 8.0, "legend.frameon": False, "xtick.labelsize": 8.0, "ytick.labelsize": 8.0,
    "xtick.direction": "in", "ytick.direction": "in", "xtick.top": True, "ytick.right": True,
    "lines.linewidth": 1.2, "lines.markersize": 4.0, "axes.linewidth": 0.6, "figure.dpi": 120,
    "savefig.dpi": 200, "figure.constrained_layout.use": True,
}  # fmt: skip

"""The one way to make a figure."""

from __future__ import annotations

import functools
import io
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import numpy as np

from torchliner.io.whole_file import PICTURES, printable, written_whole
from torchliner.report.numbers import Curves
from torchliner.report.typesetting import typeset, typeset_label

PARTS = (
    ("resistance", r"resistance, $\mathrm{Re}\,Z$"),
    ("reactance", r"reactance, $\mathrm{Im}\,Z$"),
)
Figure = Any  # matplotlib.figure.Figure; imported when drawn
SPL, INCIDENT = "SPL (dB re 20 µPa)", "incident level (dB re 20 µPa)"
V_RMS, U_RMS = r"$v'_{\mathrm{rms}}$", r"$u'_{\mathrm{rms}}$"
WIDTHS = {"one": 3.4, "page": 5.3, "two": 7.0}  # in: a column, a text block, two columns
STACKED = 4.5  # in, below which panels that stand beside each other stand one above the other
LEGEND_ROOM = 0.4  # in, of a figure's height; a higher legend makes the figure higher
MOST_POINTS = 4000  # of a curve that is drawn as lines and not as a picture
PEAK = 8  # medians of a positive quantity, above which its axis is logarithmic
DESCRIPTION = {".png": "Description", ".svg": "Description", ".pdf": "Subject"}  # in the file


_style: ContextVar[tuple[float, bool]] = ContextVar("style", default=(WIDTHS["page"], False))  # width, title


@contextmanager
def figure_style(width: str | float = "page", *, title: bool = False) -> Iterator[None]:
    """All figures within the block have this width; text is 8 pt at that size.

    Args:
        width: in, or "one" (3.4, a column; panels one above the other), "page" (5.3, the text
            block of a page, default) or "two" (7, two columns).
        title: the caption above the panels too; it is always ``figure.caption`` and stands in a
            PNG, SVG or PDF as its description.
    Raises:
        ValueError: another word, or below 2 or above 20 in.

    >>> plane = tl.VelocityPlane(torch.randn(3, 900), sampling_rate=42e3, x=[0.0, 1e-3, 2e-3])
    >>> with tl.figure_style("one"):
    ...     print(plane.plot().get_size_inches()[0])
    3.4
    """
    try:
        inches = WIDTHS[width] if isinstance(width, str) and width in WIDTHS else float(width)
    except ValueError:
        inches = math.nan
    if not 2 <= inches <= 20:
        raise ValueError(f"a figure's width is {width!r}; it must be {', '.join(WIDTHS)}, or 2 to 20 (in)")
    token = _style.set((inches, title))
    try:
        yield
    finally:
        _style.reset(token)


def style_width() -> float:
    """Of a figure drawn now, in."""
    return _style.get()[0]


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
        caption = ""

        def savefig(self, *arguments: Any, **options: Any) -> None:
            # Fonts are looked up when drawn, which may be long after ``styled``.
            kept = {key: value for key, value in RC.items() if key != "svg.fonttype"}
            with require_matplotlib().rc_context(kept):
                super().savefig(*arguments, **options)

        def _repr_png_(self) -> bytes:
            self.savefig(picture := io.BytesIO(), format="png")
            return picture.getvalue()

    return Shown


def panels_of(columns: int, height: float, given: Any = None) -> tuple[Figure, list[Any]]:
    """A row of new axes in a new figure, or those ``given``: one of the first panel, or each."""
    if given is None:
        figure, axes = subplots(1, columns, height)
        return figure, list(axes[0])
    found = [given] if hasattr(given, "plot") else list(given)
    if len(found) not in (1, columns):
        raise ValueError(f"{len(found)} axes are given; {columns} panels need {columns}, or one")
    return found[0].figure, found


def subplots(rows: int, columns: int, height: float, beside: bool = False) -> tuple[Figure, Any]:
    """A figure and its axes (rows, columns), lettered where there are several.

    Panels of one row stand one above the other in a narrow figure, but for those that share what
    stands at their left, ``beside``.
    """
    width = _style.get()[0]
    narrow = width < STACKED and rows == 1 < columns and not beside
    shape = (columns, 1) if narrow else (rows, columns)
    figure = _shown()(figsize=(width, height * (0.8 * columns if narrow else 1)))
    axes = figure.subplots(*shape, squeeze=False).reshape(rows, columns)
    if axes.size > 1:
        for letter, axis in zip(ascii_lowercase, axes.flat, strict=False):
            axis.set_title(f"({letter})", loc="left")
    return figure, axes


def head_panel(axis: Any, words: str) -> None:
    """Words behind the letter of a panel."""
    axis.set_title(f"{axis.get_title(loc='left')} {words}".strip(), loc="left")


def impedance_panels(height: float, across: str, given: Any = None) -> tuple[Figure, list[tuple[Any, str]]]:
    """Resistance and reactance beside each other over ``across``: each axis with its part."""
    figure, axes = panels_of(2, height, given)
    for axis, (_, label) in zip(axes, PARTS, strict=False):
        label_axes(axis, across, label)
    return figure, [(axis, part) for axis, (part, _) in zip(axes, PARTS, strict=False)]


def drawn_before(axes: Sequence[Any], more: int) -> int:
    """How many runs the axes show already, so that a further one has its own colour; ``more`` are to come."""
    count: int = getattr(axes[0], "torchliner_runs", 0)
    for axis in axes:
        axis.torchliner_runs = count + more
    return count


def label_axes(axis: Any, across: str, up: str) -> None:
    """Symbols and units."""
    axis.set_xlabel(across)
    axis.set_ylabel(up)


def draw_curve(axis: Any, curves: Curves, name: str, colour: str, scale: float = 1.0, **style: Any) -> None:
    """A column over ``scale`` times the variable; "{name} low" and "{name} high" are its band."""
    x = scale * curves.at
    style |= {"rasterized": len(x) > MOST_POINTS}
    if f"{name} low" in curves.values:
        draw_band(axis, x, curves.values[f"{name} low"], curves.values[f"{name} high"], colour)
    axis.plot(x, curves.values[name], color=colour, **{"label": curves.label} | style)


def break_at_poles(axis: Any) -> None:
    """Take out the segments of curves that would join both sides of a pole: longer than the axis is high."""
    low, high = axis.get_ylim()
    for line in axis.lines:
        x, y = np.asarray(line.get_xdata(), dtype=float), np.asarray(line.get_ydata(), dtype=float)
        far = np.flatnonzero(np.abs(np.diff(y)) > high - low)
        if line.get_transform().contains_branch(axis.transData) and len(far):
            line.set_data(np.insert(x, far + 1, np.nan), np.insert(y, far + 1, np.nan))


def draw_band(axis: Any, x: Any, low: Any, high: Any, colour: str, alpha: float = 0.2) -> None:
    """An interval along a curve, shaded."""
    axis.fill_between(x, low, high, color=colour, alpha=alpha, linewidth=0)


def entry(axis: Any, label: str, marker: str = "", **style: Any) -> None:
    """A row of the legend without data: a marker, a line, or, of a ``width``, a band."""
    if "width" in style:
        style = {"linewidth": style.pop("width"), "solid_capstyle": "butt"} | style
    usual = {"color": "k", "label": label, "marker": marker, "linestyle": "none" if marker else "-"}
    axis.plot([], [], scalex=False, scaley=False, **usual | style)


def plain_label(text: str) -> str:
    """A name from a file, in which nothing is a formula or moves a cursor."""
    return " ".join(printable(text).split()).replace("$", r"\$")


def frame(axis: Any, values: Any, *bands: Any) -> bool:
    """Limits that show all ``values``, and of bands what lies within one span of them; a logarithmic axis where a peak
    of positive values would squash the rest. Whether bands go on beyond."""
    before = getattr(axis, "torchliner_values", np.zeros(0))
    shown = axis.torchliner_values = np.concatenate([before, _finite(values)])
    reach = np.concatenate([shown, *map(_finite, bands)])
    if not shown.size:
        return False
    low, high = shown.min(), shown.max()
    if low > 0 and high > PEAK * np.median(shown):
        axis.set_yscale("log")
        plain_log_ticks(axis.yaxis)
        axis.set_ylim(low / 1.3, high * 1.3)
    else:
        span = high - low or abs(high) or 1.0
        ends = max(low - span, reach.min()), min(high + span, reach.max())
        axis.set_ylim(ends[0] - 0.06 * span, ends[1] + 0.06 * span)
    bottom, top = axis.get_ylim()
    return bool(reach.min() < bottom or reach.max() > top)


def _finite(values: Any) -> Any:
    flat = np.ravel(np.asarray(values, dtype=float))
    return flat[np.isfinite(flat)]


def plain_log_ticks(side: Any) -> None:
    """0.1, 0.2, 0.5, 1 ... on a logarithmic axis."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    side.set_major_locator(LogLocator(subs=(1, 2, 5)))
    side.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    side.set_minor_formatter(NullFormatter())


def legend_below(figure: Figure, axis: Any, columns: int) -> None:
    """The names in one panel, in so many columns at most, below all panels."""
    handles, labels = axis.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    place_legend(figure, list(unique.values()), list(unique), columns)


def place_legend(figure: Figure, handles: Sequence[Any], labels: Sequence[str], columns: int) -> None:
    """Below all panels, in so many columns as the figure is wide for."""
    names = [typeset_label(label) for label in labels]
    for count in range(min(columns, len(names)), 0, -1):
        legend = figure.legend(handles, names, loc="outside lower center", ncols=count)
        size = legend.get_window_extent()
        if count == 1 or size.width <= figure.bbox.width:
            width, height = figure.get_size_inches()
            more = size.height / figure.dpi - LEGEND_ROOM
            figure.set_size_inches(width, height + max(0, more))
            return
        legend.remove()


def finish(
    figure: Figure, path: str | Path | None, caption: str | None = None, legend: int = 0, given: Any = None
) -> Any:
    """Legend, caption and file, where asked for; the figure, or the axes that were ``given``, whose figure is another's
    to finish.

    Args:
        figure: with everything drawn.
        path: picture to write.
        caption: of a document around it: ``figure.caption``, and the description in the file.
        legend: columns, at most, of the names in the first panel, below all panels.
        given: axes of the caller.
    """
    if given is not None:
        return given
    if legend:
        legend_below(figure, figure.axes[0], legend)
    for one in filter(None, (axis.get_legend() for axis in figure.axes)):
        for text in one.get_texts():
            text.set_text(typeset_label(text.get_text()))
    figure.caption = typeset(" ".join((caption or "").split()))
    if _style.get()[1] and figure.caption:
        figure.suptitle(figure.caption.replace("$", r"\$"), wrap=True)
    if path is not None:
        suffix = Path(path).suffix.lower()
        facts = {DESCRIPTION[suffix]: figure.caption} if suffix in DESCRIPTION else None
        with written_whole(path, *PICTURES) as temporary:
            figure.savefig(temporary, format=suffix[1:], metadata=facts)
    return figure


ONE_ROW = 99  # of a legend
AVERAGINGS = {"admittance": "#0072B2", "velocity": "#D55E00", "phase-locked": "#009E73"}  # colours, everywhere
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000") * 99
MARKERS = ("o", "s", "^", "D", "v", "P") * 99  # both recur
LINES: tuple[Any, ...] = ("-", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1))) * 99  # of curves
REFERENCES: tuple[dict[str, Any], ...] = (
    {"color": "0.6", "linewidth": 2.4, "linestyle": "-", "zorder": 1},  # others stay visible on it
    *({"color": "k", "linewidth": 0.9, "linestyle": each} for each in ("--", ":", "-.")),
)

RC: Any = {
    "font.size": 8.0,
    "font.family": "serif",
    "font.serif": ["STIXGeneral", "DejaVu Serif"],
    "mathtext.fontset": "stix",
    **dict.fromkeys(("axes.titlesize", "axes.labelsize", "figure.titlesize", "legend.fontsize"), 8.0),
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize"), 8.0),
    "legend.frameon": False,
    "legend.columnspacing": 1.4,
    "legend.handletextpad": 0.6,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
    "lines.linewidth": 1.1,
    "lines.markersize": 3.6,
    "axes.linewidth": 0.6,
    "axes.unicode_minus": True,
    "figure.dpi": 120,
    "savefig.dpi": 250,
    "pdf.fonttype": 42,
    "ps.fonttype": 42,
    "svg.fonttype": "none",
    "figure.constrained_layout.use": True,
}

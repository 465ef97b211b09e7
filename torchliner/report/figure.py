"""The one style of all figures: colours, panels, curves with their intervals, legend, caption, file."""

from __future__ import annotations

import functools
import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import numpy as np

from torchliner.io.whole_file import PICTURES, printable, written_whole
from torchliner.report.numbers import Curves, part_of
from torchliner.report.typesetting import typeset, typeset_label

Figure = Any  # matplotlib.figure.Figure; imported when drawn
PARTS = (("resistance", r"resistance, $\mathrm{Re}\,Z$"), ("reactance", r"reactance, $\mathrm{Im}\,Z$"))
SPL, INCIDENT = "SPL (dB re 20 µPa)", "incident level (dB re 20 µPa)"
V_RMS, U_RMS = r"$v'_{\mathrm{rms}}$", r"$u'_{\mathrm{rms}}$"
X_MM, Y_MM, KHZ = "$x$ (mm)", "$y$ (mm)", "$f$ (kHz)"
SCALES = {"x (m)": 1e3, "frequency (Hz)": 1e-3}  # of variables: their factor on an axis
WIDTHS = {"one": 3.4, "page": 5.3, "two": 7.0}  # in: a column, a text block, two columns
STACKED = 4.5  # in, below which panels that stand beside each other stand one above the other
CHARACTER, HANDLE, ROW = 0.053, 0.5, 0.15  # in, of a legend at 8 pt
MOST_POINTS = 4000  # of a curve that is drawn as lines and not as a picture
DESCRIPTION = {".png": "Description", ".svg": "Description", ".pdf": "Subject"}  # in the file

AVERAGINGS = {"admittance": "#0072B2", "velocity": "#D55E00", "phase-locked": "#009E73"}  # colours, everywhere
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000") * 99
MARKERS = ("o", "s", "^", "D", "v", "P") * 99  # both recur
LINES: tuple[Any, ...] = ("-", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1))) * 99  # of curves
REFERENCES: tuple[dict[str, Any], ...] = (
    {"color": "0.6", "linewidth": 2.4, "linestyle": "-", "zorder": 1},  # others stay visible on it
    *({"color": "k", "linewidth": 0.9, "linestyle": each} for each in ("--", ":", "-.")),
)
BAND: Any = {"linewidth": 5, "solid_capstyle": "butt"}  # of a legend's row for a band
TEXT = ("font.size", "axes.titlesize", "axes.labelsize", "figure.titlesize", "legend.fontsize")
RC: Any = {
    **dict.fromkeys((*TEXT, "xtick.labelsize", "ytick.labelsize"), 8.0),
    "font.family": "serif",
    "font.serif": ["STIXGeneral", "DejaVu Serif"],
    "mathtext.fontset": "stix",
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
    "figure.dpi": 120,
    "savefig.dpi": 250,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "figure.constrained_layout.use": True,
}
_width: ContextVar[float] = ContextVar("width", default=WIDTHS["page"])


@contextmanager
def figure_style(width: str | float = "page") -> Iterator[None]:
    """All figures within the block have this width; text is 8 pt at that size.

    Args:
        width: in, or "one" (3.4, a column; panels one above the other), "page" (5.3, the text block of a page,
            default) or "two" (7, two columns).
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
    token = _width.set(inches)
    try:
        yield
    finally:
        _width.reset(token)


def require_matplotlib() -> Any:
    """The module; ImportError where it is not installed."""
    try:
        import matplotlib
    except ImportError as error:
        raise ImportError("figures need matplotlib: pip install torchliner[report]") from error
    return matplotlib


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Draw and save in this style without touching the caller's settings."""

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

        @styled
        def savefig(self, *arguments: Any, **options: Any) -> Any:
            """Fonts are looked up when a figure is saved."""
            return super().savefig(*arguments, **options)

        def _repr_png_(self) -> bytes:
            self.savefig(picture := io.BytesIO(), format="png")
            return picture.getvalue()

    return Shown


def subplots(rows: int, columns: int, height: float, beside: bool = False) -> tuple[Figure, Any]:
    """A figure and its axes (rows, columns), lettered where there are several; those of one row stand one above the
    other in a narrow figure, unless they share what stands at their left, ``beside``."""
    width = _width.get()
    narrow = width < STACKED and rows == 1 < columns and not beside
    shape = (columns, 1) if narrow else (rows, columns)
    figure = _shown()(figsize=(width, height * (0.8 * columns if narrow else 1)))
    axes = figure.subplots(*shape, squeeze=False).reshape(rows, columns)
    for letter, axis in zip(ascii_lowercase, axes.flat, strict=False):
        axis.set_title(f"({letter})" * (axes.size > 1), loc="left")
    return figure, axes


def panels_of(columns: int, height: float, given: Any = None) -> tuple[Figure, list[Any]]:
    """A row of new axes in a new figure, or those ``given``: one of the first panel, or each."""
    if given is None:
        figure, axes = subplots(1, columns, height)
        return figure, list(axes[0])
    found = [given] if hasattr(given, "plot") else list(given)
    if len(found) not in (1, columns):
        raise ValueError(f"{len(found)} axes are given; {columns} panels need {columns}, or one")
    return found[0].figure, found


def impedance_panels(height: float, across: str, given: Any = None) -> tuple[Figure, list[tuple[Any, str]]]:
    """Resistance and reactance beside each other over ``across``: each axis with its part."""
    figure, axes = panels_of(2, height, given)
    for axis, (_, label) in zip(axes, PARTS, strict=False):
        axis.set(xlabel=across, ylabel=label)
    return figure, [(axis, part) for axis, (part, _) in zip(axes, PARTS, strict=False)]


def colour_of(i: int, label: str = "", **style: Any) -> dict[str, Any]:
    """Colour, line and label of the i-th curve."""
    return {"color": COLOURS[i], "linestyle": LINES[i], "label": plain_label(label)} | style


def drawn_before(axes: Sequence[Any], more: int) -> int:
    """How many runs the axes show already, so that a further one has its own colour; ``more`` are to come."""
    count: int = getattr(axes[0], "torchliner_runs", 0)
    for axis in axes:
        axis.torchliner_runs = count + more
    return count


def draw_values(axis: Any, x: Any, y: Any, bounds: Any = None, bars: bool = False, **style: Any) -> None:
    """Values along x with their interval as a band, or as bars."""
    axis.plot(x, y, **{"rasterized": len(x) > MOST_POINTS} | style)
    if bounds is not None and bars:
        axis.vlines(x, *bounds, color=style["color"], linewidth=1.2, zorder=2)
    elif bounds is not None:
        axis.fill_between(x, *bounds, color=style["color"], alpha=0.2, linewidth=0)


def draw_impedance(panels: Any, x: Any, z: Any, bounds: Any = None, bars: bool = False, **style: Any) -> None:
    """Both parts of complex values along x in their panels, with the interval between two complex ``bounds``."""
    z, bounds = np.asarray(z), None if bounds is None else [np.asarray(end) for end in bounds]
    for axis, part in panels:
        ends = None if bounds is None else [part_of(end, part) for end in bounds]
        draw_values(axis, x, part_of(z, part), ends, bars, **style)


def draw_curve(axis: Any, curves: Curves, name: str, **style: Any) -> None:
    """A column with its interval over the variable, in mm or kHz."""
    low, high = (curves.values.get(f"{name} {end}") for end in ("low", "high"))
    x = SCALES.get(curves.variable, 1.0) * curves.at
    draw_values(axis, x, curves.values[name], None if low is None else (low, high), **style)


def draw_references(panels: Any, references: Mapping[str, complex], along: str = "x") -> None:
    """Lines of impedances known from elsewhere, all along x or y."""
    for i, (name, value) in enumerate(references.items()):
        for axis, part in panels:
            draw = axis.axhline if along == "x" else axis.axvline
            draw(part_of(value, part), label=plain_label(name), **REFERENCES[i % 4])


def frame(axis: Any, sides: str = "y", poles: bool = False) -> None:
    """Limits that show all lines, but not all of wider intervals. Near ``poles`` they show the middle 90 % of the
    values, and a curve breaks where it leaps farther than the axis is high."""
    shares, margin = ((5, 95), 0.5) if poles else ((0, 100), 0.1)
    for i, side in enumerate("xy"):
        ends: list[float] = []
        for line in axis.lines if side in sides else ():
            values = np.asarray(line.get_data()[i], dtype=float)
            values = values[np.isfinite(values)]
            if len(values) and line.get_transform().contains_branch_seperately(axis.transData)[i]:
                ends += np.percentile(values, shares).tolist()
        if ends:
            wide = margin * (max(ends) - min(ends)) or 0.05
            axis.set(**{f"{side}lim": (min(ends) - wide, max(ends) + wide)})
    low, high = axis.get_ylim()
    for line in axis.lines if poles else ():
        x, y = (np.asarray(each, dtype=float) for each in line.get_data())
        far = np.flatnonzero(np.abs(np.diff(y)) > high - low) + 1
        line.set_data(np.insert(x, far, np.nan), np.insert(y, far, np.nan))


def entry(axis: Any, label: str, marker: str = "", **style: Any) -> None:
    """A row of the legend without data: a marker or a line."""
    usual = {"color": "k", "label": label, "marker": marker, "linestyle": "none" if marker else "-"}
    axis.plot([], [], scalex=False, scaley=False, **usual | style)


def plain_label(text: str) -> str:
    """A name from a file, in which nothing is a formula or moves a cursor."""
    return " ".join(printable(text).split()).replace("$", r"\$")


def legend_below(figure: Figure, axes: Any, columns: int = 4) -> None:
    """The names in the axes, each once, below all panels, in as many columns as the figure is wide for."""
    rows: dict[str, Any] = {}
    for axis in np.ravel(axes):
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            rows.setdefault(typeset_label(label), handle)
    if rows:
        width, height = figure.get_size_inches()
        fitting = int(width / (HANDLE + CHARACTER * max(map(len, rows))))
        columns = max(1, min(columns, fitting, len(rows)))
        figure.set_size_inches(width, height + ROW * (math.ceil(len(rows) / columns) - 1))
        figure.legend(rows.values(), rows, loc="outside lower center", ncols=columns)


def finish(
    figure: Figure, path: str | Path | None, caption: str | None = None, legend: int = 0, given: Any = None
) -> Any:
    """Legend of the first panel in at most so many columns, caption (``figure.caption``, and the description in the
    file) and file; returns the figure, or the axes that were ``given``, whose figure is another's to finish."""
    if given is not None:
        return given
    if legend:
        legend_below(figure, figure.axes[:1], legend)
    figure.caption = typeset(" ".join((caption or "").split()))
    if path is not None:
        suffix = Path(path).suffix.lower()
        facts = {DESCRIPTION[suffix]: figure.caption} if suffix in DESCRIPTION else None
        with written_whole(path, *PICTURES) as temporary:
            figure.savefig(temporary, format=suffix[1:], metadata=facts)
    return figure

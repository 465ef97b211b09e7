"""The one style of all figures: colours, panels, curves with their intervals, legend, caption, file.

Nearly every figure is resistance and reactance beside each other over one variable: ``draw_parts`` of curves, which
``curve_of`` makes of rows. Fonts, ticks and sizes stand in ``style.mplstyle``; text is 8 pt at the width of a page's
text block. For other widths give axes of your own.
"""

import functools
import io
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import numpy as np

from torchliner.io.whole_file import PICTURES, printable, written_whole

Figure = Any  # matplotlib.figure.Figure; imported when drawn
Rows = Sequence[Mapping[str, Any]]
STYLE = Path(__file__).with_name("style.mplstyle")
PARTS = (("resistance", r"resistance, $\mathrm{Re}\,Z$"), ("reactance", r"reactance, $\mathrm{Im}\,Z$"))
PLANE = {"xlabel": PARTS[0][1], "ylabel": PARTS[1][1]}  # of axes
SPL, INCIDENT = "SPL (dB re 20 µPa)", "incident level (dB re 20 µPa)"
V_RMS = r"$v'_{\mathrm{rms}}$"
X_MM, Y_MM, KHZ = "$x$ (mm)", "$y$ (mm)", "$f$ (kHz)"
SCALES = {"x (m)": 1e3, "x": 1e3, "height": 1e3, "frequency (Hz)": 1e-3, "frequency": 1e-3}  # from SI to an axis
WIDTH = 5.3  # in
CHARACTER, HANDLE, ROW = 0.053, 0.5, 0.15  # in, of a legend at 8 pt
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
        with require_matplotlib().rc_context(fname=STYLE):
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


def subplots(rows: int, columns: int, height: float) -> tuple[Figure, Any]:
    """A figure and its axes (rows, columns), lettered where there are several."""
    figure = _shown()(figsize=(WIDTH, height))
    axes = figure.subplots(rows, columns, squeeze=False)
    for letter, axis in zip(ascii_lowercase, axes.flat, strict=False):
        axis.set_title(f"({letter})" * (axes.size > 1), loc="left")
    return figure, axes


def panels_of(columns: int, height: float, given: Any = None, runs: int = 1) -> tuple[Figure, list[Any]]:
    """A row of new axes in a new figure, or those ``given``: one of the first panel, or each; they remember how many
    ``runs`` are drawn into them."""
    if given is None:
        figure, axes = subplots(1, columns, height)
        found = list(axes[0])
    else:
        found = [given] if hasattr(given, "plot") else list(given)
        figure = found[0].figure
    if len(found) not in (1, columns):
        raise ValueError(f"{len(found)} axes are given; {columns} panels need {columns}, or one")
    found[0].torchliner_runs = runs_in(found) + runs
    return figure, found


def runs_in(axes: Any) -> int:
    """How many runs the axes show already, so that a further one has its own colour."""
    first = axes if axes is None or hasattr(axes, "plot") else axes[0]
    return getattr(first, "torchliner_runs", 0)


@styled
def draw_parts(
    curves: Rows,
    across: str,
    path: str | Path | None = None,
    caption: str = "",
    *,
    references: Mapping[str, complex] | None = None,
    more: Callable[[Any, str], Any] | None = None,
    poles: bool | None = False,
    height: float = 3.0,
    legend: int = 4,
    axes: Any = None,
    runs: int = 1,
) -> Any:
    """Resistance and reactance beside each other over a variable: what nearly every figure is. Returns the figure, or
    the axes that were given.

    Args:
        curves: each the arguments of ``draw_values`` but the axis, with complex values and ends.
        across, height, legend: label of the variable; of the panels, in; columns at most.
        references: impedances known from elsewhere, as lines.
        more: draws into an axis besides; takes it and its part.
        poles: whether limits and lines end before poles, see ``frame``; None: limits that show all there is.
        axes, runs: given ones, and how many runs these curves are of.
    """
    figure, panels = panels_of(2, height, axes, runs)
    for axis, (part, label) in zip(panels, PARTS, strict=False):
        axis.set(xlabel=across, ylabel=label)
        for curve in curves:
            ends = curve.get("ends")
            own = {"y": part_of(curve["y"], part), "ends": ends and [part_of(end, part) for end in ends]}
            draw_values(axis, **{**curve, **own})
        for look, (name, value) in zip(REFERENCES, (references or {}).items(), strict=False):
            axis.axhline(part_of(value, part), label=plain_label(name), **look)
        if poles is not None:
            frame(axis, poles=poles)
        if more is not None:
            more(axis, part)
    return finish(figure, path, caption, legend, axes)


def curve_of(rows: Rows, at: str, value: str = "impedance", **style: Any) -> dict[str, Any]:
    """A curve of rows over what they have by the name ``at``, with the intervals that they know."""
    known = value == "impedance" and bool(rows) and rows[0].get("low") is not None
    ends = [[row[end] for row in rows] for end in ("low", "high")] if known else None
    x = SCALES.get(at, 1.0) * np.array([row[at] for row in rows], dtype=float)
    return {"x": x, "y": [row[value] for row in rows], "ends": ends, **style}


def part_of(value: Any, part: str) -> Any:
    """'resistance' or 'reactance' of a complex number, or of many as an array; nan of what is unknown."""
    many = value.detach().cpu().numpy() if hasattr(value, "detach") else value
    if isinstance(many, list | tuple):
        many = np.array([math.nan if each is None else each for each in many], dtype=complex)
    return many.real if part == "resistance" else many.imag


def draw_values(axis: Any, x: Any, y: Any, ends: Any = None, bars: bool = False, **style: Any) -> None:
    """Values along x with their interval as a band, or as bars."""
    axis.plot(x, y, **style)
    if ends is not None and bars:
        axis.vlines(x, *ends, color=style["color"], linewidth=1.2, zorder=2)
    elif ends is not None:
        axis.fill_between(x, *ends, color=style["color"], alpha=0.2, linewidth=0)


def colour_of(i: int, label: str = "", **style: Any) -> dict[str, Any]:
    """Colour, line and label of the i-th curve."""
    return {"color": COLOURS[i], "linestyle": LINES[i], "label": plain_label(label)} | style


def dots(colour: str, marker: str, label: str, **style: Any) -> dict[str, Any]:
    """Markers without a line."""
    return {"color": colour, "marker": marker, "linestyle": "none", "label": plain_label(label)} | style


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


def plain_label(text: str) -> str:
    """A name from a file, in which nothing is a formula or moves a cursor."""
    return " ".join(printable(text).split()).replace("$", r"\$")


def entry(axis: Any, label: str, marker: str = "", **style: Any) -> None:
    """A row of the legend without data: a marker or a line."""
    usual = {"color": "k", "label": label, "marker": marker, "linestyle": "none" if marker else "-"}
    axis.plot([], [], scalex=False, scaley=False, **usual | style)


def legend_below(figure: Figure, axes: Any, columns: int = 4) -> None:
    """The names in the axes, each once, below all panels, in as many columns as the figure is wide for."""
    rows: dict[str, Any] = {}
    for axis in np.ravel(axes):
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            rows.setdefault(label, handle)
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
    figure.caption = " ".join((caption or "").split())
    if path is not None:
        suffix = Path(path).suffix.lower()
        facts = {DESCRIPTION[suffix]: figure.caption} if suffix in DESCRIPTION else None
        with written_whole(path, *PICTURES) as temporary:
            figure.savefig(temporary, format=suffix[1:], metadata=facts)
    return figure

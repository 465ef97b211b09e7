"""Results along x and over frequency: their numbers as rows, and the pictures of these."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import index_of_frequency
from torchliner.conversions import impedance_from_admittance
from torchliner.engine.blocks import Blocks
from torchliner.engine.drives import Drive
from torchliner.engine.kernels import BAND
from torchliner.engine.sums import Job, PlaneRecord, linear, reduce, square
from torchliner.liners.model import Liner, as_liner
from torchliner.records import ImpedanceMap, Interval, PointImpedances, VelocityPlane
from torchliner.report import figure as look
from torchliner.report.maps import case_title, draw_map, family, interval_words, labels_of, mark_cells, over_surface
from torchliner.report.table import Row
from torchliner.studies.variants import rows_of

ORDERS = {"admittance": "admittance over points", "pressure-first": "pressure first"}  # of averaging, in situ
ASIDE = 0.3  # mm, between markers at one cell
VELOCITIES = {
    "v0 (m/s)": "$v_0$ (m s$^{-1}$)",
    "v' rms (m/s)": f"{look.V_RMS} (m s$^{{-1}}$)",
}


def impedance_along_x(result: ImpedanceMap, frequency_index: int = 0) -> list[Row]:
    """Z along x, the admittance averaged over z, and the bounds of its interval if known."""
    x, average = over_z(result.x, result.probes["admittance"].admittance[..., frequency_index])
    ends = _interval_along_x(result, len(x))
    found = {end: None if ends is None else getattr(ends, end)[:, frequency_index] for end in ("low", "high")}
    place = {"probe" if result.x is None else "x (m)": x}
    return rows_of(**place, impedance=impedance_from_admittance(average), **found)


def _interval_along_x(result: ImpedanceMap, points: int) -> Interval | None:
    """Of the rows of a plane, or of the probes of a line in the order of x."""
    if "admittance" in result.along_x:
        return result.along_x["admittance"].interval
    interval = result.probes["admittance"].interval
    if interval is None or interval.low.ndim != 2 or len(interval.low) != points:  # probes that share an x
        return None
    order = torch.arange(points) if result.x is None else result.x.argsort()
    return Interval(*(value[order] for value in vars(interval).values()))


def points_along_x(found: PointImpedances, frequency_index: int = 0) -> list[Row]:
    """Z of another method along x: the admittance averaged over equal x."""
    value = found.points.impedance[:, frequency_index]
    known = torch.isfinite(value.real)
    place = found.point_x[known] if bool(torch.isfinite(found.point_x).all()) else None
    x, average = over_z(place, 1 / value[known])
    return rows_of(**{"point" if place is None else "x (m)": x}, impedance=impedance_from_admittance(average))


def impedance_over_frequency(result: ImpedanceMap) -> list[Row]:
    """Z of the whole liner: of the answer with its interval, and in the other averagings by their names."""
    answer = result.liner[result.averaging]
    others = {name: result.liner[name].impedance for name in result.averagings if name != result.averaging}
    about = {"frequency (Hz)": result.frequency, "impedance": answer.impedance, "interval": answer.interval}
    return rows_of(**about, **others)


def time_moments(plane: VelocityPlane) -> tuple[Tensor, Tensor]:
    """Time mean of v and of v squared, m/s and m2/s2, each (P,), in float64."""
    jobs = [Job(Drive(), measure) for measure in (linear, square)]
    blocks = Blocks((0, plane.samples), plane.sampling_rate, 1)
    mean, mean_square = reduce(PlaneRecord(plane, torch.float64, torch.device("cpu")), blocks, jobs)
    return mean.flatten() / plane.samples, mean_square.flatten() / plane.samples


def velocity_along_x(plane: VelocityPlane) -> list[Row]:
    """v0 and v'_rms (m/s) along x; rms values averaged over z as squares."""
    mean, square = (each.reshape(plane.probe_shape) for each in time_moments(plane))
    x, mean_x = over_z(plane.x, mean)
    rms = over_z(plane.x, square - mean**2)[1].double().clamp(min=0).sqrt()
    return rows_of(**{"x (m)": x, "v0 (m/s)": mean_x.double(), "v' rms (m/s)": rms})


def over_z(x: Tensor | None, values: Tensor) -> tuple[Tensor, Tensor]:
    """Mean over z of (z, x), or over probes of equal x, of what is no nan; x itself, or the index without one."""
    values = torch.atleast_1d(values.detach().cpu())
    x = torch.arange(values.shape[-1]) if x is None else x.cpu()
    points, member = torch.unique(x, return_inverse=True)
    member, values = member.expand_as(values).reshape(-1), values.reshape(-1)
    known = ~values.isnan()
    total = values.new_zeros(len(points)).index_add_(0, member[known], values[known])
    return points.double(), total / torch.bincount(member[known], minlength=len(points))


def references_of(result: ImpedanceMap, index: int) -> dict[str, complex]:
    """Independent impedances of the case, the file's "true" first; Goodrich's where the flow is known."""
    known = dict(result.reference) if index == result.tone else {}  # none but at the tone
    found = {"reference": known.pop("true")} | known if "true" in known else known
    if result.goodrich is not None:
        found["Goodrich (2.7), linear liner"] = complex(result.goodrich[index])
    return found


def alongside_at(result: ImpedanceMap, index: int) -> list[tuple[PointImpedances, int]]:
    """Results of other methods at a frequency of the map, each with its index there."""
    tone = float(result.frequency[index])
    known = [(other, index_of_frequency(other.frequency, tone)) for other in result.alongside]
    return [(other, at) for other, at in known if at is not None]


def known_of(result: ImpedanceMap, index: int) -> dict[str, tuple[complex, Any]]:
    """Both, by name, with the bounds of an interval or None."""
    found: dict[str, tuple[complex, Any]] = {name: (z, None) for name, z in references_of(result, index).items()}
    for other, f in alongside_at(result, index):
        for each, word in ORDERS.items():
            z = complex(other.liner[each].impedance[f])
            found[f"{other.name}, {word}"] = z, other.bounds_of_liner(each, f)
    return found


def draw_result(
    result: ImpedanceMap, path: str | Path | None = None, frequency_index: int | None = None, axes: Any = None
) -> Any:
    """Resistance and reactance of a map at one frequency, over (x, z) or along x; of several frequencies, with None,
    over frequency. Returns the figure, or the axes that were given."""
    if frequency_index is None and len(result.frequency) > 1:
        return draw_spectrum([result], path, axes)
    if over_surface(result):
        return draw_map(result, path, frequency_index or 0, axes)
    return draw_along_x([result], path, frequency_index or 0, axes)


def draw_along_x(
    results: Sequence[ImpedanceMap],
    path: str | Path | None = None,
    frequency_index: int = 0,
    axes: Any = None,
) -> Any:
    """R and X along x of several runs, with cell averages and references (figures 10, 17): of one run in the colours of
    the averagings, of several each in its own, with the cells of the answer's averaging."""
    first, before, words = results[0], look.runs_in(axes), interval_words(results[0])
    alone, drawn = len(results) == 1 and not before, list[Row]()
    for i, (result, name) in enumerate(zip(results, labels_of(results), strict=True), before):
        rows = impedance_along_x(result, frequency_index)
        drawn.append(look.curve_of(rows, next(iter(rows[0])), **look.colour_of(i, "probes" if alone else name)))
        for k, averaging in enumerate(result.averagings if alone else [result.averaging]):
            colour, aside = (look.AVERAGINGS[averaging], k - 1) if alone else (look.COLOURS[i], i - len(results) / 2)
            style = look.dots(colour, look.MARKERS[k if alone else i], f"cells, {averaging}")
            drawn += _cells(result, averaging, frequency_index, ASIDE * aside, style)
    beside = {other.name: (other, at) for one in results for other, at in alongside_at(one, frequency_index)}
    for other, at in beside.values():
        drawn += _cells_of_points(other, at, f"{other.name}, ")
    known = {} if before else {k: z for one in results for k, z in references_of(one, frequency_index).items()}

    def more(axis: Any, part: str) -> None:
        if first.x is not None and not before:
            mark_cells(axis, first)
        if words and not before and part == "resistance":
            look.entry(axis, words, color="0.8", **look.BAND)

    return look.draw_parts(
        drawn,
        look.X_MM if first.x is not None else "probe",
        path,
        f"{family(results, frequency_index)}; bands and bars: {words or 'none'}",
        references=known,
        more=more,
        axes=axes,
        runs=len(results),
    )


def _cells(result: ImpedanceMap, averaging: str, index: int, aside: float, style: Row) -> list[Row]:
    """Averages of the cells that have a place, filled in the averaging of the answer."""
    x, cells = 1e3 * result.cell_x.cpu().numpy() + aside, result.cells[averaging]
    if not np.isfinite(x).any():
        return []
    ends = None if cells.interval is None else (cells.interval.low[:, index], cells.interval.high[:, index])
    face = style["color"] if averaging == result.averaging else "white"
    value = {"x": x, "y": cells.impedance[:, index], "ends": ends, "bars": True}
    return [value | style | {"markerfacecolor": face, "zorder": 4}]


def _cells_of_points(found: PointImpedances, index: int, label: str) -> list[Row]:
    """Cell values of another method, filled: admittance over points; open and larger: pressure first."""
    return [
        {"x": 1e3 * found.cell_x, "y": found.cells[name].impedance[:, index]}
        | look.dots("k", "X", f"{label}{order}", markerfacecolor=face, zorder=9 - 0.1 * size, markersize=size)
        for (name, order), face, size in zip(ORDERS.items(), ("k", "white"), (5, 8), strict=True)
    ]


def draw_spectrum(results: Sequence[ImpedanceMap], path: str | Path | None = None, axes: Any = None) -> Any:
    """R and X over frequency with intervals: of one run in all averagings, of several the answer of each."""
    before = look.runs_in(axes)
    alone, drawn = len(results) == 1 and not before, list[Row]()
    for i, (result, name) in enumerate(zip(results, labels_of(results), strict=True), before):
        rows = impedance_over_frequency(result)
        for averaging in result.averagings if alone else [result.averaging]:
            mine = averaging == result.averaging
            style = look.colour_of(i, averaging if alone else name)
            style |= {"color": look.AVERAGINGS[averaging], "linestyle": "-" if mine else "--"} if alone else {}
            drawn.append(look.curve_of(rows, "frequency (Hz)", "impedance" if mine else averaging, **style))
    words = f"{case_title(results[0])}; bands: {interval_words(results[0]) or 'none'}"
    return look.draw_parts(drawn, look.KHZ, path, words, poles=True, axes=axes, runs=len(results))


def draw_liner(liner: Liner, speeds: Sequence[float], title: str, path: str | Path | None = None) -> look.Figure:
    """R and X over 300 to 3500 Hz, or the range of its table, one curve per speed |v|, m/s (figure 3)."""
    frequency, drawn = np.linspace(*(as_liner(liner).frequency_range or BAND), 641), []
    for i, v in enumerate(speeds):
        style = look.colour_of(i) | {"label": f"$|v|$ = {v:g} m s$^{{-1}}$"}
        drawn.append({"x": 1e-3 * frequency, "y": liner.impedance(frequency, v)} | style)

    def more(axis: Any, _: str) -> None:
        axis.axhline(0, color="0.7", linewidth=0.6, zorder=0)

    return look.draw_parts(drawn, look.KHZ, path, title, poles=True, more=more, height=2.7, legend=6)


@look.styled
def draw_velocity(
    planes: VelocityPlane | Sequence[VelocityPlane], path: str | Path | None = None, axes: Any = None
) -> Any:
    """v0 and v' along x (figures 9 and 16)."""
    several = [planes] if isinstance(planes, VelocityPlane) else planes
    profiles, before = [velocity_along_x(each) for each in several], look.runs_in(axes)
    figure, panels = look.panels_of(len(VELOCITIES), 2.7, axes, len(several))
    for axis, quantity in zip(panels, VELOCITIES, strict=False):
        for i, (rows, name) in enumerate(zip(profiles, labels_of(several), strict=True), before):
            look.draw_values(axis, **look.curve_of(rows, "x (m)", quantity, **look.colour_of(i, name)))
        axis.set(xlabel=look.X_MM, ylabel=VELOCITIES[quantity], ylim=(None if quantity == "v0 (m/s)" else 0, None))
    return look.finish(figure, path, case_title(several[0]), 6, axes)


def draw_points(
    found: PointImpedances, path: str | Path | None = None, true: complex | None = None, title: str = "", f: int = 0
) -> look.Figure:
    """R and X of another method along x: points, cells in both ways of averaging, and a reference."""
    rows = points_along_x(found, f)
    known = "x (m)" in rows[0]
    drawn = [look.curve_of(rows, "x (m)" if known else "point", **look.colour_of(0, "points"))]
    drawn += _cells_of_points(found, f, "cells, ") if known else []
    words = f"{title or found.name}, {float(found.frequency[f]):g} Hz"
    references = {} if true is None else {"reference": true}
    return look.draw_parts(drawn, look.X_MM if known else "point", path, words, references=references, poles=None)

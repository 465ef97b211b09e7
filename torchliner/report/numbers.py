"""The numbers behind the figures, as plain arrays; every figure can be redrawn from its CSV."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchliner.conversions import impedance_from_admittance
from torchliner.engine.kernels import BAND
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, as_liner
from torchliner.records import ImpedanceMap, Interval, PointImpedances, VelocityPlane
from torchliner.report.table import Column, Table
from torchliner.velocity.reading import time_moments

Array = NDArray[np.float64]
COMPLEX_PART = {"resistance": "real", "reactance": "imag"}


def part_of(value: Any, part: str) -> Any:
    """'resistance' or 'reactance' of a complex number, or of a tensor as an array."""
    number = getattr(value, COMPLEX_PART[part])
    return number.detach().cpu().numpy() if hasattr(number, "detach") else number


@dataclass(frozen=True)
class Curves:
    """Quantities over one variable.

    Args:
        at: the variable, increasing, (N,).  values: columns by name, each (N,).
        label: for legends.  variable: its name and unit.
    """

    at: Array
    values: dict[str, Array]
    label: str
    variable: str = "x (m)"

    def write_csv(self, path: str | Path) -> None:
        """The variable and the values, by columns, nine digits."""
        self.table.write_csv(path)

    @property
    def table(self) -> Table:
        """A row a value of the variable."""
        return table_of_curves([self])


def table_of_curves(several: Sequence[Curves]) -> Table:
    """Curves one below the other, with a column of their labels where there are several."""
    names = dict.fromkeys(name for one in several for name in one.values)
    rows = []
    for one in several:
        for i, at in enumerate(one.at.tolist()):
            about = {"curve": one.label} if len(several) > 1 else {}
            values = {name: float(one.values[name][i]) if name in one.values else None for name in names}
            rows.append(about | {several[0].variable: at} | values)
    return Table(rows, [Column(name) for name in (rows[0] if rows else ())], ".9g")


def height_label(height: float | None) -> str:
    """'y = 1 mm' or nothing."""
    return "" if height is None else f"y = {1e3 * height:.3g} mm"


def case_title(one: ImpedanceMap | VelocityPlane) -> str:
    """The title up to the height: what several heights share."""
    return one.title.split(", y =")[0]


def labels_of(results: Sequence[Any]) -> list[str]:
    """What tells maps or planes of one figure apart: height, side of the source, level, title, else their number."""

    def level(one: Any) -> str:
        return "" if one.incident_level is None else f"{one.incident_level:g} dB"

    facts = [
        (height_label(one.height), f"source {one.source_side}" if one.source_side else "", level(one), one.title)
        for one in results
    ]
    kept = [i for i in range(4) if len({each[i] for each in facts}) > 1] or [0]
    for count in range(1, len(kept) + 1):
        labels = [", ".join(each[i] for i in kept[:count] if each[i]) for each in facts]
        if len({*labels}) == len(labels):
            return labels
    return [f"{label or 'run'}, {i}" for i, label in enumerate(labels, 1)]


def interval_words(result: ImpedanceMap) -> str:
    """'95 % interval' or nothing."""
    return "" if result.level is None else f"{100 * result.level:g} % interval"


def main_of(result: ImpedanceMap) -> int:
    """Index of the frequency of the data's tone, else of that at which v is most coherent."""
    if result.tone is not None:
        return result.tone
    flat = result.coherence.reshape(-1, len(result.frequency)).double()
    median = flat.nanmedian(0).values.nan_to_num(-1)
    return int(median.argmax()) if bool((median > 0).any()) else 0


def impedance_along_x(result: ImpedanceMap, frequency_index: int = 0) -> Curves:
    """Resistance and reactance along x, and the bounds of their statistical intervals if known.

    Where there is a z the admittance is averaged over it.
    """
    admittance = result.probes["admittance"].admittance[..., frequency_index]
    x, average = over_z(result.x, admittance)
    values = _parts(impedance_from_admittance(average))
    interval = _interval_along_x(result, len(x))
    for name in ("low", "high") if interval is not None else ():
        values |= _parts(getattr(interval, name)[:, frequency_index], f" {name}")
    return Curves(x, values, height_label(result.height), "probe" if result.x is None else "x (m)")


def _interval_along_x(result: ImpedanceMap, points: int) -> Interval | None:
    """Of the rows of a plane, or of the probes of a line in the order of x."""
    if "admittance" in result.along_x:
        return result.along_x["admittance"].interval
    interval = result.probes["admittance"].interval
    if interval is None or interval.low.ndim != 2 or len(interval.low) != points:  # probes that share an x
        return None
    order = torch.arange(points) if result.x is None else result.x.argsort()
    return interval.map(lambda value: value[order])


def points_along_x(found: PointImpedances, frequency_index: int = 0) -> Curves:
    """Resistance and reactance of another method along x: admittance averaged over equal x."""
    value = found.point_impedance[:, frequency_index]
    known = torch.isfinite(value.real)
    place = found.point_x[known] if bool(torch.isfinite(found.point_x).all()) else None
    x, average = over_z(place, 1 / value[known])
    return Curves(x, _parts(impedance_from_admittance(average)), found.name, "point" if place is None else "x (m)")


def impedance_over_band(liner: Liner, speed: float = 0.0, label: str = "") -> Curves:
    """Resistance and reactance of a liner over 300 to 3500 Hz, or the range of its table."""
    low, high = as_liner(liner).frequency_range or BAND
    frequency = np.linspace(low, high, 641)
    values = _parts(liner.impedance(frequency, speed))
    return Curves(frequency, values, label, "frequency (Hz)")


def impedance_over_frequency(result: ImpedanceMap) -> Curves:
    """Whole-liner impedance in all averagings, the statistical interval of the answer, and quartiles over the probes
    that were not left out, which are no uncertainty."""
    values: dict[str, Array] = {}
    for part in COMPLEX_PART:
        values[part] = part_of(result.answer, part)
        for averaging in result.averagings:
            if averaging != result.averaging:
                values[f"{part}, {averaging}"] = part_of(result.liner[averaging].impedance, part)
        interval = result.liner[result.averaging].interval
        if interval is not None:
            values[f"{part} low"] = part_of(interval.low, part)
            values[f"{part} high"] = part_of(interval.high, part)
        flat = part_of(result.impedance, part).reshape(-1, len(result.frequency))
        for share in (25, 75):
            values[f"{part}, {share} % of probes"] = np.nanpercentile(flat, share, axis=0)
    frequency = result.frequency.detach().cpu().numpy()
    return Curves(frequency, values, height_label(result.height), "frequency (Hz)")


def _parts(impedance: Tensor, end: str = "") -> dict[str, Array]:
    return {f"{part}{end}": part_of(impedance, part).astype(np.float64) for part in COMPLEX_PART}


def velocity_along_x(record: VelocityPlane | Moments) -> Curves:
    """v0, v'_rms and, if stored, u'_rms (m/s) along x; rms values averaged over z as squares."""
    values: dict[str, Array] = {}
    x: Array | None = None
    plane = record.plane if isinstance(record, Moments) else record
    for name, part in (("v", plane.velocity), ("u", plane.streamwise)):
        if part is None:
            continue
        if isinstance(record, Moments):  # of v alone
            mean, square = record.survey.mean, record.survey.mean_square
        else:
            mean, square = time_moments(VelocityPlane(part, sampling_rate=plane.sampling_rate, name=plane.name))
        mean, square = mean.reshape(plane.probe_shape), square.reshape(plane.probe_shape)
        x, mean_x = over_z(plane.x, mean)
        _, variance = over_z(plane.x, square - mean**2)
        if name == "v":
            values["v0 (m/s)"] = _array(mean_x)
        values[f"{name}' rms (m/s)"] = np.sqrt(np.maximum(_array(variance), 0))
    assert x is not None
    return Curves(x, values, height_label(plane.height))


def over_z(x: Tensor | None, values: Tensor) -> tuple[Array, Tensor]:
    """Mean over z of (z, x) or over probes of equal x; x itself, or the index without one."""
    values = values.detach().cpu()
    if values.ndim == 2:
        where = np.arange(values.shape[1], dtype=float) if x is None else _array(x)
        return where, _nanmean(values)
    values = values.reshape(-1)
    if x is None:
        return np.arange(len(values), dtype=float), values
    points, member = torch.unique(x.cpu(), return_inverse=True)
    return _array(points), _nanmean(values, member, len(points))


def _nanmean(values: Tensor, member: Tensor | None = None, count: int = 0) -> Tensor:
    """Over the first axis; with ``member``, of each of ``count`` groups of values, (P,)."""
    if values.is_complex():
        return torch.complex(_nanmean(values.real, member, count), _nanmean(values.imag, member, count))
    if member is None:
        return values.nanmean(0)
    known = ~values.isnan()
    total = values.new_zeros(count).index_add_(0, member[known], values[known])
    return total / torch.bincount(member[known], minlength=count)


def _array(value: Tensor) -> Array:
    return value.detach().cpu().numpy().astype(np.float64)

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
from torchliner.report.table import Table, rows_of, table_of
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
        at: the variable, increasing, (N,).
        values: columns by name, each (N,).
        label: for legends.
        variable: its name and unit.
    """

    at: Array
    values: dict[str, Array]
    label: str
    variable: str = "x (m)"

    def write_csv(self, path: str | Path) -> None:
        """The variable and the values, by columns."""
        self.table.write_csv(path)

    @property
    def table(self) -> Table:
        """A row a value of the variable."""
        return table_of(rows_of(**{self.variable: self.at}, **self.values))


def height_label(height: float | None) -> str:
    """'y = 1 mm' or nothing."""
    return "" if height is None else f"y = {1e3 * height:.3g} mm"


def case_title(one: ImpedanceMap | VelocityPlane) -> str:
    """The title up to the height: what several heights share."""
    return one.title.split(", y =")[0]


def labels_of(results: Sequence[Any]) -> list[str]:
    """What tells maps or planes of one figure apart: height, side of the source, level, title, else their number."""
    return distinct(
        [
            (
                height_label(one.height),
                f"source {one.source_side}" if one.source_side else "",
                "" if one.incident_level is None else f"{one.incident_level:g} dB",
                one.title,
            )
            for one in results
        ]
    )


def distinct(facts: Sequence[Sequence[str]]) -> list[str]:
    """The first fact that differs if it tells all apart, else all that differ, else a number."""
    kept = [i for i, values in enumerate(zip(*facts, strict=True)) if len({*values}) > 1] or [0]
    for few in (kept[:1], kept):
        labels = [", ".join(each[i] for i in few if each[i]) for each in facts]
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
    coherence = result.coherence.reshape(-1, len(result.frequency))
    return int(coherence.nanmedian(0).values.nan_to_num(-1).argmax())


def impedance_along_x(result: ImpedanceMap, frequency_index: int = 0) -> Curves:
    """Resistance and reactance along x, the admittance averaged over z, and the bounds of their intervals if known."""
    x, average = over_z(result.x, result.probes["admittance"].admittance[..., frequency_index])
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
    frequency = np.linspace(*(as_liner(liner).frequency_range or BAND), 641)
    return Curves(frequency, _parts(liner.impedance(frequency, speed)), label, "frequency (Hz)")


def impedance_over_frequency(result: ImpedanceMap) -> Curves:
    """Whole-liner impedance in all averagings, and the statistical interval of the answer."""
    values, answer = dict[str, Array](), result.liner[result.averaging]
    for part in COMPLEX_PART:
        values[part] = part_of(answer.impedance, part)
        others = [name for name in result.averagings if name != result.averaging]
        values |= {f"{part}, {name}": part_of(result.liner[name].impedance, part) for name in others}
        if answer.interval is not None:
            values |= {f"{part} {end}": part_of(getattr(answer.interval, end), part) for end in ("low", "high")}
    return Curves(result.frequency.cpu().numpy(), values, height_label(result.height), "frequency (Hz)")


def velocity_along_x(record: VelocityPlane | Moments) -> Curves:
    """v0, v'_rms and, if stored, u'_rms (m/s) along x; rms values averaged over z as squares."""
    values, plane = dict[str, Array](), record.plane if isinstance(record, Moments) else record
    x = np.zeros(0)
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
            values["v0 (m/s)"] = mean_x.double().numpy()
        values[f"{name}' rms (m/s)"] = variance.double().clamp(min=0).sqrt().numpy()
    return Curves(x, values, height_label(plane.height))


def over_z(x: Tensor | None, values: Tensor) -> tuple[Array, Tensor]:
    """Mean over z of (z, x), or over probes of equal x, of what is no nan; x itself, or the index without one."""
    values = torch.atleast_1d(values.detach().cpu())
    x = torch.arange(values.shape[-1]) if x is None else x.cpu()
    points, member = torch.unique(x, return_inverse=True)
    member, values = member.expand_as(values).reshape(-1), values.reshape(-1)
    known = ~values.isnan()
    total = values.new_zeros(len(points)).index_add_(0, member[known], values[known])
    return points.double().numpy(), total / torch.bincount(member[known], minlength=len(points))


def _parts(impedance: Tensor, end: str = "") -> dict[str, Array]:
    return {f"{part}{end}": part_of(impedance, part).astype(np.float64) for part in COMPLEX_PART}

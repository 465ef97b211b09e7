"""Maps over (x, z): colours of resistance and reactance, cells of the liner; what runs are called."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.report import figure as look
from torchliner.report.table import Row
from torchliner.studies.variants import rows_of

ENDS = (1, 99)  # %, of the probes: single ones over a hard spot would hide the rest
FLAT = 1e-3  # mm, within which places lie on a line
AREA = 1e4  # square points over the number of scattered probes: the size of their markers


def places_of(result: ImpedanceMap) -> Any:
    """x and z of all probes, mm, or of a plane without places their numbers, (2, P); None for probes without a z."""
    shape, x, z = tuple(result.mean_velocity.shape), result.x, result.z
    if len(shape) == 1:
        return None if x is None or z is None else 1e3 * np.stack([x.numpy(), z.numpy()])
    along = [np.arange(n) if at is None else 1e3 * at.numpy() for at, n in ((x, shape[1]), (z, shape[0]))]
    return np.stack([each.ravel() for each in np.meshgrid(*along)])


def over_surface(result: ImpedanceMap) -> bool:
    """Whether the probes lie on a surface and not along a line."""
    places = places_of(result)
    return places is not None and bool(np.linalg.matrix_rank(places - places[:, :1], tol=FLAT) == 2)


@look.styled
def draw_map(
    result: ImpedanceMap,
    path: str | Path | None = None,
    frequency_index: int = 0,
    given: Any = None,
) -> Any:
    """Both parts over (x, z); colours end at 1 and 99 % of the probes."""
    (x, z), shape = places_of(result), result.mean_velocity.shape
    unit = "index" if result.x is None else "mm"
    figure, axes = look.panels_of(2, min(5.4, 1.3 + 2.05 * (np.ptp(z) + 1e-9) / (np.ptp(x) + 1e-9)), given)
    for axis, (part, label) in zip(axes, look.PARTS, strict=False):
        values = look.part_of(result.impedance[..., frequency_index], part)
        low, high = np.nanpercentile(values, ENDS)
        style: Any = {"cmap": "cividis", "rasterized": True, "vmin": low, "vmax": high}
        if len(shape) == 2:
            drawn = axis.pcolormesh(x.reshape(shape), z.reshape(shape), values, shading="nearest", **style)
        else:
            drawn = axis.scatter(x, z, c=values, s=np.clip(AREA / len(x), 0.5, 60), linewidths=0, **style)
        axis.figure.colorbar(drawn, ax=axis, extend="both", label=label, location="bottom" if given is None else None)
        axis.set(aspect="equal", xlabel=f"$x$ ({unit})", ylabel=f"$z$ ({unit})")
    words = f"{result.title}, {float(result.frequency[frequency_index]):g} Hz; colours: 1 to 99 % of the probes"
    return look.finish(figure, path, words, 2, given)


def mark_cells(axis: Any, result: ImpedanceMap) -> None:
    """Thin lines at the borders of cells along x, mm, where pitch and places are known; none over a hard wall."""
    liner = result.choices.get("liner")
    pitch = liner.get("cell_pitch") if isinstance(liner, dict) else None
    if pitch and result.x is not None and result.choices.get("surface") != "hard wall":
        low, high = axis.get_xlim()
        at, half = 1e3 * result.cell_x.cpu().numpy(), 500 * float(pitch)
        borders = np.unique(np.round([at - half, at + half], 6))
        for border in borders[(low < borders) & (borders < high)]:
            axis.axvline(border, color="0.6", linewidth=0.5, zorder=0, label="border of cells")


def probe_rows(result: ImpedanceMap, index: int) -> list[Row]:
    """A row a probe: x, z, and Z."""
    x, z = places_of(result) / (1.0 if result.x is None else 1e3)
    return rows_of(**{"x (m)": x, "z (m)": z}, impedance=result.impedance[..., index].detach().cpu().reshape(-1))


# What maps and planes of one figure are called.


def case_title(one: ImpedanceMap | VelocityPlane) -> str:
    """The title up to the height: what several heights share."""
    return one.title.split(", y =")[0]


def family(results: Sequence[ImpedanceMap], frequency_index: int) -> str:
    """What several results share: the title up to the height, the frequency, the null test."""
    hard = any(result.choices.get("surface") == "hard wall" for result in results)
    title = f"{case_title(results[0]) or 'educed impedance'}{' (null test)' * hard}"
    return f"{title}, {float(results[0].frequency[frequency_index]):g} Hz"


def labels_of(results: Sequence[Any]) -> list[str]:
    """What tells maps or planes of one figure apart: height, side of the source, level, title, else their number."""
    return distinct(
        [
            (
                "" if one.height is None else f"y = {1e3 * one.height:.3g} mm",
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

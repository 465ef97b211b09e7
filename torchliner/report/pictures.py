"""All pictures of a run in one folder, each with its numbers as CSV beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from torchliner.file_names import frequency_ends, unique_names
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.reduction.moments import ReducedVelocity
from torchliner.report import figures
from torchliner.report.closure_report import closure_table, draw_closure
from torchliner.report.figures import draw_spectrum
from torchliner.report.map_figures import map_limits
from torchliner.report.numbers import impedance_along_x, impedance_over_frequency, velocity_along_x


def draw_pictures(
    results: Sequence[ImpedanceMap], planes: Sequence[VelocityPlane], folder: Path
) -> None:
    """Pictures of all planes; those of other frequencies than the first go to folders of theirs."""
    groups: dict[tuple[float, ...], list[int]] = {}
    for i, result in enumerate(results):
        groups.setdefault(tuple(result.frequency.tolist()), []).append(i)
    stems = unique_names(Path(plane.name.split(":/")[0]).absolute() for plane in planes)
    for number, members in enumerate(groups.values()):
        where = folder if number == 0 else folder / stems[members[0]]
        _draw_group(
            [results[i] for i in members], [planes[i] for i in members],
            [stems[i] for i in members], where,
        )  # fmt: skip


def _draw_group(
    results: Sequence[ImpedanceMap], planes: Sequence[VelocityPlane], stems: Sequence[str],
    folder: Path,
) -> None:  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    frequencies = results[0].frequency.tolist()
    for i, end in enumerate(frequency_ends(frequencies)):
        limits = map_limits(results, i)  # maps of one call are to be compared
        for result, stem in zip(results, stems, strict=True):
            if result.mean_velocity.ndim == 2 or figures.over_surface(result, i):
                figures.draw_map(result, folder / f"map_{stem}{end}.png", i, limits=limits)
            impedance_along_x(result, i).write_csv(folder / f"along_x_{stem}{end}.csv")
        figures.draw_along_x(results, folder / f"along_x{end}.png", i)
        if len(results) > 1:
            figures.draw_against_height(results, folder / f"height{end}.png", i)
        if any(result.closure is not None for result in results):
            draw_closure(results, folder / f"closure{end}.png", i)
            closure_table(results, i).write_csv(folder / f"closure{end}.csv")
    if len(frequencies) > 1:
        draw_spectrum(results, folder / "spectrum.png")
        for result, stem in zip(results, stems, strict=True):
            impedance_over_frequency(result).write_csv(folder / f"spectrum_{stem}.csv")
    # Of moments the velocity is gone.
    there = [
        pair
        for pair in zip(planes, stems, strict=True)
        if not isinstance(pair[0].velocity, ReducedVelocity)
    ]
    for plane, stem in there:
        velocity_along_x(plane).write_csv(folder / f"velocity_{stem}.csv")
    if there:
        figures.draw_velocity([plane for plane, _ in there], folder / "velocity.png")

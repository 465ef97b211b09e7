"""All pictures of a run in one folder, each with its numbers as CSV beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch

from torchliner.engine.moments import ReducedVelocity
from torchliner.file_names import frequency_ends, unique_names
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.same_case import planes_by_height
from torchliner.report import figures
from torchliner.report.figures import draw_spectrum
from torchliner.report.level_check_report import draw_level_check, level_check_rows, level_check_table
from torchliner.report.map_figures import Limits, map_limits
from torchliner.report.numbers import impedance_along_x, impedance_over_frequency, velocity_along_x


def draw_pictures(results: Sequence[ImpedanceMap], planes: Sequence[VelocityPlane], folder: Path) -> None:
    """Pictures of all planes: heights of a case in one; those of other cases or frequencies than
    the first, and of heights that are unknown or there already, go to folders of theirs."""
    groups: list[list[int]] = []
    for i, plane in enumerate(planes):
        for group in groups:
            same = torch.equal(results[group[0]].frequency, results[i].frequency)
            if same and _one_case([plane, *(planes[k] for k in group)]):
                group.append(i)
                break
        else:
            groups.append([i])
    stems = unique_names(Path(plane.name.split(":/")[0]).absolute() for plane in planes)
    for number, members in enumerate(groups):
        where = folder if number == 0 else folder / stems[members[0]]
        _draw_group(
            [results[i] for i in members], [planes[i] for i in members],
            [stems[i] for i in members], where, _limits(results, members[0]),
        )  # fmt: skip


def _one_case(planes: Sequence[VelocityPlane]) -> bool:
    """Whether planes differ in height, which is known, and may stand in one figure."""
    try:
        planes_by_height(planes)
    except ValueError:
        return False
    return True


def _limits(results: Sequence[ImpedanceMap], member: int) -> list[Limits]:
    """Ends of the colours at each frequency: maps of one call are to be compared."""
    frequency = results[member].frequency
    alike = [each for each in results if torch.equal(each.frequency, frequency)]
    return [map_limits(alike, i) for i in range(len(frequency))]


def _draw_group(
    results: Sequence[ImpedanceMap], planes: Sequence[VelocityPlane], stems: Sequence[str],
    folder: Path, limits: Sequence[Limits],
) -> None:  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    frequencies = results[0].frequency.tolist()
    for i, end in enumerate(frequency_ends(frequencies)):
        for result, stem in zip(results, stems, strict=True):
            if result.mean_velocity.ndim == 2 or figures.over_surface(result, i):
                figures.draw_map(result, folder / f"map_{stem}{end}.png", i, limits=limits[i])
            impedance_along_x(result, i).write_csv(folder / f"along_x_{stem}{end}.csv")
        figures.draw_along_x(results, folder / f"along_x{end}.png", i)
        if len(results) > 1:
            figures.draw_against_height(results, folder / f"height{end}.png", i)
        if any(row["verdict"] for row in level_check_rows(results, i)):  # a pressure is known
            draw_level_check(results, folder / f"level_check{end}.png", i)
            level_check_table(results, i).write_csv(folder / f"level_check{end}.csv")
    if len(frequencies) > 1:
        draw_spectrum(results, folder / "spectrum.png")
        for result, stem in zip(results, stems, strict=True):
            impedance_over_frequency(result).write_csv(folder / f"spectrum_{stem}.csv")
    # Of moments the velocity is gone.
    there = [pair for pair in zip(planes, stems, strict=True) if not isinstance(pair[0].velocity, ReducedVelocity)]
    for plane, stem in there:
        velocity_along_x(plane).write_csv(folder / f"velocity_{stem}.csv")
    if there:
        figures.draw_velocity([plane for plane, _ in there], folder / "velocity.png")

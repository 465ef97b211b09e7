"""Pictures of a run in one folder, each with its numbers as CSV beside it."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path

import torch

from torchliner.engine.moments import ReducedVelocity
from torchliner.file_names import unique_names
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.report.curves import draw_along_x, draw_difference, draw_spectrum, draw_velocity
from torchliner.report.maps import draw_map, map_limits, over_surface
from torchliner.report.numbers import impedance_along_x, impedance_over_frequency, main_of, velocity_along_x
from torchliner.report.planes import draw_against_height
from torchliner.report.table import table_of
from torchliner.report.trends import draw_level_check
from torchliner.studies.compare import compare


def draw_pictures(results: Sequence[ImpedanceMap], planes: Sequence[VelocityPlane], folder: Path) -> None:
    """All planes in one figure of each kind: along x at the tone, over frequency where there are several, and what two
    runs differ by. Planes of other frequencies than the first have folders of their own."""
    stems = unique_names(Path(plane.name.split(":/")[0]).absolute() for plane in planes)
    alike = [torch.equal(one.frequency, results[0].frequency) for one in results]
    for same, one, plane, stem in zip(alike, results, planes, stems, strict=True):
        if not same:
            draw_pictures([one], [plane], folder / stem)
    runs = [run for same, run in zip(alike, zip(results, planes, stems, strict=True), strict=True) if same]
    maps, main = [one for one, _, _ in runs], main_of(results[0])
    folder.mkdir(parents=True, exist_ok=True)
    limits = map_limits(maps, main)
    for one, _, stem in runs:
        if over_surface(one, main):
            draw_map(one, folder / f"map_{stem}.png", main, limits=limits)
        impedance_along_x(one, main).write_csv(folder / f"along_x_{stem}.csv")
        if len(one.frequency) > 1:
            impedance_over_frequency(one).write_csv(folder / f"spectrum_{stem}.csv")
    draw_along_x(maps, folder / "along_x.png", main)
    if len(results[0].frequency) > 1:
        draw_spectrum(maps, folder / "spectrum.png")
    if len({one.height for one in maps} - {None}) > 1:
        draw_against_height(maps, folder / "height.png", main)
    if len(maps) == 2:
        with contextlib.suppress(ValueError):  # other cells or averagings have no difference
            rows = compare(maps[0], maps[1]).rows
            draw_difference(maps, rows, folder / "difference.png", main)
            table_of(rows).write_csv(folder / "difference.csv")
    _draw_levels(maps, folder, main)
    # Of moments the velocity is gone.
    there = [(plane, stem) for _, plane, stem in runs if not isinstance(plane.velocity, ReducedVelocity)]
    for plane, stem in there:
        velocity_along_x(plane).write_csv(folder / f"velocity_{stem}.csv")
    if there:
        draw_velocity([plane for plane, _ in there], folder / "velocity.png")


def _draw_levels(maps: Sequence[ImpedanceMap], folder: Path, index: int) -> None:
    """The level checks, where a pressure is known at this frequency."""
    rows = [
        {"height": one.height, "averaging": name, **check.liner.at(i, index), "verdict": check.verdict(name, index)}
        for one in maps
        if (check := one.level_check) is not None
        for i, name in enumerate(check.averagings)
    ]
    if any(row["verdict"] for row in rows):
        draw_level_check(maps, folder / "level_check.png", index)
        table_of(rows).write_csv(folder / "level_check.csv")

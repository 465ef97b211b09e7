"""Pictures of a run in one folder, each with its numbers as CSV beside it."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path

import torch

from torchliner.engine.moments import ReducedVelocity
from torchliner.names import unique_names
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.report.curves import draw_along_x, draw_comparison, draw_spectrum, draw_velocity
from torchliner.report.maps import draw_map, map_limits, over_surface
from torchliner.report.numbers import impedance_along_x, impedance_over_frequency, main_of, velocity_along_x
from torchliner.report.planes import draw_against_height
from torchliner.report.studies import draw_level_check, level_rows
from torchliner.report.table import table_of
from torchliner.studies.compare import compare


def draw_pictures(results: Sequence[ImpedanceMap], planes: Sequence[VelocityPlane], folder: Path) -> None:
    """All planes in one figure of each kind: along x at the tone, over frequency where there are several, and what two
    runs differ by. Planes of other frequencies than the first have folders of their own."""
    stems = unique_names(Path(plane.name.split(":/")[0]).absolute() for plane in planes)
    runs = list(zip(results, planes, stems, strict=True))
    for one, plane, stem in runs:
        if not torch.equal(one.frequency, results[0].frequency):
            draw_pictures([one], [plane], folder / stem)
    runs = [run for run in runs if torch.equal(run[0].frequency, results[0].frequency)]
    maps, main, several = [one for one, _, _ in runs], main_of(results[0]), len(results[0].frequency) > 1
    folder.mkdir(parents=True, exist_ok=True)
    limits = map_limits(maps, main)
    for one, plane, stem in runs:
        if over_surface(one):
            draw_map(one, folder / f"map_{stem}.png", main, limits=limits)
        impedance_along_x(one, main).write_csv(folder / f"along_x_{stem}.csv")
        if several:
            impedance_over_frequency(one).write_csv(folder / f"spectrum_{stem}.csv")
        if not isinstance(plane.velocity, ReducedVelocity):  # of moments the velocity is gone
            velocity_along_x(plane).write_csv(folder / f"velocity_{stem}.csv")
    draw_along_x(maps, folder / "along_x.png", main)
    if several:
        draw_spectrum(maps, folder / "spectrum.png")
    if len({one.height for one in maps} - {None}) > 1:
        draw_against_height(maps, folder / "height.png", main)
    if len(maps) == 2:
        with contextlib.suppress(ValueError):  # other cells or averagings have no difference
            found = compare(maps[0], maps[1])
            draw_comparison(found, folder / "difference.png", float(maps[0].frequency[main]))
            table_of(found.rows).write_csv(folder / "difference.csv")
    rows = level_rows(maps, main)
    if any(row["verdict"] for row in rows):
        draw_level_check(maps, folder / "level_check.png", main)
        table_of(rows).write_csv(folder / "level_check.csv")
    if there := [plane for _, plane, _ in runs if not isinstance(plane.velocity, ReducedVelocity)]:
        draw_velocity(there, folder / "velocity.png")

"""Pressures of the project's own resolved simulations: surface, cavity floor, microphone rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from studies.resolved_cases import resolved_provenance, time_last
from studies.resolved_liner import (
    complex_attribute,
    liner_of_group,
    read_attribute,
    require_case,
    resolved_cases,
    resolved_fluid,
    truth_of,
)
from torchliner.checks import plain_number
from torchliner.io.axes import read_times
from torchliner.io.hdf5 import open_file, read_si
from torchliner.records import PressureRecord

# The file's own impedances by the name a reader knows them under.
OWN = {
    "waves": "wave",
    "two microphones": "2mic",
    "pressure and velocity": "pv",
    "in situ": "insitu",
    "Dean": "dean",
}


def read_resolved_pressure(path: str | Path, case: str, stride: int = 1) -> PressureRecord:
    """Surface, cavity and microphone pressures of one case of a resolved liner.

    Args:
        path: file with one group a case; see ``resolved_cases.read_resolved``.
        case: group.
        stride: keep every n-th surface point along x (and z).
    Returns:
        The record. ``reference`` holds the file's own impedances: ``true`` (by waves for the slit,
        the pressure over the velocity through the hole for the orifice, the top row on its coarser
        lattice), and those of each method. The cases of the coarser lattice have one surface
        pressure a cell, its average.
    Raises:
        ValueError: no such case, or a stride below 1.
    """
    require_case(path, case, resolved_cases(path))
    if stride < 1:
        raise ValueError(f"stride is {stride}; it is at least 1")
    with open_file(path) as file:
        group = file[case]
        three = "z" in group
        geometry = liner_of_group(group, path)
        pitch = geometry.cell_pitch
        assert pitch is not None
        cut = (slice(None), *(slice(None, None, stride),) * (2 if three else 1))
        own = {name: complex_attribute(group, key, path) for name, key in OWN.items()}
        if three:
            own["top row"] = complex_attribute(group, "top", path)
        true = complex_attribute(group, truth_of(group, path), path)
        cells = "p_surface_cell" in group  # averaged over each cell
        x, z = read_si(group, "x", "m", path)[::stride], None
        if cells:
            x = x[0] + pitch * (0.5 + np.arange(group["p_surface_cell"].shape[-1]))
        elif three:
            z = read_si(group, "z", "m", path)[::stride]
        return PressureRecord(
            time_last(group, "p_surface_cell", (), path, "pressure")
            if cells
            else time_last(group, "p_surface", cut, path, "pressure"),
            time_last(group, "p_cavity_bottom", (), path, "pressure"),
            sampling_rate=read_times(group, Path(path))[0],
            x=x,
            z=z,
            cavity_depth=plain_number(geometry.cavity_depth),
            cavity_porosity=plain_number(geometry.cavity_porosity),
            cavity_hydraulic_radius=plain_number(geometry.cavity_hydraulic_radius),
            cell_pitch=pitch,
            microphones=time_last(group, "mic_p", (), path, "pressure"),
            microphone_y=read_si(group, "mic_y", "m", path),
            microphone_velocity=time_last(group, "mic_v", (), path),
            fluid=resolved_fluid(group, path),
            frequency=read_attribute(group, "frequency_Hz", path),
            incident_level=read_attribute(group, "incident_SPL_dB_nominal", path),
            mach=read_attribute(group, "mach", path),
            reference={"true": true, **own},
            title=f"resolved {'orifice (3-D)' if three else 'slit (2-D)'}, case {case}",
            provenance=resolved_provenance(file, case, stride, path),
            name=f"{path}:/{case}",
        )

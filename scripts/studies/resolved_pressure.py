"""Pressures of the project's own resolved simulations: surface, cavity floor, microphone rows."""

from __future__ import annotations

from pathlib import Path

from torchliner.io.hdf5 import open_file, read_attribute, read_si
from torchliner.io.resolved import (
    complex_attribute,
    require_case,
    resolved_cases,
    resolved_fluid,
    resolved_provenance,
    time_last,
)
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
        path: file with one group a case; see ``io.resolved.read_resolved``.
        case: group.
        stride: keep every n-th surface point along x (and z).
    Returns:
        The record. ``reference`` holds the file's own impedances: ``true`` (by waves for the slit,
        the pressure over the velocity through the hole for the orifice), and those of each method.
    Raises:
        ValueError: no such case, or a stride below 1.
    """
    require_case(path, case, resolved_cases(path))
    if stride < 1:
        raise ValueError(f"stride is {stride}; it is at least 1")
    with open_file(path) as file:
        group = file[case]
        three = "z" in group
        spacing = read_attribute(group, "cfg_dx", path)
        width = spacing * read_attribute(group, "cfg_D", path)
        pitch = spacing * read_attribute(group, "cfg_Lc", path)
        time = read_si(group, "time", "s", path)
        cut = (slice(None), *(slice(None, None, stride),) * (2 if three else 1))
        own = {name: complex_attribute(group, key, path) for name, key in OWN.items()}
        if three:
            own["top row"] = complex_attribute(group, "top", path)
        true = own["in situ" if three else "waves"]
        return PressureRecord(
            time_last(group, "p_surface", cut, path, "pressure"),
            time_last(group, "p_cavity_bottom", (), path, "pressure"),
            sampling_rate=float((len(time) - 1) / (time[-1] - time[0])),
            x=read_si(group, "x", "m", path)[::stride],
            z=read_si(group, "z", "m", path)[::stride] if three else None,
            cavity_depth=spacing * read_attribute(group, "cfg_H", path),
            cavity_porosity=(width / pitch) ** (2 if three else 1),
            # Twice the area over the perimeter: plates, or a square.
            cavity_hydraulic_radius=width / 2 if three else width,
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

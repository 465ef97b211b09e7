"""Layouts of the project's own simulations: resolved liner cells and channel planes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from studies.resolved_liner import (
    complex_attribute,
    preset_of,
    read_attribute,
    require_case,
    resolved_cases,
    resolved_fluid,
    resolved_holes,
    truth_of,
)
from torchliner.io.axes import read_times
from torchliner.io.hdf5 import (
    get_dataset,
    get_group,
    is_there,
    open_file,
    place,
    read_si,
    text_attribute,
)
from torchliner.io.stored_values import read_values
from torchliner.records import VelocityPlane
from torchliner.units import si_factor

TRUTHS = {"wave": "waves", "insitu": "in situ", "top": "top row"}


def read_resolved(path: str | Path, case: str | None = None, line: int = 0, stride: int = 1) -> VelocityPlane:
    """One height of one case of a resolved liner, with its own true impedance.

    Args:
        path: file with one group a case: ``time``, ``x``, [``z``,] ``y_lines``,
            ``v_n`` (time, line, [z,] x) and attributes.
        case: group.
        line: index of the height.
        stride: keep every n-th point along x.
    Returns:
        The plane. Its liner is the preset of this geometry and lattice, or "" with a warning: the
        linear part of another lattice is another one (see ``resolved_liner``).
    Raises:
        ValueError: no such case or line, times that are not uniform, no geometry.
    Warns:
        DataWarning: no preset has this geometry on this lattice.
    """
    cases = resolved_cases(path)
    if case is None:
        raise ValueError(f"case is not stated; {path} holds {', '.join(cases)}")
    require_case(path, case, cases)
    if not 0 <= line < len(cases[case]):
        raise ValueError(f"{path}:/{case} has lines 0 to {len(cases[case]) - 1}, not {line}")
    with open_file(path) as file:
        group = get_group(file, case, path)
        three = is_there(group, "z", path)
        whole = slice(None)
        rate, samples = read_times(group, path)
        velocity = time_last(group, "v_n", (whole, line, ..., slice(None, None, stride)), path)
        require_samples(velocity, samples, place(group, "v_n", path))
        stream = None
        if "u_x" in group and stride == 2:  # stored at every second point
            stream = time_last(group, "u_x", (whole, line), path)
        truth = truth_of(group, path)
        other = "insitu" if truth != "insitu" else "top"
        return VelocityPlane(
            velocity,
            sampling_rate=rate,
            height=cases[case][line],
            x=read_si(group, "x", "m", path)[::stride],
            z=read_si(group, "z", "m", path) if three else None,
            holes=resolved_holes(group, path),
            streamwise=stream,
            fluid=resolved_fluid(group, path),
            frequency=read_attribute(group, "frequency_Hz", path),
            incident_level=read_attribute(group, "incident_SPL_dB_nominal", path),
            mach=read_attribute(group, "mach", path),
            source_side="normal",
            liner=preset_of(group, path),
            reference={
                name: complex_attribute(group, key, path)
                for name, key in (("true", truth), (TRUTHS[other], other))
                if f"Z_{key}_re" in group.attrs  # a run without sound has none
            },
            title=f"resolved {'orifice (3-D)' if three else 'slit (2-D)'}, case {case}, "
            f"y = {1e3 * cases[case][line]:g} mm",
            provenance=resolved_provenance(file, case, stride, path),
            name=f"{path}:/{case}/v_n[{line}]",
        )


def resolved_provenance(file: h5py.File, case: str, stride: int, path: str | Path) -> dict[str, Any]:
    """Where a cut of a case comes from."""
    return {
        "source": str(file.attrs.get("source", "")),
        "solver": str(file.attrs.get("solver", "")),
        "case": case,
        "stride_x": stride,
        "periods_behind_truth": int(read_attribute(file[case], "n_periods_analysed", path)),
    }


def time_last(group: h5py.Group, key: str, part: Any, path: str | Path, quantity: str = "velocity") -> np.ndarray:
    """A part of a dataset, SI units, its first remaining axis, time, moved to the end."""
    dataset = get_dataset(group, key, path)
    factor = si_factor(quantity, text_attribute(dataset, "units"), place(group, key, path))
    stored = read_values(dataset, place(group, key, path), path, part)
    values = np.ascontiguousarray(np.moveaxis(stored, 0, -1))
    return values if factor == 1 else values * values.dtype.type(factor)


def require_samples(values: np.ndarray, samples: int, label: str) -> None:
    """Refuse a signal that has not one value for each time."""
    if values.shape[-1] != samples:
        raise ValueError(f"{label} has {values.shape[-1]} samples for {samples} times")


def read_channel(path: str | Path, line: int = 0, length: float = 1.0, velocity: float = 1.0) -> VelocityPlane:
    """One plane of the turbulent channel (hard wall, no sound), rescaled to a duct.

    Args:
        path: file with ``v`` (plane, time, z, x), ``t``, ``x``, ``y``, ``z``.
        line: index of the plane.
        length, velocity: factors on lengths and velocities; times scale by their ratio.
    Raises:
        ValueError: no such plane.
    """
    with open_file(path) as file:
        heights = read_si(file, "y", "m", path)
        if not 0 <= line < len(heights):
            raise ValueError(f"{path} has planes 0 to {len(heights) - 1}, not {line}")
        rate, samples = read_times(file, path, "t")
        values = time_last(file, "v", line, path)
        require_samples(values, samples, place(file, "v", path))
        stream = None
        if "u_plane1" in file and line == 1:
            stream = time_last(file, "u_plane1", (), path)
        raw = VelocityPlane(
            values,
            sampling_rate=rate,
            height=float(heights[line]),
            x=read_si(file, "x", "m", path),
            z=read_si(file, "z", "m", path),
            streamwise=stream,
            source_side="none",
            liner="hard wall",
            provenance={
                "solver": str(file.attrs.get("solver", "")),
                "Re_tau": read_attribute(file, "Re_tau", path),
                "scale_length": length,
                "scale_velocity": velocity,
            },
            name=f"{path}:/v[{line}]",
        )
    scaled = raw.scaled(length, velocity)
    title = f"channel LES over a hard wall, y = {1e3 * (scaled.height or 0):.3g} mm"
    object.__setattr__(scaled, "title", title)
    return scaled

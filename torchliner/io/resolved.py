"""Layouts of the project's own simulations: resolved liner cells and channel planes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.checks import did_you_mean
from torchliner.fluid import Fluid
from torchliner.io.hdf5 import get_dataset, open_file, read_si
from torchliner.records import VelocityPlane


def resolved_cases(path: str | Path) -> dict[str, list[float]]:
    """Cases of a resolved-liner file and the heights (m) of their lines or planes."""
    with open_file(path) as file:
        return {
            name: [round(float(y), 9) for y in group["y_lines"][()]]
            for name, group in file.items()
            if isinstance(group, h5py.Group) and "y_lines" in group
        }


def read_resolved(path: str | Path, case: str, line: int, stride: int = 1) -> VelocityPlane:
    """One height of one case of a resolved liner, with its own true impedance.

    Args:
        path: file with one group a case: ``time``, ``x``, [``z``,] ``y_lines``,
            ``v_n`` (time, line, [z,] x) and attributes.
        case: group.
        line: index of the height.
        stride: keep every n-th point along x.
    Raises:
        ValueError: no such case or line.
    """
    cases = resolved_cases(path)
    if case not in cases:
        raise ValueError(
            f"{path} has no case {case!r}{did_you_mean(case, list(cases))}; it holds "
            f"{', '.join(cases) or 'none'}"
        )
    if not 0 <= line < len(cases[case]):
        raise ValueError(f"{path}:/{case} has lines 0 to {len(cases[case]) - 1}, not {line}")
    with open_file(path) as file:
        group = file[case]
        known = dict(group.attrs)
        three = "z" in group
        velocity = np.moveaxis(get_dataset(group, "v_n", path)[:, line, ..., ::stride], 0, -1)
        stream = None
        if "u_x" in group and stride == 2:  # stored at every second point
            stream = np.moveaxis(group["u_x"][:, line], 0, -1)
        time = group["time"][()]
        density = float(known["density_kg_m3"])
        truth = "insitu" if three else "wave"
        other = ("top row", "top") if three else ("in situ", "insitu")
        mach = float(known["mach"])
        provenance = {
            "source": str(file.attrs.get("source", "")),
            "solver": str(file.attrs.get("solver", "")),
            "case": case,
            "stride_x": stride,
            "periods_behind_truth": int(known["n_periods_analysed"]),
        }
        return VelocityPlane(
            np.ascontiguousarray(velocity),
            sampling_rate=float((len(time) - 1) / (time[-1] - time[0])),
            height=cases[case][line],
            x=read_si(group, "x", "length", path)[::stride],
            z=read_si(group, "z", "length", path) if three else None,
            streamwise=None if stream is None else np.ascontiguousarray(stream),
            # An isothermal lattice gas: gamma = 1, no thermal losses.
            fluid=Fluid(
                float(known["sound_speed_m_s"]),
                density,
                float(known["kinematic_viscosity_m2_s"]) * density,
                1.0,
                1.0,
            ),
            frequency=float(known["frequency_Hz"]),
            incident_level=float(known["incident_SPL_dB_nominal"]),
            mach=mach,
            source_side="normal",
            liner="lbm_orifice" if three else "lbm_slit",
            reference={
                "true": _complex(known, truth),
                other[0]: _complex(known, other[1]),
            },
            title=f"resolved {'orifice (3-D)' if three else 'slit (2-D)'}, case {case}, "
            f"y = {1e3 * cases[case][line]:g} mm",
            provenance=provenance,
            name=f"{path}:/{case}/v_n[{line}]",
        )


def _complex(known: dict[str, Any], key: str) -> complex:
    return complex(float(known[f"Z_{key}_re"]), float(known[f"Z_{key}_im"]))


def read_channel(
    path: str | Path, plane: int, length: float = 1.0, velocity: float = 1.0
) -> VelocityPlane:
    """One plane of the turbulent channel (hard wall, no sound), rescaled to a duct.

    Args:
        path: file with ``v`` (plane, time, z, x), ``t``, ``x``, ``y``, ``z``.
        plane: index of the plane.
        length, velocity: factors on lengths and velocities; times scale by their ratio.
    Raises:
        ValueError: no such plane.
    """
    with open_file(path) as file:
        heights = read_si(file, "y", "length", path)
        if not 0 <= plane < len(heights):
            raise ValueError(f"{path} has planes 0 to {len(heights) - 1}, not {plane}")
        time = read_si(file, "t", "time", path)
        values = np.moveaxis(get_dataset(file, "v", path)[plane], 0, -1)
        stream = None
        if "u_plane1" in file and plane == 1:
            stream = np.ascontiguousarray(np.moveaxis(file["u_plane1"][()], 0, -1))
        raw = VelocityPlane(
            np.ascontiguousarray(values),
            sampling_rate=float((len(time) - 1) / (time[-1] - time[0])),
            height=float(heights[plane]),
            x=read_si(file, "x", "length", path),
            z=read_si(file, "z", "length", path),
            streamwise=stream,
            source_side="none",
            liner="hard wall",
            provenance={
                "solver": str(file.attrs.get("solver", "")),
                "Re_tau": float(file.attrs["Re_tau"]),
                "scale_length": length,
                "scale_velocity": velocity,
            },
            name=f"{path}:/v[{plane}]",
        )
    scaled = raw.scaled(length, velocity)
    title = f"channel LES over a hard wall, y = {1e3 * (scaled.height or 0):.3g} mm"
    object.__setattr__(scaled, "title", title)
    return scaled

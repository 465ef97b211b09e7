"""Layouts of the project's own simulations: resolved liner cells and channel planes."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.checks import tell
from torchliner.fluid import Fluid
from torchliner.io.axes import read_times
from torchliner.io.hdf5 import get_dataset, open_file, place, read_si, text_attribute
from torchliner.liners.catalogue import load_liner
from torchliner.liners.sdof import SDoFLiner
from torchliner.names import did_you_mean
from torchliner.records import VelocityPlane
from torchliner.units import si_factor

# A preset stands for one geometry on one lattice: its spacing (m) fixes the linear part, since the
# Stokes layer is not resolved. Beside it, which of the file's impedances is the truth there.
GRIDS = {
    "lbm_slit": (6.84e-5, "wave"),
    "lbm_slit_coarse": (1.368e-4, "wave"),
    "lbm_orifice": (1.08e-4, "insitu"),
    "lbm_orifice_coarse": (1.38375e-4, "top"),  # surface pressure is extrapolated through a layer
}
GEOMETRY = ("facesheet_thickness", "orifice_diameter", "porosity", "cavity_depth",
            "cavity_hydraulic_radius", "cavity_porosity", "cell_pitch")  # fmt: skip
SAME_GEOMETRY = 1e-3  # relative
TRUTHS = {"wave": "waves", "insitu": "in situ", "top": "top row"}


def resolved_cases(path: str | Path) -> dict[str, list[float]]:
    """Cases of a resolved-liner file and the heights (m) of their lines or planes."""
    with open_file(path) as file:
        return {
            name: [round(float(y), 9) for y in read_si(group, "y_lines", "m", path)]
            for name, group in file.items()
            if isinstance(group, h5py.Group) and "y_lines" in group
        }


def read_resolved(path: str | Path, case: str | None, line: int, stride: int = 1) -> VelocityPlane:
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
        raise ValueError(f"--layout resolved needs --case; {path} holds {', '.join(cases)}")
    require_case(path, case, cases)
    if not 0 <= line < len(cases[case]):
        raise ValueError(f"{path}:/{case} has lines 0 to {len(cases[case]) - 1}, not {line}")
    with open_file(path) as file:
        group = file[case]
        three = "z" in group
        whole = slice(None)
        velocity = time_last(group, "v_n", (whole, line, ..., slice(None, None, stride)), path)
        stream = None
        if "u_x" in group and stride == 2:  # stored at every second point
            stream = time_last(group, "u_x", (whole, line), path)
        truth = truth_of(group, path)
        other = "insitu" if truth != "insitu" else "top"
        return VelocityPlane(
            velocity,
            sampling_rate=read_times(group, Path(path))[0],
            height=cases[case][line],
            x=read_si(group, "x", "m", path)[::stride],
            z=read_si(group, "z", "m", path) if three else None,
            streamwise=stream,
            fluid=resolved_fluid(group, path),
            frequency=read_attribute(group, "frequency_Hz", path),
            incident_level=read_attribute(group, "incident_SPL_dB_nominal", path),
            mach=read_attribute(group, "mach", path),
            source_side="normal",
            liner=preset_of(group, path),
            reference={
                "true": complex_attribute(group, truth, path),
                TRUTHS[other]: complex_attribute(group, other, path),
            },
            title=f"resolved {'orifice (3-D)' if three else 'slit (2-D)'}, case {case}, "
            f"y = {1e3 * cases[case][line]:g} mm",
            provenance=resolved_provenance(file, case, stride, path),
            name=f"{path}:/{case}/v_n[{line}]",
        )


def resolved_liner(path: str | Path, case: str, linear: complex | str | None = None) -> SDoFLiner:
    """The liner of a case, with the geometry of the file.

    Args:
        path, case: as for ``read_resolved``.
        linear: Z at low level on the same lattice, or the case that has it (of n115 its truth):
            the model's Z at |v| = 0 and the tone is shifted there. None: no shift.
    Raises:
        ValueError: no such case, or no geometry.
    """
    require_case(path, case, (known := resolved_cases(path)))
    with open_file(path) as file:
        liner = liner_of_group(file[case], path)
        if linear is None:
            return liner
        if isinstance(linear, str):
            require_case(path, linear, known)
            linear = complex_attribute(file[linear], truth_of(file[linear], path), path)
        frequency = read_attribute(file[case], "frequency_Hz", path)
    return liner.replace(impedance_offset=linear - complex(liner.impedance(frequency)))


def liner_of_group(group: h5py.Group, path: str | Path) -> SDoFLiner:
    """Of the lattice's nodes; no offset."""
    node = read_attribute(group, "cfg_dx", path)
    names = {"tp": "thickness", "D": "cavity", "H": "depth", "Lc": "pitch"}
    nodes = {name: read_attribute(group, f"cfg_{key}", path) for key, name in names.items()}
    three = "z" in group
    hole = (1e-3 * read_attribute(group, "cfg_d_eff_mm", path) if three
            else node * read_attribute(group, "cfg_slit", path))  # fmt: skip
    side = node * nodes["cavity"]
    return SDoFLiner(
        node * nodes["thickness"], hole, read_attribute(group, "porosity", path),
        node * nodes["depth"],
        # Twice the area over the perimeter: a square, or two plates.
        side / 2 if three else side, (nodes["cavity"] / nodes["pitch"]) ** (2 if three else 1),
        cell_pitch=node * nodes["pitch"], fluid=resolved_fluid(group, path),
        name=f"resolved {group.name.strip('/')}",
    )  # fmt: skip


def truth_of(group: h5py.Group, path: str | Path) -> str:
    """Which of the file's impedances is the true one: vortices bias the waves of an orifice."""
    spacing = read_attribute(group, "cfg_dx", path)
    known = [truth for name, (node, truth) in GRIDS.items()
             if same(node, spacing) and ("orifice" in name) == ("z" in group)]  # fmt: skip
    return known[0] if known else "insitu" if "z" in group else "wave"


def preset_of(group: h5py.Group, path: str | Path) -> str:
    """The preset with the geometry and lattice of a case; "" with a warning if there is none."""
    mine, spacing = liner_of_group(group, path), read_attribute(group, "cfg_dx", path)
    differing = ""
    for name, (node, _) in GRIDS.items():
        known = load_liner(name)
        pairs = {key: (getattr(mine, key), getattr(known, key)) for key in GEOMETRY}
        off = [f"{key} {a:.4g} for {b:.4g}" for key, (a, b) in pairs.items() if not same(a, b)]
        if same(spacing, node) and not off:
            return name
        if name.endswith(("slit", "orifice")) and ("orifice" in name) == ("z" in group):
            differing = f"{name} differs: " + ", ".join([*off, f"spacing {spacing:g} for {node:g}"])
    tell(
        f"{path}:{group.name} has the geometry and lattice of no preset (SI; {differing}); its "
        "liner is not stated: write its own with resolved_liner, or convert --liner-file --linear",
        2,
    )
    return ""


def same(one: float, other: float) -> bool:
    """Within ``SAME_GEOMETRY``."""
    return abs(one / other - 1) < SAME_GEOMETRY


def require_case(path: str | Path, case: str, cases: Iterable[str]) -> None:
    """Refuse a case that the file does not hold; the nearest is named."""
    known = list(cases)
    if case not in known:
        raise ValueError(
            f"{path} has no case {case!r}{did_you_mean(case, known)}; it holds "
            f"{', '.join(known) or 'none'}"
        )


def resolved_fluid(group: h5py.Group, path: str | Path) -> Fluid:
    """The gas of a case: isothermal on a lattice, so gamma = 1 and no thermal losses."""
    density = read_attribute(group, "density_kg_m3", path)
    viscosity = read_attribute(group, "kinematic_viscosity_m2_s", path) * density
    return Fluid(read_attribute(group, "sound_speed_m_s", path), density, viscosity, 1.0, 1.0)


def resolved_provenance(
    file: h5py.File, case: str, stride: int, path: str | Path
) -> dict[str, Any]:
    """Where a cut of a case comes from."""
    return {
        "source": str(file.attrs.get("source", "")),
        "solver": str(file.attrs.get("solver", "")),
        "case": case,
        "stride_x": stride,
        "periods_behind_truth": int(read_attribute(file[case], "n_periods_analysed", path)),
    }


def read_attribute(group: h5py.Group, key: str, path: str | Path) -> float:
    """A number among the attributes.

    Raises:
        ValueError: there is none of this name.
    """
    if key not in group.attrs:
        raise ValueError(f"{path}:{group.name} has no attribute {key!r}")
    return float(group.attrs[key])


def complex_attribute(group: h5py.Group, key: str, path: str | Path) -> complex:
    """An impedance Z_key of a case, stored as two attributes."""
    return complex(*(read_attribute(group, f"Z_{key}_{part}", path) for part in ("re", "im")))


def time_last(
    group: h5py.Group, key: str, part: Any, path: str | Path, quantity: str = "velocity"
) -> np.ndarray:
    """A part of a dataset, SI units, its first remaining axis, time, moved to the end."""
    dataset = get_dataset(group, key, path)
    factor = si_factor(quantity, text_attribute(dataset, "units"), place(group, key, path))
    values = np.ascontiguousarray(np.moveaxis(dataset[part], 0, -1))
    return values if factor == 1 else values * values.dtype.type(factor)


def read_channel(
    path: str | Path, line: int, length: float = 1.0, velocity: float = 1.0
) -> VelocityPlane:
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
        values = time_last(file, "v", line, path)
        stream = None
        if "u_plane1" in file and line == 1:
            stream = time_last(file, "u_plane1", (), path)
        raw = VelocityPlane(
            values,
            sampling_rate=read_times(file, Path(path), "t")[0],
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

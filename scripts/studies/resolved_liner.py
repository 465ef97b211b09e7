"""The liner of a resolved case: geometry of the file, and the preset that stands for it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.checks import require_positive, tell
from torchliner.fluid import Fluid
from torchliner.io.hdf5 import is_there, open_file, read_si
from torchliner.liners.catalogue import load_liner
from torchliner.liners.sdof import SDoFLiner
from torchliner.names import did_you_mean
from torchliner.records.holes import Holes

# A preset stands for one geometry on one lattice: its spacing (m) fixes the linear part, since the
# Stokes layer is not resolved. Beside it, which of the file's impedances is the truth there.
GRIDS = {
    "lbm_slit": (6.84e-5, "wave"),
    "lbm_slit_coarse": (1.368e-4, "wave"),
    "lbm_orifice": (1.08e-4, "insitu"),
    "lbm_orifice_coarse": (1.38375e-4, "top"),  # surface pressure is extrapolated through a layer
}
GEOMETRY = (
    "facesheet_thickness",
    "orifice_diameter",
    "porosity",
    "cavity_depth",
    "cavity_hydraulic_radius",
    "cavity_porosity",
    "cell_pitch",
)
SAME_GEOMETRY = 1e-3  # relative


def read_attribute(group: h5py.Group, key: str, path: str | Path) -> float:
    """A number among the attributes.

    Raises:
        ValueError: there is none of this name, or it is no single finite number.
    """
    value = np.asarray(group.attrs.get(key, "missing"))
    if value.size != 1 or value.dtype.kind not in "fiu" or not np.isfinite(value).all():
        raise ValueError(f"{path}:{group.name}: attribute {key!r} is {value}; one finite number is needed")
    return float(value.reshape(()))


def resolved_cases(path: str | Path) -> dict[str, list[float]]:
    """Cases of a resolved-liner file and the heights (m) of their lines or planes."""
    with open_file(path) as file:
        return {
            name: [round(float(y), 9) for y in read_si(group, "y_lines", "m", path)]
            for name, group in file.items()
            if isinstance(group, h5py.Group) and is_there(group, "y_lines", path)
        }


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
    require_positive(f"{path}:{group.name}: cfg_Lc", nodes["pitch"])
    three = "z" in group
    hole = (
        1e-3 * read_attribute(group, "cfg_d_eff_mm", path) if three else node * read_attribute(group, "cfg_slit", path)
    )
    side = node * nodes["cavity"]
    require_positive(f"{path}:{group.name}: cfg_dx (m)", node)
    return SDoFLiner(
        node * nodes["thickness"],
        hole,
        read_attribute(group, "porosity", path),
        node * nodes["depth"],
        # Twice the area over the perimeter: a square, or two plates.
        side / 2 if three else side,
        (nodes["cavity"] / nodes["pitch"]) ** (2 if three else 1),
        cell_pitch=node * nodes["pitch"],
        fluid=resolved_fluid(group, path),
        name=f"resolved {group.name.strip('/')}",
    )


def resolved_holes(group: h5py.Group, path: str | Path) -> Holes | None:
    """Centres of the slits or orifices, one a cell, from the open nodes; None without these."""
    masks = [name for name in ("orifice_mask_full", "orifice_mask", "orifice_ix") if is_there(group, name, path)]
    if not masks:
        return None
    node, pitch = (read_attribute(group, f"cfg_{key}", path) for key in ("dx", "Lc"))
    values = read_si(group, masks[0], "1", path)
    z, x = values.nonzero() if values.ndim == 2 else (None, values)
    cells = [x // pitch == number for number in np.unique(x // pitch)]

    def middle(nodes: Any) -> tuple[float, ...]:
        # The first node is centred at half a spacing: 0 is a cell's corner.
        return tuple(float(node * (nodes[one].mean() + 0.5)) for one in cells)

    diameter = (float(liner_of_group(group, path).orifice_diameter),) * len(cells)
    return Holes(middle(x), diameter, None if z is None else middle(z))


def truth_of(group: h5py.Group, path: str | Path) -> str:
    """Which of the file's impedances is the true one: vortices bias the waves of an orifice."""
    spacing = read_attribute(group, "cfg_dx", path)
    known = [
        truth for name, (node, truth) in GRIDS.items() if same(node, spacing) and ("orifice" in name) == ("z" in group)
    ]
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
        "liner is not stated: write its own with resolved_liner",
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
            f"{path} has no case {case!r}{did_you_mean(case, known)}; it holds {', '.join(known) or 'none'}"
        )


def resolved_fluid(group: h5py.Group, path: str | Path) -> Fluid:
    """The gas of a case: isothermal on a lattice, so gamma = 1 and no thermal losses."""
    density = read_attribute(group, "density_kg_m3", path)
    viscosity = read_attribute(group, "kinematic_viscosity_m2_s", path) * density
    return Fluid(read_attribute(group, "sound_speed_m_s", path), density, viscosity, 1.0, 1.0)


def complex_attribute(group: h5py.Group, key: str, path: str | Path) -> complex:
    """An impedance Z_key of a case, stored as two attributes."""
    return complex(*(read_attribute(group, f"Z_{key}_{part}", path) for part in ("re", "im")))

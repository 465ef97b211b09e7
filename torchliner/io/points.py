"""Points of a solver's file as a plane: which direction is normal to the wall, grid or scattered, order of probes.

The plane's x and z are the two axes along the wall in this order: x and z where the normal is y, x and y where it is z,
y and z where it is x.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.checks import tell
from torchliner.file_checks import Unwritten
from torchliner.io.plane_format import Imported, PlaneRequest, Stored
from torchliner.records import VelocityPlane
from torchliner.units import require_plausible, si_factor

AXES = "xyz"
SAME = 1e-5  # of the largest coordinate: points that agree to the digits of a text
COMPONENT = re.compile(r"([xyz])[ _.-]?vel(?:ocity)?|(?:u|v|(?:.*[ _])?vel(?:ocity)?)[ _:.[-]*([xyz])]?", re.IGNORECASE)
OTHERS = re.compile(
    r"(?:p|rho|t)(?:[ _]?(?:rgh|mean|prime|prime2mean|fluc\w*|rms|0))?|cp|k|nut|omega"
    r"|.*(?:temperature|density|vorticity)",
    re.IGNORECASE,
)
PRESSURE = re.compile(r"(?:.*[ _-])?(?:static|total|dynamic|mean|acoustic|wall)?[ _-]?press(?:ure)?s?", re.IGNORECASE)


# Names and units


def component_of(name: str | None) -> int | None:
    """0, 1, 2 for names as x_velocity, YVelocity, U_z; None for those of a vector or of others."""
    found = COMPONENT.fullmatch(name or "")
    return AXES.index((found[1] or found[2]).lower()) if found else None


def require_velocity(label: str, request: PlaneRequest) -> None:
    """Refuse what is named as another quantity, FILE:/VARIABLE or FILE: a pressure gives an impedance as any do."""
    path, _, name = label.rpartition(":/")
    name = name.rpartition("/")[2] if path else Path(label).stem
    if not request.wall_normal_component and (PRESSURE.fullmatch(name) or (path and OTHERS.fullmatch(name))):
        raise ValueError(
            f"{label}: {name!r} names no velocity but another quantity; name the velocity (--variable), or state "
            "wall_normal_component=True (--wall-normal-component) if it is one"
        )


def direction_of(name: str, request: PlaneRequest, label: str) -> int | None:
    """``component_of`` one value a point; where its name tells none, the user must say that it is along the normal."""
    component = component_of(name)
    if component is None and not request.wall_normal_component:
        raise ValueError(
            f"{label} has one value a point, and its name tells no direction: take a vector or a component "
            "(--variable), or state wall_normal_component=True (--wall-normal-component)"
        )
    return component


def require_direction(label: str, component: int | None, normal: str | None) -> None:
    """Refuse a component along another axis than the normal that the user states."""
    if normal and component is not None and AXES[component] != normal[-1]:
        raise ValueError(
            f"{label} is the velocity along {AXES[component]}, but normal is {normal!r}; name the variable of that "
            "direction"
        )


def stated_factor(request: PlaneRequest, quantity: str, label: str) -> float:
    """To SI, of velocities or lengths whose unit no file states; a ValueError where the user states none either."""
    unit = getattr(request, f"{quantity}_units")
    if unit is None:
        example = "m/s" if quantity == "velocity" else "m"
        raise ValueError(
            f"{label} states no unit of {quantity}: state {quantity}_units='{example}' or another "
            f"(--{quantity}-units {example})"
        )
    return si_factor(quantity, unit, f"{label}: {quantity}_units")


# Places


@dataclass(frozen=True)
class Placed:
    """Points as probes of a plane: the axis of the wall normal, and -1 where it points towards lower coordinates; the
    point that each probe is, (P,); the shape of the probes, (z, x) or (P,); x, z (m) and area (m2); the height, m."""

    label: str
    axis: int
    sign: float
    order: np.ndarray
    shape: tuple[int, ...]
    about: dict[str, Any]
    height: float

    def plane(self, velocity: np.ndarray | Stored, rate: float, start: float, path: Path, **told: Any) -> VelocityPlane:
        """The plane of velocities along the normal, m/s: values (T, P) in the order of the probes, or what is stored.
        Its rate is in Hz, its start in s, its title from the path; what is ``told`` goes into the provenance."""
        if isinstance(velocity, np.ndarray):
            velocity = Imported(velocity, (*self.shape, len(velocity)), self.label)
        told |= {"normal": ("-" if self.sign < 0 else "") + AXES[self.axis], "normal_coordinate": self.height}
        about = {**self.about, "name": self.label, "title": path.stem, "provenance": told}
        return VelocityPlane(velocity, sampling_rate=rate, start=start, **about)


def place(
    points: np.ndarray,
    request: PlaneRequest,
    label: str,
    component: int | None = None,
    facing: np.ndarray | None = None,
    area: np.ndarray | None = None,
) -> Placed:
    """Where points lie in a plane; those that fill a grid of two rows at least are one.

    Args:
        points, request, label: m, (N, 3); its ``normal`` is taken if stated; for messages.
        component: axis that the velocity in the file is along; None: it is a vector.
        facing: normal of the surface, (3,), where the file has one.
        area: m2, that each point stands for, (N,).
    Raises:
        ValueError: coordinates that are not finite or too large; no direction is stated, and the points do not tell;
            another than the component's is stated; points that stand one above another.
    Warns:
        DataWarning: the normal follows from points or names; the points stand at several heights.
    """
    if not len(points):
        raise Unwritten(f"{label} has no points")
    if not np.isfinite(points).all():
        raise ValueError(f"{label} has points whose coordinates are not finite")
    require_plausible(points, "length", f"{label}: points")
    axis, sign = _wall_normal(points, request, label, component, facing)
    height = points[:, axis]
    x, z = (points[:, i] for i in range(3) if i != axis)
    near = SAME * max(np.abs(x).max(), np.abs(z).max())
    (columns, column), (rows, row) = (_levels(values, near) for values in (x, z))
    spot = row * len(columns) + column
    order = np.argsort(spot, kind="stable")
    shape: tuple[int, ...] = (len(rows), len(columns))
    if np.ptp(height) > SAME * np.abs(points).max():
        span = f"{AXES[axis]} = {height.min():.6g} to {height.max():.6g} m along the wall normal"
        if above := len(spot) - len(np.unique(spot)):
            raise ValueError(
                f"{label}: {above} of {len(spot)} points stand above others, {span}; a plane has one height: write the "
                "points of one height alone"
            )
        tell(f"{label}: the points stand at {span}, of which a plane has one")
    if min(shape) > 1 and np.array_equal(spot[order], np.arange(math.prod(shape))):
        x, z = columns, rows
    else:
        order, shape = np.arange(len(points)), (len(points),)
    about = {"x": x, "z": z, "area": None if area is None else area[order]}
    return Placed(label, axis, sign, order, shape, about, float(np.median(height)))


def _wall_normal(
    points: np.ndarray, request: PlaneRequest, label: str, component: int | None, facing: np.ndarray | None
) -> tuple[int, float]:
    """Axis of the wall normal, and 1, or -1 where it points towards lower coordinates."""
    if request.normal is not None:
        require_direction(label, component, request.normal)
        return AXES.index(request.normal[-1]), -1.0 if request.normal[0] == "-" else 1.0
    extent = np.ptp(points, axis=0)
    flat = np.flatnonzero(extent <= SAME * max(extent.max(), np.abs(points).max()))
    if component is None and len(flat) != 1:
        raise ValueError(
            f"{label}: the points extend over {' x '.join(f'{length:.4g}' for length in extent)} m along x, y, z, "
            "which tells no wall-normal direction; state normal='y' or another (--normal y; --normal=-y where the "
            "liner lies above)"
        )
    axis = int(flat[0]) if component is None else component
    sign = -1.0 if facing is not None and facing[axis] < 0 else 1.0
    side, other = (f"-{AXES[axis]}", f"+{AXES[axis]}")[:: int(-sign)]
    why = "the variable is named so" if component is not None else "the points lie in a plane"
    faces = "" if facing is None else " and the surface faces that way"
    tell(
        f"{label}: the wall normal is taken as {side}, since {why}{faces}; state normal='{side}' if so, '{other}' if "
        "the liner lies on the other side"
    )
    return axis, sign


def _levels(values: np.ndarray, near: float) -> tuple[np.ndarray, np.ndarray]:
    """Values that differ by more than ``near``, and which of them each one is."""
    order = np.argsort(values, kind="stable")
    new = np.diff(values[order], prepend=-math.inf) > near
    level = np.empty(len(values), np.int64)
    level[order] = np.cumsum(new) - 1
    return values[order][new], level

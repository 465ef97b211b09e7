"""Points of a solver's file as a plane: the direction normal to the wall, a grid or scattered probes, their order; and
series of frames, whose values are read once.

The plane's x and z are the two axes along the wall in this order: x and z where the normal is y, x and y where it is z,
y and z where it is x.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.checks import tell
from torchliner.file_checks import Unwritten, naming, require_memory
from torchliner.io.plane_format import Imported, PlaneRequest, Stored, room
from torchliner.names import did_you_mean
from torchliner.records import VelocityPlane
from torchliner.units import require_plausible, si_factor

AXES = "xyz"
SAME = 1e-5  # of the largest coordinate: points that agree to the digits of a text
COMPONENT = re.compile(r"([xyz])[ _.-]?vel(?:ocity)?|(?:u|v|(?:.*[ _])?vel(?:ocity)?)[ _:.[-]*([xyz])]?", re.IGNORECASE)
VELOCITY = re.compile(r"(?:U|u|v|[Vv]elocity|VELOCITY|vel)(?:[_:]?[xyz])?|[XYZxyz]_?[Vv]elocity")
OTHERS = re.compile(
    r"(?:p|rho|t)(?:[ _]?(?:rgh|mean|prime|prime2mean|fluc\w*|rms|0))?|cp|k|nut|omega"
    r"|.*(?:temperature|density|vorticity)",
    re.IGNORECASE,
)
PRESSURE = re.compile(r"(?:.*[ _-])?(?:static|total|dynamic|mean|acoustic|wall)?[ _-]?press(?:ure)?s?", re.IGNORECASE)
Places = tuple[np.ndarray, np.ndarray | None]  # points, (N, 3), and areas of faces
Read = Callable[[], "Frame"]

# Names and units


def component_of(name: str | None) -> int | None:
    """0, 1, 2 for names as x_velocity, YVelocity, U_z; None for those of a vector or of others."""
    found = COMPONENT.fullmatch(name or "")
    return AXES.index((found[1] or found[2]).lower()) if found else None


def require_velocity(label: str, request: PlaneRequest) -> None:
    """Refuse FILE:/VARIABLE or FILE that names another quantity: a pressure gives an impedance as a velocity does."""
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
    """Where points, m, (N, 3), lie in a plane; those that fill a grid of two rows at least are one.

    The wall normal is that of the request, else the axis of the ``component`` in the file (None: a vector), else that
    of the plane in which the points lie, with a DataWarning; ``facing``, (3,), is the normal that the file states.
    ``area``: m2 for each point, (N,). A ValueError where these do not tell the normal or contradict each other,
    coordinates are not finite or too large, or points stand one above another.
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
                f"{label}: {above} of {len(spot)} points stand above others, {span}; keep those of one height"
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


def centres_of(points: np.ndarray, corners: np.ndarray, ends: np.ndarray, label: str) -> Places:
    """Centroids (F, 3) and areas (F,) of faces, by triangles about the mean corner; ``corners`` are numbers of points,
    (N, 3), of all faces one after another, ``ends`` where those of each end, (F,)."""
    starts = np.append(0, ends[:-1])
    sizes = ends - starts
    if not len(ends) or (sizes < 3).any() or ends[-1] != len(corners):
        raise ValueError(f"{label}: faces have {sizes.min(initial=3)} corners of {len(corners)}; three are needed")
    if corners.min() < 0 or corners.max() >= len(points):
        raise ValueError(f"{label}: faces name points {corners.min()} to {corners.max()}; there are {len(points)}")
    corner = points[corners]
    middle = np.add.reduceat(corner, starts) / sizes[:, None]
    hub = np.repeat(middle, sizes, 0)
    after = np.arange(1, len(corner) + 1)
    after[ends - 1] = starts
    triangle = 0.5 * np.cross(corner - hub, corner[after] - hub)
    size = np.linalg.norm(triangle, axis=1)[:, None]
    total = np.add.reduceat(size, starts)
    moment = np.add.reduceat(size * (corner + corner[after] + hub) / 3, starts)
    centres = np.where(total > 0, moment / np.where(total > 0, total, 1), middle)
    return centres, np.linalg.norm(np.add.reduceat(triangle, starts), axis=1)


# Frames


@dataclass(frozen=True)
class Frame:
    """Values at one time: points, (N, 3); arrays by name, whether they lie on faces, and (N, components); where faces
    stand, and their areas; what tells, beside points, whether two frames have the same faces; the time stated."""

    points: np.ndarray
    arrays: Mapping[str, tuple[bool, np.ndarray]]
    faces: Callable[[], Places] | None = None
    corners: tuple[np.ndarray, ...] = ()
    time: float | None = None

    def pick(self, request: PlaneRequest, label: str) -> str:
        """Name of the velocity: stated, or that of the only vector or component along the normal called so."""
        held, name = ", ".join(self.arrays) or "none", request.variable
        if name is not None and name not in self.arrays:
            raise ValueError(f"{label} has no variable {name!r}{did_you_mean(name, [*self.arrays])}; it holds {held}")
        usual = {name: values.shape[1] for name, (_, values) in self.arrays.items() if VELOCITY.fullmatch(name)}
        along = {None} | ({AXES.index(request.normal[-1])} if request.normal else set())
        found = [name for name, size in usual.items() if size == 3] or [n for n in usual if component_of(n) in along]
        if name is None and len(found) != 1:
            raise ValueError(f"{label} holds {held}; name the velocity (--variable)")
        return name or found[0]

    def stands_as(self, first: Frame) -> bool:
        """Whether points, to the digits of text, and faces are those of another, in the same order."""
        near = SAME * np.abs(first.points).max(initial=0)
        same = self.points.shape == first.points.shape and (np.abs(self.points - first.points) <= near).all()
        return bool(same) and all(map(np.array_equal, self.corners, first.corners))


def plane_of_frames(
    frames: Sequence[tuple[Path, Read]],
    clock: Callable[[list[float | None]], tuple[float, float]],
    request: PlaneRequest,
    path: Path,
    factor: float = 1.0,
    length: float = 1.0,
    **about: Any,
) -> VelocityPlane:
    """The plane of a series of frames, each a file and a function that reads it, in the order of time; they are read
    here, one after another.

    ``clock`` gives sampling rate, Hz, and start, s, from the times that the frames state; ``factor`` and ``length`` are
    to m/s and m, ``about`` is for the provenance. A ValueError as of ``place``, where there is no velocity or several,
    or a frame has other points or another order of them.
    """
    file, read = frames[0]
    with naming(file):
        first = read()
    name = first.pick(request, str(file))
    label, (on_faces, values) = f"{file}:/{name}", first.arrays[name]
    if values.shape[1] not in (1, 3):
        raise ValueError(f"{label} has {values.shape[1]} components; a vector, or one component, is needed")
    component = direction_of(name, request, label) if values.shape[1] == 1 else None
    points, area = first.faces() if on_faces and first.faces else (first.points, None)
    if len(points) != len(values):
        raise ValueError(f"{label} has {len(values)} values for {len(points)} {'faces' if on_faces else 'points'}")
    area = None if area is None else area * length**2
    placed = place(length * points, request, f"{path}:/{name}", component, area=area)
    column = placed.axis if values.shape[1] == 3 else 0
    require_memory(8 * len(values), f"{label}: one frame")
    found, times = room((len(frames), len(values)), np.float64 if values.dtype.itemsize > 4 else np.float32), []
    for i, (file, read) in enumerate(frames):
        with naming(file):
            frame = read() if i else first
        there, own = frame.arrays.get(name, (on_faces, values[:0]))
        if there != on_faces or own.shape != values.shape or not frame.stands_as(first):
            raise ValueError(
                f"{file} has {len(own)} values of {name!r}, the first frame, {frames[0][0]}, {len(values)}, or their "
                "points or faces are others, or in another order: give each stretch of times on its own"
            )
        found[i] = own[placed.order, column]
        times.append(frame.time)
    if factor * placed.sign != 1:
        np.multiply(found, factor * placed.sign, out=found, casting="same_kind")
    about |= {"frames": len(frames), "values": "faces" if on_faces else "points"}
    return placed.plane(found, *clock(times), path, **about)

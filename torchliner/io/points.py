"""Points of a solver's file as a plane: the direction normal to the wall, a grid or scattered probes, their order; and
series of frames, whose values are read once.

The plane's x and z are the two axes along the wall in this order: x and z where the normal is y, x and y where it is z,
y and z where it is x.
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from torchliner.checks import tell
from torchliner.file_checks import Unwritten, naming, require_memory
from torchliner.io.plane_format import PlaneRequest, Stored, clock_of
from torchliner.names import did_you_mean
from torchliner.records import VelocityPlane
from torchliner.units import si_factor

AXES = "xyz"
SAME = 1e-5  # of the largest coordinate: points that agree to the digits of a text
COMPONENT = re.compile(r"([xyz])[ _.-]?vel(?:ocity)?|(?:u|v|(?:.*[ _])?vel(?:ocity)?)[ _:.[-]*([xyz])]?", re.IGNORECASE)
PRESSURE = re.compile(r"p|.*press(ure)?s?", re.IGNORECASE)
USUAL = ("U", "u", "velocity", "Velocity", "VELOCITY")  # names of vectors
Places = tuple[np.ndarray, np.ndarray | None]  # points, (N, 3), and areas of faces


def component_of(name: str | None) -> int | None:
    """0, 1, 2 for names as x_velocity, YVelocity, U_z; None for those of a vector or of others."""
    found = COMPONENT.fullmatch(name or "")
    return AXES.index((found[1] or found[2]).lower()) if found else None


def require_velocity(label: str, request: PlaneRequest) -> None:
    """Refuse FILE:/VARIABLE or FILE that names a pressure, which gives an impedance as a velocity does."""
    path, _, name = label.rpartition(":/")
    name = name.rpartition("/")[2] if path else Path(label).stem
    if PRESSURE.fullmatch(name) and not request.wall_normal_component:
        raise ValueError(
            f"{label}: {name!r} names no velocity but another quantity; name the velocity (--variable), or state "
            "wall_normal_component=True (--wall-normal-component) if it is one"
        )


def require_direction(label: str, name: str, normal: str | None) -> None:
    """Refuse a component that is named along another axis than the normal that the user states."""
    component = component_of(name)
    if normal and component is not None and AXES[component] != normal[-1]:
        raise ValueError(f"{label} is the velocity along {AXES[component]}, but normal is {normal!r}; name another one")


def column_of(name: str, values: int, request: PlaneRequest, label: str) -> int:
    """Which of one or three values a point is along the wall normal. Of one, its name must tell, or the user."""
    require_direction(label, name, request.normal)
    if values not in (1, 3):
        raise ValueError(f"{label} has {values} values a point; a vector, or one component, is needed")
    if values == 1 and component_of(name) is None and not request.wall_normal_component:
        raise ValueError(
            f"{label} has one value a point, and its name tells no direction: take a vector or a component "
            "(--variable), or state wall_normal_component=True (--wall-normal-component)"
        )
    return AXES.index((request.normal or "x")[-1]) if values == 3 else 0


def stated_factor(request: PlaneRequest, quantity: str, label: str) -> float:
    """To SI, of velocities or lengths whose unit no file states; a ValueError where the user states none either."""
    unit, example = getattr(request, f"{quantity}_units"), "m/s" if quantity == "velocity" else "m"
    if unit is None:
        raise ValueError(f"{label} states no unit of {quantity}: {quantity}_units=... (--{quantity}-units {example})")
    return si_factor(quantity, unit, f"{label}: {quantity}_units")


@dataclass(frozen=True)
class Placed:
    """Points as probes of a plane: the point that each probe is, (P,); the shape of the probes, (z, x) or (P,); x, z
    (m) and area (m2); -1 where the wall normal points towards lower coordinates; facts for the provenance."""

    label: str
    order: np.ndarray
    shape: tuple[int, ...]
    about: dict[str, Any]
    sign: float
    told: dict[str, Any]

    def plane(self, velocity: np.ndarray | Stored, rate: float, start: float, path: Path, **told: Any) -> VelocityPlane:
        """The plane of velocities along the normal, m/s: values (T, P) in the order of the probes, or what is stored.
        Its rate is in Hz, its start in s, its title from the path; what is ``told`` goes into the provenance."""
        about = {**self.about, "name": self.label, "title": path.stem, "provenance": {**told, **self.told}}
        signals: Any = velocity
        if isinstance(velocity, np.ndarray):
            signals = torch.from_numpy(velocity).T.unflatten(0, self.shape)
        return VelocityPlane(signals, sampling_rate=rate, start=start, **about)


def place(points: np.ndarray, request: PlaneRequest, label: str, area: np.ndarray | None = None) -> Placed:
    """Where points, m, (N, 3), lie in a plane normal to the direction that the user states; those that fill a grid of
    two rows at least are one. ``area``: m2 for each point, (N,).

    A ValueError where no normal is stated, coordinates are not finite or too large, or points stand one above another.
    """
    if not len(points):
        raise Unwritten(f"{label} has no points")
    if not np.isfinite(points).all():
        raise ValueError(f"{label} has points whose coordinates are not finite")
    if request.normal is None:
        extent = " x ".join(f"{length:.4g}" for length in np.ptp(points, axis=0))
        raise ValueError(
            f"{label}: the points extend over {extent} m along x, y, z; state normal='y' or another (--normal y; "
            "--normal=-y where the liner lies above)"
        )
    axis = AXES.index(request.normal[-1])
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
            raise ValueError(f"{label}: {above} of {len(spot)} points stand above others, {span}; keep one height")
        tell(f"{label}: the points stand at {span}, of which a plane has one")
    if min(shape) > 1 and np.array_equal(spot[order], np.arange(math.prod(shape))):
        x, z = columns, rows
    else:
        order, shape = np.arange(len(points)), (len(points),)
    about = {"x": x, "z": z, "area": None if area is None else area[order]}
    told = {"normal": request.normal.lstrip("+"), "normal_coordinate": float(np.median(height))}
    return Placed(label, order, shape, about, -1.0 if request.normal[0] == "-" else 1.0, told)


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
    whole = len(ends) and sizes.min() > 2 and ends[-1] == len(corners)
    if not whole or not 0 <= corners.min() <= corners.max() < len(points):
        raise ValueError(f"{label}: faces have fewer than three corners, or name points that are not there")
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


class Frame(NamedTuple):
    """Values at one time: arrays by name, whether they lie on faces, and (N, components); where points, or faces,
    stand, and areas; the time stated."""

    arrays: Mapping[str, tuple[bool, np.ndarray]]
    places: Callable[[bool], Places]
    time: float | None = None


Frames = list[tuple[Path, Callable[[], Frame], float]]  # files, what reads them, their times or numbers


def plane_of_frames(
    frames: Frames, request: PlaneRequest, path: Path, *, timed: bool, si: bool, **about: Any
) -> VelocityPlane:
    """The plane of a series of frames in the order of time, which are read here, one after another.

    ``timed``: the numbers of the files are times, s, else they count unless the frames state times. ``si``: units are
    SI. ``about`` is for the provenance. A ValueError as of ``place`` and ``clock_of``; where there is no velocity, a
    unit or the rate is missing, or a frame has other points or another order of them.
    """
    file, read, _ = frames[0]
    with naming(file):
        first = read()
    factor, length = (1.0 if si else stated_factor(request, each, f"{path}") for each in ("velocity", "length"))
    if not timed and first.time is None and request.sampling_rate is None:
        raise ValueError(f"{file} states no time (TimeValue); state sampling_rate=... (--sampling-rate HZ)")
    name = request.variable or next((each for each in USUAL if each in first.arrays), "")
    if name not in first.arrays:
        held, near = ", ".join(first.arrays) or "none", did_you_mean(name, [*first.arrays])
        raise ValueError(f"{file} has no variable {name!r}{near}; it holds {held}; name the velocity (--variable)")
    label, (on_faces, values) = f"{file}:/{name}", first.arrays[name]
    column = column_of(name, values.shape[1], request, label)
    points, area = first.places(on_faces)
    if len(points) != len(values):
        raise ValueError(f"{label} has {len(values)} values for {len(points)} {'faces' if on_faces else 'points'}")
    placed = place(length * points, request, f"{path}:/{name}", None if area is None else area * length**2)
    kind = np.dtype(np.float64 if values.dtype.itemsize > 4 else np.float32)
    require_memory(kind.itemsize * len(frames) * len(values), f"{path}, {len(frames)} frames of {len(values)} values,")
    found, times = np.empty((len(frames), len(values)), kind), []
    for i, (file, read, number) in enumerate(frames):
        with naming(file):
            frame = read() if i else first
            there, own = frame.arrays.get(name, (on_faces, values[:0]))
            same = there == on_faces and own.shape == values.shape
            if not same or np.abs(frame.places(on_faces)[0] - points).max() > SAME * np.abs(points).max():
                raise ValueError(
                    f"{file} has {len(own)} values of {name!r}, the first frame, {frames[0][0]}, {len(values)}, or "
                    "their points or faces are others, or in another order: give each stretch of times on its own"
                )
        found[i] = own[placed.order, column]
        times.append(number if timed or frame.time is None else frame.time)
    if factor * placed.sign != 1:
        np.multiply(found, factor * placed.sign, out=found, casting="same_kind")
    rate, start = clock_of(np.array(times), f"{path}, times", request.sampling_rate)
    about |= {"frames": len(frames), "values": "faces" if on_faces else "points"}
    return placed.plane(found, rate, start, path, **about)

"""Points of a solver's file as a plane: wall-normal direction, grid or scattered, order of probes.

Points have coordinates x, y, z of the solver. The plane's x and z are the two axes along the wall
in this order: x and z where the normal is y, x and y where it is z, y and z where it is x.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchliner.checks import tell
from torchliner.file_checks import Unwritten, naming
from torchliner.io.plane_format import FrameVelocity, PlaneRequest
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
Source = Callable[[int, int], np.ndarray]


def component_of(name: str | None) -> int | None:
    """0, 1, 2 for names as x_velocity, YVelocity, U_z; None for those of a vector or of others."""
    found = COMPONENT.fullmatch(name or "")
    return AXES.index((found[1] or found[2]).lower()) if found else None


def require_velocity(label: str, request: PlaneRequest) -> None:
    """Refuse what is named as another quantity: a pressure gives an impedance as any numbers do.

    Args:
        label: FILE:/VARIABLE, or FILE alone where the format names no variable.
        request: its ``wall_normal_component`` says that it is the velocity all the same.
    Raises:
        ValueError: it is.
    """
    path, _, name = label.rpartition(":/")
    name = name.rpartition("/")[2] if path else Path(label).stem
    if request.wall_normal_component or not (PRESSURE.fullmatch(name) or (path and OTHERS.fullmatch(name))):
        return
    raise ValueError(
        f"{label}: {name!r} names no velocity but another quantity; name the velocity (--variable), or state "
        "wall_normal_component=True (--wall-normal-component) if it is one"
    )


def direction_of(name: str, request: PlaneRequest, label: str) -> int | None:
    """``component_of`` one value a point; None only where the user says that it is along the wall normal.

    Raises:
        ValueError: its name tells no direction, and the user says none.
    """
    component = component_of(name)
    if component is None and not request.wall_normal_component:
        raise ValueError(
            f"{label} has one value a point, and its name tells no direction: take a vector or a component "
            "(--variable), or state wall_normal_component=True (--wall-normal-component)"
        )
    return component


def length_factor(request: PlaneRequest, label: str) -> float:
    """To m, of coordinates whose unit no file states.

    Raises:
        ValueError: it is not stated here either.
    """
    return _stated(request, "length", label)


def velocity_factor(request: PlaneRequest, label: str) -> float:
    """To m/s, of velocities whose unit no file states.

    Raises:
        ValueError: it is not stated here either.
    """
    return _stated(request, "velocity", label)


def _stated(request: PlaneRequest, quantity: str, label: str) -> float:
    """Factor of a stated unit."""
    unit = getattr(request, f"{quantity}_units")
    if unit is None:
        example = "m/s" if quantity == "velocity" else "m"
        raise ValueError(
            f"{label} states no unit of {quantity}: state {quantity}_units='{example}' or another "
            f"(--{quantity}-units {example})"
        )
    return si_factor(quantity, unit, f"{label}: {quantity}_units")


def wall_normal(
    points: np.ndarray, request: PlaneRequest, label: str,
    component: int | None = None, facing: np.ndarray | None = None,
) -> tuple[int, float]:  # fmt: skip
    """Axis of the wall normal, and 1, or -1 where it points towards lower coordinates.

    Args:
        points: m, (N, 3).
        request: its ``normal`` is taken if stated.
        label: for messages.
        component: axis that the velocity in the file is along; None: it is a vector.
        facing: normal of the surface, (3,), where the file has one.
    Raises:
        ValueError: no direction is stated, and the points do not tell; another than the
            component's is stated.
    Warns:
        DataWarning: it is not stated but follows from points or names.
    """
    if request.normal is not None:
        stated = re.fullmatch(r"([+-]?)([xyz])", str(request.normal))
        if stated is None:
            raise ValueError(
                f"{label}: normal is {request.normal!r}; x, y or z is needed, with '-' where the "
                "liner lies on the positive side"
            )
        axis = AXES.index(stated[2])
        if component not in (None, axis):
            raise ValueError(
                f"{label} is the velocity along {AXES[component or 0]}, but normal is "
                f"{request.normal!r}; name the variable of that direction"
            )
        return axis, -1.0 if stated[1] == "-" else 1.0
    extent = np.ptp(points, axis=0)
    flat = np.flatnonzero(extent <= SAME * max(extent.max(), np.abs(points).max()))
    if component is None and len(flat) != 1:
        raise ValueError(
            f"{label}: the points extend over "
            f"{' x '.join(f'{length:.4g}' for length in extent)} m along x, y, z, which tells no "
            "wall-normal direction; state normal='y' or another (--normal y; --normal=-y where "
            "the liner lies above)"
        )
    axis = int(flat[0]) if component is None else component
    sign = -1.0 if facing is not None and facing[axis] < 0 else 1.0
    side = "-" if sign < 0 else ""
    why = "the variable is named so" if component is not None else "the points lie in a plane"
    tell(
        f"{label}: the wall normal is taken as {side or '+'}{AXES[axis]}, since {why}"
        f"{' and the surface faces that way' if facing is not None else ''}; state "
        f"normal='{side}{AXES[axis]}' if so, '{'' if side else '-'}{AXES[axis]}' if the liner lies "
        "on the other side",
        depth=3,
    )
    return axis, sign


def require_one_height(points: np.ndarray, axis: int, label: str) -> None:
    """Refuse points that stand one above another.

    Args:
        points: m, (N, 3).
        axis: of the wall normal.
        label: for messages.
    Raises:
        ValueError: they do.
    Warns:
        DataWarning: they stand at several heights, none above another, as on a curved wall.
    """
    height, near = points[:, axis], SAME * np.abs(points).max()
    low, high = height.min(), height.max()
    if high - low <= near:
        return
    (_, column), (rows, row) = (_levels(points[:, i], near) for i in range(3) if i != axis)
    place = column * len(rows) + row
    order = np.lexsort((height, place))
    above = (np.diff(place[order]) == 0) & (np.diff(height[order]) > near)
    span = f"{AXES[axis]} = {low:.6g} to {high:.6g} m along the wall normal"
    if above.any():
        raise ValueError(
            f"{label}: {int(above.sum())} of {len(points)} points stand above others, {span}; a "
            "plane has one height: write the points of one height alone"
        )
    tell(f"{label}: the points stand at {span}, of which a plane has one", depth=3)


def grid_order(x: np.ndarray, z: np.ndarray) -> tuple[np.ndarray | None, np.ndarray, np.ndarray] | None:
    """How scattered points fill a grid: which point stands at each place (None: as they come), x
    and z of columns and rows; None where they fill none of two rows at least.

    Args:
        x, z: (N,) each.
    """
    near = SAME * max(np.abs(x).max(), np.abs(z).max())
    (columns, column), (rows, row) = (_levels(values, near) for values in (x, z))
    if min(len(columns), len(rows)) < 2 or len(columns) * len(rows) != len(x):
        return None
    place = row * len(columns) + column
    order = np.argsort(place, kind="stable")
    if not np.array_equal(place[order], np.arange(len(x))):
        return None
    return (None if np.array_equal(order, np.arange(len(x))) else order), columns, rows


def _levels(values: np.ndarray, near: float) -> tuple[np.ndarray, np.ndarray]:
    """Values that differ by more than ``near``, and which of them each one is."""
    order = np.argsort(values, kind="stable")
    new = np.diff(values[order], prepend=-math.inf) > near
    level = np.empty(len(values), np.int64)
    level[order] = np.cumsum(new) - 1
    return values[order][new], level


@dataclass
class Arranged:
    """A source whose points stand in another order than the plane's."""

    source: Source
    order: np.ndarray

    def __call__(self, begin: int, end: int) -> np.ndarray:
        """Values in the plane's order, (t, P)."""
        return np.asarray(self.source(begin, end))[:, self.order]


def named(
    opens: Callable[[Path, PlaneRequest], VelocityPlane],
) -> Callable[[Path, PlaneRequest], VelocityPlane]:
    """A function that opens a path, whatever fails in it an error that names the path."""

    def opened(path: Path, request: PlaneRequest) -> VelocityPlane:
        with naming(path):
            return opens(path, request)

    return opened


def all_rows(values: np.ndarray, begin: int, end: int, path: Path) -> np.ndarray:
    """Samples begin .. end - 1 as a file gave them.

    Raises:
        OSError: it gave fewer, as it has become shorter since it was opened.
    """
    if len(values) != end - begin:
        raise OSError(f"{path} has become shorter: {len(values)} samples from {begin} on, of "
                      f"{end - begin}")  # fmt: skip
    return values


def plane_at(
    points: np.ndarray,
    request: PlaneRequest,
    source_of: Callable[[int], Source],
    samples: int,
    rate: float,
    *,
    path: Path,
    variable: str,
    component: int | None = None,
    facing: np.ndarray | None = None,
    factor: float = 1.0,
    area: np.ndarray | None = None,
    dtype: torch.dtype = torch.float32,
    tile_rows: int = 1,
    start: float = 0.0,
    **about: Any,
) -> VelocityPlane:
    """The plane of a solver's points, its velocity left in the files.

    Args:
        points: m, (N, 3).
        request: what the user states.
        source_of: of an axis: values along it, (t, N), in the order of ``points``.
        samples, rate: T; Hz.
        path, variable: for messages.
        component, facing: as for ``wall_normal``.
        factor: to m/s.
        area: m2, that each point stands for, (N,).
        dtype, tile_rows: as for ``FrameVelocity``.
        start: time of the first sample, s.
        about: what else provenance says.
    Raises:
        ValueError: as ``wall_normal`` and ``require_one_height``; no points, coordinates that are
            not finite or too large; one sample.
    """
    label = f"{path}:/{variable}"
    if not len(points) or samples < 2:
        raise Unwritten(f"{label} has {len(points)} points and {samples} samples; at least one "
                         "point and two samples are needed")  # fmt: skip
    if not np.isfinite(points).all():
        raise ValueError(f"{label}: {int((~np.isfinite(points)).any(1).sum())} points have "
                         "coordinates that are not finite")  # fmt: skip
    require_plausible(points, "length", f"{label}: points")
    axis, sign = wall_normal(points, request, label, component, facing)
    require_one_height(points, axis, label)
    x, z = (points[:, i] for i in range(3) if i != axis)
    source, shape, order = source_of(axis), (len(points),), None
    grid = grid_order(x, z)
    if grid is not None:
        order, x, z = grid
        shape = (len(z), len(x))  # type: ignore[assignment]
    if order is not None:
        source = Arranged(source, order)
        area = None if area is None else area[order]
    where = {"normal": ("-" if sign < 0 else "") + AXES[axis],
             "normal_coordinate": float(np.median(points[:, axis]))}  # fmt: skip
    velocity = FrameVelocity(source, (*shape, samples), label, factor * sign, dtype, tile_rows=tile_rows)
    return VelocityPlane(
        velocity, sampling_rate=rate, start=start, x=x, z=z, area=area, name=label, title=path.stem,
        provenance={**where, **about},
    )  # fmt: skip

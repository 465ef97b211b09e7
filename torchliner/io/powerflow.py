"""PowerFLOW's measurement files: .snc surfaces, .fnc volumes, .psnc and .pfnc probes.

netCDF-3, or netCDF-4 (HDF5) of newer releases, in lattice units: u = u_lat lx_scales[3], lengths
(x_lat + csys[0, :3, 3]) lx_scales[0], a time step of lx_scales[-1] lx_scales[0] / lx_scales[3].
A frame is the mean over the steps start_time .. end_time and stands at their middle. So a tone of
frequency f is attenuated by sinc(f Tw), Tw the length of the mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch
from scipy.io import netcdf_file

from torchliner.checks import tell
from torchliner.file_checks import naming, require_memory
from torchliner.io.clocks import uniform_rate
from torchliner.io.hdf5 import open_file
from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.io.point_layout import AXES, all_rows, component_of, named, plane_at
from torchliner.io.stored_values import read_values
from torchliner.io.surface_frames import Surface
from torchliner.names import did_you_mean
from torchliner.records import VelocityPlane

DAMPED = 0.01  # attenuation of a tone by the frames' averages that is warned of
HIGHEST = 6000.0  # Hz, that is asked for
Read = Callable[..., np.ndarray]


@contextmanager
def variables_of(path: Path) -> Iterator[tuple[dict[str, tuple[int, ...]], Read]]:
    """Shapes of the variables of a file, and a function of a name and a part to values.

    Raises:
        OSError, ValueError: the file cannot be read, is truncated or damaged.
    """
    with path.open("rb") as file:
        classic = file.read(3) == b"CDF"
    if not classic:
        with open_file(path) as hdf:
            yield (
                {name: each.shape for name, each in hdf.items() if hasattr(each, "shape")},
                lambda name, part=(): (
                    np.asarray(hdf[name][part]) if hdf[name].dtype.kind == "S"
                    else read_values(hdf[name], f"{path}:/{name}", path, part)
                ),
            )  # fmt: skip
        return
    with naming(path), path.open("rb") as file:
        net = netcdf_file(file, "r", mmap=True)
        try:
            yield (
                {name: each.shape for name, each in net.variables.items()},
                # A copy in the machine's order of bytes: no view of the file may outlive it.
                lambda name, part=(): _native(net.variables[name].data[part]),
            )
        finally:
            net.close()


def _native(values: np.ndarray) -> np.ndarray:
    return np.array(values, values.dtype.newbyteorder("="))


@dataclass
class Frames:
    """One variable of the frames at some of the points, in lattice units."""

    path: Path
    index: int
    points: np.ndarray | None

    def __call__(self, begin: int, end: int) -> np.ndarray:
        """Values, (t, N)."""
        with variables_of(self.path) as (_, read):
            found = read("measurements", (slice(begin, end), self.index))
        all_rows(found, begin, end, self.path)
        return found if self.points is None else found[:, self.points]


def recognises(path: Path, head: bytes) -> bool:
    """netCDF with the names of its variables; in HDF5 they may stand anywhere."""
    if head[:3] == b"CDF":
        return b"variable_short_names" in head or _names(path)
    return head[:8] == b"\x89HDF\r\n\x1a\n" and _names(path)


def _names(path: Path) -> bool:
    """Whether the file has the variables of a measurement."""
    try:
        with variables_of(path) as (shapes, _):
            return {"variable_short_names", "measurements"} <= set(shapes)
    except (OSError, ValueError):
        return False


def open_measurement(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a measurement.

    Args:
        path: .snc, .fnc, .psnc, .pfnc.
        request: ``variable``, of ``variable_short_names``; ``group``, of ``face_names``.
    Raises:
        OSError: as ``variables_of``.
        ValueError: a variable is missing or of another shape; several faces, of which none is
            named; frames of unequal length or not uniform; as ``plane_at``.
    Warns:
        DataWarning: a tone within 6 kHz is attenuated by more than 1 % in the frames.
    """
    with naming(path), variables_of(path) as (shapes, read):
        get = partial(_get, read, shapes, path)
        scales = get("lx_scales").astype(float).reshape(-1)
        if len(scales) < 4 or not (np.isfinite(scales[[0, 3, -1]]) & (scales[[0, 3, -1]] > 0)).all():
            raise ValueError(f"{path}:/lx_scales is {scales}; lengths, velocity and time need at "
                             "least four, above 0")  # fmt: skip
        length, velocity = float(scales[0]), float(scales[3])
        shape = shapes.get("measurements", ())
        if len(shape) != 3:
            raise ValueError(f"{path}:/measurements has shape {shape}; (frames, variables, points) "
                             "is needed")  # fmt: skip
        points, area, facing = _places(get, shapes, path, length)
        if len(points) != shape[2]:
            raise ValueError(f"{path}:/measurements has {shape[2]} points, their coordinates "
                             f"{len(points)}")  # fmt: skip
        face, chosen = _face(get, shapes, path, request, shape[2])
        wide = read("measurements", (slice(0, 1), slice(0, 1), slice(0, 1))).dtype.itemsize > 4
        rate, start, window = _clock(get, path, float(scales[-1]) * length / velocity, shape[0])
        names = _texts(get("variable_short_names"))
    if len(names) != shape[1]:
        raise ValueError(f"{path}:/variable_short_names names {len(names)} variables, "
                         f"{', '.join(names)}; the measurements have {shape[1]}")  # fmt: skip
    if request.variable is not None and request.variable not in names:
        raise ValueError(f"{path} has no variable {request.variable!r}"
                         f"{did_you_mean(request.variable, names)}; it holds "
                         f"{', '.join(names)}")  # fmt: skip

    def source(axis: int) -> Frames:
        name = request.variable or f"{AXES[axis]}_velocity"
        if name not in names:
            raise ValueError(f"{path} has no {name}, the velocity along the wall's normal; it "
                             f"holds {', '.join(names)}")  # fmt: skip
        return Frames(path, names.index(name), chosen)

    if chosen is not None:
        points = points[chosen]
        area, facing = (None if each is None else each[chosen] for each in (area, facing))
    mean = None if facing is None else facing.sum(0)
    if mean is not None and facing is not None and np.linalg.norm(mean) < 0.99 * len(facing):
        mean = None  # no plane
    plane = plane_at(
        points, request, source, shape[0], rate, path=path,
        variable=request.variable or "measurements", component=component_of(request.variable),
        facing=mean, factor=velocity, area=area, start=start,
        dtype=torch.float64 if wide else torch.float32,
        format="PowerFLOW", frame_average=window, face=face,
    )  # fmt: skip
    _warn_of_averages(plane.name, window)
    return plane


def attenuation(frequency: float, window: float) -> float:
    """Factor on a tone in means over ``window`` seconds: sin(pi f Tw)/(pi f Tw)."""
    return float(np.sinc(frequency * window))


def _warn_of_averages(name: str, window: float) -> None:
    """Say from which frequency on frames attenuate a tone by more than ``DAMPED``."""
    if 1 - attenuation(HIGHEST, window) > DAMPED:
        limit = math.sqrt(6 * DAMPED) / (math.pi * window)
        tones = ", ".join(f"{f:g} Hz {attenuation(f, window):.4f}"
                          for f in (500.0, 1000.0, 2000.0, 4000.0, HIGHEST))  # fmt: skip
        tell(
            f"{name}: frames are means over {window:.4g} s, which attenuate a tone, and with it "
            f"|v|, by more than {DAMPED:.0%} above {limit:.4g} Hz: {tones}; measure with shorter "
            "means",
            depth=2,
        )


def _get(read: Read, shapes: dict[str, tuple[int, ...]], path: Path, name: str) -> np.ndarray:
    """A variable, whole.

    Raises:
        ValueError: it is not there, or larger than memory.
    """
    if name not in shapes:
        raise ValueError(f"{path} has no variable {name}, which PowerFLOW's files have; it holds "
                         f"{', '.join(sorted(shapes))}")  # fmt: skip
    require_memory(8 * math.prod(shapes[name]), f"{path}:/{name}, {shapes[name]},")
    return read(name)


def _texts(letters: np.ndarray) -> list[str]:
    """Names between zero bytes."""
    raw = np.asarray(letters).astype("S1").tobytes() if letters.dtype.kind == "S" else (
        letters.astype(np.uint8).tobytes())  # fmt: skip
    return [text.decode("latin-1").strip() for text in raw.split(b"\0") if text.strip()]


def _clock(get: Callable[[str], np.ndarray], path: Path, step: float, frames: int) -> tuple[
    float, float, float
]:  # fmt: skip
    """Sampling rate, Hz, time of the first frame, s, and length of their means, s."""
    low, high = (get(name).astype(float).reshape(-1) for name in ("start_time", "end_time"))
    if len(low) != frames or len(high) != frames:
        raise ValueError(f"{path}:/start_time and /end_time have {len(low)} and {len(high)} "
                         f"values for {frames} frames; the file is truncated")  # fmt: skip
    windows = high - low
    if not (windows >= 0).all() or np.ptp(windows) > 0.01 * windows.max():
        at = int(np.abs(windows - np.median(windows)).argmax())
        raise ValueError(f"{path}: frame {at} is a mean over {windows[at]:g} time steps, others "
                         f"over {np.median(windows):g}; all must be alike")  # fmt: skip
    times = (low + high) / 2 * step
    rate = uniform_rate(times, f"{path}, start_time to end_time") if frames > 1 else 1.0
    return rate, float(times[0]), float(np.median(windows)) * step


def _places(
    get: Callable[[str], np.ndarray], shapes: dict[str, tuple[int, ...]], path: Path, length: float
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """Points (m), areas (m2) and normals of cells, probes or surfels."""
    offset = get("csys")[0, 0:3, 3].astype(float)
    if "vertex_coords" not in shapes:
        points = get("coords").astype(float)
        if "voxel_scales" not in shapes and path.suffix.lower().startswith(".fn"):
            raise ValueError(f"{path} lacks voxel_scales, the sizes of its cells: they would be half a cell off")
        if "voxel_scales" in shapes:  # lower corners of cells of this size
            points = points + 0.5 * 2.0 ** (1 + get("voxel_scales").astype(float))[:, None]
        return (points + offset) * length, None, None
    first = get("first_vertex_refs").astype(np.int64).reshape(-1)
    corners = get("vertex_refs").astype(np.int64).reshape(-1)
    ends = np.append(first[1:], len(corners))[: len(first)]
    if not len(first) or first[0] != 0 or (np.diff(first) <= 0).any():
        raise ValueError(f"{path}:/first_vertex_refs does not increase from 0; it is damaged")
    vertices = (get("vertex_coords").astype(float) + offset) * length
    points, area = Surface(vertices, corners, ends).faces(str(path))
    if "surfel_area" in shapes:
        area = get("surfel_area").astype(float).reshape(-1) * length**2
    return points, area, get("surfel_normal").astype(float) if "surfel_normal" in shapes else None


def _face(
    get: Callable[[str], np.ndarray], shapes: dict[str, tuple[int, ...]], path: Path,
    request: PlaneRequest, count: int,
) -> tuple[str, np.ndarray | None]:  # fmt: skip
    """Name of the face that is read, and its points; None for all."""
    if "face_names" not in shapes or "face" not in shapes:
        if request.group is not None:
            raise ValueError(f"{path} names no faces; leave out group {request.group!r}")
        return "", None
    names, face = _texts(get("face_names")), get("face").astype(np.int64).reshape(-1)
    if len(face) != count or (len(face) and not 0 <= face.min() <= face.max() < len(names)):
        raise ValueError(f"{path}:/face has {len(face)} values for {count} points and "
                         f"{len(names)} face_names; it is damaged")  # fmt: skip
    used = [names[i] for i in np.unique(face)]
    if request.group is None and len(used) > 1:
        raise ValueError(f"{path} holds the faces {', '.join(used)}; name one as group (--group)")
    name = request.group or used[0]
    if name not in used:
        raise ValueError(f"{path} has no face {name!r}{did_you_mean(name, used)}; it holds "
                         f"{', '.join(used)}")  # fmt: skip
    chosen = np.flatnonzero(face == names.index(name))
    return name, None if len(chosen) == count else chosen


FORMAT = PlaneFormat("PowerFLOW", recognises, named(open_measurement), ("variable", "group", "normal"))

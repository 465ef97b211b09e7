"""PowerFLOW's measurement files: .snc surfaces, .fnc volumes, .psnc and .pfnc probes.

netCDF-3, or netCDF-4 (HDF5) of newer releases, in lattice units: u = u_lat lx_scales[3], lengths
(x_lat + csys[0, :3, 3]) lx_scales[0], a time step of lx_scales[-1] lx_scales[0] / lx_scales[3].
A frame is the mean over the steps start_time .. end_time and stands at their middle. So a tone of
frequency f is attenuated by sinc(f Tw), Tw the length of the mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import numpy as np
import torch

from torchliner.checks import tell
from torchliner.file_checks import require_memory
from torchliner.io.clocks import uniform_rate
from torchliner.io.foreign import classic_arrays, classic_fields
from torchliner.io.frames import centres_of
from torchliner.io.hdf5 import hold_open, is_there, open_file
from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.io.plane_selection import SelectedVelocity
from torchliner.io.points import AXES, component_of, named, place
from torchliner.io.to_plane import HDF5_SIGNATURE
from torchliner.io.variable_velocity import Opener, velocity_of
from torchliner.io.variables import Field, fields_of_hdf5
from torchliner.names import did_you_mean
from torchliner.records import VelocityPlane

DAMPED = 0.01  # attenuation of a tone by the frames' averages that is warned of
HIGHEST = 6000.0  # Hz, that is asked for
NEEDED = ("/variable_short_names", "/measurements")
Get = Callable[[str], np.ndarray]


@contextmanager
def _fields(path: Path) -> Iterator[tuple[dict[str, Field], Opener]]:
    """Variables of a file by name, and who opens it again."""
    with path.open("rb") as file:
        classic = file.read(3) == b"CDF"
    if classic:
        yield classic_fields(path)[0], partial(classic_arrays, path)
        return
    with open_file(path) as hdf:
        yield fields_of_hdf5(hdf, path), partial(hold_open, path)


def recognises(path: Path, head: bytes) -> bool:
    """netCDF, or HDF5, with the variables of a measurement."""
    with suppress(OSError, ValueError):
        if head[:3] == b"CDF":
            return set(NEEDED) <= classic_fields(path)[0].keys()
        if head[:8] == HDF5_SIGNATURE:
            with open_file(path) as file:
                return all(is_there(file, name, path) for name in NEEDED)
    return head[:3] == b"CDF" and b"variable_short_names" in head


def open_measurement(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a measurement.

    Args:
        path: .snc, .fnc, .psnc, .pfnc.
        request: ``variable``, of ``variable_short_names``; ``group``, of ``face_names``.
    Raises:
        OSError: the file is truncated or damaged.
        ValueError: a variable is missing or of another shape; several faces, of which none is
            named; frames of unequal length or not uniform; as ``place``.
    Warns:
        DataWarning: a tone within 6 kHz is attenuated by more than 1 % in the frames.
    """
    with _fields(path) as (fields, opens):
        get = partial(_get, fields, path)
        scales = get("lx_scales").astype(float).reshape(-1)
        if len(scales) < 4 or not (np.isfinite(scales[[0, 3, -1]]) & (scales[[0, 3, -1]] > 0)).all():
            raise ValueError(f"{path}:/lx_scales is {scales}; lengths, velocity and time need at least four, above 0")
        length, velocity, step = float(scales[0]), float(scales[3]), float(scales[-1] * scales[0] / scales[3])
        values = fields["/measurements"]
        if len(values.shape) != 3:
            raise ValueError(f"{values.label} has shape {values.shape}; (frames, variables, points) is needed")
        names = _texts(fields["/variable_short_names"])
        if len(names) != values.shape[1]:
            raise ValueError(
                f"{path}:/variable_short_names names {len(names)} variables, {', '.join(names)}; the measurements have "
                f"{values.shape[1]}"
            )
        points, area, facing = _places(get, fields, path, length)
        if len(points) != values.shape[2]:
            raise ValueError(f"{values.label} has {values.shape[2]} points, their coordinates {len(points)}")
        face, chosen = _face(get, fields, path, request, len(points))
        area, facing = (None if each is None else each[chosen] for each in (area, facing))
        mean = None if facing is None else facing.sum(0)
        if mean is not None and np.linalg.norm(mean) < 0.99 * len(chosen):
            mean = None  # no plane
        label = f"{path}:/{request.variable or 'measurements'}"
        placed = place(points[chosen], request, label, component_of(request.variable), mean, area)
        name = request.variable or f"{AXES[placed.axis]}_velocity"
        if name not in names:
            raise ValueError(f"{path} has no variable {name!r}{did_you_mean(name, names)}; it holds {', '.join(names)}")
        one = names.index(name)
        rate, start, window = _clock(get, path, step, values.shape[0])
        stored = velocity_of(values, opens, (0, 2), placed.sign * velocity, part={1: slice(one, one + 1)})
    columns = torch.from_numpy(chosen[placed.order])
    shape = (*placed.shape, values.shape[0])
    stored.label = label
    selected = SelectedVelocity(stored, shape, columns=columns)
    plane = placed.plane(selected, rate, start, path, format="PowerFLOW", frame_average=window, face=face)
    _warn_of_averages(plane.name, window)
    return plane


def attenuation(frequency: float, window: float) -> float:
    """Factor on a tone in means over ``window`` seconds: sin(pi f Tw)/(pi f Tw)."""
    return float(np.sinc(frequency * window))


def _warn_of_averages(name: str, window: float) -> None:
    """Say from which frequency on frames attenuate a tone by more than ``DAMPED``."""
    if 1 - attenuation(HIGHEST, window) > DAMPED:
        limit = math.sqrt(6 * DAMPED) / (math.pi * window)
        tones = ", ".join(f"{f:g} Hz {attenuation(f, window):.4f}" for f in (500.0, 1000.0, 2000.0, 4000.0, HIGHEST))
        tell(
            f"{name}: frames are means over {window:.4g} s, which attenuate a tone, and with it |v|, by more than "
            f"{DAMPED:.0%} above {limit:.4g} Hz: {tones}; measure with shorter means"
        )


def _get(fields: dict[str, Field], path: Path, name: str) -> np.ndarray:
    """A variable, whole.

    Raises:
        ValueError: it is not there, or larger than memory.
    """
    if f"/{name}" not in fields:
        there = ", ".join(sorted(each[1:] for each in fields))
        raise ValueError(f"{path} has no variable {name}, which PowerFLOW's files have; it holds {there}")
    require_memory(8 * fields[f"/{name}"].size, f"{path}:/{name}, {fields[f'/{name}'].shape},")
    return fields[f"/{name}"].values()


def _texts(field: Field) -> list[str]:
    """Names between zero bytes."""
    letters = np.asarray(field.array[()])
    raw = letters.astype("S1" if letters.dtype.kind == "S" else np.uint8).tobytes()
    return [text.decode("latin-1").strip() for text in raw.split(b"\0") if text.strip()]


def _clock(get: Get, path: Path, step: float, frames: int) -> tuple[float, float, float]:
    """Sampling rate, Hz, time of the first frame, s, and length of their means, s."""
    low, high = (get(name).astype(float).reshape(-1) for name in ("start_time", "end_time"))
    if len(low) != frames or len(high) != frames:
        raise ValueError(
            f"{path}:/start_time and /end_time have {len(low)} and {len(high)} values for {frames} frames; the file is "
            "truncated"
        )
    windows = high - low
    if not (windows >= 0).all() or np.ptp(windows) > 0.01 * windows.max():
        at = int(np.abs(windows - np.median(windows)).argmax())
        raise ValueError(
            f"{path}: frame {at} is a mean over {windows[at]:g} time steps, others over {np.median(windows):g}; all "
            "must be alike"
        )
    times = (low + high) / 2 * step
    return uniform_rate(times, f"{path}, start_time to end_time"), float(times[0]), float(np.median(windows)) * step


def _places(
    get: Get, fields: dict[str, Field], path: Path, length: float
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """Points (m), areas (m2) and normals of cells, probes or surfels."""
    offset = get("csys")[0, 0:3, 3].astype(float)
    if "/vertex_coords" not in fields:
        points = get("coords").astype(float)
        if "/voxel_scales" in fields or path.suffix.lower().startswith(
            ".fn"
        ):  # lower corners of cells of the size that voxel_scales tells
            points = points + 0.5 * 2.0 ** (1 + get("voxel_scales").astype(float))[:, None]
        return (points + offset) * length, None, None
    first = get("first_vertex_refs").astype(np.int64).reshape(-1)
    corners = get("vertex_refs").astype(np.int64).reshape(-1)
    ends = np.append(first[1:], len(corners))[: len(first)]
    if not len(first) or first[0] != 0 or (np.diff(first) <= 0).any():
        raise ValueError(f"{path}:/first_vertex_refs does not increase from 0; it is damaged")
    vertices = (get("vertex_coords").astype(float) + offset) * length
    points, area = centres_of(vertices, corners, ends, None, str(path))
    if "/surfel_area" in fields:
        area = get("surfel_area").astype(float).reshape(-1) * length**2
    return points, area, get("surfel_normal").astype(float) if "/surfel_normal" in fields else None


def _face(get: Get, fields: dict[str, Field], path: Path, request: PlaneRequest, count: int) -> tuple[str, np.ndarray]:
    """Name of the face that is read, and its points."""
    if not {"/face_names", "/face"} <= fields.keys():
        if request.group is not None:
            raise ValueError(f"{path} names no faces; leave out group {request.group!r}")
        return "", np.arange(count)
    names, face = _texts(fields["/face_names"]), get("face").astype(np.int64).reshape(-1)
    if len(face) != count or (len(face) and not 0 <= face.min() <= face.max() < len(names)):
        raise ValueError(
            f"{path}:/face has {len(face)} values for {count} points and {len(names)} face_names; it is damaged"
        )
    used = [names[i] for i in np.unique(face)]
    name = request.group or (used[0] if len(used) == 1 else "")
    if name not in used:
        raise ValueError(
            f"{path} holds the faces {', '.join(used)}{did_you_mean(name, used)}; name one as group (--group)"
        )
    return name, np.flatnonzero(face == names.index(name))


FORMAT = PlaneFormat("PowerFLOW", recognises, named(open_measurement), ("variable", "group", "normal"))

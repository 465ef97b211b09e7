"""PowerFLOW's measurement files: .snc surfaces, .fnc volumes, .psnc and .pfnc probes.

netCDF-3, or netCDF-4 (HDF5) of newer releases, in lattice units: u = u_lat lx_scales[3], lengths
(x_lat + csys[0, :3, 3]) lx_scales[0], a time step of lx_scales[-1] lx_scales[0] / lx_scales[3].
A frame is the mean over the steps start_time .. end_time and stands at their middle. So a tone of
frequency f is attenuated by sinc(f Tw), Tw the length of the mean.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch

from torchliner.checks import require_choice, tell
from torchliner.io.foreign import open_source
from torchliner.io.hdf5 import is_there, open_file
from torchliner.io.plane_format import HDF5_SIGNATURE, PlaneFormat, PlaneRequest, uniform_rate
from torchliner.io.plane_parts import SelectedVelocity
from torchliner.io.points import Places, centres_of, column_of, place
from torchliner.io.variables import VariableVelocity
from torchliner.records import VelocityPlane

DAMPED = 0.01  # attenuation of a tone by the frames' averages that is warned of
HIGHEST = 6000.0  # Hz, that is asked for
NEEDED = ("variable_short_names", "measurements")
Arrays = Mapping[str, np.ndarray]


def recognises(path: Path, head: bytes) -> bool:
    """netCDF, or HDF5, with the variables of a measurement."""
    if head[:8] == HDF5_SIGNATURE:
        with open_file(path) as file:
            return all(is_there(file, name, path) for name in NEEDED)
    return head[:3] == b"CDF" and b"variable_short_names" in head


def open_measurement(path: Path, request: PlaneRequest) -> VelocityPlane:
    """The plane of a measurement; ``variable`` is of ``variable_short_names``, ``group`` of ``face_names``. A
    DataWarning where a tone within 6 kHz is attenuated by more than 1 % in the frames."""
    with open_source(path) as source:
        fields = {name[1:]: each for name, each in source.fields.items()}
        values = fields.pop("measurements")
        letters = {name for name, each in fields.items() if each.array.dtype.kind == "S"}
        file = {k: np.asarray(each.array[()]) if k in letters else each.values() for k, each in fields.items()}
        scales = _row(file["lx_scales"])
        if len(scales) < 4 or not (np.isfinite(scales[[0, 3, -1]]) & (scales[[0, 3, -1]] > 0)).all():
            raise ValueError(f"{path}:/lx_scales is {scales}; lengths, velocity and time need at least four, above 0")
        length, velocity, step = float(scales[0]), float(scales[3]), float(scales[-1] * scales[0] / scales[3])
        points, area = _places(file, length, path)
        names = _texts(file["variable_short_names"])
        if values.shape[1:] != (len(names), len(points)):
            raise ValueError(f"{values.label} has shape {values.shape}, not (frames, {len(names)}, {len(points)})")
        face, chosen = _face(file, request, len(points), path)
        name = request.variable or f"{(request.normal or 'y')[-1]}_velocity"
        label = f"{path}:/{name}"
        column_of(name, 1, request, label)
        placed = place(points[chosen], request, label, None if area is None else area[chosen])
        require_choice(f"variable of {path},", name, names)
        rate, start, window = _clock(file, step, values.shape[0], path)
        part = {1: slice(names.index(name), names.index(name) + 1)}
        stored = VariableVelocity(values, source.opens, (0, 2), placed.sign * velocity, part)
    stored.label = label
    columns = torch.from_numpy(chosen[placed.order])
    selected = SelectedVelocity(stored, (*placed.shape, values.shape[0]), columns=columns)
    if (kept := float(np.sinc(HIGHEST * window))) < 1 - DAMPED:
        tell(
            f"{label}: frames are means over {window:.4g} s, which attenuate a tone, and with it |v|, to {kept:.4f} at "
            f"{HIGHEST:g} Hz; measure with shorter means"
        )
    return placed.plane(selected, rate, start, path, format="PowerFLOW", frame_average=window, face=face)


def _texts(letters: np.ndarray) -> list[str]:
    """Names between zero bytes."""
    raw = letters.astype("S1" if letters.dtype.kind == "S" else np.uint8).tobytes()
    return [text.decode("latin-1").strip() for text in raw.split(b"\0") if text.strip()]


def _row(values: np.ndarray, kind: type = float) -> np.ndarray:
    return values.astype(kind).reshape(-1)


def _clock(file: Arrays, step: float, frames: int, path: Path) -> tuple[float, float, float]:
    """Sampling rate, Hz, time of the first frame, s, and length of their means, s."""
    low, high = (_row(file[name]) for name in ("start_time", "end_time"))
    if not len(low) == len(high) == frames:
        raise ValueError(f"{path}: start_time and end_time are those of {len(low)} of {frames} frames")
    windows, times = high - low, (low + high) / 2 * step
    if not (windows >= 0).all() or np.ptp(windows) > 0.01 * windows.max():
        raise ValueError(f"{path}: frames are means over {windows.min():g} to {windows.max():g} time steps")
    return uniform_rate(times, f"{path}, start_time to end_time"), float(times[0]), float(np.median(windows)) * step


def _places(file: Arrays, length: float, path: Path) -> Places:
    """Points (m), and areas (m2) of surfels."""
    offset = file["csys"][0, 0:3, 3].astype(float)
    if "vertex_coords" not in file:
        points = file["coords"].astype(float)
        if "voxel_scales" in file or path.suffix.lower().startswith(".fn"):  # lower corners of cells
            points = points + 0.5 * 2.0 ** (1 + file["voxel_scales"].astype(float))[:, None]
        return (points + offset) * length, None
    first, corners = (_row(file[name], np.int64) for name in ("first_vertex_refs", "vertex_refs"))
    if not len(first) or first[0] != 0 or (np.diff(first) <= 0).any():
        raise ValueError(f"{path}:/first_vertex_refs does not increase from 0; it is damaged")
    vertices = (file["vertex_coords"].astype(float) + offset) * length
    points, area = centres_of(vertices, corners, np.append(first[1:], len(corners)), str(path))
    return points, _row(file["surfel_area"]) * length**2 if "surfel_area" in file else area


def _face(file: Arrays, request: PlaneRequest, count: int, path: Path) -> tuple[str, np.ndarray]:
    """Name of the face that is read, and its points."""
    if "face_names" not in file or "face" not in file:
        return "", np.arange(count)
    names, face = _texts(file["face_names"]), _row(file["face"], np.int64)
    if len(face) != count or not 0 <= face.min() <= face.max() < len(names):
        raise ValueError(f"{path}:/face is not one of {len(names)} face_names for each of {count} points: damaged")
    used = [names[i] for i in np.unique(face)]
    name = request.group or (used[0] if len(used) == 1 else "")
    if name not in used:
        raise ValueError(f"{path} holds the faces {', '.join(used)}; name one as group (--group)")
    return name, np.flatnonzero(face == names.index(name))


FORMAT = PlaneFormat("PowerFLOW", recognises, open_measurement, ("variable", "group", "normal"))

"""PowerFLOW's measurements: lattice units, surfels and cells, frames that are means."""

from __future__ import annotations

import pickle

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plane_files import (
    FUZZED,
    POINTS,
    QUADS,
    UP,
    VALUES,
    X,
    Z,
    answer_or_error,
    cuts,
    mutate,
    mutations,
    opened,
    recognised,
)
from scipy.io import netcdf_file

from torchliner.checks import DataWarning
from torchliner.io.plane_format import PlaneRequest
from torchliner.io.powerflow import FORMAT, attenuation

CELL, SPEED, STEP = 2e-3, 340.0, 0.5  # lx_scales[0], [3] and [-1]
SECONDS = STEP * CELL / SPEED  # of a time step
OFFSET = np.array([3.0, -2.0, 1.0])
NAMES = ("static_pressure", "x_velocity", "y_velocity", "z_velocity", "density")


def texts(names):
    return np.frombuffer("\0".join((*names, "")).encode(), "S1")


def measurement(kind, window=2, faces=(0,)):
    """Variables and their dimensions: cells of .fnc at POINTS, or six surfels of .snc."""
    lattice = POINTS / CELL - OFFSET
    values = VALUES if kind == "fnc" else VALUES[:, :6]
    count = values.shape[1]
    stored = np.full((9, 5, count), 0.3, np.float32)
    stored[:, 1:4] = np.moveaxis(values, -1, 1) / SPEED
    csys = np.zeros((1, 4, 4))
    csys[0, :3, 3] = OFFSET
    frames = 10 * np.arange(9)
    found = {
        "lx_scales": (np.array([CELL, 1.2, 1.0, SPEED, STEP]), ("scales",)),
        "lx_offsets": (np.zeros(5), ("scales",)),
        "measurements": (stored, ("nsets", "n_variables", "npoints")),
        "variable_short_names": (texts(NAMES), ("letters",)),
        "start_time": (frames + 5 - window // 2, ("nsets",)),
        "end_time": (frames + 5 + window - window // 2, ("nsets",)),
        "csys": (csys, ("ncsys", "four", "columns")),
    }
    if kind == "fnc":
        scales = np.full(12, 1)
        found |= {
            "coords": (lattice - 0.5 * 2.0 ** (1 + scales)[:, None], ("npoints", "ndims")),
            "voxel_scales": (scales, ("npoints",)),
        }
        return found
    area = np.full(6, 5e-5 / CELL**2)
    return found | {
        "vertex_coords": (lattice, ("nvertices", "ndims")),
        "first_vertex_refs": (4 * np.arange(6), ("npoints",)),
        "vertex_refs": (QUADS.reshape(-1), ("nvertex_refs",)),
        "surfel_area": (area, ("npoints",)),
        "surfel_normal": (np.tile([0.0, 1.0, 0.0], (6, 1)), ("npoints", "ndims")),
        "face_names": (texts([f"plane_{i}" for i in range(2)]), ("nfaces_letters",)),
        "face": (np.resize(faces, 6), ("npoints",)),
    }


def store(path, variables, classic):
    """netCDF-3, or HDF5."""
    if not classic:
        with h5py.File(path, "w") as file:
            for name, (values, _) in variables.items():
                file[name] = values
        return path
    with netcdf_file(path, "w") as file:
        for name, (values, dims) in variables.items():
            for dim, size in zip(dims, values.shape, strict=True):
                if dim not in file.dimensions:
                    file.createDimension(dim, size)
            kind = "c" if values.dtype.kind == "S" else values.dtype.char.replace("l", "i")
            file.createVariable(name, kind, dims)[:] = values
    return path


@pytest.mark.parametrize("classic", [True, False])
@pytest.mark.parametrize("kind", ["fnc", "snc"])
def test_lattice_units_become_si(tmp_path, kind, classic):
    """Velocity, places, areas and times by the file's own scales."""
    path = store(tmp_path / f"a.{kind}", measurement(kind), classic)
    assert recognised(FORMAT, path)
    plane = FORMAT.open(path, UP)
    velocity = plane.load().velocity.numpy()
    if kind == "fnc":
        assert np.allclose(velocity, VALUES[..., 1].T.reshape(3, 4, 9), rtol=1e-6, atol=1e-6)
        assert np.allclose(plane.x, X, atol=1e-12)
        assert np.allclose(plane.z, Z, atol=1e-12)
    else:
        assert np.allclose(velocity, VALUES[:, :6, 1].T.reshape(2, 3, 9), rtol=1e-6, atol=1e-6)
        assert np.allclose(plane.x, [5e-3, 15e-3, 25e-3])
        assert np.allclose(plane.area, 5e-5)
        assert plane.provenance["face"] == "plane_0"
    assert plane.sampling_rate == pytest.approx(1 / (10 * SECONDS))
    assert plane.start == pytest.approx(5 * SECONDS)
    assert plane.provenance["frame_average"] == pytest.approx(2 * SECONDS)
    stored = pickle.loads(pickle.dumps(plane.velocity))
    assert np.array_equal(stored.read(4, 6), velocity.reshape(-1, 9).T[4:6])
    with pytest.raises(ValueError, match="points stand above others, x = "):
        FORMAT.open(path, PlaneRequest(variable="x_velocity", normal="x"))


def test_surfels_say_where_they_face(tmp_path):
    """Without a stated normal the surfels' own is taken, and said."""
    variables = measurement("snc")
    path = store(tmp_path / "a.snc", variables, True)
    with pytest.warns(DataWarning, match=r"taken as \+y.*the surface faces that way"):
        up = FORMAT.open(path, PlaneRequest()).load().velocity
    variables["surfel_normal"] = (-variables["surfel_normal"][0], ("npoints", "ndims"))
    with pytest.warns(DataWarning, match=r"taken as -y"):
        down = FORMAT.open(store(path, variables, True), PlaneRequest()).load().velocity
    assert np.array_equal(down, -up)


def test_frames_attenuate_a_tone(tmp_path):
    """The factor is that of a mean of a sine, and is told where it matters."""
    window = 8
    time = (np.arange(20000) + 0.5) / 20000 * 1e-4
    assert attenuation(3000.0, 1e-4) == pytest.approx(np.cos(2 * np.pi * 3000 * (time - 5e-5)).mean(), rel=1e-6)
    path = store(tmp_path / "a.fnc", measurement("fnc", window), True)
    with pytest.warns(DataWarning, match=r"more than 1% above 3314 Hz.*6000 Hz 0\.9675"):
        FORMAT.open(path, UP)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda v: v.pop("lx_scales"), "no variable lx_scales, which PowerFLOW's files have"),
        (lambda v: v.pop("csys"), "no variable csys.*it holds"),
        (lambda v: v.update(lx_scales=(np.zeros(5), ("scales",))), "lx_scales is .*above 0"),
        (lambda v: v["end_time"][0].__setitem__(3, 50), "frame 3 is a mean over 16 time steps"),
        (lambda v: [v[n][0].__setitem__(slice(4, None), v[n][0][4:] + 10)
                    for n in ("start_time", "end_time")], "lacks 1 frames.*after sample 3"),
        (lambda v: v["face"][0].__setitem__(2, 1), "faces plane_0, plane_1; name one as group"),
        (lambda v: v["face"][0].__setitem__(2, 7), "2 face_names; it is damaged"),
        (lambda v: v.update(variable_short_names=(texts(NAMES[:4]), ("s",))), "names 4 variables"),
        (lambda v: v.update(variable_short_names=(texts("abcde"), ("s",))), "no y_velocity"),
        (lambda v: v["vertex_refs"][0].__setitem__(0, 99), "there are 12"),
        (lambda v: v["first_vertex_refs"][0].__setitem__(2, 1), "does not increase"),
    ],
)  # fmt: skip
def test_faults(tmp_path, change, message):
    variables = {name: (values.copy(), dims) for name, (values, dims)
                 in measurement("snc").items()}  # fmt: skip
    change(variables)
    path = store(tmp_path / "a.snc", variables, False)
    assert recognised(FORMAT, path)
    with pytest.raises(ValueError, match=rf"{path}.*({message})"):
        FORMAT.open(path, UP).load()


def test_cells_without_sizes_are_refused(tmp_path):
    """Their centres are half a cell from the corners that are stored."""
    variables = measurement("fnc")
    del variables["voxel_scales"]
    with pytest.raises(ValueError, match=r"lacks voxel_scales.* half a cell off"):
        FORMAT.open(store(tmp_path / "a.fnc", variables, True), UP)


def test_one_face_of_several(tmp_path):
    path = store(tmp_path / "a.snc", measurement("snc", faces=(0, 1)), True)
    plane = FORMAT.open(path, PlaneRequest(normal="y", group="plane_1"))
    assert np.allclose(plane.load().velocity.numpy().T, VALUES[:, 1:6:2, 1], atol=1e-6)
    for stated, message in (("plane_7", "did you mean 'plane_"), (None, "name one as group")):
        with pytest.raises(ValueError, match=message):
            FORMAT.open(path, PlaneRequest(normal="y", group=stated))
    with pytest.raises(ValueError, match=r"no variable 'y_velocty'.*did you mean 'y_velocity'"):
        FORMAT.open(path, PlaneRequest(variable="y_velocty", normal="y", group="plane_1"))


@FUZZED
@given(marks=mutations, cut=cuts, kind=st.sampled_from(["fnc", "snc"]))
def test_mutated_bytes(tmp_path_factory, marks, cut, kind):
    """netCDF-3 that is damaged; HDF5 has its own tests."""
    path = store(tmp_path_factory.mktemp("pf") / f"a.{kind}", measurement(kind), True)
    clean = opened(FORMAT, path)
    mutate(path, marks, cut)
    if recognised(FORMAT, path):
        answer_or_error(FORMAT, path, UP, f"a.{kind}", clean)

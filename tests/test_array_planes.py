"""Arrays of MATLAB and numpy as planes that stay in their files."""

from __future__ import annotations

import pickle
from itertools import permutations

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plane_files import FUZZED, VALUES, X, Z, answer_or_error, cuts, mutate, mutations, recognised
from scipy.io import savemat

from torchliner.io.array_planes import MATLAB_FORMAT, NPY_FORMAT
from torchliner.io.arrays import plane_from_array
from torchliner.io.plane_format import PlaneRequest

GRID = VALUES.transpose(2, 1, 0).reshape(3, 3, 4, 9)[1]  # z, x, time
AXES = ("z", "x", "time")
WAYS = ["a.npy", "a.mat", "packed.mat", "v73.mat"]


def stated(**more):
    base = {"axes": AXES, "velocity_units": "m/s", "sampling_rate": 1e5, "normal": "y"}
    return PlaneRequest(**{**base, **more})


def store(path, **arrays):
    """One file of each kind; v7.3 is HDF5 with reversed axes behind a page of text."""
    if path.suffix == ".npy":
        np.save(path, next(iter(arrays.values())))
    elif path.name == "v73.mat":
        with h5py.File(path, "w", userblock_size=512) as file:
            for name, values in arrays.items():
                file[name] = np.transpose(values)
        with path.open("r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")
    else:
        savemat(path, arrays, do_compression=path.name == "packed.mat")
    return path


def form(path):
    return NPY_FORMAT if path.suffix == ".npy" else MATLAB_FORMAT


@pytest.mark.parametrize("name", WAYS)
@pytest.mark.parametrize("axes", [*permutations(AXES)])
def test_any_order_of_axes(tmp_path, name, axes):
    """Every order of axes, kind of file and slab gives what the array in memory gives."""
    turned = GRID.transpose([AXES.index(axis) for axis in axes]).astype("f4")
    path = store(tmp_path / name, YVelocity=turned)
    assert recognised(form(path), path)
    plane = form(path).open(path, stated(axes=",".join(axes), velocity_units="mm/s"))
    wanted = plane_from_array(turned, axes, "mm/s", 1e5).velocity
    assert plane.velocity.dtype == wanted.dtype
    assert np.allclose(plane.load().velocity, wanted, atol=0, rtol=1e-6)
    stored = pickle.loads(pickle.dumps(plane.velocity))
    assert np.array_equal(stored.read(2, 7), plane.load().velocity.flatten(0, 1).T[2:7])


@pytest.mark.parametrize("name", WAYS[1:])
def test_coordinates_beside_the_velocity(tmp_path, name):
    """X_unique and Y_unique of a wall along x and y; y runs downward and stays with its rows."""
    about = {"X_unique": 1e3 * X, "Y_unique": 1e3 * Z[::-1], "ZVelocity": GRID[::-1],
             "XVelocity": GRID + 1, "YVelocity": GRID + 2}  # fmt: skip
    path = store(tmp_path / name, **about)
    asked = {"axes": ("y", "x", "time"), "normal": "-z", "length_units": "mm"}
    plane = MATLAB_FORMAT.open(path, stated(**asked))
    assert np.allclose(plane.z, Z[::-1])
    assert np.allclose(plane.x, X)
    assert np.allclose(plane.load().velocity, -GRID[::-1])
    for change, message in (
        ({"length_units": None}, "X_unique states no unit of length|Y_unique states no unit"),
        ({"normal": "y", "variable": "YVelocity"}, "axis y, of several heights.*--row I"),
        ({"normal": "z", "variable": "XVelocity"}, "is the velocity along x, but normal is 'z'"),
        ({"axes": ("x", "y", "time")}, "values for 3 along x; check the order|for 4 along y"),
        ({"normal": None}, "name the one meant"),
    ):
        with pytest.raises(ValueError, match=message):
            MATLAB_FORMAT.open(path, stated(**{**asked, **change}))


@pytest.mark.parametrize("name", WAYS)
def test_nothing_is_guessed(tmp_path, name):
    """What is not stated is named with its option."""
    path = store(tmp_path / name, v=GRID)
    for change, message in (
        ({"axes": None}, "state axes .--axes time,z,x"),
        ({"sampling_rate": None}, "state sampling_rate .--sampling-rate HZ"),
        ({"velocity_units": None}, "state velocity_units='m/s'"),
        ({"velocity_units": "knots"}, "a velocity is needed in one of"),
        ({"axes": ("time", "x")}, r"shape \(3, 4, 9\), but 2 axes"),
        ({"axes": ("time", "x", "w")}, "axes are time,x,w"),
        ({"variable": "u"}, "no variable 'u'|leave out variable"),
    ):
        with pytest.raises(ValueError, match=rf"{path}.*{message}|{message}"):
            form(path).open(path, stated(**change))
    line = store(tmp_path / name, v=GRID[:, :1])
    plane = form(line).open(line, stated(axes=("probe", "time")))
    assert plane.load().velocity.shape == (3, 9)
    with pytest.raises(ValueError, match="not real numbers"):
        form(path).open(store(tmp_path / name, v=1j * GRID), stated()).load()


def test_integers_and_rows_of_time(tmp_path):
    """Integers keep their values; a stored array is not read before it is asked for."""
    whole = (1000 * GRID).astype("i4")
    path = store(tmp_path / "a.npy", v=whole)
    plane = NPY_FORMAT.open(path, stated(velocity_units="mm/s"))
    assert np.allclose(plane.load().velocity, whole / 1e3)
    path.write_bytes(path.read_bytes()[:-80])
    with pytest.raises((OSError, ValueError), match=r"a\.npy"):
        plane.load()
    store(path, v=whole[..., :5])
    with pytest.raises(OSError, match=r"a\.npy.* has become shorter: 5 samples from 0 on, of 9"):
        plane.load()


@FUZZED
@given(marks=mutations, cut=cuts, name=st.sampled_from(["a.npy", "v73.mat", "a.mat"]))
def test_mutated_bytes(tmp_path_factory, marks, cut, name):
    path = store(tmp_path_factory.mktemp("arrays") / name, v=GRID)
    clean = form(path).open(path, stated()).load().velocity.numpy()
    mutate(path, marks, cut)
    if recognised(form(path), path):
        answer_or_error(form(path), path, stated(), name, clean)

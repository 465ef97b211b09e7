"""Plain arrays and MATLAB files: nothing is guessed, so every order and unit must be honoured."""

from itertools import permutations

import h5py
import numpy as np
import pytest
import torch
from scipy.io import savemat

from torchliner import names
from torchliner.io import arrays
from torchliner.io.arrays import plane_from_array, read_array
from torchliner.io.burst_format import BurstFormat

CUBE = np.random.default_rng(0).normal(size=(2, 3, 5))  # z, x, time: all lengths differ
AXES = ("z", "x", "time")


def store(path, **arrays):
    """Arrays in the way the ending (or ``_v73``) implies; MATLAB 7.3 reverses the axes."""
    if path.suffix == ".npy":
        np.save(path, next(iter(arrays.values())))
    elif path.suffix == ".mat" and "v73" not in path.name:
        savemat(path, arrays)
    else:
        with h5py.File(path, "w") as file:
            for name, values in arrays.items():
                file[name] = np.transpose(values) if path.suffix == ".mat" else values
    return path


FILES = ["a.npy", "a.mat", "a_v73.mat", "a.h5", "a.hdf5", "a.nc", "A.H5"]


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("dtype", ["f4", "f8", "i2"])
def test_every_format_gives_the_same_array(tmp_path, name, dtype):
    wanted = (100 * CUBE).astype(dtype)
    found = read_array(store(tmp_path / name, v=wanted))
    assert found.dtype == wanted.dtype
    assert np.array_equal(found, wanted)


def test_a_new_ending_is_one_row(tmp_path, monkeypatch):
    """A function and a row of ``names.ARRAY_ENDINGS`` make a format."""
    monkeypatch.setitem(names.ARRAY_ENDINGS, ".raw", "torchliner.io.arrays:read_raw")
    monkeypatch.setattr(arrays, "read_raw", lambda path, _: np.fromfile(path), raising=False)
    CUBE.tofile(tmp_path / "v.RAW")
    assert np.array_equal(read_array(tmp_path / "v.RAW"), CUBE.reshape(-1))


@pytest.mark.parametrize("table", ["ARRAY_ENDINGS", "BURST_FORMATS", "PLANE_LAYOUTS"])
def test_every_format_leads_somewhere(table):
    """Each row names a function, or an object, that is there."""
    for row in getattr(names, table).values():
        found = names.resolve(row if isinstance(row, str) else row[0])
        assert isinstance(found, BurstFormat) if table == "BURST_FORMATS" else callable(found)


@pytest.mark.parametrize("name", ["a.mat", "a_v73.mat", "a.h5"])
def test_variable_is_named_where_there_are_several(tmp_path, name):
    path = store(tmp_path / name, YVelocity=CUBE, XVelocity=-CUBE)
    assert np.array_equal(read_array(path, "YVelocity"), CUBE)
    with pytest.raises(ValueError, match=r"a.*\..* holds .Velocity, .Velocity; name the one meant"):
        read_array(path)
    with pytest.raises(ValueError, match=r"no variable 'YVelocty' \(did you mean 'YVelocity'\?\)"):
        read_array(path, "YVelocty")


@pytest.mark.parametrize("order", list(permutations(AXES)))
def test_axes_are_put_in_order(order):
    values = CUBE.transpose([AXES.index(axis) for axis in order])
    plane = plane_from_array(values, order, "m/s", 50e3)
    assert np.array_equal(plane.velocity.numpy(), CUBE)
    assert plane.sampling_rate == 50e3


@pytest.mark.parametrize(
    ("values", "axes", "wanted"),
    [
        (CUBE[0], ("x", "time"), CUBE[0]),
        (CUBE[0].T, ("time", "probe"), CUBE[0]),
        (CUBE[0, 0], ("time",), CUBE[0, 0]),
        (CUBE[0, :1], ("time",), CUBE[0, 0]),  # MATLAB keeps a vector as a row
        (CUBE[:, :1], ("z", "time"), CUBE[:, 0]),
        (CUBE[:1, :1, :1], ("z", "x", "time"), CUBE[:1, :1, :1]),
    ],
)
def test_lines_and_single_probes(values, axes, wanted):
    found = plane_from_array(values, axes, "m/s", 50e3).velocity
    assert np.array_equal(found.numpy(), wanted)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(("unit", "factor"), [("m/s", 1.0), ("mm/s", 1e-3), ("ft/s", 0.3048)])
def test_units_and_sign(dtype, unit, factor):
    values = CUBE.astype(dtype)
    away = plane_from_array(values, AXES, unit, 50e3)
    into = plane_from_array(values, AXES, unit, 50e3, towards_liner=True)
    assert away.velocity.dtype == getattr(torch, np.dtype(dtype).name)
    assert np.allclose(away.velocity.numpy(), factor * CUBE, rtol=1e-6)
    assert torch.equal(into.velocity, -away.velocity)
    assert np.array_equal(values, CUBE.astype(dtype))


def test_coordinates_and_the_rest_are_passed_on():
    plane = plane_from_array(CUBE, AXES, "m/s", 50e3, x=[[0, 1, 2]], z=[3, 4], length_units="mm", mach=0.3, height=1e-3)
    assert plane.x.tolist() == pytest.approx([0, 1e-3, 2e-3])
    assert plane.z.tolist() == pytest.approx([3e-3, 4e-3])
    assert (plane.mach, plane.height) == (0.3, 1e-3)


def test_integers_become_floats_once_their_unit_is_stated():
    plane = plane_from_array(np.arange(6, dtype=np.int16), ["time"], "mm/s", 1.0)
    assert plane.velocity.tolist() == pytest.approx([0, 1e-3, 2e-3, 3e-3, 4e-3, 5e-3])


def test_npy_is_read_on_demand_and_never_changed(tmp_path):
    path = store(tmp_path / "a.npy", v=CUBE)
    values = read_array(path)
    assert isinstance(values, np.memmap)
    plane_from_array(values, AXES, "m/s", 50e3).velocity.zero_()
    assert np.array_equal(np.load(path), CUBE)


@pytest.mark.parametrize(
    ("values", "axes", "units", "error", "message"),
    [
        (CUBE, ("z", "x"), "m/s", ValueError, r"axes are z,x; 'time' and probe, or any of z and x"),
        (CUBE, ("z", "u", "time"), "m/s", ValueError, r"axes are z,u,time; .* each once, are need"),
        (CUBE, ("x", "x", "time"), "m/s", ValueError, r"axes are x,x,time; .* each once, are need"),
        (CUBE, ("probe", "x", "time"), "m/s", ValueError, r"axes are probe,x,time"),
        (
            CUBE,
            ("x", "time"),
            "m/s",
            ValueError,
            r"array has shape \(2, 3, 5\), but 2 axes.*x,time",
        ),
        (CUBE[0], AXES, "m/s", ValueError, r"array has shape \(3, 5\), but 3 axes are named"),
        (CUBE, AXES, "ms", ValueError, r"array velocity has units 'ms'.*'m/s'.*one of m/s, "),
        (CUBE + 0j, AXES, "m/s", TypeError, r"array is complex128; real numbers are needed"),
        (CUBE > 0, AXES, "m/s", TypeError, r"array is bool; real numbers are needed"),
    ],
)
def test_wrong_statements_are_refused(values, axes, units, error, message):
    with pytest.raises(error, match=message):
        plane_from_array(values, axes, units, 50e3)


def test_wrong_coordinates_are_refused():
    with pytest.raises(ValueError, match=r"x has 2 values; probes of shape \(2, 3\) need 3"):
        plane_from_array(CUBE, AXES, "m/s", 50e3, x=[0, 1])
    with pytest.raises(ValueError, match=r"array coordinates has units 'mn' .*one of m, mm"):
        plane_from_array(CUBE, AXES, "m/s", 50e3, x=[0, 1, 2], length_units="mn")


@pytest.mark.parametrize("name", ["a.npy", "a.mat", "a.h5"])
@pytest.mark.parametrize("values", [CUBE + 1j, np.array(["a", "bc"])])
def test_only_real_numbers_are_read(tmp_path, name, values):
    if name == "a.h5" and values.dtype.kind == "U":
        values = values.astype("S")
    path = store(tmp_path / name, v=values)
    with pytest.raises(ValueError, match=rf"{name}:.* is .*(, not real|;) numbers"):
        read_array(path)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", b"1,2", r"a.csv: .npy, .mat or .h5 is needed, not '.csv'"),
        ("a", b"1,2", r"a: .npy, .mat or .h5 is needed, not 'no ending'"),
        ("a.npy", b"", r"a.npy is not a whole .npy file"),
        ("a.npy", b"\x93NUMPY\x01\x00", r"a.npy is not a whole .npy file"),
        ("a.mat", b"", r"a.mat is not a whole MATLAB file"),
        ("a.mat", b"not MATLAB " * 50, r"a.mat is not a whole MATLAB file"),
    ],
)
def test_broken_files_are_refused(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=message):
        read_array(tmp_path / name)


def test_truncated_and_missing_files_are_refused(tmp_path):
    for name, message in (("a.npy", "not a whole .npy file"), ("a.mat", "not a whole MATLAB file")):
        path = store(tmp_path / name, v=np.ones(1000))
        path.write_bytes(path.read_bytes()[:-100])
        with pytest.raises(ValueError, match=message):
            read_array(path)
    with pytest.raises(FileNotFoundError, match=r"b.npy: no such file"):
        read_array(tmp_path / "b.npy")

"""Plain arrays and MATLAB files: nothing is guessed, so every order and unit must be honoured."""

import h5py
import numpy as np
import pytest
from scipy.io import savemat

import torchliner as tl
from torchliner.io.foreign import read_array

CUBE = np.random.default_rng(0).normal(size=(2, 3, 5))  # z, x, time: all lengths differ


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


@pytest.mark.parametrize("name", ["a.mat", "a_v73.mat", "a.h5"])
def test_variable_is_named_where_there_are_several(tmp_path, name):
    path = store(tmp_path / name, YVelocity=CUBE, XVelocity=-CUBE)
    assert np.array_equal(read_array(path, "YVelocity"), CUBE)
    with pytest.raises(ValueError, match=r"a.*\..* holds .Velocity, .Velocity; name the one meant"):
        read_array(path)
    with pytest.raises(ValueError, match=r"no variable 'YVelocty' \(did you mean 'YVelocity'\?\)"):
        read_array(path, "YVelocty")


@pytest.mark.parametrize(
    ("values", "axes", "wanted"),
    [
        (CUBE[0].T, "time,probe", CUBE[0]),
        (CUBE[0, 0], "time", CUBE[0, 0]),
        (CUBE[0, :1], "time", CUBE[0, 0]),  # MATLAB keeps a vector as a row
        (CUBE[:, :1], "z,time", CUBE[:, 0]),
        (CUBE[:1, :1], "z,x,time", CUBE[:1, :1]),
        ((100 * CUBE).astype("i4"), "z,x,time", (100 * CUBE).astype("i4")),
    ],
)
@pytest.mark.parametrize("name", ["a.npy", "a.mat", "a_v73.mat"])
def test_lines_single_probes_and_integers(tmp_path, name, values, axes, wanted):
    path = store(tmp_path / name, v=values)
    found = tl.read_plane(path, axes=axes, velocity_units="m/s", sampling_rate=5e4).velocity
    assert np.array_equal(found.numpy(), wanted)


@pytest.mark.parametrize("name", ["a.npy", "a.mat", "a.h5"])
@pytest.mark.parametrize("values", [CUBE + 1j, np.array(["a", "bc"])])
def test_only_real_numbers_are_read(tmp_path, name, values):
    if name == "a.h5" and values.dtype.kind == "U":
        values = values.astype("S")
    path = store(tmp_path / name, v=values)
    with pytest.raises(ValueError, match=rf"{name}:.* is .*(, not real|;) numbers"):
        read_array(path)

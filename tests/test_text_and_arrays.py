"""Texts, TOML, sounds and arrays that are not what their name says; arrays that carry more."""

import io
import struct

import h5py
import numpy as np
import pytest
import torch
import xarray
from scipy.io import savemat

import torchliner as tl
from torchliner import file_checks
from torchliner.io.burst_sources import read_bursts
from torchliner.io.foreign import read_array
from torchliner.io.microphone_file import read_microphones, read_signal

LINER = "frequency, resistance, reactance"
BURSTS = "arrival_time [ms], wall_normal [m/s]"
LINE = "# duct_height = 50 mm\nx [mm], frequency [Hz], SPL [dB], phase [deg]\n0, 1000, 120, 10\n"
READERS = {"liner": tl.load_liner, "bursts": read_bursts, "microphones": read_microphones}


def stored(tmp_path, text, name="a.csv"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    ("kind", "text", "message"),
    [
        ("liner", f"{LINER}\n1000, 0,30, -1,25\n", "line 2 has 5 cells, the header 3"),
        ("liner", f"{LINER}, resistance\n1000, 1, 2, 3\n", "'resistance' is named twice"),
        ("liner", f"{LINER}\n#N/A, 1, 2\n2000, 1, 2\n", "line 2, column 'frequency' is '#N/A'"),
        ("liner", f"{LINER}\n1, 2, 3\n1, 2, 4\n", "each frequency needs one row for each speed"),
        ("liner", f"{LINER}\n1, 2, 3\0\n", "holds zero bytes: it is no text file"),
        ("bursts", f"{BURSTS}\n1, 5\n#N/A, 2\n", "line 3, column 'arrival_time' is '#N/A'"),
        ("bursts", f"{BURSTS}\n1, 5\n#2, 5\n", "line 3, column 'arrival_time' is '#2'"),
        ("bursts", f"{BURSTS}\n1, 5\n2, 9.96921e36\n", "line 3, holds .* m/s, which is no vel"),
        ("bursts", f"# x = 1e400 mm\n{BURSTS}\n1, 5\n", "line 1, x is '1e400 mm'; a finite number"),
        ("microphones", LINE + "#N/A, 1000, 119, 20\n", "line 4, column 'x' is '#N/A'; a number"),
        ("microphones", LINE + "9, 1000, 119, -1e300\n", r"line 4, holds -1e\+300 deg, which is"),
        ("microphones", LINE + "9, 1000, 1e-300, 20\n", "levels are 1e-300 to"),
        ("microphones", LINE + "9, 1000, 119, 20, 7\n", "line 4 has 5 cells, the header 4"),
    ],
)
def test_cells_that_are_none_are_refused(tmp_path, kind, text, message):
    with pytest.raises(ValueError, match=rf"a.csv.*{message}"):
        READERS[kind](stored(tmp_path, text))


@pytest.mark.parametrize("kind", READERS)
def test_only_regular_files_are_tables(tmp_path, kind):
    (tmp_path / "zero.csv").symlink_to("/dev/zero")
    with pytest.raises(OSError, match=r"zero.csv is a device or a pipe; a regular file is needed"):
        READERS[kind](tmp_path / "zero.csv")


def test_texts_larger_than_memory_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(file_checks, "machine_memory", lambda: 100.0)
    with pytest.raises(ValueError, match=r"a.csv as cells of text takes .* GB; this machine has"):
        read_microphones(stored(tmp_path, LINE))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = " + "[" * 9999, "a.toml is not valid TOML"),
        ("a = " + "1" * 9999, "a.toml is not valid TOML"),
        (b"\xff\xfe", "a.toml is not UTF-8 text"),
    ],
    ids=range(3),
)
def test_toml_that_is_none(tmp_path, text, message):
    with pytest.raises(ValueError, match=message):
        tl.load_liner(stored(tmp_path, text, "a.toml"))


def wav(channels=1, size=None, samples=100):
    data = bytes(2 * channels * samples)
    head = struct.pack("<HHIIHH", 1, channels, 8000, 16000 * channels, 2 * channels, 16)
    body = b"WAVEfmt " + struct.pack("<I", 16) + head + b"data"
    body += struct.pack("<I", len(data) if size is None else size) + data
    return b"RIFF" + struct.pack("<I", len(body) if size is None else size) + body


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (wav(size=0), "is not a whole .wav file"),
        (wav(size=2**32 - 1), "is not a whole .wav file"),
        (wav(channels=0), "is not a whole .wav file"),
        (wav(samples=0), "or are none"),
        (wav()[:50], "is not a whole .wav file"),
        (b"", "is not a whole .wav file"),
        (wav()[:34] + b"\x08\0" + wav()[36:], "8 bits a sample .* do not fill 2 bytes"),
    ],
)
def test_sounds_that_were_streamed_or_broken_off(tmp_path, content, message):
    with pytest.raises(ValueError, match=f"a.wav.*{message}"):
        read_signal(stored(tmp_path, content, "a.wav"))
    assert read_signal(stored(tmp_path, wav(), "b.wav")).sampling_rate == 8000


@pytest.mark.parametrize(("order", "kind", "scale"), [("<", "i2", 2**15), (">", "i2", 2**15), ("<", "u1", 2**7)])
def test_a_sound_of_either_byte_order_and_of_8_bits(tmp_path, order, kind, scale):
    values = np.array([0, 1, -2, 100]) + (128 if kind == "u1" else 0)  # 8 bits count from 128
    data = values.astype(order + kind).tobytes()
    size = len(data) // len(values)
    head = struct.pack(order + "IHHIIHH", 16, 1, 1, 8000, 8000 * size, size, 8 * size)
    body = b"WAVEfmt " + head + b"data" + struct.pack(order + "I", len(data)) + data
    content = (b"RIFF" if order == "<" else b"RIFX") + struct.pack(order + "I", len(body)) + body
    found = read_signal(stored(tmp_path, content, "a.wav"))
    assert (found.sampling_rate, found.signal.tolist()) == (8000, [0, 1 / scale, -2 / scale, 100 / scale])


def archive():
    kept = io.BytesIO()
    np.savez(kept, a=np.ones(3))
    return kept.getvalue()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.npy", archive(), "a.npy is not a whole .npy file: the magic string"),
        ("a.npy", b"\x93NUMPY\x01\x00\x10\x00" + b"(" * 16, "a.npy is not a whole .npy file"),
        ("a.mat", b"MATLAB 5.0" + bytes(114) + b"\x00\x01IM" + b"\x07" * 64, "a.mat is not"),
        ("a.mat", bytes(200), "a.mat"),
    ],
)
def test_arrays_that_are_none(tmp_path, name, content, message):
    with pytest.raises(ValueError, match=message):
        read_array(stored(tmp_path, content, name))


V = np.random.default_rng(0).normal(size=(6, 2, 3))  # time, z, x
GAP = np.ma.masked_equal([500.0, 900.0], 500.0)


def of(values, **about):
    return tl.VelocityPlane(values, sampling_rate=1e4, **about)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: of(xarray.DataArray(V[:, 0], dims=("time", "x"))), TypeError, "axes have names; .*from_xarray"),
        (lambda: of(V[0], x=np.ma.masked_less([0.0, 0.1], 0.05)), ValueError, "x has 1 masked val"),
        (lambda: of(V[0], x=xarray.DataArray([0.0, 1.0])), TypeError, "x is a DataArray whose axes have names"),
        (lambda: of(V[0], area=[1.0, -1.0]), ValueError, "area"),
        (lambda: of(V[0], x=[0.0, 1e300]), ValueError, r"x is 1e\+300 m at 1"),
        (lambda: tl.load_liner("polito").impedance(GAP), ValueError, "1 masked values"),
        (lambda: tl.MicrophoneLine([0.0, 0.1], GAP, 500.0, duct_height=0.05), ValueError, "pressure has 1 masked val"),
        (lambda: tl.TabulatedLiner([1.0, 2.0], GAP), ValueError, "values has 1 masked values"),
    ],
)
def test_what_an_array_cannot_carry_is_refused(make, error, message):
    with pytest.raises(error, match=message):
        make()


def test_coordinates_may_stand_in_a_file_of_their_own(tmp_path):
    np.save(tmp_path / "v.npy", V[:, 0])
    np.save(tmp_path / "x.npy", [0.0, 2.0, 4.0])
    stated = {"axes": "time,x", "sampling_rate": 5e4, "velocity_units": "m/s", "length_units": "mm"}
    found = tl.read_plane(tmp_path / "v.npy", x=tmp_path / "x.npy", **stated)
    assert found.x.tolist() == pytest.approx([0.0, 2e-3, 4e-3])


def test_masked_velocities_are_missing():
    masked = np.ma.masked_greater(V[:, 0].T, 1.0)
    wanted = torch.from_numpy(np.where(V[:, 0].T > 1.0, np.nan, V[:, 0].T))
    found = of(masked)
    assert torch.equal(found.velocity.isnan(), wanted.isnan())
    assert torch.equal(found.velocity.nan_to_num(), wanted.nan_to_num())


# Plain arrays and MATLAB files: nothing is guessed, so every order and unit must be honoured

CUBE = np.random.default_rng(0).normal(size=(2, 3, 5))  # z, x, time: all lengths differ


def saved(path, **arrays):
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
    path = saved(tmp_path / name, YVelocity=CUBE, XVelocity=-CUBE)
    assert np.array_equal(read_array(path, "YVelocity"), CUBE)
    with pytest.raises(ValueError, match=r"a.*\..* holds .Velocity, .Velocity; name the one meant"):
        read_array(path)
    with pytest.raises(ValueError, match=r"no variable 'YVelocty' \(did you mean 'YVelocity'\?\)"):
        read_array(path, "YVelocty")


@pytest.mark.parametrize(
    ("values", "axes", "wanted"),
    [
        (CUBE[0].T, "time,probe", CUBE[0]),
        (CUBE[0, :1], "probe,time", CUBE[0, :1]),  # MATLAB keeps a vector as a row
        (CUBE[:1, :1], "z,x,time", CUBE[:1, :1]),
        ((100 * CUBE).astype("i4"), "z,x,time", (100 * CUBE).astype("i4")),
    ],
)
@pytest.mark.parametrize("name", ["a.npy", "a.mat", "a_v73.mat"])
def test_lines_single_probes_and_integers(tmp_path, name, values, axes, wanted):
    path = saved(tmp_path / name, v=values)
    found = tl.read_plane(path, axes=axes, velocity_units="m/s", sampling_rate=5e4).velocity
    assert np.array_equal(found.numpy(), wanted)


@pytest.mark.parametrize("name", ["a.npy", "a.mat", "a.h5"])
@pytest.mark.parametrize("values", [CUBE + 1j, np.array(["a", "bc"])])
def test_only_real_numbers_are_read(tmp_path, name, values):
    if name == "a.h5" and values.dtype.kind == "U":
        values = values.astype("S")
    path = saved(tmp_path / name, v=values)
    with pytest.raises(ValueError, match=rf"{name}.* is .*; numbers are needed"):
        read_array(path)

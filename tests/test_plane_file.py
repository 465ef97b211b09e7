"""The plane file: written, read back, refused; for damaged files see test_own_files.py."""

from dataclasses import replace

import h5py
import numpy as np
import pytest
import torch
import xarray
from hypothesis import given, settings
from hypothesis import strategies as st

import torchliner as tl
from torchliner import file_checks
from torchliner.io.plane_writer import write_plane
from torchliner.records.slabs import SLAB_ROWS

RATE = 50e3
# name -> probe shape, coordinates, dimensions in the file
LAYOUTS = {
    "plane": ((3, 4), {"x": [0.0, 0.001, 0.002, 0.003], "z": [0.0, 0.01, 0.02]}, "time z x"),
    "bare plane": ((3, 4), {}, "time z x"),
    "line": ((4,), {"x": [0.0, 0.1, 0.2, 0.4]}, "time x"),
    "line upstream": ((3,), {"x": [0.2, 0.1, 0.0]}, "time probe"),
    "scattered": ((3,), {"x": [0.2, 0.1, 0.3], "z": [0.0, 0.5, 0.0]}, "time probe"),
    "bare probes": ((3,), {}, "time probe"),
    "one probe": ((1,), {"x": [0.7]}, "time x"),
    "one probe in a plane": ((1, 1), {"x": [0.7], "z": [0.1]}, "time z x"),
    "no probe axis": ((), {}, "time"),
}


def make_plane(shape=(3, 4), samples=20, dtype=torch.float64, rate=RATE, **about):
    noise = torch.Generator().manual_seed(samples)
    velocity = torch.randn(*shape, samples, generator=noise, dtype=dtype)
    return tl.VelocityPlane(velocity, sampling_rate=rate, **about)


TIMES = np.arange(20) / RATE


def raw_file(path, velocity, time=TIMES, dims=(), units="m/s", time_units="s", **more):
    """A file as others might write it; ``more``: dataset = (values, units)."""
    with h5py.File(path, "w") as file:
        datasets = {"wall_normal_velocity": (velocity, units), "time": (time, time_units), **more}
        for name, (values, unit) in datasets.items():
            if values is not None:
                file[name] = values
                file[name].attrs.update({} if unit is None else {"units": unit})
        for axis, name in enumerate(dims):
            if name not in file:
                file[name] = np.arange(velocity.shape[axis]) + 0.5
                file[name].attrs["units"] = "1"
            file[name].make_scale(name)
            file["wall_normal_velocity"].dims[axis].attach_scale(file[name])
    return path


@pytest.mark.parametrize("layout", LAYOUTS)
def test_dimensions_of_each_layout(tmp_path, layout):
    shape, coordinates, dims = LAYOUTS[layout]
    plane = make_plane(shape, **coordinates)
    plane.write(tmp_path / "a.h5")
    with xarray.open_dataset(tmp_path / "a.h5", engine="h5netcdf") as data:
        assert data.wall_normal_velocity.dims == tuple(dims.split())
        assert all(data[key].units == "m" for key in coordinates)


@settings(max_examples=40)
@given(
    shape=st.lists(st.integers(1, 3), max_size=2).map(tuple),
    samples=st.sampled_from([2, SLAB_ROWS - 1, SLAB_ROWS, SLAB_ROWS + 1]),
    dtype=st.sampled_from([torch.float32, torch.float64]),
    rate=st.floats(1.0, 1e7),
)
def test_round_trip_of_any_shape(tmp_path_factory, shape, samples, dtype, rate):
    path = tmp_path_factory.getbasetemp() / "any.h5"
    plane = make_plane(shape, samples, dtype, rate)
    write_plane(plane, path)
    found = tl.read_plane(path)
    assert torch.equal(found.velocity, plane.velocity)
    assert found.sampling_rate == pytest.approx(rate, rel=1e-12)
    assert torch.equal(tl.read_plane(path, lazy=True).read(1, samples), plane.read(1, samples))


def test_references_come_back_under_any_name(tmp_path):
    plane = make_plane(reference={"true": 1.5 - 0.25j, "in situ": 2, "in_situ": 3j, "p/v, wall": 1 + 1j})
    plane.write(tmp_path / "a.h5")
    found = tl.read_plane(tmp_path / "a.h5")
    assert found.reference == plane.reference
    assert found.name.endswith("a.h5:/wall_normal_velocity")


def test_lazy_plane_may_be_written_over_its_own_file(tmp_path):
    make_plane().write(tmp_path / "a.h5")
    replace(tl.read_plane(tmp_path / "a.h5", lazy=True), title="new").write(tmp_path / "a.h5")
    found = tl.read_plane(tmp_path / "a.h5")
    assert found.title == "new"
    assert torch.equal(found.velocity, make_plane().velocity)


WAVE = np.random.default_rng(0).normal(size=(20, 6))
SQUARE = np.random.default_rng(0).normal(size=(20, 20))


@pytest.mark.parametrize(
    ("velocity", "wanted", "dims"),
    [
        (WAVE, WAVE.T, ()),
        (WAVE.T, WAVE.T, ()),
        (WAVE.T, WAVE.T, ("probe", "time")),
        (SQUARE, SQUARE, ("probe", "time")),
        (SQUARE, SQUARE.T, ("time", "probe")),
        (WAVE.T.reshape(2, 3, 20), WAVE.T.reshape(2, 3, 20), ()),
        (WAVE.astype(">f4"), WAVE.T.astype("f4"), ()),
    ],
)
def test_layouts_of_others_are_read_as_they_are(tmp_path, velocity, wanted, dims):
    path = raw_file(tmp_path / "a.h5", velocity, dims=dims)
    found, lazy = tl.read_plane(path), tl.read_plane(path, lazy=True)
    assert np.array_equal(found.velocity.numpy(), wanted)
    assert torch.equal(lazy.read(4, 9), found.read(4, 9))


def test_units_are_converted(tmp_path):
    more = {"x": (np.arange(6.0), "mm"), "frequency": ([1.4], "kHz")}
    found = tl.read_plane(raw_file(tmp_path / "a.h5", 1e3 * WAVE, 1e3 * TIMES, (), "mm/s", "ms", **more))
    assert np.allclose(found.velocity, WAVE.T, rtol=1e-14)
    assert found.sampling_rate == pytest.approx(RATE)
    assert found.x.tolist() == pytest.approx([0, 1e-3, 2e-3, 3e-3, 4e-3, 5e-3])
    assert found.frequency == pytest.approx(1400.0)


def shifted(intervals):
    return np.where(np.arange(20) == 10, TIMES + intervals / RATE, TIMES)


def test_small_jitter_of_time_is_accepted(tmp_path):
    found = tl.read_plane(raw_file(tmp_path / "a.h5", WAVE, shifted(0.009)))
    assert found.sampling_rate == pytest.approx(RATE)


V, T = "a.h5:/wall_normal_velocity", "a.h5:/time"
BAD = {
    "no velocity": ({"velocity": None}, r"a.h5:/time has units 's'.* a velocity is needed"),
    "no time": ({"time": None}, rf"{V} has shape .* one axis is time: name all .*and give sampling_ra"),
    "4-D": ({"velocity": np.ones((20, 1, 1, 1))}, r"\(20, 1, 1, 1\).*; \(time, z, x\) or"),
    "other length": ({"velocity": WAVE[:19]}, r"\(19, 6\).* but there are 20 times; .*time first or last"),
    "short": ({"velocity": SQUARE[:19], "dims": ("time", "p")}, r"\(19, 20\) .* but there are 20 times"),
    "square": ({"velocity": SQUARE}, r"\(20, 20\) .* there are 20 times.* marked by the dim.* where both fit"),
    "integers": ({"velocity": WAVE.astype(np.int16)}, f"{V} is int16; floating-point m/s"),
    "complex": ({"velocity": WAVE + 0j}, f"{V} is complex128; floating-point m/s"),
    "no units": ({"units": None}, f"{V} has no units attribute; set it to one of m/s, "),
    "wrong units": ({"units": "Pa"}, f"{V} has units 'Pa'.*a velocity is needed in one of m/s"),
    "no time units": ({"time_units": None}, f"{T} has no units attribute; set it to one of s, ms"),
    "uneven": ({"time": shifted(0.3)}, f"{T} is not uniform.* 0.3 sampling .*limit 0.01.*resample"),
    "lost frames": ({"time": np.r_[TIMES[:9], TIMES[9:] + 2 / RATE]}, "lacks 2 frames, the fir"),
    "two runs": ({"time": np.r_[TIMES[:9], TIMES[3:14]]}, r"out of order: sample 9 is at 6e-05 s"),
    "one time": ({"time": np.zeros(1)}, rf"{T} has shape \(1,\); a list of at least two times"),
    "nan time": ({"time": shifted(np.nan)}, f"{T} holds 1 values not finite"),
    "x": ({"x": (np.zeros(5), "m")}, "x has 5 values; probes of shape .* need 6"),
    "x units": ({"x": (np.zeros(6), None)}, "a.h5:/x has no units attribute"),
    "frequencies": ({"frequency": ([1e3, 2e3], "Hz")}, r"/frequency has shape \(2,\); one number"),
    "height": ({"height": (0.0, "m")}, f"{V}: height is 0 m"),
    "density": ({"density": (-1.0, "kg/m3")}, r"a.h5:/density holds -1 kg/m3, which is no density"),
    "reference": (
        {"reference_a_resistance": (1.0, "1")},
        "a.h5:/reference_a_resistance and its other part are .*nan if missing",
    ),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_file_is_refused_with_its_place(tmp_path, kind):
    changes, message = BAD[kind]
    path = raw_file(tmp_path / "a.h5", **{"velocity": WAVE, **changes})
    with pytest.raises(ValueError, match=message):
        tl.read_plane(path)


def test_damaged_tile_is_named(tmp_path):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["time"] = np.arange(300) / RATE
        file.create_dataset(
            "wall_normal_velocity", data=np.random.default_rng(0).normal(size=(300, 40)), chunks=(99, 40), compression=9
        )
        file["time"].attrs["units"], file["wall_normal_velocity"].attrs["units"] = "s", "m/s"
    with h5py.File(path) as file:
        tile = file["wall_normal_velocity"].id.get_chunk_info(1)
    content = bytearray(path.read_bytes())
    content[tile.byte_offset : tile.byte_offset + tile.size] = bytes(tile.size)
    path.write_bytes(content)
    with pytest.raises(OSError, match=f"{V} cannot be read from sample 0 to 300"):
        tl.read_plane(path)


def test_single_sample_cannot_be_written(tmp_path):
    with pytest.raises(ValueError, match="velocity has 1 sample; at least two times are needed"):
        make_plane(samples=1).write(tmp_path / "a.h5")
    assert list(tmp_path.iterdir()) == []


# What was never written, is packed, linked or damaged is said or refused

NAME = "wall_normal_velocity"


def good():
    return make_plane(x=[0.0, 0.1, 0.2, 0.3], z=[0.0, 0.1, 0.2], height=1e-3)


def edited(tmp_path, edit):
    """A good file that one edit has changed."""
    path = tmp_path / "a.h5"
    good().write(path)
    with h5py.File(path, "r+") as file:
        edit(file)
    return path


def remade(name, **how):
    """A dataset in the place of another, with its units and without dimension scales; functions are of its values."""

    def edit(file):
        values, units = file[name][()], file[name].attrs["units"]
        del file[name]
        words = {key: each(values) if callable(each) else each for key, each in how.items()}
        file.create_dataset(name, **words).attrs["units"] = units
        return file[name]

    return edit


def linked(name, link):
    return lambda file: (file.pop(name), file.__setitem__(name, link))


def set_attribute(name, key, value):
    return lambda file: (file[name] if name else file).attrs.__setitem__(key, value)


def half_written(file):
    remade(NAME, shape=np.shape, dtype="f4", chunks=(5, 3, 4))(file)[:10] = 1.0


def virtual(file):
    shape = file.pop(NAME).shape
    layout = h5py.VirtualLayout(shape, "f4")
    layout[:] = h5py.VirtualSource("part.h5", "v", shape)
    file.create_virtual_dataset(NAME, layout).attrs["units"] = "m/s"


OUTSIDE = remade(NAME, shape=np.shape, dtype="f4", external=[("v.raw", 0, h5py.h5f.UNLIMITED)])
PLANES = {
    "chunks never written": (half_written, rf"{NAME}: 2 of 4 chunks were never written .* read as 0"),
    "values never written": (remade(NAME, shape=np.shape, dtype="f4"), rf"{NAME}: 1 of 1 blocks were never written"),
    "empty": (remade(NAME, data=h5py.Empty("f4")), rf"{NAME} has shape \(\)"),
    "height never written": (remade("height", shape=np.shape, dtype="f4"), "height: 1 of 1 blocks were never written"),
    "a link": (linked("height", h5py.SoftLink("/h")), "height is a link to /h, which is not ther"),
    "a link elsewhere": (linked("height", h5py.ExternalLink("no.h5", "/h")), "height is a link to no.h5:/h, which"),
    "raw storage": (
        OUTSIDE,
        rf"{NAME} keeps its values outside the file; .*h5repack",
    ),
    "a virtual set": (virtual, rf"{NAME} keeps its values outside the file; .*h5repack"),
    "x of index units": (set_attribute("x", "units", "1"), "x has units '1'; a length is needed"),
    "x not finite": (lambda f: f["x"].write_direct(np.array([0, 1, np.nan, 2.0])), "x is nan m at 2"),
    "x absurd": (lambda f: f["x"].write_direct(np.array([0, 1, 2, 1e300])), r"x holds 1e\+300 m, which is"),
    "texts": (remade("height", data="1 mm"), "height is object; numbers are needed"),
    "factor of 0": (set_attribute(NAME, "scale_factor", 0.0), "scale_factor is 0"),
    "factor of text": (set_attribute(NAME, "scale_factor", "2"), "scale_factor is '2'; numbers"),
    "nested JSON": (set_attribute("", "provenance", "[" * 9999), "'provenance' is .*Invalid JSON"),
    "source side": (set_attribute("", "source_side", "left"), "source_side 'left'; choose one of: upstream, downstr"),
    "JSON of another kind": (set_attribute("", "provenance", "[1]"), "'provenance' is .* an object; repair it"),
}


@pytest.mark.parametrize("lazy", [False, True])
@pytest.mark.parametrize("kind", PLANES)
def test_what_is_not_there_is_no_zero(tmp_path, kind, lazy):
    edit, message = PLANES[kind]
    path = edited(tmp_path, edit)
    with pytest.raises(ValueError, match=f"a.h5.*{message}"):
        tl.read_plane(path, lazy)


def test_what_a_file_fills_is_missing(tmp_path):
    """The fill value of the dataset itself, without an attribute, as netCDF has it."""
    fill = np.float32(9.96921e36)

    def first(values):
        return np.where(np.arange(values.size).reshape(values.shape) == 0, fill, values).astype("f4")

    path = edited(tmp_path, remade(NAME, data=first, fillvalue=fill, chunks=(20, 3, 4)))
    assert torch.isnan(tl.read_plane(path).velocity).nonzero().tolist() == [[0, 0, 0]]


def test_values_of_other_files_are_named(tmp_path):
    def edit(file):
        with h5py.File(tmp_path / "part.h5", "w") as other:
            other.create_dataset("v", data=file[NAME][()]).attrs["units"] = "m/s"
        linked(NAME, h5py.ExternalLink("part.h5", "v"))(file)

    path = edited(tmp_path, edit)
    with pytest.warns(tl.DataWarning, match=r"its values stand in .*part.h5"):
        found = tl.read_plane(path)
    assert torch.equal(found.velocity, good().velocity)


@pytest.mark.parametrize("longer", [False, True])
def test_more_than_memory_is_refused_from_the_header(tmp_path, monkeypatch, longer):
    def edit(file):
        if longer:
            remade("time", data=np.arange(400) / RATE)(file)
            remade(NAME, data=np.zeros((400, 3, 4), "f4"))(file)

    path = edited(tmp_path, edit)
    monkeypatch.setattr(file_checks, "machine_memory", lambda: 1000.0)
    with pytest.raises(ValueError, match=r"a.h5:/.* takes .* GB; this machine has 1e-06 GB"):
        tl.read_plane(path)

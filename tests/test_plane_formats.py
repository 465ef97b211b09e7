"""netCDF-4, netCDF-3, zarr, xarray, HDF5, numpy and MATLAB: the same plane, whatever the names, order and units."""

import sys

import numpy as np
import pandas
import pytest
import torch
import xarray
import zarr
from scipy.io import netcdf_file

import torchliner as tl
from torchliner.units import si_factor

RATE = 40e3
VALUES = np.random.default_rng(3).normal(size=(30, 3, 4)).astype("f4")  # (time, z, x)
X, Z, TIMES = np.linspace(0.001, 0.004, 4), np.linspace(0.0, 0.01, 3), np.arange(30) / RATE
AXES, V = ("time", "z", "x"), "wall_normal_velocity"
FILES = ("netcdf4", "netcdf3", "zarr")  # that say all themselves


def dataset(order=AXES, name=V, attrs=None, values=VALUES, **coordinates):
    """A dataset as solvers' exporters write it."""
    units = {"time": "s", "x": "m", "z": "m"}
    base = {"time": TIMES, "z": Z, "x": X} | coordinates
    data = xarray.DataArray(values.copy(), dims=AXES, attrs={"units": "m s**-1"} | (attrs or {}))
    coords = {key: (key, value, {"units": units[key]}) for key, value in base.items()}
    return xarray.Dataset({name: data.transpose(*order)}, coords)


def written(data, folder, kind):
    """The dataset in a file of a kind."""
    folder.mkdir(exist_ok=True)
    path = folder / "a.data"
    if kind == "zarr":
        data.to_zarr(path, consolidated=False)
    else:
        data.to_netcdf(path, engine={"netcdf4": "h5netcdf", "netcdf3": "scipy"}[kind])
    return path


def same_plane(found, wanted=VALUES, rtol=1e-6):
    """Velocity over (z, x), coordinates, rate."""
    assert np.allclose(found.velocity.numpy(), np.moveaxis(wanted, 0, -1), rtol=rtol, equal_nan=True)
    assert np.allclose(found.x, X)
    assert np.allclose(found.z, Z)
    assert found.sampling_rate == pytest.approx(RATE, rel=1e-6)


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize(
    "encoding",
    [
        {"dtype": "i2", "scale_factor": 1e-3, "add_offset": 0.5, "_FillValue": -32000},
        {"dtype": "i4", "scale_factor": 1e-4, "missing_value": -7},
        {"dtype": "f4", "_FillValue": np.float32(9.96921e36)},
    ],
)
def test_packed_and_missing_values(tmp_path, kind, encoding):
    data = dataset()
    data[V][7, 1, 2] = np.nan
    data[V].encoding = encoding
    path = written(data, tmp_path, kind)
    wanted = np.moveaxis(VALUES, 0, -1).copy()
    wanted[1, 2, 7] = np.nan
    for lazy in (False, True):
        assert np.allclose(tl.read_plane(path, lazy=lazy).load().velocity, wanted, atol=6e-4, equal_nan=True)


def test_unsigned_numbers_in_signed_ones_are_refused(tmp_path):
    data = dataset()
    data[V].encoding = {"dtype": "i2", "scale_factor": 1e-3, "_Unsigned": "true", "_FillValue": -1}
    with pytest.raises(ValueError, match="_Unsigned in signed integers"):
        tl.read_plane(written(data, tmp_path, "netcdf3"))


@pytest.mark.parametrize("kind", ["i2", "i4", "f4", "f8"])
@pytest.mark.parametrize("name", [V, "time"])
def test_records_that_nobody_wrote_hold_what_the_library_fills_in(tmp_path, kind, name):
    """netCDF-3 without ``_FillValue``: nan in the velocity, an error in the times; frames added later are not seen."""
    path = tmp_path / "a.nc"
    fill = {"i2": -32767, "i4": -2147483647}.get(kind, 9.9692099683868690e36)  # netcdf.h
    values = {"time": np.arange(30.0), V: np.ones((30, 4)), "p": np.full((30, 4), 7.0)}  # records interleave
    values[name][20:] = fill
    with netcdf_file(path, "w") as file:
        file.createDimension("time", None)
        file.createDimension("x", 4)
        for each, unit in (("time", "ms"), ("p", "Pa"), (V, "m/s")):
            variable = file.createVariable(each, kind if name == each else "f4", ["time", "x"][: values[each].ndim])
            variable.units, variable.scale_factor = unit, 1.0
            variable[:] = values[each]
    if name == "time":
        with pytest.raises(ValueError, match=r"a.nc:/time holds 10 values not finite"):
            tl.read_plane(path)
        return
    lazy = tl.read_plane(path, lazy=True)
    with netcdf_file(path, "a") as file:
        file.variables["time"][30:31] = [30]
        file.variables[V][30:31] = np.ones((1, 4))
    found = lazy.load().velocity
    assert (found[:, :20] == 1).all()
    assert found[:, 20:].isnan().all()
    assert tl.read_plane(path).samples == lazy.samples + 1 == 31


def store(path, version, fill=0, **arrays):
    """A store written through zarr itself: arrays, and how many of their values; (time, x)."""
    group = zarr.open_group(path, mode="w", zarr_format=version)
    for name, (values, count) in arrays.items():
        dims, unit = {"time": (["time"], "s"), "x": (["x"], "m")}.get(name, (["time", "x"], "m/s"))
        about = {"dtype": values.dtype, "fill_value": fill, "chunks": (10, *values.shape[1:])}
        words = {"dimension_names": dims} if version == 3 else {}
        array = group.create_array(name, shape=values.shape, **about, **words)
        array.attrs.update({"units": unit} if words else {"units": unit, "_ARRAY_DIMENSIONS": dims})
        array[:count] = values[:count]
    return path


@pytest.mark.parametrize("version", [2, 3])
def test_a_store_that_fills_with_0(tmp_path, monkeypatch, version):
    """Zeros that were written are zeros, also at the first time; chunks that were not are none."""
    v = np.where(VALUES[:, 0] > 0, VALUES[:, 0], 0)
    whole = {"time": (TIMES, 30), "x": (X, 4), V: (v, 30)}
    path = tmp_path / "a.zarr"
    assert np.array_equal(tl.read_plane(store(path, version, **whole)).velocity.numpy(), v.T)
    for name, count, words in ((V, 20, "1 of 3"), (V, 0, "3 of 3"), ("time", 20, "1 of 3"), ("x", 0, "1 of 1")):
        broken = whole | {name: (whole[name][0], count)}
        with pytest.raises(ValueError, match=rf"a.zarr:/{name}: {words} chunks were never .*write_empty_chunks=True"):
            tl.read_plane(store(path, version, **broken))
    missing = tl.read_plane(store(path, version, fill=np.nan, **whole | {V: (v, 20)}))
    assert missing.velocity[:, 20:].isnan().all()
    alone = tl.read_plane(store(path, version, **whole | {"x": (np.zeros(1), 1), V: (v[:, :1], 30)}))
    assert alone.x.tolist() == [0.0]
    data = dataset()
    data[V].encoding = {"dtype": "i2", "scale_factor": 1e-3, "add_offset": 9.0, "_FillValue": 0}
    data[V][7, 1, 2] = np.nan
    data.to_zarr(tmp_path / "b.zarr", consolidated=False, zarr_format=version)
    assert torch.isnan(tl.read_plane(tmp_path / "b.zarr").velocity).nonzero().tolist() == [[1, 2, 7]]
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(ImportError, match=r"a.zarr is a zarr store: .*torchliner\[zarr\]"):
        tl.read_plane(path)


def test_groups_dates_and_axes_of_size_1(tmp_path):
    data = dataset(x=1e3 * X).expand_dims(y=[2.5], axis=1)
    data.y.attrs["units"] = data.x.attrs["units"] = "mm"
    data = data.assign_coords(time=("time", 1e6 + TIMES, {"units": "seconds since 2020-01-01 00:00:00"}))
    data["sound_speed"] = ((), 345.0, {"units": "m/s"})
    data.to_netcdf(tmp_path / "a.nc", engine="h5netcdf", group="run/plane")
    found = tl.read_plane(tmp_path / "a.nc", variable=f"run/plane/{V}")
    same_plane(found)
    assert (found.start, found.fluid.sound_speed) == (1e6, 345)
    assert found.name.endswith(f"a.nc:/run/plane/{V}")
    with pytest.raises(ValueError, match=r"a.nc has no variable 'run/wall/v' .*it holds .*name the velocity"):
        tl.read_plane(tmp_path / "a.nc", variable="run/wall/v")


@pytest.mark.parametrize(
    ("data", "stated", "factor"),
    [
        (dataset(name="v"), {"variable": "v"}, 1),
        (dataset(), {"normal": "-y"}, -1),
        (dataset().rename(z="y"), {"normal": "z"}, 1),
    ],
)
def test_names_and_signs_are_stated(data, stated, factor):
    same_plane(tl.VelocityPlane.from_xarray(data, **stated), factor * VALUES)


def named(**names):
    """With other names of axes, and no coordinates along them."""
    return dataset().rename(names).drop_vars([*names.values()])


BARE = xarray.DataArray(VALUES, dims=AXES)
REFUSED = [
    (dataset(name="u"), {}, r"no variable 'wall_normal_velocity'; it holds .* u \(30x3x4"),
    (dataset(name="v"), {"variable": "vv"}, r"has no variable 'vv' \(did you mean 'v'\?\)"),
    (dataset(name="x_velocity"), {"normal": "y", "variable": "x_velocity"}, "velocity along x, but normal is 'y'"),
    (named(z="y"), {}, "axes time, y, x; a plane has x and z, .* take one height, or state normal='z' if y"),
    (named(z="component"), {}, "axes time, component, x; a plane has x and z"),
    (named(z="level").isel(x=0, drop=True), {}, "axes time, level; a plane has x and z"),
    (named(x="t"), {}, "axes time, z, time; one axis is time"),
    (dataset(), {"velocity_units": "mm/s"}, r"is in m s\*\*-1 by its own words, not in mm/s"),
    (BARE, {}, "velocity has no units attribute"),
    (BARE, {"velocity_units": "m/s"}, "give sampling_rate"),
]


@pytest.mark.parametrize(("data", "stated", "message"), REFUSED, ids=range(len(REFUSED)))
def test_what_the_data_do_not_tell_or_contradict_is_refused(data, stated, message):
    with pytest.raises(ValueError, match=message):
        tl.VelocityPlane.from_xarray(data, **stated)


def test_a_rate_or_a_sign_against_a_plane_of_ours_is_refused(tmp_path):
    path = tmp_path / "a.h5"
    tl.VelocityPlane(torch.ones(2, 9), sampling_rate=RATE).write(path)
    with pytest.raises(ValueError, match=r"a.h5:/time: its times are at .* states 5000 Hz; leave"):
        tl.read_plane(path, sampling_rate=5e3)
    rate = tl.read_plane(path).sampling_rate
    assert tl.read_plane(path, sampling_rate=1.009 * rate).sampling_rate == rate
    with pytest.raises(ValueError, match=r"a.h5:/wall_normal_velocity is positive away .* by its schema"):
        tl.read_plane(path, normal="-y")


def test_times_without_a_unit_or_in_single_precision():
    """Whatever they count, sample 100 of 40 kHz is at 2.5 ms; 5 s on, float32 is exact to a fiftieth of a step."""
    data = dataset(time=np.arange(100.0, 130.0))
    del data.time.attrs["units"]
    found = tl.VelocityPlane.from_xarray(data, sampling_rate=RATE)
    assert found.start == pytest.approx(100 / RATE)
    data = dataset(time=np.float32(5 + TIMES))
    with pytest.warns(tl.DataWarning, match=r"/time are float32, exact to 5e-07 s, 0.019 of"):
        found = tl.VelocityPlane.from_xarray(data)
    assert found.sampling_rate != RATE
    assert found.sampling_rate == pytest.approx(RATE, rel=7e-4)
    assert tl.VelocityPlane.from_xarray(data, sampling_rate=RATE).sampling_rate == RATE
    loose = tl.VelocityPlane.from_xarray(data, sampling_rate=1.009 * RATE)
    assert loose.sampling_rate == found.sampling_rate


def test_our_own_file_through_xarray_is_the_plane_itself(tmp_path):
    velocity = np.moveaxis(VALUES, 0, -1).copy()
    about = {"frequency": 1400.0, "fluid": tl.Fluid(340.0), "area": np.full(12, 1e-6)}
    about |= {"x": X, "z": Z, "reference": {"true": 1 - 0.5j}, "provenance": {"run": [1, "b"]}, "liner": "onera"}
    about |= {"mach": 0.3, "source_side": "upstream", "title": "a case", "incident_level": 130.0, "start": 0.25}
    wanted = tl.VelocityPlane(velocity, sampling_rate=RATE, height=1e-3, **about)
    wanted.write(tmp_path / "a.h5")
    with xarray.open_dataset(tmp_path / "a.h5", engine="h5netcdf") as data:
        data.to_netcdf(tmp_path / "b.nc", engine="scipy")
        planes = [tl.VelocityPlane.from_xarray(data).load()]
    for found in (*planes, *(tl.read_plane(tmp_path / name) for name in ("a.h5", "b.nc"))):
        for name in ("velocity", "height", *about):
            mine, theirs = getattr(found, name), getattr(wanted, name)
            assert torch.equal(mine, theirs) if isinstance(mine, torch.Tensor) else mine == theirs, name


def test_numbers_of_the_case():
    """A field of the name of one, in a file of others, is none."""
    data = dataset(name="v").assign(density=(AXES, VALUES + 1.2, {"units": "kg m-3"}))
    data = data.assign(frequency=((), 1.4, {"units": "kHz"}), height=((), 2.0, {"units": "mm"}))
    found = tl.VelocityPlane.from_xarray(data, variable="v")
    assert (found.frequency, found.height, found.fluid, found.name) == (1400.0, 2e-3, tl.Fluid(), "xarray:/v")


def test_dates_of_pandas_tables_and_arrays_without_units():
    """datetime64 is a clock; what has no unit is stated; a table is refused with the remedy, and the remedy works."""
    data = dataset()
    dates = pandas.Timestamp("2024-05-01") + pandas.to_timedelta(TIMES, "s")
    same_plane(tl.VelocityPlane.from_xarray(data.assign_coords(time=dates)))
    bare = xarray.DataArray(1e3 * VALUES, dims=AXES)
    found = tl.VelocityPlane.from_xarray(bare, velocity_units="mm/s", sampling_rate=RATE, x=X, z=Z, frequency=1000.0)
    same_plane(found, rtol=1e-4)
    assert found.frequency == 1000.0
    table = data[V].to_series().reset_index()
    with pytest.raises(TypeError, match=r"set_index.*to_xarray\(\)"):
        tl.VelocityPlane.from_xarray(table)
    with pytest.raises(TypeError, match=r"is a DataFrame; give .to_numpy"):
        tl.VelocityPlane(data[V][:, 0].to_pandas(), sampling_rate=RATE)
    stated = {"velocity_units": "m/s", "length_units": "m", "sampling_rate": RATE}
    same_plane(tl.VelocityPlane.from_xarray(table.set_index([*AXES]).to_xarray(), **stated))


def test_a_lazy_dataset_stays_so(tmp_path):
    path = written(dataset(), tmp_path, "netcdf4")
    with xarray.open_dataset(path, engine="h5netcdf", chunks={"time": 7}) as data:
        found = tl.VelocityPlane.from_xarray(data)
        assert not isinstance(found.velocity, torch.Tensor)
        same_plane(found.load())


UNITS = {
    "velocity": ["m/s", "m s-1", "meter second-1", "m/sec", "m.s^-1", "m s**-1"],
    "time": ["s", "seconds", "sec", "second"],
    "length": ["m", "meter", "metre", "meters"],
    "density": ["kg/m3", "kg m-3", "kg m^-3", "kg/m^3"],
}


@pytest.mark.parametrize("quantity", UNITS)
def test_units_are_read_as_they_are_spelled(quantity):
    assert {si_factor(quantity, unit, "v") for unit in UNITS[quantity]} == {1.0}
    for wrong in ("M/s", "m/s2", "m", "s/m", "m s", "1/m"):
        with pytest.raises(ValueError, match="a velocity is needed"):
            si_factor("velocity", wrong, "v")

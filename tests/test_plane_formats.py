"""netCDF-4, netCDF-3, zarr and xarray: the same plane, whatever the names, order and units."""

import pickle
import re
import sys
import warnings

import h5py
import numpy as np
import pandas
import pytest
import torch
import xarray
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import netcdf_file

import torchliner as tl
from torchliner.io.planes import format_of
from torchliner.units import canonical_unit, si_factor

RATE = 40e3
VALUES = np.random.default_rng(3).normal(size=(30, 3, 4)).astype("f4")  # (time, z, x)
X, Z = np.linspace(0.001, 0.004, 4), np.linspace(0.0, 0.01, 3)


def dataset(order=("time", "z", "x"), name="v", attrs=None, **coordinates):
    """A dataset as solvers' exporters write it."""
    units = {"time": "s", "x": "m", "z": "m"}
    base = {"time": np.arange(30) / RATE, "z": Z, "x": X} | coordinates
    about = {"units": "m s**-1"} | (attrs or {})
    data = xarray.DataArray(VALUES.copy(), dims=("time", "z", "x"), attrs=about)
    coords = {key: (key, value, {"units": units[key]}) for key, value in base.items()}
    return xarray.Dataset({name: data.transpose(*order)}, coords)


def written(data, path, kind):
    """The dataset in a file of a kind."""
    if kind == "netcdf4":
        data.to_netcdf(path / "a.data", engine="h5netcdf")
    elif kind == "netcdf3":
        data.to_netcdf(path / "a.data", engine="scipy")
    else:
        data.to_zarr(path / "a.data", consolidated=False)
    return path / "a.data"


def same_plane(found, wanted=VALUES, rtol=1e-6):
    """Velocity over (z, x), coordinates, rate."""
    assert np.allclose(found.velocity.numpy(), np.moveaxis(wanted, 0, -1), rtol=rtol)
    assert np.allclose(found.x, X)
    assert np.allclose(found.z, Z)
    assert found.sampling_rate == pytest.approx(RATE, rel=1e-6)


KINDS = ("netcdf4", "netcdf3", "zarr")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("order", ["time z x", "x z time", "z time x"])
def test_any_order_of_axes_is_one_plane(tmp_path, kind, order):
    """Names and order of the axes do not matter, nor the ending of the file."""
    path = written(dataset(tuple(order.split())), tmp_path, kind)
    found, lazy = tl.read_plane(path), tl.read_plane(path, lazy=True)
    same_plane(found)
    assert torch.equal(lazy.read(4, 9), found.read(4, 9))
    assert torch.equal(pickle.loads(pickle.dumps(lazy.velocity)).load(), found.velocity)
    assert format_of(path).name == {"netcdf4": "HDF5 or netCDF-4", "netcdf3": "netCDF-3"}.get(kind, "zarr")


@pytest.mark.parametrize("kind", KINDS)
def test_a_second_axis_of_time_is_none_of_probes(tmp_path, kind):
    """It is refused unless its length is 1, or the user says what it is."""
    data = dataset().rename(x="t")
    path = written(data, tmp_path, kind)
    with pytest.raises(ValueError, match=r"shape \(30, 3, 4\) and more than one axis of time"):
        tl.read_plane(path)
    found = tl.read_plane(path, axes=("time", "z", "x"))
    assert torch.equal(found.velocity, tl.VelocityPlane.from_xarray(dataset()).velocity)
    (tmp_path / "one").mkdir()
    path = written(data.isel(t=[2]), tmp_path / "one", kind)
    assert torch.equal(tl.read_plane(path).velocity, found.velocity[:, 2:3])


@pytest.mark.parametrize("kind", KINDS)
def test_packed_shorts_with_a_fill_value_are_unpacked(tmp_path, kind):
    """scale_factor, add_offset and _FillValue; a missing value is nan, in slabs too."""
    data = dataset()
    data.v[7, 1, 2] = np.nan
    encoding = {"dtype": "i2", "scale_factor": 1e-3, "add_offset": 0.5, "_FillValue": -32000}
    data.v.encoding = encoding
    path = written(data, tmp_path, kind)
    for lazy in (False, True):
        found = tl.read_plane(path, lazy=lazy).load().velocity
        assert torch.isnan(found).nonzero().tolist() == [[1, 2, 7]]
        wanted = np.moveaxis(data.v.values, 0, -1)
        assert np.nanmax(np.abs(found.numpy() - wanted)) < 6e-4


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mark", [{"_FillValue": -2}, {"valid_range": [0, 60000]}])
def test_unsigned_numbers_in_signed_shorts(tmp_path, kind, mark):
    """``_Unsigned``: what is stored above 32767 is no negative number, nor are its marks."""
    stored = np.rint((VALUES + 4) * 8000).astype("u2")
    stored[7, 1, 2] = 65534
    data = dataset(attrs={"_Unsigned": "true", "scale_factor": 1.25e-4, "add_offset": -4.0})
    data["v"] = data.v.copy(data=stored.view("i2")).assign_attrs(
        {key: np.array(value, "i8").astype("i2")[()] for key, value in mark.items()}
    )
    path = written(data, tmp_path, kind)
    wanted = np.moveaxis(np.where(stored == 65534, np.nan, VALUES), 0, -1)
    for lazy in (False, True):
        found = tl.read_plane(path, lazy=lazy).load().velocity.numpy()
        assert np.allclose(found, wanted, atol=7e-5, equal_nan=True)


@pytest.mark.parametrize("kind", ["i2", "i4", "f4", "f8"])
@pytest.mark.parametrize("name", ["v", "time"])
def test_records_that_nobody_wrote_hold_what_the_library_fills_in(tmp_path, kind, name):
    """netCDF-3 without ``_FillValue``: nan in the velocity, an error in the times."""
    path = tmp_path / "a.nc"
    fill = {"i2": -32767, "i4": -2147483647}.get(kind, 9.9692099683868690e36)  # netcdf.h
    with netcdf_file(path, "w") as file:
        file.createDimension("time", None)
        file.createDimension("x", 4)
        file.createVariable("time", kind if name == "time" else "f4", ["time"]).units = "ms"
        file.createVariable("v", kind if name == "v" else "f4", ["time", "x"]).units = "m/s"
        file.variables["v"].scale_factor = 1.0
        values = {"time": np.arange(30.0), "v": np.ones((30, 4))}
        values[name][20:] = fill
        for each, stored in values.items():
            file.variables[each][:] = stored
    if name == "time":
        with pytest.raises(ValueError, match=r"a.nc:/time holds 10 values not finite"):
            tl.read_plane(path)
        return
    found = tl.read_plane(path).velocity
    assert (found[:, :20] == 1).all()
    assert found[:, 20:].isnan().all()


def store(path, version, fill=0, **arrays):
    """A store written through zarr itself: arrays, and how many of their values; (time, x)."""
    group = zarr.open_group(path, mode="w", zarr_format=version)
    for name, (values, count) in arrays.items():
        dims, unit = {"time": (["time"], "s"), "x": (["x"], "m")}.get(name, (["time", "x"], "m/s"))
        words = {"dimension_names": dims} if version == 3 else {}
        array = group.create_array(name, shape=values.shape, dtype=values.dtype, fill_value=fill,
                                   chunks=(10, *values.shape[1:]), **words)  # fmt: skip
        array.attrs.update({"units": unit, **({} if words else {"_ARRAY_DIMENSIONS": dims})})
        array[:count] = values[:count]
    return path


@pytest.mark.parametrize("version", [2, 3])
def test_a_store_that_fills_with_0(tmp_path, version):
    """Zeros that were written are zeros, also at the first time; chunks that were not are none."""
    v = np.where(VALUES[:, 0] > 0, VALUES[:, 0], 0)
    whole = {"time": (np.arange(30) / RATE, 30), "x": (X, 4), "v": (v, 30)}
    path = tmp_path / "a.zarr"
    found = tl.read_plane(store(path, version, **whole))
    assert np.array_equal(found.velocity.numpy(), v.T)
    for name, count, words in (
        ("v", 20, "1 of 3 chunks were never written and would read as 0.0, .*: samples 20 to 29"),
        ("v", 0, "3 of 3 chunks .*: samples 0 to 29. .* write_empty_chunks=True"),
        ("time", 20, "1 of 3 chunks .*: values 20 to 29"),
        ("x", 0, "1 of 1 chunks .*: values 0 to 3"),
    ):
        broken = whole | {name: (whole[name][0], count)}
        with pytest.raises(ValueError, match=rf"a.zarr:/{name}: {words}"):
            tl.read_plane(store(path, version, **broken))
    missing = tl.read_plane(store(path, version, fill=np.nan, **whole | {"v": (v, 20)}))
    assert missing.velocity[:, 20:].isnan().all()
    alone = tl.read_plane(store(path, version, **whole | {"x": (np.zeros(1), 1), "v": (v[:, :1], 30)}))
    assert alone.x.tolist() == [0.0]


def test_packed_zeros_of_an_old_store_are_missing(tmp_path):
    """xarray stores a stated ``_FillValue`` of 0 as zarr's own."""
    data = dataset()
    data.v[7, 1, 2] = np.nan
    data.v.encoding = {"dtype": "i2", "scale_factor": 1e-3, "add_offset": 9.0, "_FillValue": 0}
    data.to_zarr(tmp_path / "a.zarr", consolidated=False, zarr_format=2)
    found = tl.read_plane(tmp_path / "a.zarr").velocity
    assert torch.isnan(found).nonzero().tolist() == [[1, 2, 7]]


def test_long_records_keep_their_times(monkeypatch):
    """Large fields are left where they are, times of any length are not."""
    monkeypatch.setattr("torchliner.io.netcdf_terms.MOST", 10)
    same_plane(tl.VelocityPlane.from_xarray(dataset()))


def test_a_store_without_its_extra_says_which(tmp_path, monkeypatch):
    """zarr is optional; the error names what to install."""
    path = written(dataset(), tmp_path, "zarr")
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(ImportError, match=r"a.data is a zarr store; .*torchliner\[xarray\]"):
        tl.read_plane(path)


def test_links_out_of_a_foreign_file_are_said(tmp_path):
    """A velocity that stands in another file is read, and that file is named."""
    dataset().to_netcdf(tmp_path / "v.nc", engine="h5netcdf")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"] = np.arange(30) / RATE
        file["time"].attrs["units"] = "s"
        file["v"] = h5py.ExternalLink("v.nc", "/v")
    with pytest.warns(tl.DataWarning) as told:
        found = tl.read_plane(tmp_path / "a.h5")
    assert any(re.search(r"a.h5:/v is a link; its values stand in .*v.nc", str(each.message))
               for each in told)  # fmt: skip
    assert np.array_equal(found.velocity.numpy(), np.moveaxis(VALUES, 0, -1))


def test_groups_dates_and_axes_of_size_1(tmp_path):
    """A velocity in a group, times as dates since, a height of size 1, mm; all found."""
    data = dataset(x=1e3 * X).expand_dims(y=[2.5], axis=1)
    data.y.attrs["units"] = data.x.attrs["units"] = "millimeter"
    data = data.assign_coords(time=("time", 1e6 + np.arange(30) / RATE,
                                    {"units": "seconds since 2020-01-01 00:00:00"}))  # fmt: skip
    data.to_netcdf(tmp_path / "a.nc", engine="h5netcdf", group="run/plane")
    found = tl.read_plane(tmp_path / "a.nc")
    same_plane(found)
    assert found.start == 1e6
    assert found.name.endswith("a.nc:/run/plane/v")
    same_plane(tl.read_plane(tmp_path / "a.nc", group="run/plane", variable="v"))


def test_the_wall_normal_component_is_told_by_its_words():
    """standard_name and long_name; a normal by the user; else all that fit are listed."""
    many = dataset(name="v").assign({k: dataset(name=k)[k] + i for i, k in enumerate("uw", 1)})
    with pytest.raises(ValueError, match=r"3 of its velocities may be normal .* u \(30x3x4, .*v "):
        tl.VelocityPlane.from_xarray(many)
    same_plane(tl.VelocityPlane.from_xarray(many, variable="v"))
    same_plane(tl.VelocityPlane.from_xarray(many, normal="y"))
    same_plane(tl.VelocityPlane.from_xarray(many, normal="-y"), -VALUES)
    many.w.attrs["long_name"] = "Wall-normal velocity"
    same_plane(tl.VelocityPlane.from_xarray(many), VALUES + 2)
    many.u.attrs["long_name"] = "velocity normal to the wall"
    with pytest.raises(ValueError, match="2 of its velocities may be normal"):
        tl.VelocityPlane.from_xarray(many)
    with pytest.raises(ValueError, match=r"has no variable 'vv' \(did you mean 'v'\?\)"):
        tl.VelocityPlane.from_xarray(many, variable="vv")
    alone = dataset(name="u")
    with pytest.raises(ValueError, match=r"1 of its velocities may be .* u \(30x3x4"):
        tl.VelocityPlane.from_xarray(alone)


def test_upward_air_velocity_has_y_across_the_duct():
    """z is normal to the wall then; positive downward is turned."""
    data = dataset(attrs={"standard_name": "upward_air_velocity"}).rename(z="y", v="w")
    same_plane(tl.VelocityPlane.from_xarray(data))
    data.w.attrs["positive"] = "down"
    same_plane(tl.VelocityPlane.from_xarray(data), -VALUES)
    side = dataset().rename(z="y")
    with pytest.raises(ValueError, match="y is the height, of which a plane has one; if it runs"):
        tl.VelocityPlane.from_xarray(side)
    same_plane(tl.VelocityPlane.from_xarray(side, normal="z"))


@pytest.mark.parametrize(
    ("attributes", "sign"),
    [
        ({"positive": "into the liner"}, -1),
        ({"positive": "into the duct"}, 1),
        ({"positive": "out of the duct"}, -1),
        ({"positive": "away from the wall"}, 1),
        ({"long_name": "velocity into the wall"}, -1),
        ({"long_name": "velocity normal to the liner, positive towards the flow"}, 1),
        ({"long_name": "velocity out of the facesheet"}, 1),
        ({"long_name": "velocity into account"}, 1),
    ],
)
def test_words_say_which_way_is_positive(attributes, sign):
    same_plane(tl.VelocityPlane.from_xarray(dataset(attrs=attributes)), sign * VALUES)


@pytest.mark.parametrize(
    "attributes",
    [{"positive": "away from the liner"}, {"long_name": "velocity out of the facesheet"}],
)
def test_a_normal_does_not_turn_what_is_positive_away(attributes):
    """As the data have it; an axis may be stated still, and data into the liner turn once."""
    data = dataset(attrs=attributes)
    with pytest.raises(ValueError, match=r"so that it is positive away .* normal='-y' would turn"):
        tl.VelocityPlane.from_xarray(data, normal="-y")
    same_plane(tl.VelocityPlane.from_xarray(data, normal="y"))
    into = dataset(attrs={"positive": "into the liner"})
    same_plane(tl.VelocityPlane.from_xarray(into, normal="-y"), -VALUES)


def test_a_rate_or_a_sign_against_a_plane_of_ours_is_refused(tmp_path):
    """Its times have a unit, and it is positive away by its schema; within 1 % its times count."""
    path = tmp_path / "a.h5"
    tl.VelocityPlane(torch.ones(2, 9), sampling_rate=RATE).write(path)
    with pytest.raises(ValueError, match=r"a.h5:/time: its times are at .* states 5000 Hz; leave"):
        tl.read_plane(path, sampling_rate=5e3)
    rate = tl.read_plane(path).sampling_rate
    assert tl.read_plane(path, sampling_rate=1.009 * rate).sampling_rate == rate
    with h5py.File(path, "r+") as file:
        for said in ("'away from the liner'", "'away, by its schema'"):
            with pytest.raises(ValueError, match=f"a.h5:/wall_normal_velocity says {said}.*'-y'"):
                tl.read_plane(path, normal="-y")
            file["wall_normal_velocity"].attrs.pop("positive", None)
            file.flush()


def test_times_without_a_unit_begin_where_they_say(tmp_path):
    """Whatever they count: at the stated rate, sample 100 of 40 kHz is at 2.5 ms."""
    data = dataset(time=np.arange(100.0, 130.0))
    del data.time.attrs["units"]
    found = tl.VelocityPlane.from_xarray(data, sampling_rate=RATE)
    assert found.start == pytest.approx(100 / RATE)


def test_times_in_single_precision_say_how_well_they_tell_the_rate():
    """5 s on, they are exact to a fiftieth of a step; a stated rate that they cannot tell holds."""
    data = dataset(time=np.float32(5 + np.arange(30) / RATE))
    with pytest.warns(tl.DataWarning, match=r"/time are float32, exact to 5e-07 s, 0.019 of"):
        found = tl.VelocityPlane.from_xarray(data)
    assert found.sampling_rate != RATE
    assert found.sampling_rate == pytest.approx(RATE, rel=7e-4)
    assert tl.VelocityPlane.from_xarray(data, sampling_rate=RATE).sampling_rate == RATE
    loose = tl.VelocityPlane.from_xarray(data, sampling_rate=1.009 * RATE)
    assert loose.sampling_rate == found.sampling_rate


@pytest.mark.parametrize("name", ["component", "vector", "dim", "nv", "velocity_components"])
def test_components_are_no_probes(name):
    """An axis of components is refused beside x and alone, unless the user says what it is."""
    data = dataset().rename(z=name).drop_vars(name)
    for each in (data, data.isel(x=0, drop=True)):
        with pytest.raises(ValueError, match=rf"axis {name} of 3, which may be the components"):
            tl.VelocityPlane.from_xarray(each, normal="y")
    same_rows = tl.VelocityPlane.from_xarray(data, axes=("time", "z", "x"))
    assert same_rows.probe_shape == (3, 4)


@pytest.mark.parametrize("name", ["height", "level", "lev", "depth", "wall_distance"])
def test_heights_are_no_rows(name):
    """One plane has one: several are refused, a single one passes."""
    data = dataset().rename(z=name)
    for each in (data, data.isel(x=0, drop=True)):
        with pytest.raises(ValueError, match=f"axis {name} of 3: {name} is the height"):
            tl.VelocityPlane.from_xarray(each, normal="y")
    assert tl.VelocityPlane.from_xarray(data.isel({name: [1]})).probe_shape == (4,)


def test_the_axis_beside_x_is_called_z_or_placed():
    """Any other name is refused, unless a coordinate z lies along it."""
    data = dataset().rename(z="row").drop_vars("row")
    with pytest.raises(ValueError, match="axes row, x, and which runs across the duct is not said"):
        tl.VelocityPlane.from_xarray(data)
    same_plane(tl.VelocityPlane.from_xarray(data.assign_coords(z=("row", Z, {"units": "m"}))))


def test_our_own_file_through_xarray_is_the_plane_itself(tmp_path):
    """Schema, fluid, references and attributes: nothing is lost in any kind of file."""
    wanted = tl.VelocityPlane(
        np.moveaxis(VALUES, 0, -1).copy(), sampling_rate=RATE, x=X, z=Z, start=0.25, height=1e-3,
        frequency=1400.0, mach=0.3, liner="onera", source_side="upstream", title="a case",
        fluid=tl.Fluid(340.0), reference={"true": 1 - 0.5j}, provenance={"run": [1, "b"]},
        incident_level=130.0,
    )  # fmt: skip
    wanted.write(tmp_path / "a.h5")
    keys = ("frequency", "height", "mach", "liner", "source_side", "title", "fluid", "reference",
            "provenance", "incident_level", "start")  # fmt: skip
    with xarray.open_dataset(tmp_path / "a.h5", engine="h5netcdf") as data:
        data.to_netcdf(tmp_path / "b.nc", engine="scipy")
        planes = [tl.VelocityPlane.from_xarray(data).load()]
    planes += [tl.read_plane(tmp_path / name) for name in ("a.h5", "b.nc")]
    for found in planes:
        assert {k: getattr(found, k) for k in keys} == {k: getattr(wanted, k) for k in keys}
        assert torch.equal(found.velocity, wanted.velocity)


def test_numbers_of_the_case_as_attributes():
    """In SI, or with a unit; a field over the plane is no property of the gas."""
    data = dataset().assign(density=(("time", "z", "x"), VALUES + 1.2, {"units": "kg m-3"}))
    data.attrs = {"frequency": "1.4 kHz", "mach": 0.3}
    found = tl.VelocityPlane.from_xarray(data)
    assert (found.frequency, found.mach, found.fluid) == (1400.0, 0.3, tl.Fluid())
    assert found.name == "xarray:/v"
    beside = data.assign(frequency=((), 1.4, {"units": "kHz"}), height=((), 2.0, {"units": "mm"}))
    assert tl.VelocityPlane.from_xarray(beside).height == 2e-3
    for owner in (beside, beside.v):
        owner.attrs["height"] = "1.5 mm"
        with pytest.raises(ValueError, match=r"attribute 'height' is 0.0015 m, the .* is 0.002; corr"):
            tl.VelocityPlane.from_xarray(beside)
        del owner.attrs["height"]
    data.attrs["frequency"] = "high"
    with pytest.raises(ValueError, match="attribute 'frequency' is 'high'; a number is needed"):
        tl.VelocityPlane.from_xarray(data)


def test_the_gas_as_attributes_and_beside_the_velocity(tmp_path):
    """Attributes of the gas were passed over: 343.2 m/s for 340."""
    data = dataset()
    data.attrs |= {"sound_speed": 340.0, "density": "1.1 kg/m3"}
    found = tl.VelocityPlane.from_xarray(data).fluid
    assert (found.sound_speed, found.density, found.prandtl) == (340.0, 1.1, 0.71)
    data["sound_speed"] = ((), 345.0, {"units": "m/s"})
    with pytest.raises(ValueError, match=r"'sound_speed' is 340 m/s, the variable .* is 345; corr"):
        tl.VelocityPlane.from_xarray(data)
    data.attrs.clear()
    data.to_netcdf(tmp_path / "a.nc", engine="h5netcdf", group="y1")
    assert tl.read_plane(tmp_path / "a.nc").fluid.sound_speed == 345


def test_dates_of_pandas_and_arrays_without_units():
    """datetime64 is a clock; what has no unit is stated, and not against the file's own words."""
    data = dataset()
    dates = pandas.Timestamp("2024-05-01") + pandas.to_timedelta(np.arange(30) / RATE, "s")
    same_plane(tl.VelocityPlane.from_xarray(data.assign_coords(time=dates)))
    bare = xarray.DataArray(1e3 * VALUES, dims=("time", "z", "x"))
    with pytest.raises(ValueError, match="velocity has no units attribute"):
        tl.VelocityPlane.from_xarray(bare)
    with pytest.raises(ValueError, match=r"none of its axes is time|no times; give sampling_rate"):
        tl.VelocityPlane.from_xarray(bare, velocity_units="mm/s")
    found = tl.VelocityPlane.from_xarray(bare, velocity_units="mm/s", sampling_rate=RATE, x=X, z=Z, frequency=1000.0)
    same_plane(found, rtol=1e-4)
    assert found.frequency == 1000.0
    with pytest.raises(ValueError, match=r"is in m s\*\*-1 by its own words, not in mm/s"):
        tl.VelocityPlane.from_xarray(data, velocity_units="mm/s")


def test_tables_of_pandas_go_through_xarray():
    """A table is refused with the remedy, and the remedy works."""
    table = dataset().v.to_series().reset_index()
    with pytest.raises(TypeError, match=r"set_index.*to_xarray\(\)"):
        tl.VelocityPlane.from_xarray(table)
    with pytest.raises(TypeError, match="DataFrame, whose rows and columns have names"):
        tl.VelocityPlane(dataset().v[:, 0].to_pandas(), sampling_rate=RATE)
    data = table.set_index(["time", "z", "x"]).to_xarray()
    same_plane(tl.VelocityPlane.from_xarray(
        data, variable="v", velocity_units="m/s", length_units="m", sampling_rate=RATE
    ))  # fmt: skip


@pytest.mark.parametrize("order", ["time z x", "x z time", "x time z", "x y time"])
def test_an_array_with_names_is_taken_by_them(order):
    """Given to VelocityPlane itself: time last, x before it, whatever the order was."""
    data = dataset().v.rename(z="y") if "y" in order else dataset().v
    found = tl.VelocityPlane(data.transpose(*order.split()), sampling_rate=RATE, x=X, z=Z)
    same_plane(found)


def test_a_lazy_dataset_stays_so(tmp_path):
    """Of dask or a file: nothing is read before a slab is asked for."""
    path = written(dataset(), tmp_path, "netcdf4")
    with xarray.open_dataset(path, engine="h5netcdf", chunks={"time": 7}) as data:
        found = tl.VelocityPlane.from_xarray(data)
        assert found.stored is not None
        same_plane(found.load())


UNITS = {"velocity": ["m/s", "m s-1", "meter second-1", "m/sec", "metres per second", "m.s^-1",
                      "m s**-1", "m s⁻¹"],
         "time": ["s", "seconds", "sec", "second"], "length": ["m", "meter", "metre", "meters"],
         "density": ["kg/m3", "kg m-3", "kg m^-3", "kg/m^3", "kg m**-3"]}  # fmt: skip


@pytest.mark.parametrize("quantity", UNITS)
def test_units_are_read_as_they_are_spelled(quantity):
    """One factor for all spellings, and others for others."""
    assert {si_factor(quantity, unit, "v") for unit in UNITS[quantity]} == {1.0}
    assert si_factor("velocity", "millimeter/second", "v") == 1e-3
    assert si_factor("time", "minutes", "t") == 60
    for wrong in ("M/s", "m/s2", "m", "s/m", "m s", "1/m"):
        with pytest.raises(ValueError, match="a velocity is needed"):
            si_factor("velocity", wrong, "v")


@given(st.text(max_size=12))
def test_spelling_is_settled_once(text):
    """What is canonical stays so."""
    assert canonical_unit(canonical_unit(text)) == canonical_unit(text) or "-" in text


BAD = {
    "nothing": (b"", OSError, "is empty; it is of no format of planes that is known: "),
    "text": (b"hello\nworld", OSError, "is text that begins with 'hello'; it is of no format"),
    "binary": (b"\0\1\2\3", OSError, r"is binary and begins with b'\\x00\\x01"),
}


@pytest.mark.parametrize("kind", BAD)
def test_what_nobody_recognises_is_described(tmp_path, kind):
    """With what it looks like, and the formats that were tried."""
    content, error, message = BAD[kind]
    (tmp_path / "a.bin").write_bytes(content)
    with pytest.raises(error, match=f"a.bin {message}.*netCDF-3"):
        tl.read_plane(tmp_path / "a.bin")


def test_folders_options_and_permissions(tmp_path, monkeypatch):
    """A folder that is no store; an option of no format; a file that may not be read."""
    with pytest.raises(OSError, match="is an empty folder; it is of no format"):
        tl.read_plane(tmp_path)
    path = written(dataset(), tmp_path, "netcdf3")
    with pytest.raises(ValueError, match="netCDF-3, which says group itself or has none: leave"):
        tl.read_plane(path, group="run")
    with pytest.raises(TypeError, match=r"takes no 'varable' \(did you mean 'variable'\?\)"):
        tl.read_plane(path, varable="v")

    def refused(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.open", refused)
    with pytest.raises(OSError, match=r"a.data cannot be read: Permission denied"):
        tl.read_plane(path)


@pytest.mark.parametrize("keep", [0.1, 0.3, 0.6])
def test_a_truncated_netcdf3_file_is_named(tmp_path, keep):
    """In the header or in the values; and one that is cut while it is read."""
    path = written(dataset(), tmp_path, "netcdf3")
    whole, lazy = path.read_bytes(), tl.read_plane(path, lazy=True)
    path.write_bytes(whole[: int(keep * len(whole))])
    with pytest.raises(OSError, match=r"a.data is truncated"):
        tl.read_plane(path)
    with pytest.raises(OSError, match=r"a.data:/v cannot be read from .* the file ends"):
        lazy.read(0, 30)


def test_records_of_several_variables_and_growth(tmp_path):
    """Unlimited time: records interleave; frames added later are not in a plane opened before."""
    path = tmp_path / "a.nc"
    with netcdf_file(path, "w") as file:
        file.createDimension("time", None)
        file.createDimension("x", 4)
        for name, dims, unit in [("time", "time", b"s"), ("x", "x", b"m"), ("p", "time x", b"Pa"),
                                 ("v", "time x", b"m/s")]:  # fmt: skip
            file.createVariable(name, "f4", dims.split()).units = unit
        file.variables["x"][:] = X
        file.variables["time"][:] = np.arange(30) / RATE
        file.variables["p"][:] = np.full((30, 4), 7.0)
        file.variables["v"][:] = VALUES[:, 0]
    lazy = tl.read_plane(path, lazy=True)
    with netcdf_file(path, "a") as file:
        file.variables["time"][30:31] = [30 / RATE]
        file.variables["v"][30:31] = np.ones((1, 4))
    assert np.array_equal(lazy.load().velocity.numpy(), VALUES[:, 0].T)
    assert tl.read_plane(path).samples == 31


@pytest.mark.parametrize("kind", ["netcdf4", "netcdf3"])
def test_mutated_bytes_are_errors_or_answers(tmp_path_factory, kind):
    """A clear error that names the file, or a plane; no other exception."""
    clean = written(dataset(), tmp_path_factory.mktemp(kind), kind).read_bytes()
    path = tmp_path_factory.mktemp(kind) / "m.data"

    @settings(max_examples=60)
    @given(st.integers(0, min(len(clean), 3000) - 1), st.integers(1, 255), st.booleans())
    def mutate(at, change, cut):
        content = bytearray(clean[:at] if cut else clean)
        if not cut:
            content[at] ^= change
        path.write_bytes(content)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                found = tl.read_plane(path)
            except (OSError, ValueError) as error:
                assert "m.data" in str(error), error  # noqa: PT017
            else:
                assert found.velocity.dtype in (torch.float32, torch.float64)

    mutate()


@settings(max_examples=60)
@given(key=st.sampled_from(["units", "scale_factor", "standard_name", "positive", "_FillValue"]),
       value=st.one_of(st.text(max_size=8), st.floats(), st.integers(-5, 5), st.binary(max_size=4)),
       where=st.sampled_from(["v", "time", "x"]))  # fmt: skip
def test_mutated_attributes_are_errors_or_answers(tmp_path_factory, key, value, where):
    """Of the velocity and of its coordinates."""
    clean = tmp_path_factory.getbasetemp() / "clean.nc"
    if not clean.exists():
        dataset().to_netcdf(clean, engine="h5netcdf")
    path = tmp_path_factory.mktemp("mutated") / "attributes.nc"
    path.write_bytes(clean.read_bytes())
    with h5py.File(path, "r+") as file:
        try:
            file[where].attrs[key] = value
        except (ValueError, TypeError):
            return
    try:
        found = tl.read_plane(path)
    except (OSError, ValueError) as error:
        assert "attributes.nc" in str(error), error  # noqa: PT017
    else:
        assert found.probe_shape == (3, 4)

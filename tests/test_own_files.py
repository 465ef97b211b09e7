"""Files of our own records, one contract for all: back to the bit, open to others, damage refused with its place."""

from __future__ import annotations

import dataclasses
import json

import h5py
import numpy as np
import pytest
import torch
import xarray
from conftest import turbulence
from test_burst_files import record_of
from test_map_file import hand_map, made_map
from test_microphone_line import line_of
from test_moments_file import grid_plane, same_bits
from test_plane_file import LAYOUTS, make_plane
from test_pressure_file import record
from test_results_out import line, made, points
from test_wall_file import field_fit, noisy

import torchliner as tl
from torchliner.io.burst_file import read_burst_file
from torchliner.records.notes import Note

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
SAMPLES = 300
FACTS = {
    "height": 1e-3, "mach": 0.3, "incident_level": 145.0, "displacement_thickness": 1.73e-3, "source_side": "upstream",
    "fluid": tl.Fluid(343.2, 1.21, 1.8e-5, 1.4, 0.7),
}  # fmt: skip
PRESSURES = {
    "line": {},
    "numbered cells": {"cell_pitch": None, "probe_cell": [0, 0, 0, 1, 1, -1]},
    "one backplate": {"backplate": turbulence((SAMPLES,), seed=4)},
    "backplate like the facesheet": {"backplate": turbulence((6, SAMPLES), seed=4)},
    "surface": {"facesheet": turbulence((2, 3, SAMPLES)), "x": [0.0, 1.0, 2.0], "z": [0.0, 1.0]},
    "one probe": {"facesheet": turbulence((SAMPLES,)), "x": 0.5, "z": 0.1},
    "scattered": {"z": [0.1] * 6},
    "microphones": {"facesheet": None, "backplate": None, "x": None},
    "no microphones": {"microphones": None, "microphone_y": None, "microphone_velocity": None},
}


def noted():
    """A map with all that may stand beside Z."""
    found = made_map("plane", **FACTS)
    return dataclasses.replace(
        found, notes=(*found.notes, Note("by-hand", "of some size", 0.1)), holes=tl.Holes((0.01,), (1e-3,))
    )


def checked():
    """A map whose level is known."""
    time = torch.arange(900, dtype=torch.float64) / 42e3
    plane = tl.VelocityPlane(
        torch.cos(2 * torch.pi * 1400 * time).expand(3, -1).contiguous(), sampling_rate=42e3, frequency=1400.0,
        incident_level=150.0, source_side="normal", x=[0.0, 0.01, 0.02],
    )  # fmt: skip
    return tl.educe(plane, tl.load_liner("polito")).with_alongside(points())


def tones(**about):
    return line_of(
        liner_start=0.0, liner_end=0.132, duct_width=0.05, liner="onera", title="a line", notes=("doubt",),
        provenance={"a": 1}, reference={"true": 2 - 1j}, **about,
    )  # fmt: skip


def bursts():
    return record_of(
        0, 50, dropped={"outlier": 3}, notes=("a doubt",), provenance={"a": 1}, reference={"true": 1 - 2j},
        liner="onera", source_side="upstream",
    )  # fmt: skip


def microphones():
    return noisy("upstream", provenance={"who": "me"}, reference={"true": 1 + 0j})


def read_one(path):
    return read_burst_file(path)[0]


def read_first(path):
    return tl.read_wall(path)[0]


RECORDS = {
    **{f"map, {place}": (lambda place=place: made_map(place), tl.read_map)
       for place in ("plane", "bare plane", "line", "bare line", "one probe")},
    "map by hand": (hand_map, tl.read_map),
    "map with all": (noted, tl.read_map),
    "map with a level check": (checked, tl.read_map),
    "line of stations": (line, tl.read_line),
    "points": (points, tl.read_points),
    **{f"plane, {layout}": (lambda layout=layout: make_plane(LAYOUTS[layout][0], **LAYOUTS[layout][1]), tl.read_plane)
       for layout in LAYOUTS},
    "plane with all": (grid_plane, tl.read_plane),
    **{f"pressure, {name}": (lambda about=about: record(**about), tl.read_pressure)
       for name, about in PRESSURES.items()},
    "moments": (lambda: tl.moments(grid_plane(), cell_pitch=0.02), tl.read_moments),
    "microphones": (lambda: tones(coherence=torch.rand(12, 2).double()), tl.read_microphones),
    "lines of microphones": (lambda: line_of(batch=(3, 2), title="draws"), tl.read_microphones),
    "waves": (lambda: tl.kumaresan_tufts(microphones(), draws=3), read_first),
    "fit of the field": (lambda: field_fit(microphones()), read_first),
    "bursts": (bursts, read_one),
}  # fmt: skip


@pytest.fixture(params=RECORDS)
def written(request, tmp_path):
    """A record, its file and its reader."""
    make, read = RECORDS[request.param]
    made = make()
    made.write(tmp_path / "a.nc")
    return made, tmp_path / "a.nc", read


def test_it_comes_back_to_the_bit(written):
    wanted, path, read = written
    found = read(path)
    if hasattr(wanted, "choices"):  # JSON has lists alone
        plain = json.loads(json.dumps(wanted.choices, default=lambda each: each.tolist()))
        wanted = dataclasses.replace(wanted, choices=plain)
    if hasattr(wanted, "velocity"):
        assert torch.equal(found.velocity, wanted.velocity)
        wanted = dataclasses.replace(wanted, title=wanted.title or path.stem)
    if hasattr(wanted, "sampling_rate"):
        assert found.sampling_rate == pytest.approx(wanted.sampling_rate, rel=1e-12)
        wanted = dataclasses.replace(wanted, sampling_rate=found.sampling_rate)
    if getattr(wanted, "draws", None) is not None:  # they share what an eduction says of itself
        wanted = dataclasses.replace(wanted, draws=dataclasses.replace(wanted.draws, choices=wanted.choices))
    assert same_bits(found, wanted)


def attributes(path):
    with h5py.File(path) as file:
        owners = {"/": file}
        file.visititems(lambda name, each: owners.update({name: each}))
        for name, owner in owners.items():
            for key in owner.attrs:
                yield name, key, owner.attrs.get_id(key).dtype


def test_other_programs_open_it(written):
    """netCDF-4 with named dimensions, units and texts of fixed length, which nco and Octave read."""
    _, path, _ = written
    for name, key, dtype in attributes(path):
        assert dtype.kind != "O" or key in ("DIMENSION_LIST", "REFERENCE_LIST"), (name, key)
    with h5py.File(path) as file:
        groups = [None, *(name for name, each in file.items() if isinstance(each, h5py.Group))]
    for group in groups:
        with xarray.open_dataset(path, engine="h5netcdf", group=group) as data:
            assert not [dim for dim in data.dims if str(dim).startswith("phony")]
            for name, each in data.variables.items():
                assert "units" in each.attrs or each.dtype.kind in "OTUM" or str(each.dtype) == "object", name


def datasets(path):
    """Names of what is read: indices are not."""
    with h5py.File(path) as file:
        found = {}
        file.visititems(lambda name, each: found.update({name: each}))
        return [name for name, each in found.items() if isinstance(each, h5py.Dataset)
                and not each.attrs.get("long_name", b"").startswith(b"number of the ")
                and not (each.is_scale and each.attrs["NAME"].startswith(b"This is"))]  # fmt: skip


def some(names, count):
    """So many of them, evenly."""
    return names[:: -(-len(names) // count)]


def cut(file, name):
    """One value less along the last axis, or a list for a number."""
    values, about = file[name][()], dict(file[name].attrs)
    kind = file[name].dtype
    del file[name]
    file.create_dataset(name, data=values[..., :-1] if values.ndim else [values] * 2, dtype=kind)
    if "units" in about:
        file[name].attrs["units"] = about["units"]


def fault(read, path):
    """Why a file is refused, or an empty text."""
    try:
        read(path)
    except (ValueError, OSError) as error:
        return str(error)
    return ""


# Of a plane without places a column less is a plane too, as of backplates a cell less; empty lists have none.
UNTOLD = ("wall_normal_velocity", "backplate_pressure", "cell_x", "cell_z")


def test_another_shape_is_refused_with_its_place(written):
    """Of every variable, those that follow from others as well."""
    _, path, read = written
    whole = path.read_bytes()
    for name in some(datasets(path), 9):
        path.write_bytes(whole)
        with h5py.File(path, "r+") as file:
            cut(file, name)
        assert str(path) in fault(read, path) or name in UNTOLD, name


@pytest.mark.parametrize("kind", ["map, plane", "line of stations", "points", "waves", "microphones", "moments"])
def test_damage_is_refused(kind, tmp_path):
    """Another schema, no unit, no number, infinite values, half a file; and no file at all."""
    make, read = RECORDS[kind]
    path = tmp_path / "a.h5"
    make().write(path)
    whole, seen = path.read_bytes(), []
    for name in some(datasets(path), 9):
        for change, value in (("units", None), ("units", "furlong")):
            path.write_bytes(whole)
            with h5py.File(path, "r+") as file:
                if "units" not in file[name].attrs or file[name].is_scale:
                    continue
                del file[name].attrs[change]
                if value is not None:
                    file[name].attrs[change] = value
            if said := fault(read, path):
                assert f"{path}:/{name}" in said
                seen.append(name)
    assert len(seen) > 2
    path.write_bytes(whole)
    with h5py.File(path, "r+") as file:
        file.attrs["schema"] = "torchliner plan 1"
    with pytest.raises(ValueError, match="its schema is 'torchliner plan 1', not 'torchliner"):
        read(path)
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(OSError, match=r"a.h5 is truncated: .*; copy it again, or write it anew"):
        read(path)
    path.write_text("not HDF5")
    with pytest.raises(OSError, match=r"a.h5 is not an HDF5 \(netCDF-4\) file"):
        read(path)
    with pytest.raises(FileNotFoundError, match=r"b.h5: no such file"):
        read(tmp_path / "b.h5")
    with pytest.raises(OSError, match="is a folder"):
        read(tmp_path)
    with pytest.raises(ValueError, match="must be one of"):
        make().write(tmp_path / "a.xyz")


def raised(name, amount):
    def change(file):
        file[name][...] = file[name][()] + amount

    return change


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    [
        ("map, plane", raised("liner_resistance", 1e-3), "liner_resistance is not what follows"),
        ("map, plane", raised("liner_resistance_low", 1e3), "liner_resistance_low or its other part is above"),
        ("map, plane", raised("reflection_real", np.inf), "reflection_real or its other part is infinite"),
        ("map, plane", raised("frequency", -2000.0), "a.h5:/frequency"),
        ("map, plane", raised("phase_rule_used", 1), "phase_rule_used holds other values than 0 and 1"),
        ("map, plane", lambda file: file.pop("reactance_high"), "reactance_high is missing"),
        ("map, plane", lambda file: file.pop("coherence"), "coherence is missing; the file holds: absorp"),
        ("map, plane", lambda file: file.attrs.pop("title") and file.attrs.update(notes="{"), "'notes' is not JSON"),
        ("map with a level check", lambda file: file.pop("known_pressure_level"), "known_pressure_level is mi"),
        ("map with a level check", lambda file: file.attrs.pop("level_check_limit"), "'level_check_limit'"),
        ("points", lambda file: file.attrs.update(choices="[]"), "'choices' is .*; an object is needed"),
        ("line of stations", raised("segment_spread_resistance", 1.0), "segment_spread_resistance is not what follows"),
        ("line of stations", lambda file: file.attrs.update(flags="[]"), "flags has 0 values for 2 stations"),
        ("waves", raised("eduction_0/energy_share", 0.5), "eduction_0/energy_share is not what follows"),
    ],
)  # fmt: skip
def test_what_contradicts_itself_is_refused(kind, change, message, tmp_path):
    make, read = RECORDS[kind]
    make().write(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        change(file)
    with pytest.raises(ValueError, match=message):
        read(tmp_path / "a.h5")


def test_texts_of_any_length_come_back(tmp_path):
    """HDF5 has 64 kB for an attribute; texts have their umlauts."""
    found = dataclasses.replace(hand_map(), title="Überströmt", choices={"long": "x" * 70_000, "none": ""})
    found.write(tmp_path / "a.nc")
    again = tl.read_map(tmp_path / "a.nc")
    assert (again.title, again.choices) == (found.title, found.choices)


def test_what_xarray_writes_is_read(tmp_path):
    """All that stands in the main part."""
    made().write(tmp_path / "map.h5")
    with xarray.open_dataset(tmp_path / "map.h5", engine="h5netcdf") as stored:
        stored.to_netcdf(tmp_path / "again.nc", engine="h5netcdf")
    assert same_bits(tl.read_map(tmp_path / "again.nc").cells, tl.read_map(tmp_path / "map.h5").cells)

"""Files of our own records, one contract for all: back to the bit, open to others, damage refused with its place."""

import dataclasses
import hashlib
import json
import math
import os

import h5py
import numpy as np
import pytest
import torch
import xarray
from conftest import EVERY, doubtful, plane_of, same_bits, turbulence
from test_burst_files import record_of
from test_microphone_line import line_of
from test_plane_file import LAYOUTS, make_plane
from test_results_out import hand_map, line, made, points
from test_wall_pressure import both_ways
from test_wall_pressure import line_of as wall_line

import torchliner as tl
from torchliner.cli.main import DONE, main
from torchliner.records.declared import flat
from torchliner.records.educed import Educed
from torchliner.records.notes import Note
from torchliner.records.wall_eduction import fine_places

SAMPLES = 300
MICROPHONES = ("microphones", "microphone_y", "microphone_velocity")
FLUID = tl.Fluid(343.2, 1.21, 1.8e-5, 1.4, 0.7)
FACTS = {"height": 1e-3, "mach": 0.3, "incident_level": 145.0, "source_side": "upstream", "fluid": FLUID}
PRESSURES = {
    "line": {},
    "one backplate": {"backplate": turbulence((SAMPLES,), seed=4)},
    "backplate like the facesheet": {"backplate": turbulence((6, SAMPLES), seed=4)},
    "surface": {"facesheet": turbulence((2, 3, SAMPLES)), "x": [0.0, 1.0, 2.0], "z": [0.0, 1.0]},
    "one probe": {"facesheet": turbulence((SAMPLES,)), "x": 0.5, "z": 0.1},
    "scattered": {"z": [0.1] * 6},
    "microphones": {"facesheet": None, "backplate": None, "x": None},
    "no microphones": dict.fromkeys(MICROPHONES),
}


def grid_plane(dtype=torch.float32):
    """(z, x) probes with all that a plane may state."""
    facts = {"x": 0.01 * torch.arange(4.0), "z": 0.02 * torch.arange(2.0), "area": torch.linspace(1e-6, 8e-6, 8)}
    facts |= {"height": 1e-3, "incident_level": 130.0, "mach": 0.1, "source_side": "upstream", "liner": "polito"}
    facts |= {"reference": {"true": 1 - 0.5j}, "title": "two rows", "provenance": {"run": 7}, "start": 0.25}
    time = torch.arange(900, dtype=torch.float64) / 42e3
    v = turbulence((2, 4, 900)) + 2 + 3 * torch.cos(2 * torch.pi * 1400 * time)
    return plane_of(v.to(dtype), **facts)


def record(**about) -> tl.PressureRecord:
    """Everything a record can hold, over one line of probes."""
    usual = {"sampling_rate": 40000.0, "x": [0.001 * i for i in range(6)], "cavity_depth": 0.038, "cell_pitch": 0.003}
    for seed, (name, probes) in enumerate(
        {"facesheet": 6, "backplate": 2, "microphones": 3, "microphone_velocity": 3}.items()
    ):
        usual[name] = turbulence((probes, SAMPLES), seed=seed).float()
    usual |= {"cavity_porosity": 0.8, "cavity_hydraulic_radius": 0.005, "microphone_y": [0.01, 0.02, 0.03]}
    usual |= {"microphone_mach": 0.1, "frequency": 1400.0, "incident_level": 130.0, "mach": 0.3, "title": "made up"}
    about = usual | {"reference": {"true": 1 - 0.5j}, "provenance": {"source": "a test"}} | about
    return tl.PressureRecord(about.pop("facesheet"), about.pop("backplate"), **about)


def noisy(side, seed=0, **about):
    """A line of two waves and 1 % of noise, so that methods leave a residual."""
    pressure = both_ways(side)[0]
    draw = torch.Generator().manual_seed(seed)
    noise = torch.randn(pressure.shape, dtype=torch.complex128, generator=draw)
    return wall_line(pressure * (1 + 0.01 * noise), side, title=f"{side} case", **about)


def field_fit(line, draws=True):
    """A fit of the field as ``fit_field`` returns it, with numbers at random."""
    draw = torch.Generator().manual_seed(1)
    lead = (3,) if draws is None else ()

    def random(*shape):
        return torch.randn(*lead, *shape, dtype=torch.complex128, generator=draw)

    count, along = len(line.frequency), fine_places(line.x)
    spread = random(count, 2, 2).abs()
    known = {"method": "LEE fit", "frequency": line.frequency, "x": line.x, "source_side": line.source_side}
    known |= {name: random(count) for name in ("amplitude", "end_reflection")}
    known |= {name: random(count).abs() for name in ("residual", "misfit")}
    known |= {"pressure": random(line.microphones, count), "pressure_along": random(len(along), count)}
    return tl.FieldFit(
        impedance=2 + random(count) / 9,
        covariance=spread @ spread.mT * 1e-4,
        along=along,
        converged=random(count).real > 0,
        draws=field_fit(line, None) if draws else None,
        line=line,
        choices={"method": "field", "mach": 0.3},
        **known,
    )


def noted():
    """A map with all that may stand beside Z."""
    found = made("plane", displacement_thickness=1.73e-3, **FACTS).with_alongside(points())
    notes = (*found.notes, Note("by-hand", "of some size", 0.1))
    return dataclasses.replace(found, notes=notes, title="Überströmt")


def tones():
    about = {"liner_start": 0.0, "liner_end": 0.132, "duct_width": 0.05, "liner": "onera", "title": "a line"}
    about |= {"notes": ("doubt",), "provenance": {"a": 1}, "reference": {"true": 2 - 1j}}
    return line_of(coherence=torch.rand(12, 2).double(), **about)


def draws():
    scale = 1 + torch.arange(6.0).double().reshape(3, 2, 1, 1)
    return dataclasses.replace(line_of(title="draws"), pressure=scale * line_of().pressure)


def bursts():
    about = {"notes": ("a doubt",), "provenance": {"a": 1}, "reference": {"true": 1 - 2j}, "liner": "onera"}
    return record_of(0, 50, dropped={"outlier": 3}, source_side="upstream", **about)


def microphones():
    return noisy("upstream", provenance={"who": "me"}, reference={"true": 1 + 0j})


TABLE = tl.TabulatedLiner([1000.0, 2000.0], np.full((2, 3), 2 + 1j), [0.0, 5.0, 40.0])


def bare_plane(third=0.0):
    v = turbulence((8, 900))
    v[3, ::7] = third
    return plane_of(v, title="t")


RECORDS = {
    **{
        f"map, {place}": (lambda place=place: made(place), tl.read_map)
        for place in ("plane", "bare", "line", "scattered", "one probe")
    },
    "map by hand": (hand_map, tl.read_map),
    "map with all": (noted, tl.read_map),
    "line of stations": (line, tl.read_line),
    "points": (points, tl.read_points),
    **{
        f"plane, {layout}": (lambda layout=layout: make_plane(LAYOUTS[layout][0], **LAYOUTS[layout][1]), tl.read_plane)
        for layout in LAYOUTS
    },
    "plane with all": (grid_plane, tl.read_plane),
    **{
        f"pressure, {name}": (lambda about=about: record(**about), tl.read_pressure)
        for name, about in PRESSURES.items()
    },
    "moments": (lambda: tl.moments(grid_plane(), cell_pitch=0.02), tl.read_moments),
    "moments of levels": (lambda: tl.moments(bare_plane(), TABLE), tl.read_moments),
    "moments of lines": (lambda: tl.moments(bare_plane(), frequency=[1400.0, 1000.0]), tl.read_moments),
    "moments, some left out": (lambda: tl.moments(bare_plane(torch.nan), missing="exclude"), tl.read_moments),
    "moments of one probe": (lambda: tl.moments(plane_of(turbulence((900,)), title="t")), tl.read_moments),
    "microphones": (tones, tl.read_microphones),
    "lines of microphones": (draws, tl.read_microphones),
    "waves": (lambda: tl.kumaresan_tufts(microphones(), draws=3), lambda path: tl.read_wall(path)[0]),
    "fit of the field": (lambda: field_fit(microphones()), lambda path: tl.read_wall(path)[0]),
    "bursts": (bursts, lambda path: tl.read_bursts(path)[0]),
}


@pytest.fixture(params=RECORDS)
def written(request, tmp_path):
    """A record, its file and its reader."""
    make, read = RECORDS[request.param]
    made = make()
    made.write(tmp_path / "a.nc")
    return made, tmp_path / "a.nc", read


def with_plain_choices(found):
    """JSON has lists alone."""
    plain = json.loads(json.dumps(found.choices, default=lambda each: each.tolist()))
    return dataclasses.replace(found, choices=plain)


def test_it_comes_back_to_the_bit(written):
    wanted, path, read = written
    found = read(path)
    if hasattr(wanted, "choices"):
        wanted = with_plain_choices(wanted)
    if hasattr(wanted, "velocity"):
        assert torch.equal(found.velocity, wanted.velocity)
        wanted = dataclasses.replace(wanted, title=wanted.title or path.stem)
    if hasattr(wanted, "sampling_rate"):
        assert found.sampling_rate == pytest.approx(wanted.sampling_rate, rel=1e-12)
        wanted = dataclasses.replace(wanted, sampling_rate=found.sampling_rate)
    if getattr(wanted, "draws", None) is not None:
        wanted = dataclasses.replace(wanted, draws=with_plain_choices(wanted.draws))
    assert same_bits(found, wanted)


def owners(path):
    """Groups and datasets of a file, by name."""
    with h5py.File(path) as file:
        found = {"/": file}
        file.visititems(lambda name, each: found.update({name: each}))
        yield from found.items()


def test_other_programs_open_it(written):
    """netCDF-4 with named dimensions, units and texts of fixed length, which nco and Octave read."""
    _, path, _ = written
    groups = [None]
    for name, owner in owners(path):
        groups += [name] * (isinstance(owner, h5py.Group) and name != "/")
        for key in owner.attrs:
            fixed = owner.attrs.get_id(key).dtype.kind != "O"
            assert fixed or key in ("DIMENSION_LIST", "REFERENCE_LIST"), (name, key)
    for group in groups:
        with xarray.open_dataset(path, engine="h5netcdf", group=group) as data:
            assert not [dim for dim in data.dims if str(dim).startswith("phony")]
            for name, each in data.variables.items():
                assert "units" in each.attrs or each.dtype.kind in "OTUM" or str(each.dtype) == "object", name


def some(path, count=9):
    """Names of datasets that are read, so many of them, evenly: indices are not read."""
    names = [
        name
        for name, each in owners(path)
        if isinstance(each, h5py.Dataset)
        and not each.attrs.get("long_name", b"").startswith(b"number of the ")
        and not (each.is_scale and each.attrs["NAME"].startswith(b"This is"))
    ]
    return names[:: -(-len(names) // count)]


def cut(file, name):
    """One value less along the last axis, or two where there is one."""
    values, about, kind = file[name][()], dict(file[name].attrs), file[name].dtype
    del file[name]
    one = values.ndim == 0 or values.shape[-1] == 1
    file.create_dataset(
        name, data=np.repeat(values, 2, -1 if values.ndim else None) if one else values[..., :-1], dtype=kind
    )
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
    """Of every variable that is read: those that follow from others are not."""
    made, path, read = written
    whole = path.read_bytes()
    own, every = ({name for row, _ in flat(made, derived=which) for name in row.names} for which in (False, True))
    for name in [each for each in some(path) if each.rpartition("/")[2] not in every - own]:
        path.write_bytes(whole)
        with h5py.File(path, "r+") as file:
            cut(file, name)
        alone = name == "x" and getattr(made, "probes", None) == 1  # a probe needs no place
        assert str(path) in fault(read, path) or name in UNTOLD or alone, name


@pytest.mark.parametrize(
    "kind", ["map, plane", "line of stations", "points", "waves", "microphones", "moments", "pressure, line"]
)
def test_damage_is_refused(kind, tmp_path):
    make, read = RECORDS[kind]
    path = tmp_path / "a.h5"
    make().write(path)
    whole, seen = path.read_bytes(), []
    for name in some(path):
        for unit in (None, "furlong"):
            path.write_bytes(whole)
            with h5py.File(path, "r+") as file:
                if "units" not in file[name].attrs or file[name].is_scale:
                    continue
                del file[name].attrs["units"]
                if unit is not None:
                    file[name].attrs["units"] = unit
            if said := fault(read, path):
                assert f"{path}:/{name}" in said
                seen.append(name)
    assert len(seen) > 2
    path.write_bytes(whole)
    with h5py.File(path, "r+") as file:
        file.attrs["schema"] = "torchliner plan 1"
    assert "'torchliner plan 1'" in fault(read, path)
    for content, words in ((whole[: len(whole) // 2], "a.h5 is truncated"), (b"not HDF5", "a.h5 is not an HDF5")):
        path.write_bytes(content)
        with pytest.raises(OSError, match=words):
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


def replaced(name, values, units="Pa"):
    def change(file):
        del file[name]
        file[name] = values
        file[name].attrs["units"] = units

    return change


def head(key, **changes):
    """A change of a JSON attribute."""
    return lambda file: file.attrs.update({key: json.dumps(json.loads(file.attrs[key]) | changes)})


def without(*stems):
    """No variables that begin like these."""
    return lambda file: [file.pop(name) for name in [*file] if name.startswith(stems)]


def named(*names):
    """Other averagings."""

    def change(file):
        file["averaging"][...] = names

    return change


@pytest.mark.parametrize(
    ("kind", "change", "words"),
    [
        ("map, plane", raised("liner_resistance_low", 1e3), "liner_resistance_low or its other part is above"),
        ("map, plane", raised("reflection_real", np.inf), "reflection_real or its other part is infinite"),
        ("map, plane", raised("frequency", -2000.0), "a.h5:/frequency"),
        ("map, plane", raised("phase_rule_used", 1), "phase_rule_used holds other values than 0 and 1"),
        ("map, plane", lambda file: file.pop("coherence"), "coherence is missing; the file holds: absorp"),
        (
            "map, plane",
            lambda file: file.attrs.pop("title") and file.attrs.update(notes="{"),
            r"'notes' is '{': Invalid JSON",
        ),
        ("map, plane", lambda file: file.attrs.pop("level_check"), "lacks the attribute 'level_check'"),
        ("map, plane", without("level_gap", "phase_gap"), "lacks liner: it is damaged"),
        ("map, plane", named("probes first", "admittance", "velocity"), "averaging holds"),
        ("points", lambda file: file.attrs.update(choices="[]"), "'choices' is .* an object; repair it"),
        ("line of stations", lambda file: file.attrs.update(flags="[]"), "flags has 0 values for 2 stations"),
        ("waves", lambda file: file.pop("eduction_0/microphones"), "microphones are missing"),
        ("waves", raised("eduction_0/frequency", 3.0), "of other frequencies"),
        ("moments", head("blocks", borders=[0, 5000]), r"peaks has shape .*1 block|sums has shape .*1 block"),
        ("moments", lambda file: file.attrs.update(precision="int8"), "damaged, or of another layout .*int8"),
        ("moments", head("nodes", kind="levels"), "'nodes'.* repair it"),
        ("moments", head("nodes", count=20), r"admittance_sums has shape .*20 node"),
        ("moments", lambda file: file.pop("taken"), ":/taken is missing"),
        ("moments", raised("peaks", np.nan), "a.h5: peaks is nan m/s at 0, 0 .*finite values are needed"),
        ("moments", raised("admittance_sums", np.inf), ":/admittance_sums .*infinite"),
        ("moments", raised("used", 2), ":/used holds other values than 0 and 1"),
        ("pressure, line", lambda file: file.pop("backplate_pressure"), "backplate is missing; facesheet and"),
        ("pressure, line", replaced("backplate_pressure", np.zeros((77, 2))), "there are 300 times"),
        ("pressure, line", replaced("backplate_pressure", np.zeros((300, 2), dtype=int)), "is int64"),
        ("pressure, line", lambda file: file.pop("time"), "time is missing"),
        ("pressure, line", replaced("time", np.arange(300) ** 2 / 1e5, "s"), "is not uniform"),
        ("pressure, line", replaced("cavity_porosity", 12.0, "1"), "cavity_porosity is 12"),
        ("bursts", raised("transit_time", -1.0), "transit_time is .*finite|transit_time is"),
    ],
)
def test_what_contradicts_itself_is_refused(kind, change, words, tmp_path):
    make, read = RECORDS[kind]
    make().write(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        change(file)
    with pytest.raises(ValueError, match=words) as error:
        read(tmp_path / "a.h5")
    assert "a.h5" in str(error.value)


def test_intervals_of_some_averagings_have_no_file(tmp_path):
    """A nan in their place would be taken for an interval."""
    cells = {**made().cells, "velocity": Educed(made().cells["velocity"].reflection)}
    with pytest.raises(ValueError, match=r"2 of 3 averagings have intervals"):
        dataclasses.replace(made(), cells=cells).write(tmp_path / "a.nc")
    assert not (tmp_path / "a.nc").exists()


def refused(error):
    def refuse(*_, **__):
        raise error

    return refuse


@pytest.mark.parametrize("name", ["a.nc", "a.csv"])
@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")])
def test_an_old_file_stays_where_a_new_one_fails(tmp_path, monkeypatch, name, error):
    hand_map().write(tmp_path / name)
    before = (tmp_path / name).read_bytes()
    monkeypatch.setattr(os, "replace", refused(error))
    with pytest.raises(type(error), match=rf"{name} cannot be written: .*No space" if error.args else "^$"):
        hand_map().write(tmp_path / name)
    assert (tmp_path / name).read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == [name]


# Moments


@doubtful
@pytest.mark.parametrize("choices", EVERY, ids=str)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_file_answers_as_memory_does(choices, dtype, liner, tmp_path):
    path = tmp_path / "m.h5"
    known = tl.moments(grid_plane(dtype), cell_pitch=liner.cell_pitch, **choices)
    known.write(path)
    found = tl.read_moments(path)
    assert same_bits(found, known)
    assert found.notes == known.notes
    assert (found.plane.velocity.shape, found.plane.velocity.dtype) == ((2, 4, 900), dtype)
    assert same_bits(found.educe(liner, **choices), known.educe(liner, **choices))
    with pytest.raises(ValueError, match=r"m\.h5 holds moments.* no time samples"):
        found.plane.read(0, 1)


# Pressures


def test_units_are_converted(tmp_path):
    record().write(tmp_path / "p.h5")
    with h5py.File(tmp_path / "p.h5", "a") as file:
        file["backplate_pressure"].attrs["units"] = "kPa"
        file["cavity_depth"].attrs["units"] = "mm"
    found = tl.read_pressure(tmp_path / "p.h5")
    assert torch.allclose(found.backplate, 1000 * record().backplate)
    assert found.cavity_depth == pytest.approx(0.038e-3)


def faulty(label, value):
    """A record one of whose signals holds a value at probe 1, sample 7."""
    bad = turbulence((2, SAMPLES))
    bad[1, 7] = value
    alone = {"facesheet": {"x": [0.0, 1.0]}, "microphones": {"microphone_y": [0.1, 0.2], "microphone_velocity": None}}
    return {label: bad, **alone.get(label, {})}


@pytest.mark.parametrize(
    ("about", "error", "words"),
    [
        ({"backplate": None}, ValueError, "backplate is missing; facesheet and"),
        ({"facesheet": None, "x": None}, ValueError, "facesheet is missing"),
        (dict.fromkeys(("facesheet", "backplate", "x", *MICROPHONES)), ValueError, "no pressure is given"),
        ({"backplate": turbulence((2, 299))}, ValueError, "backplate has shape (2, 299); (2 backplate, 300 time)"),
        (
            {"facesheet": torch.zeros(6, 0), "backplate": torch.zeros(0), **dict.fromkeys(MICROPHONES)},
            ValueError,
            "(6, 0)",
        ),
        ({"x": [0.0, 1.0]}, ValueError, "x has 2 values; probes of shape (6,)"),
        ({"x": [0.0] * 5 + [float("nan")]}, ValueError, "x is nan m at 5"),
        ({"cavity_porosity": 80.0}, ValueError, "cavity_porosity is 80; (0, 1] is needed (share of"),
        ({"sampling_rate": float("nan")}, ValueError, "sampling_rate (Hz) is nan"),
        ({"microphone_mach": float("nan")}, ValueError, "microphone_mach is nan; (-1, 1)"),
        ({"microphone_y": None}, ValueError, "microphone_y is missing; microphones and"),
        ({"microphones": None}, ValueError, "microphones is missing"),
        ({"facesheet": torch.zeros(6, SAMPLES, dtype=torch.int32)}, TypeError, "facesheet is torch.int32"),
        ({"cavity_depth": "38 mm"}, TypeError, "cavity_depth is '38 mm'; one number"),
        (faulty("facesheet", float("nan")), ValueError, "facesheet is nan Pa at 1, 7"),
        (faulty("backplate", float("inf")), ValueError, "backplate is inf Pa at 1, 7"),
        (faulty("microphones", 1e200), ValueError, "microphones is 1e+200 Pa at 1, 7 and 0 more; [-1e9, 1e9] Pa"),
    ],
)
def test_refusals(about, error, words):
    with pytest.raises(error) as said:
        record(**about)
    assert words in str(said.value)


def test_a_file_without_signals_is_refused(tmp_path):
    with h5py.File(tmp_path / "empty.h5", "w"):
        pass
    with pytest.raises(ValueError, match="facesheet_pressure is missing; the file holds: nothing"):
        tl.read_pressure(tmp_path / "empty.h5")
    with pytest.raises(ValueError, match="has 1 sample"):
        tl.PressureRecord(torch.ones(1), torch.ones(1), sampling_rate=1.0).write(tmp_path / "x.h5")


# Eductions from microphones

SIDES = ("upstream", "downstream")


@pytest.fixture(scope="module")
def lines(tmp_path_factory):
    """Both sources of one wall, what kt makes of them with draws, and its page."""
    folder = tmp_path_factory.mktemp("wall")
    for side in SIDES:
        noisy(side).write(folder / f"{side}.h5")
    words = ["kt", *(str(folder / f"{side}.h5") for side in SIDES)]
    found = str(folder / "found.h5")
    assert main([*words, "--draws", "20", "--seed", "7", "-o", found, "--quiet"]) == DONE
    return folder


@doubtful
def test_a_file_keeps_an_eduction_whole(tmp_path):
    """KT with draws and a lost frequency, a fit, the field: all of it, in order."""
    line = noisy("upstream", provenance={"who": "me"}, reference={"true": 1 + 0j})
    lost = tl.kumaresan_tufts(line, draws=3)
    wave = lost.wavenumber.clone()
    wave[1] = complex(math.nan, math.nan)
    found = [
        dataclasses.replace(lost, wavenumber=wave),
        tl.two_wave_fit(line, condition="continuous-velocity"),
        field_fit(dataclasses.replace(line, title="")),
    ]
    found[0].write(tmp_path / "found.nc", *found[1:])
    again = tl.read_wall(tmp_path / "found.nc")
    assert len(again) == 3
    for one, other in zip(found, again, strict=True):
        assert dict(other.choices) == dict(one.choices)
        assert torch.equal(one.impedance, other.impedance)
        assert torch.equal(one.interval()[1], other.interval()[1])
        assert other.source_line.name == one.choices.get("source", "microphones")
        assert torch.equal(one.fitted_along()[1], other.fitted_along()[1])


def test_choices_command_and_hashes_are_kept(lines):
    for one, side in zip(tl.read_wall(lines / "found.h5"), SIDES, strict=True):
        path = lines / f"{side}.h5"
        (known,) = one.choices["inputs"]
        assert (known["what"], known["name"]) == ("microphones", str(path))
        assert known["hash"] == hashlib.sha256(path.read_bytes()).hexdigest()
        assert (one.choices["seed"], one.choices["draws"], one.choices["margin"]) == (7, 20, 0.0)
        assert one.choices["version"] == tl.__version__
        assert one.choices["command"][:2] == ["kt", str(path.parent / "upstream.h5")]


def test_what_is_no_line_of_one_case_has_no_file(lines, tmp_path):
    with pytest.raises(ValueError, match="'torchliner wall 1' is needed"):
        tl.read_wall(lines / "upstream.h5")
    with pytest.raises(ValueError, match="a file or a page needs one line"):
        tl.two_wave_fit(wall_line(torch.stack([both_ways()[0]] * 2))).write(tmp_path / "two.h5")
    assert not (tmp_path / "two.h5").exists()

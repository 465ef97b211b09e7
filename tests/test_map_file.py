"""The map file, and how map and plane files fail: whole or not at all."""

import csv
import os
from dataclasses import replace
from functools import cache

import h5py
import pytest
import torch
import xarray

import torchliner as tl
from torchliner.records.averaged import Educed

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
PLACES = {
    "plane": ((2, 3), {"x": [0.0, 0.02, 0.04], "z": [0.0, 0.02]}),
    "bare plane": ((2, 3), {}),
    "line": ((3,), {"x": [0.0, 0.02, 0.04]}),
    "bare line": ((3,), {}),
    "one probe": ((1,), {"x": [0.5]}),
}


def make_plane(place="plane", **about):
    """Noise over 7 and 5 whole periods of 1400 and 1000 Hz."""
    shape, coordinates = PLACES[place]
    noise = torch.Generator().manual_seed(0)
    velocity = 2 * torch.randn(*shape, 250, generator=noise, dtype=torch.float64)
    about = {"reference": {"in situ": 1 - 0.5j, "p/v": 2j}, **coordinates, **about}
    return tl.VelocityPlane(velocity, sampling_rate=50e3, title="noise", **about)


@cache
def made_map(place="plane", **about):
    """A map as ``educe`` gives it, with intervals; each is educed once and nobody changes it."""
    liner = tl.load_liner("polito")
    return tl.educe(make_plane(place, **about), liner, [1400.0, 1000.0])


def hand_map():
    """Two probes worked by hand: R = 1/2 gives z = 3, R = j/2 gives 0.6 + 0.8j."""
    empty = torch.zeros(0, 1, dtype=torch.complex128)
    return tl.ImpedanceMap(
        frequency=torch.tensor([1400.0], dtype=torch.float64),
        probes={"admittance": Educed(torch.tensor([[[0.5], [0.5j]]], dtype=torch.complex128))},
        cells={"admittance": Educed(empty)},
        liner={"admittance": Educed(torch.tensor([0.5], dtype=torch.complex128))},
        averaging="admittance",
        mean_velocity=torch.tensor([[0.25, -0.25]]),
        velocity_rms=torch.tensor([[1.5, 2.5]]),
        velocity_amplitude=torch.tensor([[[0.05], [0.1]]], dtype=torch.complex128),
        coherence=torch.tensor([[[0.75], [0.5]]]),
        phase_rule=torch.ones(1, 2, 1, dtype=torch.bool),
        cell_x=empty.real[:, 0],
        cell_z=empty.real[:, 0],
        x=torch.tensor([0.1, 0.2], dtype=torch.float64),
        z=torch.tensor([0.3], dtype=torch.float64),
        fluid=tl.Fluid(sound_speed=400.0, density=1.0),
    )


def test_excluded_probes_stay_nan(tmp_path):
    reflection = hand_map().probes["admittance"].reflection.clone()
    reflection[0, 1] = torch.nan
    gap = replace(hand_map(), probes={"admittance": Educed(reflection)})
    gap.write(tmp_path / "a.nc")
    gap.write(tmp_path / "a.csv")
    assert tl.read_map(tmp_path / "a.nc").impedance.isnan().tolist() == [[[False], [True]]]
    rows = list(csv.DictReader((tmp_path / "a.csv").read_text().splitlines()))
    assert [row["resistance"] for row in rows] == ["3", "nan"]


def test_xarray_picks_an_averaging_by_name(tmp_path):
    made_map().write(tmp_path / "a.nc")
    with xarray.open_dataset(tmp_path / "a.nc", engine="h5netcdf") as data:
        for name in made_map().averagings:
            value = made_map().cells[name].resistance
            assert data.cell_resistance.sel(averaging=name).values.tolist() == value.tolist()
        locked = made_map().probes["phase-locked"].reactance
        assert data.phase_locked_reactance.values.tolist() == locked.tolist()


def test_csv_has_one_row_a_probe_and_frequency(tmp_path):
    hand_map().write(tmp_path / "a.csv")
    rows = list(csv.DictReader((tmp_path / "a.csv").read_text().splitlines()))
    assert list(rows[0])[:3] == ["x (m)", "z (m)", "frequency (Hz)"]
    # p = rho c v/(1 - R): 400 x 0.05/0.5 = 40 Pa and 400 x 0.1/|1 - j/2| = 35.78 Pa, peak.
    wanted = {
        "x (m)": (0.1, 0.2), "z (m)": (0.3, 0.3), "frequency (Hz)": (1400, 1400), "resistance": (3, 0.6),
        "reactance": (0, 0.8), "absorption": (0.75, 0.75), "coherence": (0.75, 0.5),
        "inferred_incident_level (dB)": (123.0103, 122.0412), "mean_velocity (m/s)": (0.25, -0.25),
        "velocity_rms (m/s)": (1.5, 2.5),
    }  # fmt: skip
    for name, values in wanted.items():
        assert [float(row[name]) for row in rows] == pytest.approx(values, abs=1e-4), name


@pytest.mark.parametrize("place", PLACES)
def test_csv_rows_follow_the_probes(tmp_path, place):
    result = made_map(place)
    result.write(tmp_path / "a.csv")
    rows = list(csv.DictReader((tmp_path / "a.csv").read_text().splitlines()))
    found = [complex(float(r["resistance"]), float(r["reactance"])) for r in rows]
    assert found == pytest.approx(result.impedance.reshape(-1).tolist(), rel=1e-8)
    assert [float(r["frequency (Hz)"]) for r in rows[:2]] == [1400, 1000]
    if place == "plane":
        assert [float(r["x (m)"]) for r in rows[::2]] == [0.0, 0.02, 0.04] * 2
        assert [float(r["z (m)"]) for r in rows[::2]] == [0.0] * 3 + [0.02] * 3


def test_what_is_no_map_is_refused(tmp_path):
    make_plane().write(tmp_path / "plane.h5")
    hand_map().write(tmp_path / "map.nc")
    with pytest.raises(ValueError, match=r"plane.h5 is no impedance map.*'torchliner plane 1', not"):
        tl.read_map(tmp_path / "plane.h5")
    with pytest.raises(ValueError, match=r"map.nc is no velocity plane but a file of schema .torchliner map 1"):
        tl.read_plane(tmp_path / "map.nc")
    for names in (["admittance", "admittance"], ["velocity"], ["probes first", "admittance"]):
        hand_map().write(tmp_path / "map.nc")
        with h5py.File(tmp_path / "map.nc", "a") as file:
            del file["averaging"]
            file["averaging"] = names
        with pytest.raises(ValueError, match=r"map.nc.* averaging (holds .*'admittance' was chosen|is \(2,\))"):
            tl.read_map(tmp_path / "map.nc")


def test_intervals_of_some_averagings_have_no_file(tmp_path):
    """A nan in their place would be taken for an interval."""
    found = made_map("line")
    cells = {**found.cells, "velocity": Educed(found.cells["velocity"].reflection)}
    with pytest.raises(ValueError, match=r"2 of 3 averagings have intervals; all or none"):
        replace(found, cells=cells).write(tmp_path / "a.nc")


@pytest.mark.parametrize(
    ("damage", "error", "message"),
    [
        ("text", OSError, r"a.h5 (is not an HDF5|begins with b)"),
        ("empty", OSError, r"a.h5 is (not an HDF5|empty; it is of no format)"),
        ("truncated", OSError, r"a.h5 is truncated: .*eof"),
    ],
)
def test_what_is_no_whole_plane_is_refused(tmp_path, damage, error, message):
    path = tmp_path / "a.h5"
    make_plane().write(path)
    whole = path.read_bytes()
    content = {"text": b"velocity of the plane\n", "empty": b"", "truncated": whole[: len(whole) // 2]}
    path.write_bytes(content[damage])
    with pytest.raises(error, match=message):
        tl.read_plane(path)


def interrupt(*_, **__):
    raise KeyboardInterrupt


@pytest.mark.parametrize("place", [(h5py.Dataset, "__setitem__"), (h5py.File, "__exit__")])
def test_interrupted_plane_leaves_the_old_file(tmp_path, monkeypatch, place):
    check_old_file_stays(make_plane(), tmp_path / "a.h5", monkeypatch, place)


@pytest.mark.parametrize("name", ["a.nc", "a.csv"])
def test_interrupted_map_leaves_the_old_file(tmp_path, monkeypatch, name):
    check_old_file_stays(hand_map(), tmp_path / name, monkeypatch, (os, "replace"))


def check_old_file_stays(record, path, monkeypatch, place):
    record.write(path)
    before = path.read_bytes()
    monkeypatch.setattr(*place, interrupt)
    with pytest.raises(KeyboardInterrupt):
        record.write(path)
    assert path.read_bytes() == before
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]


def forbid(*_, **__):
    raise PermissionError(13, "Permission denied")


@pytest.mark.parametrize("name", ["a.nc", "a.csv"])
def test_places_that_cannot_be_written_to(tmp_path, monkeypatch, name):
    with pytest.raises(OSError, match=rf"no/{name}: the folder .*no does not exist"):
        hand_map().write(tmp_path / "no" / name)
    (tmp_path / "b.csv").mkdir()
    with pytest.raises(OSError, match=r"b.csv is a folder; name a file"):
        hand_map().write(tmp_path / "b.csv")
    monkeypatch.setattr("tempfile.mkstemp", forbid)
    with pytest.raises(OSError, match=rf"{name} cannot be written: Permission denied"):
        hand_map().write(tmp_path / name)
    assert [entry.name for entry in tmp_path.iterdir()] == ["b.csv"]

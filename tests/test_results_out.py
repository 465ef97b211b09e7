"""Results leave the program: labelled arrays, rows, and a file for each ending."""

import csv
import dataclasses
import warnings
from functools import cache

import numpy as np
import pytest
import torch
from conftest import turbulence

import torchliner as tl
from torchliner.cli.table import SHARED
from torchliner.names import RESULT_WRITERS
from torchliner.records.educed import Educed

xarray = pytest.importorskip("xarray")
RATE, TONES = 42e3, [1400.0, 1000.0]
PLACES = {
    "plane": ((2, 3), {"x": [0.0, 0.01, 0.02], "z": [0.0, 0.01]}),
    "uneven": ((2, 3), {"x": [0.0, 0.01, 0.03], "z": [0.0, 0.01]}),
    "line": ((3,), {"x": [0.0, 0.01, 0.02]}),
    "slanted": ((3,), {"x": [0.0, 0.01, 0.02], "z": [0.0, 0.005, 0.01]}),
    "scattered": ((4,), {"x": [0.0, 0.01, 0.002, 0.011], "z": [0.0, 0.001, 0.01, 0.012]}),
    "one probe": ((1,), {"x": [0.5]}),
    "bare": ((2, 3), {}),
}


@cache
def made(place="plane", tones=tuple(TONES), **facts):
    shape, where = PLACES[place]
    about = {"height": 1e-3, "incident_level": 130.0, "source_side": "normal", "frequency": 1400.0, **where, **facts}
    plane = tl.VelocityPlane(
        turbulence((*shape, 420)), sampling_rate=RATE, title="noise", reference={"in situ": 1 - 0.5j}, **about
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return tl.educe(plane, tl.load_liner("polito"), list(tones))


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


def points():
    found = made()
    known, (each, liner) = (found.cell_x, found.cell_z), (found.cells["admittance"], found.liner["admittance"])
    ways = [dict.fromkeys(("admittance", "pressure-first"), one) for one in (each, liner)]
    coherence = torch.ones(each.reflection.shape)
    return tl.PointImpedances("in situ", found.frequency, *known, *ways, coherence, *known, Educed(each.reflection))


@cache
def line():
    burst = torch.arange(4000, dtype=torch.float64) / 12e3
    stations = [
        tl.BurstRecord(burst, wall_normal=torch.cos(2 * torch.pi * 1500 * burst) + 0.1 * n, x=0.01 * n, y=1e-3, z=0.0)
        for n in range(2)
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return tl.educe_bursts(stations, tl.load_liner("onera"), 1500.0, segment=0.1)


RESULTS = {
    "scattered": lambda: made("scattered"),
    "one probe": lambda: made("one probe"),
    "line of stations": line,
    "points": points,
    "alongside": lambda: made().with_alongside(points()),
}


@pytest.mark.parametrize("kind", ["scattered", "one probe", "line of stations", "alongside"])
def test_xarray_shows_of_the_file_what_the_record_gives(kind, tmp_path):
    result = RESULTS[kind]()
    result.write(tmp_path / "r.nc")
    mine = result.to_xarray()
    with xarray.open_dataset(tmp_path / "r.nc", engine="h5netcdf") as data:
        assert data.attrs["Conventions"] == "CF-1.8"
        xarray.testing.assert_identical(mine[list(data.data_vars)], data.load())
    both = [name for name, each in mine.items() if np.iscomplexobj(each)]
    assert both
    for name in both:
        two = f"{name}_real" in mine
        real = f"{name}_real" if two else name.replace("impedance", "resistance")
        np.testing.assert_array_equal(mine[name].real, mine[real])
    for name, each in mine.variables.items():
        unsaid = ("station_name", "averaging", "sound_speed", "density", "dynamic_viscosity", "prandtl")
        assert {"units", "long_name"} <= set(each.attrs) or name in (*unsaid, "heat_capacity_ratio"), name


def test_places_are_attached_to_what_has_them():
    scattered = made("scattered")
    mine = scattered.to_xarray()
    assert {"x", "z"} <= set(mine.impedance.coords)
    assert {"x", "z"}.isdisjoint(mine.cell_impedance.coords)
    assert {"cell_x", "cell_z"} <= set(mine.cell_impedance.coords)
    there = mine.impedance.where(mine.x == 0.002, drop=True).sel(frequency=1000)
    assert complex(there[0]) == complex(scattered.impedance[2, 1])
    near = made().to_xarray().impedance.sel(x=0.011, z=0.009, method="nearest").sel(frequency=1400)
    assert complex(near) == complex(made().impedance[1, 1, 0])
    assert {"x", "station_name"} <= set(line().to_xarray().impedance.coords)


# Rows.


def read_rows(path):
    return list(csv.DictReader(path.read_text().splitlines()))


def test_csv_by_hand(tmp_path):
    reflection = hand_map().probes["admittance"].reflection.clone()
    reflection[0, 1] = torch.nan
    dataclasses.replace(hand_map(), probes={"admittance": Educed(reflection)}).write(tmp_path / "gap.csv")
    assert [row["resistance"] for row in read_rows(tmp_path / "gap.csv")] == ["3", "nan"]
    hand_map().write(tmp_path / "a.csv")
    rows = read_rows(tmp_path / "a.csv")
    assert list(rows[0])[:3] == ["x (m)", "z (m)", "frequency (Hz)"]
    # p = rho c v/(1 - R): 400 x 0.05/0.5 = 40 Pa and 400 x 0.1/|1 - j/2| = 35.78 Pa, peak.
    wanted = {
        "x (m)": (0.1, 0.2),
        "z (m)": (0.3, 0.3),
        "frequency (Hz)": (1400, 1400),
        "resistance": (3, 0.6),
        "reactance": (0, 0.8),
        "absorption": (0.75, 0.75),
        "coherence": (0.75, 0.5),
        "inferred_incident_level (dB)": (123.0103, 122.0412),
        "mean_velocity (m/s)": (0.25, -0.25),
        "velocity_rms (m/s)": (1.5, 2.5),
    }
    for name, values in wanted.items():
        assert [float(row[name]) for row in rows] == pytest.approx(values, abs=1e-4), name


def test_rows_of_probes_and_cells():
    result = made()
    rows = result.to_dataframe()
    assert len(rows) == 6 * 2
    one = rows[(rows["x (m)"] == 0.01) & (rows["z (m)"] == 0.01) & (rows["frequency (Hz)"] == 1000)]
    assert one["resistance"].item() == float(result.impedance[1, 1, 1].real)
    cells = result.to_dataframe("cells")
    for name in result.averagings:
        assert cells[f"reactance, {name}"].tolist() == result.cells[name].impedance.imag.reshape(-1).tolist()
        assert cells[f"resistance_low, {name}"].tolist() == result.cells[name].low.real.reshape(-1).tolist()
    assert set(points().to_dataframe("liners")["place"]) == {"liner"}
    rows = line().to_dataframe()
    assert rows["name"].tolist() == list(line().names)
    assert rows["reactance"].tolist() == line().impedance.imag[:, 0].tolist()
    with pytest.raises(ValueError, match=r"no rows of 'probe'; there are those of probes, cells"):
        result.to_dataframe("probe")


# Files by ending.


def test_every_ending_is_written_and_others_are_refused(tmp_path):
    for ending in (".h5", ".hdf5", ".nc", *RESULT_WRITERS):
        assert ending in SHARED["map"][0].kind.endings
        made().write(tmp_path / f"m{ending.upper()}")
        assert (tmp_path / f"m{ending.upper()}").stat().st_size > 0
        for kind in ("line of stations", "points") if ending in RESULT_WRITERS else ():
            RESULTS[kind]().write(tmp_path / f"{kind}{ending}")
            assert (tmp_path / f"{kind}{ending}").stat().st_size > 0
    with pytest.raises(ValueError, match=r"m.vtk ends in '.vtk'; .*\.csv, \.vtp, \.vtkhdf, .*\.txt$"):
        made().write(tmp_path / "m.vtk")


@pytest.mark.parametrize("ending", ["vtp", "vtkhdf"])
@pytest.mark.parametrize("place", [place for place in PLACES if place != "bare"])
def test_paraview_sees_each_probe_at_its_place(place, ending, tmp_path):
    """By the reader of VTK itself: coordinates, and Z at each of them; corners follow each other around a cell."""
    pyvista = pytest.importorskip("pyvista")
    result = made(place)
    result.write(tmp_path / f"m.{ending}")
    seen = pyvista.read(tmp_path / f"m.{ending}")
    x, z = (np.array(PLACES[place][1].get(key, [0.0])) for key in "xz")
    if len(PLACES[place][0]) == 2:
        x, z = np.tile(x, len(z)), np.repeat(z, len(x))
    wanted = np.stack([x, np.full_like(x, 1e-3), np.broadcast_to(z, x.shape)], 1)
    np.testing.assert_allclose(seen.points, wanted, atol=1e-9)
    for i, frequency in enumerate(TONES):
        for name, part in (("resistance", "real"), ("reactance", "imag")):
            values = getattr(result.impedance, part)[..., i].reshape(-1)
            np.testing.assert_allclose(seen[f"{name}_{frequency:g}Hz"], values, rtol=1e-6)
    assert seen.n_cells == (2 if place in ("plane", "uneven") else len(x))
    if seen.n_cells == 2:
        around = seen.points[seen.regular_faces]
        sides = np.abs(around - np.roll(around, 1, axis=1))
        assert (np.minimum(sides[..., 0], sides[..., 2]) == 0).all()
    with pytest.raises(ValueError, match=r"has no x or z; state them in the data, or write"):
        made("bare").write(tmp_path / f"bare.{ending}")


def test_a_table_with_a_gap_is_refused(tmp_path):
    """A solver would draw its line over what is not known."""
    whole = made()
    reflection = whole.liner[whole.averaging].reflection.clone()
    reflection[0] = torch.nan
    broken = dataclasses.replace(whole, liner={**whole.liner, whole.averaging: Educed(reflection)})
    with pytest.raises(ValueError, match=r"Z of the whole liner is not finite at \[1400.0\]"):
        broken.write(tmp_path / "z.txt")


def test_solvers_read_columns_below_comments(tmp_path):
    made().write(tmp_path / "z.txt")
    found = np.loadtxt(tmp_path / "z.txt", comments="%")
    answer = made().answer.numpy()
    wanted = [[1000, answer[1].real, answer[1].imag], [1400, answer[0].real, answer[0].imag]]
    np.testing.assert_allclose(found, wanted, rtol=1e-9)
    assert "exp(+j omega t)" in (tmp_path / "z.txt").read_text()

"""Files as OpenFOAM and Code_Saturne wrote them: what is no velocity is refused, whatever the format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pyvista

import torchliner as tl

pytestmark = pytest.mark.filterwarnings("ignore:.*lie outside the mesh")

STORED = Path(__file__).parent / "stored/solver_files"
SATURNE = {
    "velocity_units": "m/s",
    "length_units": "m",
    "points": STORED / "code_saturne/probes_coords.csv",
    "normal": "y",
    "sampling_rate": 5e4,
}


def test_velocities_are_read():
    assert tl.read_plane(STORED / "probes", normal="y").samples > 2
    found = tl.read_plane(STORED / "code_saturne/probes_Velocity[Y].csv", **SATURNE)
    rows = np.loadtxt(STORED / "code_saturne/probes_Velocity[Y].csv", delimiter=",", skiprows=1)
    assert np.allclose(found.velocity.reshape(6, -1).T, rows[:, 1:], rtol=1e-6)


@pytest.mark.parametrize(
    ("path", "stated"),
    [
        ("code_saturne/probes_Pressure.csv", SATURNE),
        ("probes", {"variable": "p", "normal": "y"}),
        ("probes/0/p", {"normal": "y"}),
    ],
)
def test_pressures_are_refused(path, stated):
    with pytest.raises(ValueError, match=r"probes.*(names no velocity|no direction).*--wall-normal-component"):
        tl.read_plane(STORED / path, **stated)
    assert tl.read_plane(STORED / path, **stated, wall_normal_component=True).samples > 2


@pytest.mark.parametrize("name", ["high_pressure_run", "suppressed", "fan_pressure_ratio"])
def test_names_of_files_that_only_speak_of_pressure_are_read(tmp_path, name):
    np.save(tmp_path / f"{name}.npy", np.zeros((8, 3)))
    stated = {"axes": ["time", "x"], "velocity_units": "m/s", "sampling_rate": 1e3}
    assert tl.read_plane(tmp_path / f"{name}.npy", **stated).samples == 8


def test_an_array_of_xarray_is_no_pressure():
    xarray = pytest.importorskip("xarray")
    data = xarray.DataArray(np.zeros((8, 3)), dims=("time", "x"), name="pressure", attrs={"units": "m/s"})
    with pytest.raises(ValueError, match="names no velocity"):
        tl.VelocityPlane.from_xarray(data, sampling_rate=1e3)


@pytest.mark.parametrize(
    ("name", "read"),
    [("y-velocity", True), ("v.y", True), ("W", False), ("vel_y", True), ("pressure", False), ("U_y", True)],
)
def test_one_value_a_point_names_its_direction(tmp_path, name, read):
    for i in range(3):
        mesh = pyvista.ImageData(dimensions=(3, 1, 2))
        mesh.point_data[name] = np.full(6, float(i))
        mesh.save(tmp_path / f"plane_{i}.vti")
    stated = {"velocity_units": "m/s", "length_units": "m", "sampling_rate": 1e4, "normal": "y", "variable": name}
    if not read:
        with pytest.raises(ValueError, match=rf"plane_0.vti:/{name} has one value a point.*--wall-normal-component"):
            tl.read_plane(tmp_path, **stated)
        stated["wall_normal_component"] = True
    assert tl.read_plane(tmp_path, **stated).velocity.amax() == 2

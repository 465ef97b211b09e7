"""The map file, and how map and plane files fail: whole or not at all."""

import csv
import json
import os
import warnings
from dataclasses import replace

import h5py
import numpy as np
import pytest
import torch
import xarray

import torchliner as tl

FREQUENCIES = [1400.0, 1000.0]
COMPLEX = ("reflection", "velocity_amplitude", "cell_reflection", "cell_reflection_velocity_first")
REAL = ("frequency", "mean_velocity", "velocity_rms", "coherence", "phase_rule", "cell_x", "cell_z")
PLACES = {
    "plane": ((2, 3), {"x": [0.0, 0.02, 0.04], "z": [0.0, 0.02]}),
    "line": ((3,), {"x": [0.0, 0.02, 0.04]}),
    "bare": ((3,), {}),
    "bare plane": ((2, 3), {}),
    "one": ((1,), {"x": [0.5]}),
}


def make_plane(shape=(2, 3), **about):
    """7 and 5 whole periods of the two tones."""
    noise = torch.Generator().manual_seed(0)
    velocity = 2 * torch.randn(*shape, 250, generator=noise, dtype=torch.float64)
    return tl.VelocityPlane(velocity, sampling_rate=50e3, title="noise", **about)


def make_map(place="plane", **about):
    shape, coordinates = PLACES[place]
    about = {"reference": {"in situ": 1 - 0.5j, "p/v": 2j}, **coordinates, **about}
    return tl.educe(
        make_plane(shape, **about), tl.load_liner("polito"), FREQUENCIES, edge="wrap"
    )


@pytest.mark.parametrize("place", PLACES)
def test_round_trip(tmp_path, place):
    wanted = make_map(place)
    wanted.write(tmp_path / "a.nc")
    found = tl.read_map(tmp_path / "a.nc")
    for name in (*COMPLEX, *REAL):
        torch.testing.assert_close(
            getattr(found, name), getattr(wanted, name), rtol=0, atol=0, equal_nan=True
        )
    for name in ("x", "z"):
        before, after = getattr(wanted, name), getattr(found, name)
        assert (before is None and after is None) or torch.equal(before, after)
    assert torch.equal(found.impedance, wanted.impedance)
    assert torch.equal(found.liner_impedance, wanted.liner_impedance)
    assert found.choices == json.loads(json.dumps(wanted.choices))


def test_what_stands_beside_the_fields_comes_back(tmp_path):
    fluid = tl.Fluid(343.0, 1.21, 1.8e-5, 1.4, 0.7)
    wanted = make_map(
        height=1e-3, mach=0.3, incident_level=145.0, displacement_thickness=1.73e-3,
        source_side="upstream", fluid=fluid,
    ) if False else None  # fmt: skip
    with pytest.warns(tl.DataWarning, match="density is 1.204 .* in the liner and 1.21"):
        wanted = make_map(
            height=1e-3, mach=0.3, incident_level=145.0, displacement_thickness=1.73e-3,
            source_side="upstream", fluid=fluid,
        )  # fmt: skip
    wanted.write(tmp_path / "a.nc")
    found = tl.read_map(tmp_path / "a.nc")
    same = ("height", "mach", "incident_level", "source_side", "fluid", "title", "notes",
            "reference")  # fmt: skip
    assert {key: getattr(found, key) for key in same} == {key: getattr(wanted, key) for key in same}
    assert len(found.notes) == 1
    assert torch.equal(found.goodrich, wanted.goodrich)

"""Pressure records: what they refuse, and how they go through files."""

from __future__ import annotations

import h5py
import pytest
import torch
from conftest import turbulence

import torchliner as tl

SAMPLES = 300


def record(**about) -> tl.PressureRecord:
    """Everything a record can hold, over one line of probes."""
    about = {
        "facesheet": turbulence((6, SAMPLES)).float(),
        "backplate": turbulence((2, SAMPLES), seed=1).float(),
        "sampling_rate": 40000.0,
        "x": [0.001 * i for i in range(6)],
        "cavity_depth": 0.038,
        "cavity_porosity": 0.8,
        "cavity_hydraulic_radius": 0.005,
        "cell_pitch": 0.003,
        "microphones": turbulence((3, SAMPLES), seed=2).float(),
        "microphone_y": [0.01, 0.02, 0.03],
        "microphone_velocity": turbulence((3, SAMPLES), seed=3).float(),
        "microphone_mach": 0.1,
        "frequency": 1400.0,
        "incident_level": 130.0,
        "mach": 0.3,
        "reference": {"true": 1 - 0.5j},
        "title": "made up",
        "provenance": {"source": "a test"},
        **about,
    }
    return tl.PressureRecord(about.pop("facesheet"), about.pop("backplate"), **about)


def test_units_are_converted(tmp_path):
    """kPa and mm become Pa and m."""
    record().write(tmp_path / "p.h5")
    with h5py.File(tmp_path / "p.h5", "a") as file:
        file["backplate_pressure"].attrs["units"] = "kPa"
        file["cavity_depth"].attrs["units"] = "mm"
    found = tl.read_pressure(tmp_path / "p.h5")
    assert torch.allclose(found.backplate, 1000 * record().backplate)
    assert found.cavity_depth == pytest.approx(0.038e-3)


# --- records that are refused -------------------------------------------------------------------


def faulty(label, value):
    """A record one of whose signals holds a value at probe 1, sample 7."""
    bad = turbulence((2, SAMPLES))
    bad[1, 7] = value
    alone = {"facesheet": {"x": [0.0, 1.0]}, "microphones": {"microphone_y": [0.1, 0.2], "microphone_velocity": None}}
    return {label: bad, **alone.get(label, {})}


@pytest.mark.parametrize(
    ("about", "error", "words"),
    [
        ({"backplate": None}, ValueError, "backplate pressure is missing"),
        ({"facesheet": None, "x": None}, ValueError, "facesheet pressure is missing"),
        ({"facesheet": None, "backplate": None, "x": None, "microphones": None}, ValueError, "no pressure is given"),
        ({"backplate": turbulence((2, 299))}, ValueError, "backplate has shape (2, 299); (2 backplate, 300 time)"),
        ({"backplate": turbulence((2, 2, SAMPLES))}, ValueError, "backplate has another shape than the facesheet"),
        ({"facesheet": torch.zeros(6, 0)}, ValueError, "facesheet has shape (6, 0); one or more samples"),
        ({"x": [0.0, 1.0]}, ValueError, "x has 2 values; probes of shape (6,)"),
        ({"x": [0.0] * 5 + [float("nan")]}, ValueError, "x holds values that are not finite"),
        ({"cavity_porosity": 80.0}, ValueError, "cavity_porosity is 80; (0, 1] is needed (share of"),
        ({"sampling_rate": float("nan")}, ValueError, "sampling_rate (Hz) is nan"),
        ({"microphone_mach": float("nan")}, ValueError, "microphone_mach is nan; (-1, 1)"),
        ({"microphone_y": None}, ValueError, "microphone_y is missing, the distances"),
        ({"microphones": None}, ValueError, "microphones have no pressure"),
        ({"probe_cell": [0, 1]}, ValueError, "probe_cell has 2 values"),
        ({"probe_cell": [0, 0, 0, 2, 2, 2]}, ValueError, "0, 1, 2, ... without gaps"),
        ({"probe_cell": [-1] * 6}, ValueError, "probe_cell has 6 values, [-1]"),
        ({"facesheet": torch.zeros(6, SAMPLES, dtype=torch.int32)}, TypeError, "facesheet is torch.int32"),
        ({"probe_cell": [0.0] * 6}, TypeError, "whole numbers are needed"),
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
